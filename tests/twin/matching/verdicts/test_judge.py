"""Verdicts: what each pair and each leftover is called, and why."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS
from twin.matching.plates.readings import PlateReading, code_now
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Plate, Site
from twin.matching.verdicts.finding import offset_of
from twin.matching.verdicts.judge import judge
from twin.store.records import Finding

CONFIG = MatchConfig()


def found(
    poles: list[ObservedPole], sites: list[Site], *, views: int = 50, config: MatchConfig = CONFIG
) -> list[Finding]:
    """Assign and judge with every site equally in view of one complete drive."""
    p_unannotated = np.full(len(sites), CONFIG.p_missed if views >= CONFIG.min_views else 1.0)
    assignment = assign(poles, sites, p_unannotated, config)
    return judge(poles, sites, assignment, np.full(len(sites), views), [["d"]] * len(sites), config)


def pole(east: float, north: float, *codes: str, sigma: float = 0.2, key: str = "d:1") -> ObservedPole:
    """Make an observed pole."""
    return ObservedPole((key,), key, east, north, sigma**2 * np.eye(2), codes, ("d",), frozenset({"d/C"}), 10)


def site(nvdb_id: int, *plates: Plate | str, east: float = 0.0, sigma: float = 0.2, own: bool = True) -> Site:
    """Make a site at (east, 0)."""
    made = tuple(
        Plate(nvdb_id * 10 + i, 3, p, "med") if isinstance(p, str) else p for i, p in enumerate(plates)
    )
    return Site(95, nvdb_id, 7, east, 0.0, sigma, own, made)


def verdicts(changes: list[Finding]) -> list[tuple[str, int, int | None]]:
    """Verdict, type and id, sorted."""
    return sorted((c.verdict, c.nvdb_type, c.nvdb_id) for c in changes)


def test_judge_unchanged_is_one_row_for_the_whole_site() -> None:
    """A pole with both its plates where NVDB has them gives one row, of the Skiltpunkt."""
    changes = found([pole(0.1, 0, "362.50", "808")], [site(1, "362.50", "808")])
    assert verdicts(changes) == [("unchanged", 95, 1)]
    assert changes[0].nvdb_version == 7
    assert changes[0].distance_m == pytest.approx(0.1)


BACK_FACE, FRONT_FACE = (180.0, math.nan), (0.0, math.nan)
JUDGED: dict[str, tuple[ObservedPole, Site, MatchConfig, list[tuple[str, int, int | None]]]] = {
    "3 m at a sigma of 0.2 m has moved": (pole(3, 0, "202"), site(1, "202"), CONFIG, [("moved", 95, 1)]),
    "1.2 m at 0.2 m has not moved for certain": (
        *(pole(1.2, 0, "202"), site(1, "202"), CONFIG, [("unchanged", 95, 1)]),
    ),
    "3 m at 2 m has not moved for certain": (
        *(pole(3, 0, "202", sigma=2.0), site(1, "202"), CONFIG, [("unchanged", 95, 1)]),
    ),
    "NVDB's own 3 m of uncertainty does not excuse a sign that we measured 3 m away": (
        *(pole(3, 0, "202"), site(1, "202", sigma=3.0), CONFIG, [("moved", 95, 1)]),
    ),
    "with a tolerance of 5 m, a sign 3 m off stands where it should": (
        *(pole(3, 0, "202"), site(1, "202"), MatchConfig(tolerance_m=5.0), [("unchanged", 95, 1)]),
    ),
    "position belongs to the pole, type to the plate: both findings stand": (
        *(pole(1.6, 0, "362.60"), site(1, "362.50", sigma=0.8), CONFIG),
        [("moved", 95, 1), ("wrong_type", 96, 10)],
    ),
    "one plate more than NVDB has on that pole is a new plate, not a new pole": (
        *(pole(0, 0, "202", "808"), site(1, "202"), CONFIG, [("new", 96, None)]),
    ),
    "a plate that faces the other way cannot be missed from this side": (
        *(pole(0, 0, "202"), site(1, "202", Plate(99, 1, "372", "mot")), CONFIG, [("unchanged", 95, 1)]),
    ),
    "a plate that faces like one that was seen can": (
        *(pole(0, 0, "202"), site(1, "202", Plate(98, 1, "372", "med")), CONFIG, [("missing", 96, 98)]),
    ),
    "a wrong code is that of the plate that faces the camera, not of the one on the back": (
        replace(pole(0, 0, "372"), seen_from_deg=frozenset({0.0})),
        site(1, Plate(11, 1, "402.1", "mot", BACK_FACE), Plate(12, 1, "202", "med", FRONT_FACE)),
        *(CONFIG, [("wrong_type", 96, 12)]),
    ),
    "what NVDB has on the centre line gets its position, and its plate is compared all the same": (
        *(pole(5, 0, "362.60"), site(1, "362.50", sigma=8.0, own=False), CONFIG),
        [("review", 95, 1), ("wrong_type", 96, 10)],
    ),
}


@pytest.mark.parametrize("fact", JUDGED)
def test_judge_of_one_pole_and_one_site(fact: str) -> None:
    """Each verdict is the one that its fact asks for, and there is no other."""
    one, other, config, expected = JUDGED[fact]
    assert verdicts(found([one], [other], config=config)) == expected


def test_judge_wrong_type_is_the_plates() -> None:
    """A 60 seen where NVDB has a 50 is one finding, of that plate; the other plate of the pole is fine."""
    changes = found([pole(0, 0, "362.60", "808")], [site(1, "362.50", "808")])
    assert verdicts(changes) == [("wrong_type", 96, 10)]
    assert (changes[0].skiltnummer_nvdb, changes[0].skiltnummer_seen) == (("362.50",), ("362.60",))


def read_as(one: ObservedPole, *codes: str, days: int = 30) -> ObservedPole:
    """Let drives some days apart read the pole's one plate so."""
    step = days * 86_400_000_000_000
    plate = tuple(PlateReading(code, f"d{k}", (1 + k) * step) for k, code in enumerate(codes))
    return replace(one, codes=(code_now(plate, CONFIG),), plates=(plate,), disputed=len(set(codes)) > 1)


def test_judge_wrong_type_is_as_sure_as_the_readings() -> None:
    """One drive may have misread it; two that agree leave no doubt. The id is the same."""
    here = [site(1, "362.50")]
    (one,) = found([read_as(pole(0, 0, "362.60"), "362.60")], here)
    (two,) = found([read_as(pole(0, 0, "362.60"), "362.60", "362.60")], here)
    assert (one.verdict, two.verdict) == ("wrong_type", "wrong_type")
    assert one.change_id == two.change_id
    assert one.confidence == pytest.approx(0.669, abs=0.002)
    assert two.confidence > 0.98
    assert [told["code"] for told in two.terms["readings"]] == ["362.60", "362.60"]


def test_judge_takes_a_reading_that_was_not_confirmed_for_a_slip() -> None:
    """50, 60, 50, 50 where NVDB has a 50: unchanged, and the code shown is the 50."""
    (change,) = found(
        [read_as(pole(0, 0, "362.50"), "362.50", "362.60", "362.50", "362.50")], [site(1, "362.50")]
    )
    assert (change.verdict, change.skiltnummer_seen) == ("unchanged", ("362.50",))


def test_judge_takes_a_slip_that_reads_like_the_plate_beside_it_for_a_slip() -> None:
    """A 30 above a 40, once read as two 40s: the plate that nobody disputes keeps its partner in NVDB."""
    month = 30 * 86_400_000_000_000
    upper = (PlateReading("362.30", "a", month), PlateReading("362.40", "b", month + 1))
    lower = (PlateReading("362.40", "a", month), PlateReading("362.40", "b", month + 1))
    seen = replace(pole(0, 0, "362.40", "362.40"), plates=(upper, lower), disputed=True)
    (change,) = found([seen], [site(1, "362.30", "362.40")])
    assert (change.verdict, change.skiltnummer_seen) == ("unchanged", ("362.30", "362.40"))


def test_judge_reviews_what_drives_contradict() -> None:
    """50, then 60 half a year later: exchanged or misread, a review of the plate that names both."""
    (change,) = found([read_as(pole(0, 0, "362.60"), "362.50", "362.60", days=182)], [site(1, "362.50")])
    assert (change.verdict, change.nvdb_type, change.nvdb_id) == ("review", 96, 10)
    assert "362.50, 362.60 in this order" in change.reason
    assert change.skiltnummer_seen == ("362.60",)


def test_judge_does_not_hold_an_old_reading_against_a_newer_version() -> None:
    """NVDB gave the plate its code after the drives: it may have followed the road. A later drive tells."""
    newer = site(1, Plate(10, 3, "362.50", "med", start_date="1970-03-15"))
    (before,) = found([read_as(pole(0, 0, "362.60"), "362.60", "362.60")], [newer])
    (after,) = found([read_as(pole(0, 0, "362.60"), "362.60", "362.60", "362.60")], [newer])
    assert (before.verdict, before.skiltnummer_seen) == ("unchanged", ("362.60",))
    assert after.verdict == "wrong_type"
    assert len(after.terms["readings"]) == 1


def test_judge_asks_two_questions_of_a_plate_without_position() -> None:
    """A plate that is a site of its own, on the centre line and read in two ways: two reviews, two ids."""
    alone = replace(site(11, Plate(11, 1, "362.50", "med"), own=False, sigma=8.0), nvdb_type=96)
    seen = read_as(pole(2, 0, "362.60"), "362.50", "362.60", days=182)
    changes = found([seen], [alone])
    assert verdicts(changes) == [("review", 96, 11), ("review", 96, 11)]
    assert len({change.change_id for change in changes}) == 2


def test_judge_new_pole_has_no_nvdb_id() -> None:
    """A sign with nothing near is new, where it was measured."""
    changes = found([pole(0, 0, "202")], [site(1, "372", east=100.0)], views=0)
    assert [(c.verdict, c.nvdb_id, c.east_m) for c in changes] == [("new", None, 0.0)]


def test_judge_far_from_every_mirrored_sign_goes_to_review() -> None:
    """Where the mirror has nothing within a kilometre, the place may lie outside the mirrored area."""
    for sites in ([], [site(1, "202", east=1500.0)]):
        (change,) = found([pole(0, 0, "202")], sites, views=0)
        assert change.verdict == "review"
        assert "mirrored area" in change.reason


def test_judge_tells_equal_extra_plates_apart() -> None:
    """Two plates of one code that NVDB lacks are two findings with two ids."""
    changes = found([pole(0, 0, "202", "808", "808")], [site(1, "202")])
    assert [c.verdict for c in changes] == ["new", "new"]
    assert len({c.change_id for c in changes}) == 2


def test_judge_confidence_of_moved_falls_near_the_tolerance() -> None:
    """5 m off is surer to have moved than 1.4 m off at a tolerance of 1 m."""
    (far,) = found([pole(5, 0, "202")], [site(1, "202")])
    (near,) = found([pole(1.4, 0, "202")], [site(1, "202")])
    assert (near.verdict, far.verdict) == ("moved", "moved")
    assert near.confidence < far.confidence


def test_judge_missing_needs_the_place_in_view_of_a_complete_drive() -> None:
    """Nothing seen is missing after 50 frames in view; 4 cannot tell."""
    (change,) = found([], [site(1, "202")], views=50)
    assert (change.verdict, change.nvdb_id, change.east_m) == ("missing", 1, 0.0)
    (change,) = found([], [site(1, "202")], views=4)
    assert change.verdict == "not_observable"
    assert found([], [site(1, "202")], views=0) == []


def test_judge_centre_line_positions_are_never_missing_or_moved() -> None:
    """An object that NVDB only has on the centre line goes to review when seen, and is silent when not."""
    line_only = site(1, "202", sigma=8.0, own=False)
    assert found([], [line_only]) == []
    (change,) = found([pole(5, 0, "202")], [line_only])
    assert change.verdict == "review"
    assert "centre line" in change.reason


def test_judge_gives_the_same_ids_in_every_run() -> None:
    """Identity comes from the finding, not from the order or the exact numbers."""
    sites = [site(1, "202"), site(2, "372", east=40.0)]
    first = found([pole(3, 0, "202"), pole(40.2, 0, "362.50", key="d:2")], sites)
    again = found([pole(40.1, 0, "362.50", key="d:2"), pole(3.1, 0, "202")], sites[::-1])
    assert [c.change_id for c in first] == [c.change_id for c in again]
    assert len({c.change_id for c in first}) == len(first)


def test_judge_every_reason_is_a_sentence() -> None:
    """Reasons start with a capital or a code and end with a full stop."""
    poles = [pole(3, 0, "202"), pole(40, 0, "362.50", key="d:2"), pole(80, 0, key="d:3")]
    for change in found(poles, [site(1, "202"), site(2, "372", east=40.0), site(3, "512", east=120.0)]):
        assert change.reason.endswith(".")
        assert 0.0 <= change.confidence <= 1.0


def test_judge_says_what_a_verdict_rests_on() -> None:
    """Terms hold the odds of each kind of evidence, and when the sign was seen, as plain JSON."""
    seen = replace(pole(0.1, 0, "202"), first_ns=1_780_000_000_000_000_000, last_ns=1_780_086_400_000_000_000)
    (change,) = found([seen], [site(1, "202")])
    assert change.terms["log_odds"].keys() == set(TERMS)
    assert change.terms["log_odds"]["code"] > 0
    assert change.terms["seen"] == {
        "first": "2026-05-28T20:26:40Z",
        "last": "2026-05-29T20:26:40Z",
        "drives": 1,
    }
    assert json.loads(json.dumps(change.terms)) == change.terms
    assert "same sign code" in change.reason


def test_judge_names_the_alternatives_of_a_review() -> None:
    """A pole between two equal sites is for a person to decide: which other it may be, and how likely."""
    sites = [site(1, "202", east=-1.0), site(2, "202", east=1.0)]
    (change,) = found([pole(0, 0, "202", sigma=1.0)], sites, views=0)
    assert change.verdict == "review"
    others = {one["nvdb_id"]: one["probability"] for one in change.terms["alternatives"]}
    assert others.keys() <= {1, 2, None}
    assert len(others.keys() & {1, 2}) == 1
    assert sum(others.values()) + change.confidence == pytest.approx(1.0, abs=0.02)


def test_judge_doubts_a_pole_that_a_later_drive_did_not_see() -> None:
    """What is probably taken down is for a person to decide, and the reason says so."""
    doubted = replace(pole(0.1, 0, "202"), p_taken_down=0.5)
    (change,) = found([doubted], [site(1, "202")])
    assert change.verdict == "review"
    assert "later" in change.reason
    (change,) = found([replace(pole(0, 0, "202"), p_taken_down=0.5)], [site(1, "372", east=50.0)], views=0)
    assert (change.verdict, change.nvdb_id) == ("review", None)


def test_judge_confidence_of_unchanged_falls_near_the_tolerance() -> None:
    """A sign measured 1.2 m off at a tolerance of 1 m is not called moved, nor surely unchanged."""
    (near,) = found([pole(0.2, 0, "202")], [site(1, "202")])
    (edge,) = found([pole(1.2, 0, "202")], [site(1, "202")])
    assert (near.verdict, edge.verdict) == ("unchanged", "unchanged")
    assert near.confidence > 0.99
    assert edge.confidence < 0.7


def test_judge_confidence_of_missing_is_that_it_is_gone() -> None:
    """A sign that is not seen is gone or overlooked, in the ratio of their probabilities."""
    (change,) = found([], [site(1, "202")])
    gone = CONFIG.p_gone / (CONFIG.p_gone + (1 - CONFIG.p_gone) * CONFIG.p_missed)
    assert change.confidence == pytest.approx(gone)


def test_offset_trusts_nvdb_where_nvdb_is_good() -> None:
    """1.1 m off by a poor measurement is rather our error where NVDB is good to 0.1 m than to 1 m."""
    poor = pole(1.1, 0, "202", sigma=0.4)
    good = offset_of(poor, site(1, "202", sigma=0.1), CONFIG).p_beyond
    bad = offset_of(poor, site(1, "202", sigma=1.0), CONFIG).p_beyond
    assert good < bad
