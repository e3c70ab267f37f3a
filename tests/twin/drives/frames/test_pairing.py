"""Frames against stamps: the rules of docs/frames.md."""

from __future__ import annotations

import numpy as np
import pytest

from twin.drives.frames.pairing import pair
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import DriveError

STAMPS = np.arange(100, 110, dtype=np.int64)


def test_equal_numbers_need_nothing() -> None:
    """Ten frames and ten stamps belong together."""
    paired = pair(STAMPS, 10, "C3.h264", "C3.timestamps", by_number=False)
    assert np.array_equal(paired.epoch_ns, STAMPS)
    assert (paired.skipped, paired.warnings) == ((), ())


@pytest.mark.parametrize(("n_frames", "kept", "reason"), [(8, 8, "no picture"), (12, 10, "no stamp")])
def test_up_to_two_apart_pair_by_number_and_are_counted(n_frames: int, kept: int, reason: str) -> None:
    """A recorder that was stopped between both files: the extra ones are left out, with count and warning."""
    paired = pair(STAMPS, n_frames, "C3.h264", "C3.timestamps", by_number=False)
    assert np.array_equal(paired.epoch_ns, STAMPS[:kept])
    assert [(s.count, s.reason.startswith(reason)) for s in paired.skipped] == [(2, True)]
    assert "C3.h264 holds" in paired.warnings[0]


@pytest.mark.parametrize("n_frames", [7, 13])
def test_more_apart_is_refused_unless_numbers_are_said_to_fit(n_frames: int) -> None:
    """Frames lost in between would shift all later ones: only the user can know that they are not."""
    with pytest.raises(DriveError, match="frames_by_number"):
        pair(STAMPS, n_frames, "C3.h264", "C3.timestamps", by_number=False)
    paired = pair(STAMPS, n_frames, "C3.h264", "C3.timestamps", by_number=True)
    assert len(paired.epoch_ns) == min(n_frames, 10)
    assert paired.skipped[0].count == 3


def test_stamps_numbered_from_one_pair_by_order() -> None:
    """Ten stamps numbered 1 to 10 are those of ten frames numbered from 0."""
    stamps = np.concatenate([[NO_STAMP], STAMPS])
    paired = pair(stamps, 10, "C3.h264", "C3.timestamps", by_number=False)
    assert np.array_equal(paired.epoch_ns, STAMPS)
    assert "numbers its stamps from 1" in paired.warnings[0]
