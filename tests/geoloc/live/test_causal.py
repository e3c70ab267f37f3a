"""The trajectory that follows a drive, against the smoother of the whole drive and against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from geoloc.earth.geodesy import enu_offset, wrap_deg
from geoloc.live.causal import CausalTrajectory, Following
from geoloc.live.samples import Fix
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.smoother.chain import Chain, Links
from geoloc.trajectory.trajectory import trajectory_from_gnss

NS = 1_000_000_000
Arrived = list[tuple[int, Fix]]


@cache
def driven() -> SimulatedDrive:
    """Twenty seconds of a street with a bend."""
    return simulate_drive(scenario("urban", 40.0, 3), 3)


def arrived(drive: SimulatedDrive) -> Arrived:
    """Fixes of both antennas in the order of their host stamps."""
    found = []
    for one in drive.gnss:
        columns = (one.epoch_ns, one.latitude_deg, one.longitude_deg, one.height_m, one.quality)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        found += [(at, Fix(one.antenna, *row)) for at, row in zip(one.host_ns.tolist(), rows, strict=True)]
    return sorted(found, key=lambda one: one[0])


def followed(drive: SimulatedDrive, fixes: Sequence[tuple[int, Fix]]) -> CausalTrajectory:
    """Take all fixes, with a solution every half second."""
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in drive.gnss}
    track, last_ns = CausalTrajectory(arms), 0
    for at_ns, fix in fixes:
        track.add_fix(fix)
        if at_ns - last_ns >= NS // 2:
            track.solve(at_ns)
            last_ns = at_ns
    return track


def apart_m(a: Poses, b: Poses) -> np.ndarray:
    """How far poses are apart, level."""
    return np.hypot(*enu_offset(a.latitude_deg, a.longitude_deg, b.latitude_deg, b.longitude_deg))


def test_a_chain_in_two_windows_is_the_whole_chain() -> None:
    """What a window leaves to the next one makes its solution that of all knots together."""
    rng = np.random.default_rng(1)
    n, d, c, cut = 9, 3, 2, 5
    jacobian, by_constants = rng.normal(size=(n, 4, d)), rng.normal(size=(n, 4, c))
    residual, weight = rng.normal(size=(n, 4)), rng.uniform(0.5, 2.0, (n, 4))
    links = (rng.normal(size=(n - 1, d, d)), rng.normal(size=(n - 1, d, d)))
    between = [rng.normal(size=(n - 1, size)) for size in (d, d, c)]
    off = rng.normal(size=n - 1)

    def chain(first: int, last: int, until: int | None = None) -> Chain:
        part = Chain(last - first, d, c, until)
        knots, steps = slice(first, last), slice(first, last - 1)
        part.observe(jacobian[knots], residual[knots], weight[knots], by_constants[knots])
        information = np.broadcast_to(np.eye(d), (last - first - 1, d, d))
        tied = Links(links[0][steps], links[1][steps], np.asarray(information))
        part.tie(tied, np.zeros((last - first, d)))
        part.across(*(one[steps] for one in between), off[steps], np.ones(last - first - 1))
        if first == 0:
            part.expect_constants(np.ones(c), np.full(c, 0.5))
        return part

    whole = chain(0, n)
    states, constants = whole.solve()
    known = chain(0, n, until=cut).known_at(cut, np.zeros((n, d)), np.zeros(c))
    second = chain(cut, n)
    second.expect_first(known.mean, known.information)
    later, same = second.solve()
    np.testing.assert_allclose(later, states[cut:], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(same, constants, rtol=1e-8, atol=1e-9)
    for a, b in zip(second.covariances(), whole.covariances(), strict=True):
        np.testing.assert_allclose(a, b[cut:] if a.ndim == 3 else b, rtol=1e-7, atol=1e-10)


def test_settled_poses_are_those_of_the_whole_drive_and_present_ones_within_their_sigmas() -> None:
    """Four seconds back the track is the batch's to millimetres; ahead of the last fix off as stated."""
    drive = driven()
    truth = drive.poses
    end_ns = int(truth.epoch_ns[0]) + 18 * NS
    track = followed(drive, [one for one in arrived(drive) if one[0] < end_ns])
    assert track.trajectory is not None
    assert track.restarts == track.too_late == track.refused == 0
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in drive.gnss}
    batch = trajectory_from_gnss(drive.gnss, arms)
    settled = truth.epoch_ns[(truth.epoch_ns < track.settled_ns) & (truth.epoch_ns > truth.epoch_ns[0] + NS)]
    a, b = track.trajectory.poses_at(settled), batch.poses_at(settled)
    assert a.valid.all()
    assert np.median(apart_m(a, b)) < 0.015
    assert np.median(np.abs(wrap_deg(a.heading_deg - b.heading_deg))) < 0.05
    row = int(np.searchsorted(truth.epoch_ns, track.newest_fix_ns + 7 * NS // 10))
    ahead = track.trajectory.poses_at(truth.epoch_ns[row : row + 1])
    true = float(truth.latitude_deg[row]), float(truth.longitude_deg[row])
    off_m = np.hypot(*enu_offset(*true, ahead.latitude_deg, ahead.longitude_deg))
    assert off_m[0] < 3.0 * ahead.sigma_horizontal_m[0]
    assert ahead.sigma_horizontal_m[0] > 1.5 * a.sigma_horizontal_m[-1]


def test_order_of_arrival_within_the_window_does_not_matter() -> None:
    """Fixes that swap places by up to a second between two solutions give the same track in the end."""
    drive, rng = driven(), np.random.default_rng(2)
    fixes = arrived(drive)
    late = [(at + int(rng.uniform(0, NS)) * (rng.random() < 0.3), fix) for at, fix in fixes]
    late = sorted(late, key=lambda one: one[0])
    end_ns = late[-1][0]
    tracks = [followed(drive, one) for one in (fixes, late)]
    for track in tracks:
        track.solve(end_ns)
    assert tracks[1].too_late == 0
    asked = drive.poses.epoch_ns[60:]
    poses = [track.trajectory.poses_at(asked) for track in tracks if track.trajectory is not None]
    known = poses[0].valid & poses[1].valid
    assert known.mean() > 0.9
    assert np.max(apart_m(*poses)[known]) < 0.05


def test_an_outage_is_predicted_with_growing_sigmas_then_lost_and_found_again() -> None:
    """Without fixes positions go on, less and less surely, until there are none; later fixes begin anew."""
    drive = driven()
    first_ns = int(drive.poses.epoch_ns[0])
    before = [one for one in arrived(drive) if one[0] < first_ns + 8 * NS]
    track = followed(drive, before)
    last_ns, sigmas = track.newest_fix_ns, []
    for after_s in (1, 3, 6):
        now_ns = last_ns + after_s * NS
        track.solve(now_ns)
        assert track.trajectory is not None
        sigmas.append(float(track.trajectory.poses_at(np.array([now_ns])).sigma_horizontal_m[0]))
        assert track.following(now_ns) is (Following.FIXED if after_s == 1 else Following.PREDICTED)
    assert sigmas[0] < 0.5 < sigmas[1] < sigmas[2]
    gone_ns = last_ns + 11 * NS
    track.solve(gone_ns)
    assert track.trajectory is None
    assert track.following(gone_ns) is Following.LOST
    for at_ns, fix in (one for one in arrived(drive) if one[0] > gone_ns):
        track.add_fix(fix)
        track.solve(at_ns)
    assert track.following(track.newest_fix_ns) is Following.FIXED


def test_a_wild_fix_and_one_that_is_too_late_move_nothing() -> None:
    """A fix hundreds of metres away is dropped; one older than the window is counted, not used."""
    drive = driven()
    fixes = arrived(drive)
    plain = followed(drive, fixes)
    at_ns, one = fixes[len(fixes) // 2]
    wild = one._replace(epoch_ns=one.epoch_ns + 1_000_000, latitude_deg=one.latitude_deg + 0.01)
    track = followed(drive, sorted([*fixes, (at_ns, wild)], key=lambda each: each[0]))
    track.add_fix(fixes[0][1])
    track.add_fix(one._replace(antenna="another"))
    assert (track.too_late, track.refused, track.restarts) == (1, 1, 0)
    asked = drive.poses.epoch_ns[60:]
    assert plain.trajectory is not None
    assert track.trajectory is not None
    poses = [each.trajectory.poses_at(asked) for each in (plain, track) if each.trajectory is not None]
    assert np.nanmax(apart_m(*poses)) < 0.05
