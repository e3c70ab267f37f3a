"""Worlds that draw what the error budget states: the sigmas of the adjustment hold there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.accuracy import nees
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.as_stated import as_stated
from geoloc.simulation.simulate import scenario, simulate_drive
from geoloc.trajectory.trajectory import trajectory_from_gnss


def _squares(
    seed: int, believed: ErrorBudget, name: str = "still", antennas: int = 2
) -> tuple[FloatArray, FloatArray]:
    """NEES in the plane, over 2, and of heights, of the poles of a drive; errors as usually stated."""
    drive = simulate_drive(as_stated(scenario(name, None, seed), antennas, seed, ErrorBudget()), seed)
    fixes = drive.gnss[:antennas]
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in fixes}
    seen, true = drive.sightings, drive.objects
    stamps = np.empty(seen.frame.size, dtype=np.int64)
    for camera in np.unique(seen.camera):
        rows = seen.camera == camera
        stamps[rows] = drive.frame_host_ns[str(camera)][seen.frame[rows]]
    observations = Observations(
        drive.rig,
        Sightings(seen.camera, seen.pixel_px),
        np.full(seen.camera.size, Kind.FOOT),
        seen.object_index,
        stamps,
        trajectory_from_gnss(fixes, arms),
    )
    found = adjust(observations, budget=believed)
    at = found.object
    east, north = enu_offset(
        true.latitude_deg[at], true.longitude_deg[at], found.latitude_deg, found.longitude_deg
    )
    up = (found.height_m - true.height_m[at]) / found.sigma_height_m
    return nees(np.stack([east, north], axis=1), found.covariance_m2) / 2.0, up**2


@pytest.mark.parametrize(
    ("believed", "holds"),
    [
        pytest.param(1.0, True, id="as drawn"),
        pytest.param(0.5, False, id="half as large", marks=pytest.mark.slow),
    ],
)
def test_sigmas_hold_where_errors_are_those_stated(believed: float, holds: bool) -> None:
    """NEES of a standing car is between 0.75 and 1.3, and above it where ground and mounting are believed."""
    usual = ErrorBudget()
    budget = replace(
        usual,
        boresight_deg=believed * usual.boresight_deg,
        ground_height_m=believed * usual.ground_height_m,
        ground_slope_deg=believed * usual.ground_slope_deg,
    )
    plane, _ = zip(*(_squares(seed, budget) for seed in range(12)), strict=True)
    assert (0.75 <= float(np.mean(plane)) <= 1.3) == holds
    assert holds or float(np.mean(plane)) > 1.3


@pytest.mark.slow
def test_heights_hold_at_speed_where_the_track_trembles_within_seconds() -> None:
    """One antenna at 60 km/h: pitch and heading that err for less than a second are in the sigmas."""
    _, up = zip(*(_squares(seed, ErrorBudget(), "highway", 1) for seed in range(5)), strict=True)
    assert 0.4 <= float(np.mean(np.concatenate(up))) <= 2.0
