"""Points, lines and areas on the ground: corners with one joint covariance."""

from __future__ import annotations

import numpy as np
import pytest
from single_frame_rig import EXACT, RIG, feet_in_view, pixels_of, poses_of

from geoloc.arrays import FloatArray
from geoloc.locate.combine import combine
from geoloc.locate.outlines import Outline, cut_to_reach, joined, locate_outline, mean_outline
from geoloc.locate.records import Located, Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_single_frame

CAMERA = "wide"
SIGMAS = {
    "sigma_horizontal_m": 0.03,
    "sigma_vertical_m": 0.05,
    "sigma_heading_deg": 0.2,
    "sigma_pitch_deg": 0.1,
    "sigma_roll_deg": 0.1,
    "speed_mps": 12.0,
}
AREA = np.array([[7.0, -1.0, 0.0], [9.5, -0.8, 0.0], [10.0, 1.2, 0.0], [7.4, 1.5, 0.0]])
"""On the rig's plane: 5.6325 m²."""


def outline(feet: FloatArray = AREA, frame: str = "1", budget: ErrorBudget | None = None) -> Outline:
    """Locate feet of the rig's plane from their true pixels."""
    pixel_px = pixels_of(feet, RIG.camera(CAMERA))
    pose = poses_of(1, heading_deg=70.0, **SIGMAS)
    return locate_outline(RIG, CAMERA, pixel_px, pose, budget or ErrorBudget(), frame=frame)


def shoelace(corners: FloatArray) -> float:
    """Area inside (k, 2) corners."""
    x, y = corners.T
    return abs(float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)) / 2.0


def test_each_corner_is_what_a_single_frame_says_of_a_foot() -> None:
    """Positions, heights and covariances are those of `locate_single_frame`; the joint one is proper."""
    feet = feet_in_view(RIG.camera(CAMERA), 12, seed=2)
    one = outline(feet)
    rows = Sightings(np.full(12, CAMERA), pixels_of(feet, RIG.camera(CAMERA)))
    other = locate_single_frame(RIG, rows, poses_of(12, heading_deg=70.0, **SIGMAS), ErrorBudget())
    for name in ("latitude_deg", "longitude_deg", "height_m", "range_m"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.corner_m2, other.covariance_m2, rtol=1e-12)
    joint = one.covariance_m2()
    np.testing.assert_allclose(joint[4:6, 4:6], one.corner_m2[2], rtol=1e-12)
    assert np.linalg.eigvalsh(joint).min() > 0.0


def test_area_and_length_are_true_and_their_sigmas_those_of_draws() -> None:
    """Of 20,000 draws from the joint covariance, areas and lengths spread as their sigmas say."""
    one = outline()
    assert one.area().value == pytest.approx(shoelace(AREA[:, :2]), abs=1e-3)
    sides = np.hypot(*np.diff(AREA[:, :2], axis=0).T)
    assert one.length().value == pytest.approx(sides.sum(), abs=1e-3)
    # A hundredth of the errors: area and length are no straight lines in the corners.
    rng = np.random.default_rng(5)
    draws = rng.multivariate_normal(np.zeros(8), one.covariance_m2() * 1e-4, size=20_000).reshape(-1, 4, 2)
    corners = one.plane_m() + draws
    areas = np.array([shoelace(corner) for corner in corners])
    lengths = np.hypot(*np.moveaxis(np.diff(corners, axis=1), -1, 0)).sum(axis=1)
    assert 100 * areas.std() == pytest.approx(one.area().sigma, rel=0.03)
    assert 100 * lengths.std() == pytest.approx(one.length().sigma, rel=0.03)
    assert (one.correlation() > 0.85).all()
    assert (one.correlation() < 1.0).all()


def test_mean_of_drawings_is_that_of_combine_and_keeps_what_they_share() -> None:
    """Pixels average out over three pictures, the mounting does not; corners at odds are no mean."""
    readings = [outline(frame=str(k)) for k in range(3)]
    mean = mean_outline(readings)
    assert mean is not None
    every = joined(readings)
    located = Located(
        *(every.latitude_deg, every.longitude_deg, every.height_m, every.corner_m2, every.own_m2),
        *(every.shared_m, every.source, every.range_m, every.rejected),
    )
    combined = combine(located, np.tile(np.arange(4), 3))
    np.testing.assert_allclose(mean[0].corner_m2, combined.covariance_m2, rtol=1e-4)
    first, pitch = readings[0], "boresight pitch wide"
    own = [one.shared_m[:, :, one.source.index(pitch)] for one in (mean[0], first)]
    np.testing.assert_allclose(*own, rtol=1e-6)
    np.testing.assert_allclose(mean[0].own_m2, first.own_m2 / 3.0, rtol=1e-3)
    turned = [*readings, outline(AREA[[1, 2, 3, 0]], frame="4")]
    assert mean_outline(turned) is None


def test_line_is_cut_where_it_leaves_the_reach() -> None:
    """A line to the horizon ends 20 m away, on the drawn side; one that stays beyond is empty."""
    far = np.array([[8.0, -2.0, 0.0], [16.0, -2.0, 0.0], [60.0, -2.0, 0.0]])
    drawn = pixels_of(far, RIG.camera(CAMERA))
    kept = cut_to_reach(RIG.camera(CAMERA), drawn, 20.0)
    np.testing.assert_array_equal(kept[:2], drawn[:2])
    one = outline_of(kept)
    assert one.range_m[-1] == pytest.approx(20.0, abs=0.6)
    assert one.range_m[-1] <= 20.0
    assert cut_to_reach(RIG.camera(CAMERA), drawn[2:].repeat(2, axis=0), 20.0).shape == (0, 2)


def outline_of(pixel_px: FloatArray) -> Outline:
    """Locate pixels without errors."""
    return locate_outline(RIG, CAMERA, pixel_px, poses_of(1), EXACT, frame="1", max_range_m=20.0)


def test_parts_of_a_line_measure_what_lies_between_their_ends() -> None:
    """Two parts that overlap by half a metre are as long as the line; one with a wide gap lacks the gap."""
    line = np.array([[6.0, -2.0, 0.0], [10.0, -2.0, 0.0], [14.0, -2.0, 0.0]])
    whole = outline(line, budget=EXACT)
    overlapping = joined([whole.at(np.array([0.0, 1.0])), whole.at(np.array([0.875, 2.0]))])
    apart = joined([whole.at(np.array([0.0, 0.5])), whole.at(np.array([1.0, 2.0]))])
    assert overlapping.length().value == pytest.approx(8.0, abs=1e-3)
    assert apart.length().value == pytest.approx(6.0, abs=1e-3)
