"""Measured signs of NVDB tie a poor receiver to the ground, where they agree."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fused_drives import CONFIG, EAST_M, NORTH_M, driven, estimate

from twin.matching.kept import Kept
from twin.matching.poles.map_aided import map_aided
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.sites import Plate, Site

OFF_M = 1.8
NORTHS_M = (5.0, 25.0, 45.0, 65.0, 85.0)


def site(number: int, north: float, *, east: float = 0.0, sigma: float = 0.1, own: bool = True) -> Site:
    """A sign of NVDB."""
    plates = (Plate(number, 1, "202", None),)
    return Site(95, number, 1, EAST_M + east, NORTH_M + north, sigma, own, plates)


def aided(sites: list[Site]) -> tuple[list[ObservedPole], str]:
    """One drive whose track is `OFF_M` too far east, good to 2 m, against these signs."""
    budget = {"pixels": (0.01, 0.0, 0.01), "gnss": (4.0, 0.0, 4.0)}
    rows = [
        replace(estimate("a", str(k), north, OFF_M), budget=budget, covariance_m2=(4.01, 0.0, 4.01))
        for k, north in enumerate(NORTHS_M)
    ]
    poles = observed_poles(rows, ["a"], CONFIG)
    return map_aided(poles, sites, rows, [driven("a")], CONFIG, Kept())


def test_agreeing_signs_move_the_drive_and_a_sentence_says_so() -> None:
    """Five signs agree that the track is 1.8 m off: all poles come to the ground."""
    poles, sentence = aided([site(k, north) for k, north in enumerate(NORTHS_M)])
    assert [pole.east_m - EAST_M for pole in poles] == pytest.approx([0.0] * 5, abs=0.3)
    assert max(pole.sigma_m for pole in poles) < 0.7
    assert "by -1.8 m east and +0.0 m north, by 5 measured signs" in sentence


def test_a_moved_sign_is_not_drawn_to_where_nvdb_has_it() -> None:
    """The third stands 2.5 m from NVDB's position: the others place it, and it keeps that distance."""
    signs = [site(k, north) for k, north in enumerate(NORTHS_M)]
    signs[2] = site(2, NORTHS_M[2], east=-2.5)
    poles, sentence = aided(signs)
    assert poles[2].east_m - signs[2].east_m == pytest.approx(2.5, abs=0.3)
    assert "by 4 measured signs" in sentence
    assert "left out were 1 that do not" in sentence


@pytest.mark.parametrize("poor", ["two alone", "accuracy", "centre line"])
def test_without_enough_measured_signs_nothing_moves(poor: str) -> None:
    """Two signs, positions to a metre, or on the centre line tie nothing."""
    signs = [
        site(k, north, sigma=1.0 if poor == "accuracy" else 0.1, own=poor != "centre line")
        for k, north in enumerate(NORTHS_M)
    ]
    poles, sentence = aided(signs[:2] if poor == "two alone" else signs)
    assert [pole.east_m - EAST_M for pole in poles] == pytest.approx([OFF_M] * 5)
    assert "nothing was moved" in sentence
