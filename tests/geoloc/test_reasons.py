"""Why a sighting was not located."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc import reasons
from geoloc.reasons import REASON_TYPE, Reason, sentence_of, stands_far_away


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_has_a_sentence_of_its_own(reason: Reason) -> None:
    """Each kind is said in words that no other kind has, and fits the arrays of reasons."""
    sentences = {one: sentence_of(one, max_range_m=60.0, span_ns=(0, 1)) for one in Reason}
    assert list(sentences.values()).count(sentences[reason]) == 1
    assert np.array([reason]).astype(REASON_TYPE)[0] == reason


def test_what_stands_far_away_does_not_hang_on_the_words(monkeypatch: pytest.MonkeyPatch) -> None:
    """With all sentences reworded, the same sightings stand far away: those whose ray finds no ground."""
    before = stands_far_away(np.array(list(Reason)))
    monkeypatch.setattr(reasons, "_SENTENCES", dict.fromkeys(Reason, "reworded"))
    np.testing.assert_array_equal(stands_far_away(np.array(list(Reason))), before)
    far = {Reason.ABOVE_HORIZON, Reason.TOO_FAR, Reason.TOO_FAR_ON_TERRAIN}
    assert {reason for reason, is_far in zip(Reason, before, strict=True) if is_far} == far
