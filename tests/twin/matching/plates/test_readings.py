"""Codes read by several drives: a vote each, in the order of time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from twin.matching.config import MatchConfig
from twin.matching.plates.readings import PlateHistory, PlateReading, code_chances, code_now, together

CONFIG = MatchConfig()
DAY_NS = 86_400_000_000_000


def read(*codes: str, days: int = 30, seen_from: tuple[float, ...] = ()) -> PlateHistory:
    """One plate, read by one drive a month."""
    return tuple(
        PlateReading(code, f"d{k}", (1 + k * days) * DAY_NS, frozenset(seen_from))
        for k, code in enumerate(codes)
    )


def test_code_chances_of_one_reading_weigh_a_slip_against_a_wrong_code() -> None:
    """One drive against NVDB: 2 % of the plates are wrong, 1 % are misread, so two in three are wrong."""
    chance = code_chances(read("362.60"), "362.50", CONFIG)
    assert chance["362.60"] == pytest.approx(0.02 * 0.99 / (0.02 * 0.99 + 0.98 * 0.01))
    assert sum(chance.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("codes", "now"),
    [
        (("50", "50", "60", "60"), "60"),
        (("50", "60", "50", "50"), "50"),
        (("60", "60"), "60"),
        (("60", "50", "50"), "50"),
        (("50", "50", "50"), "50"),
    ],
)
def test_code_chances_tell_an_exchange_from_a_slip(codes: tuple[str, ...], now: str) -> None:
    """A change that stays is real, one that goes back was misread; NVDB has a 50."""
    chance = code_chances(read(*(f"362.{code}" for code in codes)), "362.50", CONFIG)
    assert max(chance, key=lambda code: chance[code]) == f"362.{now}"
    assert chance[f"362.{now}"] > 0.95


def test_code_chances_of_a_last_odd_reading_are_unclear() -> None:
    """50, 50, 60: a slip or an exchange; the longer the time between, the likelier the exchange."""
    soon, late = (
        code_chances(read("362.50", "362.50", "362.60", days=days), "362.50", CONFIG)["362.60"]
        for days in (10, 400)
    )
    assert soon < 0.2
    assert 0.5 < late < 0.8


@pytest.mark.parametrize(
    ("codes", "days", "now", "chance"),
    [
        (("60",), 30, "60", 0.669),
        (("60", "60"), 30, "60", 0.997),
        (("50", "50", "60", "60"), 30, "60", 0.970),
        (("50", "60"), 30, "50", 0.853),
        (("50", "60"), 61, "50", 0.75),
        (("50", "60"), 730, "60", 0.80),
    ],
)
def test_code_chances_are_those_of_the_docs(
    codes: tuple[str, ...], days: int, now: str, chance: float
) -> None:
    """The table of docs/matching.md, NVDB having a 50."""
    found = code_chances(read(*(f"362.{code}" for code in codes), days=days), "362.50", CONFIG)
    assert found[f"362.{now}"] == pytest.approx(chance, abs=0.006)


def test_code_chances_by_hand_for_two_drives() -> None:
    """Read 50, then 60, without NVDB: every path of the plate written out."""
    config = replace(CONFIG, exchanged_per_year=0.1, p_misread=0.02, p_of_family=0.25)
    e = 1 - 2.718281828459045 ** (-0.1 * 60 / 365.25)
    q = 0.25
    stays_50, stays_60 = 0.98 * (1 - e) * 0.02 * q, 0.02 * q * (1 - e) * 0.98
    turns_60, turns_50 = 0.98 * e * q * 0.98, 0.02 * q * e * q * 0.02 * q
    now_60 = (stays_60 + turns_60) / (stays_50 + stays_60 + turns_60 + turns_50)
    chance = code_chances(read("362.50", "362.60", days=60), None, config)
    assert chance["362.60"] == pytest.approx(now_60, rel=1e-9)


def test_code_chances_survive_annotators_that_never_err() -> None:
    """Two codes, no slips, no exchanges: impossible, and every code is alike instead of NaN."""
    config = replace(CONFIG, p_misread=0.0, exchanged_per_year=0.0)
    assert code_chances(read("202", "204"), None, config) == {"202": 0.5, "204": 0.5}


def test_code_now_of_a_tie_is_the_latest() -> None:
    """Two drives of one moment that disagree: the later in the row counts."""
    assert code_now(read("202", "204", days=0), CONFIG) == "204"


def test_together_keeps_plates_apart_and_in_order() -> None:
    """A speed limit that was exchanged and the plate below it stay two plates, not three."""
    first = (*(read("362.50"),), *(read("808"),))
    second = tuple((r._replace(drive_id="d9"),) for (r,) in (read("362.60"), read("808")))
    limit, below = together(first, second)
    assert [r.code for r in limit] == ["362.50", "362.60"]
    assert [r.code for r in below] == ["808", "808"]


def test_together_takes_the_order_of_the_longer_list() -> None:
    """A drive that read one plate more says where it hangs."""
    plates = together((read("808"),), (read("362.50"), read("808")))
    assert [plate[0].code for plate in plates] == ["362.50", "808"]


def test_together_counts_the_cameras_of_a_drive_once() -> None:
    """What two cameras of one drive read alike is one vote."""
    (plate,) = together((read("202"),), (read("202"),))
    assert len(plate) == 1


def test_together_does_not_join_front_and_back() -> None:
    """Other codes read from opposite sides are two plates; from one side they are one that changed."""
    front, back = read("202", seen_from=(0.0,)), read("404.1", seen_from=(180.0,))
    assert len(together((front,), (back,))) == 2
    assert len(together((front,), (read("404.1", seen_from=(30.0,)),))) == 1
