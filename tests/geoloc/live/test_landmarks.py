"""Landmarks in a window: nothing that leaves it is forgotten, and estimates are those of the batch."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.adjustment.adjust import adjust
from geoloc.earth.geodesy import enu_offset
from geoloc.live.landmarks import Landmark, Landmarks, LandmarkSettings, Sighting
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss

NS = 1_000_000_000


def epochs(drive: SimulatedDrive) -> np.ndarray:
    """Epoch of each sighting by the host's stamps."""
    seen = drive.sightings
    return np.array(
        [int(drive.frame_host_ns[c][f]) for c, f in zip(seen.camera.tolist(), seen.frame, strict=True)]
    )


def solved(drive: SimulatedDrive, trajectory: Trajectory, window_s: float) -> dict[int, Landmark]:
    """Drive past all poles, with a solution every half second."""
    seen, epoch_ns = drive.sightings, epochs(drive)
    landmarks = Landmarks(drive.rig, settings=LandmarkSettings(window_s=window_s, most=100_000))
    found: dict[int, Landmark] = {}
    last_ns = int(epoch_ns.min())
    for row in np.argsort(epoch_ns, kind="stable").tolist():
        now_ns = int(epoch_ns[row])
        if now_ns - last_ns >= NS // 2:
            found |= {one.object: one for one in landmarks.solve(trajectory, now_ns)}
            last_ns = now_ns
        pixel = (float(seen.pixel_px[row, 0]), float(seen.pixel_px[row, 1]))
        landmarks.add(Sighting(int(seen.object_index[row]), str(seen.camera[row]), now_ns, pixel, Kind.FOOT))
    return found | {one.object: one for one in landmarks.solve(trajectory, last_ns)}


@pytest.mark.slow
def test_a_window_knows_what_has_left_it_and_agrees_with_the_batch() -> None:
    """Poles in windows of 4 s, in one window and in the batch adjustment lie where their sigmas allow."""
    drive = simulate_drive(scenario("urban", 40.0, 5), 5)
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in drive.gnss}
    trajectory, seen = trajectory_from_gnss(drive.gnss, arms), drive.sightings
    short, whole = (solved(drive, trajectory, window_s) for window_s in (4.0, 1000.0))
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
    assert set(short) == set(whole) == set(batch.object.tolist())
    off, error_m = [], []
    for i, number in enumerate(batch.object.tolist()):
        one, other = short[number], whole[number]
        sigma_m = np.sqrt(np.diag(batch.covariance_m2[i]))
        off.append(np.array(enu_offset(*one.place[:2], *other.place[:2])).ravel() / sigma_m)
        off.append(
            np.array(
                enu_offset(*other.place[:2], float(batch.latitude_deg[i]), float(batch.longitude_deg[i]))
            ).ravel()
            / sigma_m
        )
        truth = drive.objects
        true = enu_offset(
            float(truth.latitude_deg[number]), float(truth.longitude_deg[number]), *one.place[:2]
        )
        error_m.append(float(np.hypot(*true)))
        # A later pole teaches a batch something of an earlier one; a window in which both were, too.
        assert np.trace(one.covariance_m2) < 2.0 * np.trace(batch.covariance_m2[i])
    assert np.median(np.abs(off)) < 0.5
    assert np.max(np.abs(off)) < 3.0
    assert np.median(error_m) < 0.1
