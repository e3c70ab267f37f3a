"""Many drives past the same poles: what is averaged, what is not, and that the covariance says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_passes import POLES, SPACING_S, SPEED_MPS, passes

import geoloc.fusion.fuse
from geoloc.arrays import FloatArray
from geoloc.fusion.fuse import Clocks, Passes, fuse
from geoloc.fusion.sources import FoundClock, parts_of
from geoloc.locate.accuracy import nees
from geoloc.trajectory.fix_checks import CODE_LASTS_S


def covariance_alone(one: Passes, clocks: Clocks) -> FloatArray:
    """Covariance of each pass as its drive states it."""
    late = clocks.sigma_s[one.drive, None] * one.ahead_mps
    whole = one.own_m2 + one.common_m2 + one.track_m[:, None, None] ** 2 * np.eye(2)
    return np.asarray(whole + late[:, :, None] * late[:, None, :])


def test_one_drive_comes_back_as_it_was() -> None:
    """Places and covariances of a single drive are its own."""
    one, clocks = passes(np.random.default_rng(1), 1)
    fused = fuse(one, clocks)
    assert fused.place_m == pytest.approx(one.place_m, abs=1e-6)
    assert fused.covariance_m2 == pytest.approx(covariance_alone(one, clocks), abs=1e-5)


@pytest.mark.parametrize("drives", [1, 5, 25])
def test_covariances_are_as_large_as_the_errors(drives: int) -> None:
    """Over many draws of tracks, clocks and pixels, squared errors are as large as their variances."""
    squares = []
    for seed in range(120):
        fused = fuse(*passes(np.random.default_rng([drives, seed]), drives))
        squares.append(nees(fused.place_m, fused.covariance_m2).mean() / 2.0)
    # Poles of one road err together: one draw of it has two degrees of freedom, more or less.
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


def test_twenty_five_drives_are_five_times_as_good() -> None:
    """But for the ground and the car, which are the same in all of them."""
    one, clocks = passes(np.random.default_rng(2), 25)
    sigma = np.sqrt(np.trace(fuse(one, clocks).covariance_m2, axis1=1, axis2=2) / 2.0)
    assert (
        sigma < 0.25 * np.sqrt(np.trace(covariance_alone(one, clocks)[:POLES], axis1=1, axis2=2) / 2)
    ).all()
    same = replace(one, common_m2=one.common_m2 * 100.0)
    assert (np.sqrt(np.trace(fuse(same, clocks).covariance_m2, axis1=1, axis2=2) / 2.0) > 0.99).all()


def test_drives_both_ways_show_a_receiver_that_is_late() -> None:
    """What clocks leave along the road cancels between the ways; one way alone keeps it."""
    along = []
    for both in (True, False):
        one, clocks = passes(np.random.default_rng(3), 8, both_ways=both)
        none = replace(clocks, sigma_s=clocks.prior_s, found_s=np.zeros(8))
        along.append(fuse(one, none).covariance_m2[:, 0, 0].mean())
    assert along[0] < 0.5 * along[1]


def test_clocks_that_are_stated_to_the_second_are_each_drives_own() -> None:
    """What one drive's frames begin too late says nothing of the next: only a receiver's lateness does."""
    _, clocks = passes(np.random.default_rng(3), 2)
    alike, own = replace(clocks, prior_s=np.ones(2), late_s=np.array([0.0, 0.15])).alike_s()
    assert alike == pytest.approx([0.0, 0.15], abs=0.01)
    assert own == pytest.approx(1.0, abs=0.02)


def test_a_good_drive_places_what_a_poor_one_alone_saw() -> None:
    """A drive with RTK past half of the poles shows how far the other's track is off at the next ones."""
    poor, clocks = passes(np.random.default_rng(4), 1)
    good = replace(poor, drive=poor.drive + 1, place_m=np.zeros((POLES, 2)), track_m=np.full(POLES, 0.02))
    half = np.arange(POLES // 2)
    both = Passes(
        *(
            np.concatenate([getattr(poor, name), getattr(good, name)[half]])
            for name in Passes.__dataclass_fields__
        )
    )
    two = Clocks(
        np.arange(2),
        *(np.repeat(values, 2) for values in (clocks.found_s, clocks.sigma_s)),
        *(np.repeat(values, 2) for values in (clocks.prior_s, clocks.late_s)),
    )
    two.sigma_s[1] = two.prior_s[1] = 0.005
    two.found_s[1] = 0.0
    fused = fuse(both, two)
    next_pole = POLES // 2
    alone = covariance_alone(poor, clocks)[next_pole]
    assert np.trace(fused.covariance_m2[next_pole]) < 0.3 * np.trace(alone)
    assert np.hypot(*fused.place_m[next_pole]) < np.hypot(*poor.place_m[next_pole])


def test_neighbourhoods_leave_places_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """400 poles that are placed in parts come out as they do all at once, but for a share of their sigmas."""
    one, clocks = passes(np.random.default_rng(5), 3, poles=400)
    in_a_row = replace(one, place_m=one.place_m + np.outer(one.pole * SPACING_S * SPEED_MPS, [1.0, 0.0]))
    parts = fuse(in_a_row, clocks)
    monkeypatch.setattr(geoloc.fusion.fuse, "_WITHIN", 1000)
    whole = fuse(in_a_row, clocks)
    assert not np.array_equal(parts.place_m, whole.place_m)
    sigma = np.sqrt(np.trace(whole.covariance_m2, axis1=1, axis2=2) / 2.0)
    assert (np.abs(parts.place_m - whole.place_m).max(axis=1) < 0.2 * sigma).all()
    assert parts.covariance_m2 == pytest.approx(whole.covariance_m2, rel=0.15, abs=0.02)


def test_sources_are_what_they_are_said_to_be() -> None:
    """The parts of an estimate add up to its covariance, and a clock moves it along the heading."""
    rng = np.random.default_rng(6)
    root = rng.normal(size=(3, 2, 2))
    along = np.array([[0.0, 0.0], [0.0, 0.04]])
    by_source = {"pixels": root @ root.swapaxes(1, 2), "ground": np.tile(0.01 * np.eye(2), (3, 1, 1))}
    by_source |= {"gnss": np.tile(4.0 * np.eye(2), (3, 1, 1)), "time": np.tile(along, (3, 1, 1))}
    parts = parts_of(by_source, np.array([0.0, 180.0, 0.0]), FoundClock(0.02, 0.02, 0.02))
    assert parts.ahead_mps == pytest.approx(np.array([[0.0, 10.0], [0.0, -10.0], [0.0, 10.0]]))
    moved = (0.02 * parts.ahead_mps)[:, :, None] * (0.02 * parts.ahead_mps)[:, None, :]
    whole = parts.own_m2 + parts.common_m2 + parts.track_m[:, None, None] ** 2 * np.eye(2) + moved
    assert whole == pytest.approx(np.sum(list(by_source.values()), axis=0))


def test_velocities_tell_how_neighbours_differ() -> None:
    """Of a track that velocities hold nothing is each pole's own; of fixes alone 0.3 m are."""
    track = {"gnss": np.tile(np.eye(2), (2, 1, 1))}
    clock = FoundClock(1.0, 1.0, 1.0)
    by_fixes, held = (parts_of(track, np.zeros(2), clock, lasts_s) for lasts_s in (CODE_LASTS_S, 300.0))
    assert by_fixes.own_m2 == pytest.approx(np.tile(0.3**2 * np.eye(2), (2, 1, 1)))
    assert (held.track_m.tolist(), held.own_m2.any()) == ([1.0, 1.0], False)


def test_a_clock_that_bearings_find_moves_places_as_far_as_any_other() -> None:
    """Of 16 m a second nothing is lost where the clock is known 30 times better than beforehand."""
    prior_s, solved_s, stated_s, speed_mps = 0.15, 0.005, 0.013, 16.0
    by_prior, by_rays = solved_s**4 / prior_s**2, solved_s**2 - solved_s**4 / prior_s**2
    along = np.array([[[0.0, 0.0], [0.0, speed_mps**2]]])
    pixels = 0.01 * np.eye(2) + by_rays * along
    late = (by_prior + stated_s**2 - solved_s**2) * along
    parts = parts_of({"pixels": pixels, "time": late}, np.zeros(1), FoundClock(prior_s, solved_s, stated_s))
    assert parts.ahead_mps == pytest.approx(np.array([[0.0, speed_mps]]))
    assert parts.own_m2 == pytest.approx(0.01 * np.eye(2)[None], abs=1e-9)


def test_a_change_of_datum_is_the_same_in_every_drive() -> None:
    """Twenty-five drives know a place no better than the datum that all of them were brought to."""
    one, clocks = passes(np.random.default_rng(2), 25)
    parts = parts_of({"datum": np.tile(0.25 * np.eye(2), (2, 1, 1))}, np.zeros(2), FoundClock(1.0, 1.0, 1.0))
    same = replace(one, common_m2=one.common_m2 + parts.common_m2[0])
    assert (np.sqrt(np.trace(fuse(same, clocks).covariance_m2, axis1=1, axis2=2) / 2.0) > 0.49).all()
