"""The first ellipse of an object: honest also where the distance is the inverse of a small angle."""

from __future__ import annotations

import numpy as np
import pytest
from single_frame_rig import LAT0, LON0, RIG, pixels_of, poses_of

from geoloc.earth.geodesy import enu_offset, rotation_enu_from_rig
from geoloc.live.first import placed_by_one_frame
from geoloc.locate.accuracy import nees
from geoloc.locate.error_budget import ErrorBudget
from geoloc.trajectory.smoother.tilt import climb_ahead

CHI2_95 = 5.991


@pytest.mark.parametrize("ahead_m", [12.0, 40.0])
def test_an_ellipse_of_one_frame_holds_the_foot_near_and_far(ahead_m: float) -> None:
    """Of feet seen through errors as large as stated, 90 to 99 in 100 lie in the ellipse of 95 %."""
    rng, budget, one = np.random.default_rng(1), ErrorBudget(), RIG.cameras["narrow"]
    sigma_deg = {"heading": 0.2, "pitch": 0.5, "roll": 0.5}
    pose = poses_of(1, **{f"sigma_{name}_deg": sigma for name, sigma in sigma_deg.items()})
    fast = np.array([0.0, budget.pitch_jitter_deg, budget.roll_jitter_deg])
    wrong_deg = rng.normal(size=(250, 3)) * np.hypot(np.array(list(sigma_deg.values())), fast)
    wrong_deg += rng.normal(size=(250, 3)) * budget.boresight_deg
    slope = max(
        float(climb_ahead(np.array([ahead_m]))[0]), float(np.tan(np.radians(budget.ground_slope_deg)))
    )
    squares = []
    for turned_deg in wrong_deg:
        aside_m = ahead_m * rng.choice([-0.15, 0.15])
        rise = rng.normal(size=3) @ [budget.ground_height_m, slope * ahead_m, budget.ground_fall * aside_m]
        foot = np.array([aside_m, ahead_m, rise])
        pixel = pixels_of((rotation_enu_from_rig(*turned_deg).T @ foot)[None], one)[0]
        u, v = pixel + budget.pixel_px * rng.normal(size=2)
        found = placed_by_one_frame(RIG, "narrow", (float(u), float(v)), pose, budget)
        if found is None:
            continue
        place, covariance = found
        off = np.ravel(enu_offset(LAT0, LON0, *place[:2])) - foot[:2]
        squares.append(float(nees(off[None], covariance[None])[0]))
    assert len(squares) > 150
    assert 0.90 <= np.mean(np.array(squares) < CHI2_95) <= 0.99
