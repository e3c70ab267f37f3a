"""Known places tie drives down, never the pole that they are of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_passes import POLES, passes

from geoloc.fusion.agreeing import fuse_with_agreeing, passes_that_agree
from geoloc.fusion.fuse import Known, Passes, fuse

SIGMA_M = 0.1


def known(rng: np.random.Generator, *, off: dict[int, float] | None = None) -> Known:
    """Places of all poles, which stand at the origin; some of them off by so many metres."""
    place = rng.normal(size=(POLES, 2)) * SIGMA_M
    for pole, metres in (off or {}).items():
        place[pole] += [metres, 0.0]
    return Known(place, np.full(POLES, SIGMA_M))


def test_measured_signs_tie_a_poor_receiver_to_the_ground() -> None:
    """One drive that is 2 m off: its poles are placed to a few decimetres, and covariances say so."""
    errors, squares = [], []
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        fused, used = fuse_with_agreeing(*passes(rng, 1), known(rng))
        assert used.sum() >= POLES - 3
        errors.append(np.hypot(*fused.place_m.T))
        inverse = np.linalg.inv(fused.covariance_m2)
        squares.append(np.einsum("ni,nij,nj->n", fused.place_m, inverse, fused.place_m) / 2.0)
    assert np.median(errors) < 0.8
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_a_known_place_never_draws_its_own_pole() -> None:
    """Wherever one sign is said to stand, its own pole comes out at the same place."""
    rng = np.random.default_rng(8)
    one, clocks = passes(rng, 2)
    ties = known(rng)
    moved = replace(ties, place_m=ties.place_m + np.eye(POLES)[:, [4]] * [0.2, -0.1])
    without = Known(np.where(np.arange(POLES)[:, None] == 4, np.nan, ties.place_m), ties.sigma_m)
    places = [fuse(one, clocks, these).place_m[4] for these in (ties, moved, without)]
    assert places[0] == pytest.approx(places[1], abs=1e-6)
    assert places[0] == pytest.approx(places[2], abs=1e-6)


def test_signs_that_were_moved_do_not_count() -> None:
    """Two of twelve stand 3 m from where the map has them: they are left out, and are seen to be off."""
    rng = np.random.default_rng(9)
    one, clocks = passes(rng, 3)
    ties = known(rng, off={2: 3.0, 7: -3.0})
    fused, used = fuse_with_agreeing(one, clocks, ties)
    assert not used[[2, 7]].any()
    assert used.sum() >= 9
    assert np.hypot(*fused.place_m[[2, 7]].T).max() < 1.0


def test_neighbours_that_were_moved_alike_seldom_bend_a_track_that_velocities_hold() -> None:
    """The last two of twelve stand 3 m aside: a track that errs alike for longer does not follow them."""
    bent = []
    for lasts_s in (120.0, 500.0, 1000.0):
        drawn = (np.random.default_rng([14, seed]) for seed in range(20))
        moved = {POLES - 2: 3.0, POLES - 1: 3.0}
        used = [
            fuse_with_agreeing(*passes(rng, 1, lasts_s=lasts_s), known(rng, off=moved))[1] for rng in drawn
        ]
        bent.append(sum(bool(one[-2:].any()) for one in used))
    assert bent[0] > 10
    assert bent[1] < 8
    assert bent[2] < 4


def test_fewer_than_three_count_for_nothing() -> None:
    """Two measured signs may both be wrong alike."""
    rng = np.random.default_rng(10)
    one, clocks = passes(rng, 1)
    two = known(rng)
    two.place_m[2:] = np.nan
    fused, used = fuse_with_agreeing(one, clocks, two)
    assert not used.any()
    assert fused.place_m == pytest.approx(fuse(one, clocks).place_m)


def test_a_pole_that_was_merged_wrongly_pulls_no_drive() -> None:
    """One of five drives saw another sign 6 m away: that pass alone is taken out."""
    one, clocks = passes(np.random.default_rng(11), 5)
    wrong = np.flatnonzero((one.pole == 4) & (one.drive == 2))
    off = one.place_m.copy()
    off[wrong] += [4.0, 4.5]
    keep = passes_that_agree(replace(one, place_m=off), clocks)
    assert np.flatnonzero(~keep).tolist() == wrong.tolist()


def test_of_two_passes_that_contradict_each_other_neither_counts() -> None:
    """Two drives share eleven poles and a wrong twelfth: it has no place, the others stand as without it."""
    one, clocks = passes(np.random.default_rng(12), 2)
    off = one.place_m.copy()
    off[(one.pole == 4) & (one.drive == 1)] += [5.0, -5.0]
    nowhere = Known(np.full((POLES, 2), np.nan), np.ones(POLES))
    fused, _ = fuse_with_agreeing(replace(one, place_m=off), clocks, nowhere)
    without = Passes(*(getattr(one, name)[one.pole != 4] for name in Passes.__dataclass_fields__))
    assert np.isnan(fused.place_m[4]).all()
    assert np.delete(fused.place_m, 4, 0) == pytest.approx(np.delete(fuse(without, clocks).place_m, 4, 0))


def test_passes_of_one_pole_are_hardly_ever_taken_out() -> None:
    """Drawn as they are stated, of 40 roads with 60 passes each, none or one loses a pass."""
    lost = [np.sum(~passes_that_agree(*passes(np.random.default_rng([13, seed]), 5))) for seed in range(40)]
    assert sum(lost) <= 1
