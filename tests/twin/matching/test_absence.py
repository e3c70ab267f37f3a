"""Evidence of absence: what not having seen a sign says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.matching.absence import Passage, evidence_of_absence, still_seen
from twin.matching.config import MatchConfig
from twin.matching.in_view import Places, PlaceViews
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Plate, Site

CONFIG = MatchConfig()
DAY_NS = 86_400_000_000_000
START_NS = 1_780_000_000_000_000_000


def site(*faces: float, start_date: str = "2010-01-01") -> Site:
    """Make a site whose plates face the given ways."""
    plates = tuple(Plate(10 + i, 1, "202", None, (face, math.nan)) for i, face in enumerate(faces))
    return Site(95, 1, 1, 0.0, 0.0, 0.3, True, plates, start_date)


def passage(
    frames: int,
    *,
    day: int = 0,
    name: str = "d",
    complete: bool = True,
    azimuth: float = 180.0,
    of: Site | ObservedPole | None = None,
) -> Passage:
    """A drive that had a place in view in some frames, from one direction."""
    places = Places.of_poles([of]) if isinstance(of, ObservedPole) else Places.of_sites([of or site()])
    counts = places.count(views(frames, azimuth))
    return Passage(name, START_NS + day * DAY_NS, complete, counts)


def views(frames: int, azimuth: float = 180.0) -> PlaceViews:
    """Views of place 0."""
    return PlaceViews(np.zeros(frames, dtype=np.int64), np.full(frames, azimuth))


def p_unannotated(*passages: Passage, of: Site | None = None) -> float:
    """Probability that a sign that stands goes unannotated."""
    return float(evidence_of_absence(passages, [of or site()], CONFIG).p_unannotated[0])


def test_evidence_accumulates_over_drives() -> None:
    """Two complete drives overlook a sign more rarely than one; what is hidden stays hidden."""
    one = p_unannotated(passage(20))
    two = p_unannotated(passage(20), passage(20, name="e"))
    assert one == pytest.approx(CONFIG.p_hidden + (1 - CONFIG.p_hidden) * CONFIG.p_missed)
    assert CONFIG.p_hidden < two < one


def test_evidence_of_few_frames_is_weak() -> None:
    """A place in view in fewer frames than asked for counts as one that may well be overlooked."""
    few = p_unannotated(passage(CONFIG.min_views - 1))
    assert few == pytest.approx(CONFIG.p_unseen, abs=0.01)


def test_evidence_of_incomplete_drives_does_not_add_up() -> None:
    """Whoever annotates only speed limits leaves out the same signs in every drive."""
    one = p_unannotated(passage(20, complete=False))
    three = p_unannotated(*(passage(20, complete=False, name=str(k)) for k in range(3)))
    assert one == three == pytest.approx(CONFIG.p_unseen, abs=0.01)


def test_evidence_without_a_view_is_none() -> None:
    """A place that was never in view may hold anything."""
    assert p_unannotated() == 1.0
    assert p_unannotated(passage(0)) == 1.0


def test_evidence_from_behind_a_sign_is_none() -> None:
    """A camera to the south does not see the front of a plate that looks north, but did pass it."""
    found = evidence_of_absence([passage(20, of=site(0.0))], [site(0.0)], CONFIG)
    assert found.p_unannotated.tolist() == [1.0]
    assert found.passed.tolist() == [True]
    assert found.watched_by == [[]]
    assert p_unannotated(passage(20, of=site(180.0)), of=site(180.0)) < 0.01


def test_front_views_need_the_direction_of_every_plate() -> None:
    """One plate of unknown direction may look anywhere: then every view counts."""
    sites = (site(0.0), site(0.0, math.nan), site(0.0, 170.0), site())
    counts = [Places.of_sites([one]).count(views(3)) for one in sites]
    assert [one.fronts.tolist() for one in counts] == [[0], [3], [3], [3]]
    assert [one.views.tolist() for one in counts] == [[3]] * 4


def test_evidence_does_not_miss_what_was_put_up_later() -> None:
    """A sign that NVDB starts after the drive could not be seen."""
    assert p_unannotated(passage(20), of=site(start_date="2030-01-01")) == 1.0


def seen_once() -> ObservedPole:
    """A pole that drive d saw."""
    one = ObservedPole(("d:1",), "d:1", 0.0, 0.0, 0.01 * np.eye(2), ("202",), ("d",), frozenset({"d/C"}), 10)
    return replace(one, first_ns=START_NS, last_ns=START_NS)


def test_still_seen_drops_what_a_drive_missed_long_after() -> None:
    """A year later a complete drive that does not see the pole shows that it is gone."""
    later = passage(20, day=365, name="e")
    assert still_seen([seen_once()], [passage(20), later], CONFIG) == []


def test_still_seen_doubts_what_a_drive_missed_the_next_week() -> None:
    """A week later it was rather overlooked: the pole stays, with a probability that it is gone."""
    (pole,) = still_seen([seen_once()], [passage(20), passage(20, day=7, name="e")], CONFIG)
    assert 0 < pole.p_taken_down < 0.5
    more = [passage(20, day=7 * k, name=f"e{k}") for k in range(1, 4)]
    (doubted,) = still_seen([seen_once()], [passage(20), *more], CONFIG)
    assert doubted.p_taken_down > pole.p_taken_down


def test_still_seen_takes_no_notice_of_other_views() -> None:
    """Drives that are not complete, that came earlier, or that passed on the other side say nothing."""
    pole = replace(seen_once(), seen_from_deg=frozenset({180.0}))
    behind = passage(20, day=365, name="e", azimuth=0.0, of=pole)
    partial = passage(20, day=365, name="f", complete=False)
    before = passage(20, day=-365, name="c")
    assert still_seen([pole], [before, passage(20), behind, partial], CONFIG) == [pole]
