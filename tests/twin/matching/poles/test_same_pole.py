"""Objects of one drive that are one pole, and those that are two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from twin.matching.config import MatchConfig
from twin.matching.poles.poles import observed_poles
from twin.matching.poles.same_pole import Picture, each_pole_once, may_be_one
from twin.store.records import Estimate, split_codes

CONFIG = MatchConfig()


def estimate(name: str, east_m: float, codes: str = "366;372", **other: Any) -> Estimate:
    """Make an estimate: 2 m in common with all of its drive, 0.2 m of its own."""
    usual = Estimate(
        drive_id="d",
        object=name,
        codes=split_codes(codes),
        east_m=east_m,
        north_m=0.0,
        covariance_m2=(4.04, 0.0, 4.04),
        budget={"gnss": (4.0, 0.0, 4.0), "pixels": (0.04, 0.0, 0.04)},
        cameras=("C1", "C2"),
        n_sightings=20,
        first_ns=0,
        last_ns=1_000_000_000,
    )
    return replace(usual, **other)


def pictures(**frames: range) -> Mapping[str, frozenset[Picture]]:
    """Frames of C1 in which the foot of each object was marked."""
    return {f"d:{name}": frozenset(("C1", k, "foot") for k in seen) for name, seen in frames.items()}


ONE_AFTER_THE_OTHER = pictures(a=range(10), b=range(10, 20))


def test_track_that_was_begun_anew_is_the_same_pole() -> None:
    """Two objects of the same plates 0.5 m apart, never in one picture, are one pole with its plates once."""
    rows = [estimate("a", 0.0), estimate("b", 0.5)]
    joined = each_pole_once(rows, may_be_one(rows, CONFIG), ONE_AFTER_THE_OTHER)
    (pole,) = observed_poles(joined, ["d"], CONFIG)
    assert pole.codes == ("366", "372")
    assert pole.members == ("d:a", "d:b")
    assert pole.n_sightings == 40
    # Their errors are shared: a second track does not make the place better known.
    assert pole.sigma_m == pytest.approx(4.04**0.5)


def test_objects_of_one_picture_are_two() -> None:
    """One picture that shows both proves two plates, however near they are."""
    rows = [estimate("a", 0.0), estimate("b", 0.1)]
    together = pictures(a=range(11), b=range(10, 20))
    assert each_pole_once(rows, may_be_one(rows, CONFIG), together) == rows


def test_foot_and_face_of_one_picture_prove_no_second_pole() -> None:
    """A pole's foot and its face, marked in one picture under two ids, are still one pole."""
    rows = [estimate("a", 0.0), estimate("b", 0.1)]
    seen = {"d:a": frozenset({("C1", 1, "foot")}), "d:b": frozenset({("C1", 1, "box")})}
    (row,) = each_pole_once(rows, may_be_one(rows, CONFIG), seen)
    assert row.members == ("d:a", "d:b")


def test_objects_whose_pictures_are_unknown_are_left_alone() -> None:
    """Without sightings nothing tells what was seen beside an object."""
    rows = [estimate("a", 0.0), estimate("b", 0.1)]
    assert each_pole_once(rows, may_be_one(rows, CONFIG), {}) == rows


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (estimate("b", 1.5), "1.5 m is five sigmas of what they do not share"),
        (estimate("b", 0.5, "202"), "another plate"),
        (estimate("b", 0.5, drive_id="e"), "another drive: fused with its own rules"),
        (estimate("b", 0.5, cameras=("C3",)), "another camera: paired one-to-one"),
    ],
)
def test_objects_that_differ_are_not_compared(other: Estimate, why: str) -> None:
    """Place, plates, drive or cameras speak against one pole."""
    assert may_be_one([estimate("a", 0.0), other], CONFIG) == [], why


def test_second_passage_does_not_share_the_error_of_the_track() -> None:
    """Ten minutes later ordinary fixes are off otherwise: 1.5 m is then no distance."""
    late = estimate("b", 1.5, first_ns=600_000_000_000, last_ns=601_000_000_000)
    assert may_be_one([estimate("a", 0.0), late], CONFIG) == [("d:a", "d:b")]


def test_two_poles_far_apart_are_two_however_poor_the_fixes() -> None:
    """A single-frame position, good to metres, makes no one pole of two that stand 4 m apart."""
    rows = [estimate("a", 0.0, budget={}), estimate("b", 4.0, budget={})]
    assert may_be_one(rows, CONFIG) == []


def test_part_of_the_plates_is_enough() -> None:
    """From afar only the first plate was read: the pole keeps those that were read from nearby."""
    rows = [estimate("a", 0.0, "366"), estimate("b", 0.2, "366;372")]
    (row,) = each_pole_once(rows, may_be_one(rows, CONFIG), ONE_AFTER_THE_OTHER)
    assert row.codes == ("366", "372")


def test_three_tracks_of_which_two_share_a_picture_stay_two_poles() -> None:
    """What joined the one does not join the other, which a picture shows beside it."""
    rows = [estimate("a", 0.0), estimate("b", 0.1), estimate("c", 0.3)]
    seen = pictures(a=range(10), b=range(10, 20), c=range(15, 30))
    joined = each_pole_once(rows, may_be_one(rows, CONFIG), seen)
    assert [row.members for row in joined] == [("d:a", "d:b"), ("d:c",)]
