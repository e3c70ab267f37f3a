"""Landmarks in a window: what leaves it is not forgotten and not counted twice, as the batch shows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig
from geoloc.live.landmarks import Landmark, Landmarks, LandmarkSettings, Sighting
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss

NS = 1_000_000_000


@cache
def driven() -> tuple[SimulatedDrive, Trajectory]:
    """A street with 13 poles."""
    drive = simulate_drive(scenario("urban", 40.0, 5), 5)
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in drive.gnss}
    return drive, trajectory_from_gnss(drive.gnss, arms)


def epochs(drive: SimulatedDrive) -> np.ndarray:
    """Epoch of each sighting by the host's stamps."""
    seen = drive.sightings
    return np.array(
        [int(drive.frame_host_ns[c][f]) for c, f in zip(seen.camera.tolist(), seen.frame, strict=True)]
    )


def solved(first: Trajectory, then: Trajectory) -> dict[int, Landmark]:
    """Drive past all poles, with a solution every half second; half-way the trajectory is another one."""
    drive, _ = driven()
    seen, epoch_ns = drive.sightings, epochs(drive)
    landmarks = Landmarks(drive.rig, settings=LandmarkSettings(most=100_000))
    found: dict[int, Landmark] = {}
    last_ns, half_ns = int(epoch_ns.min()), int(np.median(epoch_ns))
    for row in np.argsort(epoch_ns, kind="stable").tolist():
        now_ns = int(epoch_ns[row])
        if now_ns - last_ns >= NS // 2:
            known = landmarks.solve(first if now_ns < half_ns else then, now_ns)
            found |= {one.object: one for one in known}
            last_ns = now_ns
        pixel = (float(seen.pixel_px[row, 0]), float(seen.pixel_px[row, 1]))
        landmarks.add(Sighting(int(seen.object_index[row]), str(seen.camera[row]), now_ns, pixel, Kind.FOOT))
    return found | {one.object: one for one in landmarks.solve(then, last_ns)}


@cache
def plain() -> dict[int, Landmark]:
    """All poles, by one trajectory."""
    _, trajectory = driven()
    return solved(trajectory, trajectory)


def leaning(trajectory: Trajectory, more_deg: float) -> Trajectory:
    """The same antennas on a car that is taken to lean so much more all the way."""
    knots, roll = trajectory.knots, trajectory.lasting_roll
    angles = knots.heading_deg, knots.pitch_deg
    before, after = (rotation_enu_from_rig(*angles, knots.roll_deg + more) for more in (0.0, more_deg))
    east, north, up = ((before - after) @ trajectory.measured_at_m).T
    latitude, longitude = geographic_from_enu(knots.latitude_deg, knots.longitude_deg, east, north)
    moved = replace(
        knots,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=knots.height_m + up,
        roll_deg=knots.roll_deg + more_deg,
    )
    return replace(trajectory, knots=moved, lasting_roll=roll._replace(deg=roll.deg + more_deg))


def apart_m(a: Landmark, b: Landmark) -> FloatArray:
    """From one place to another, east and north."""
    return np.array([float(axis) for axis in enu_offset(*a.place[:2], *b.place[:2])])


@pytest.mark.slow
def test_a_window_knows_what_has_left_it_and_agrees_with_the_batch() -> None:
    """Poles in windows of 4 s lie where the batch adjustment has them, and are as well known."""
    drive, trajectory = driven()
    truth, seen, live = drive.objects, drive.sightings, plain()
    batch = adjust(
        Observations(
            drive.rig,
            Sightings(seen.camera, seen.pixel_px),
            np.full(seen.frame.size, Kind.FOOT),
            seen.object_index,
            epochs(drive),
            trajectory,
        )
    )
    assert set(live) == set(batch.object.tolist())
    off, error_m = [], []
    for i, number in enumerate(batch.object.tolist()):
        one, sigma_m = live[number], np.sqrt(np.diag(batch.covariance_m2[i]))
        place = float(batch.latitude_deg[i]), float(batch.longitude_deg[i])
        off.append(np.ravel(enu_offset(*place, *one.place[:2])) / sigma_m)
        true = float(truth.latitude_deg[number]), float(truth.longitude_deg[number])
        error_m.append(float(np.hypot(*enu_offset(*true, *one.place[:2]))))
        # A later pole teaches a batch something of an earlier one: it is a little surer, never less sure.
        assert np.all(np.sqrt(np.diag(one.covariance_m2)) > 0.97 * sigma_m)
        assert np.all(np.sqrt(np.diag(one.covariance_m2)) < 1.2 * sigma_m)
    assert np.median(np.abs(off)) < 0.2
    assert np.max(np.abs(off)) < 0.6
    assert np.median(error_m) < 0.1


@pytest.mark.slow
def test_a_trajectory_that_learns_how_it_leans_moves_no_pole() -> None:
    """Half-way it takes its lasting roll for another one, by half a sigma, and says so: nothing moves."""
    _, trajectory = driven()
    other = solved(trajectory, leaning(trajectory, 0.5))
    sigma_m = np.array([np.sqrt(np.diag(one.covariance_m2)) for one in plain().values()])
    off = np.array([apart_m(one, other[number]) for number, one in plain().items()]) / sigma_m
    assert np.max(np.abs(off)) < 0.1
