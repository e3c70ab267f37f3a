"""Lenses with unknown parameters: the camera models' own formulas, and derivatives that are right."""

from __future__ import annotations

import numpy as np
import pytest

from geoloc.calibration.intrinsics.lens import Lens, PinholeLens, RadialCurve
from geoloc.calibration.intrinsics.radial_lenses import FisheyeLens, FThetaLens, OcamLens

SIZE = (1920, 1208)
LENSES: dict[str, Lens] = {
    "ftheta-4": FThetaLens(*SIZE),
    "ftheta-5-linear": FThetaLens(*SIZE, degree=5, linear=True),
    "ocam-4": OcamLens(*SIZE),
    "ocam-5-linear": OcamLens(*SIZE, degree=5, linear=True),
    "fisheye": FisheyeLens(*SIZE),
    "pinhole": PinholeLens(*SIZE),
}
EVERY_LENS = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())
THETA = np.linspace(0.02, 1.0, 60)
CURVE = RadialCurve(THETA, 1004.0 * THETA * (1.0 - 0.05 * THETA**2), 951.0, 611.0)


def parameters(lens: Lens) -> np.ndarray:
    """Parameters near the curve, none of them at a round value."""
    k = lens.start(CURVE)
    return np.asarray(k + np.random.default_rng(1).normal(scale=1e-3, size=k.size) * (np.abs(k) + 0.1))


def points() -> np.ndarray:
    """Points in front of the camera, one of them on its axis."""
    drawn = np.random.default_rng(2).uniform((-1.0, -0.7, 1.0), (1.0, 0.7, 3.0), (60, 3))
    drawn[0, :2] = 0.0
    return np.asarray(drawn)


@EVERY_LENS
def test_lens_projects_as_the_camera_that_it_builds(lens: Lens) -> None:
    """A lens and the fixed camera model of the same parameters give the same pixels to 1e-9 px."""
    k = parameters(lens)
    ours, theirs = lens.project(k, points()), lens.camera(k).pixel_from_camera_point(points())[0]
    assert ours.valid.all()
    np.testing.assert_allclose(ours.pixel_px, theirs, atol=1e-9)


@EVERY_LENS
def test_lens_derivatives_are_those_of_its_pixels(lens: Lens) -> None:
    """Derivatives by point and by parameter agree with central differences."""
    k, at = parameters(lens), points()
    projection = lens.project(k, at)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        numeric = (lens.project(k, at + step).pixel_px - lens.project(k, at - step).pixel_px) / 2e-6
        np.testing.assert_allclose(projection.by_point[..., axis], numeric, rtol=1e-6, atol=1e-4)
    for number, step in enumerate(1e-6 * np.eye(k.size)):
        numeric = (lens.project(k + step, at).pixel_px - lens.project(k - step, at).pixel_px) / 2e-6
        np.testing.assert_allclose(projection.by_lens[..., number], numeric, rtol=1e-6, atol=1e-3)


@EVERY_LENS
def test_start_comes_near_the_curve(lens: Lens) -> None:
    """The first parameters follow the given radial curve to 1.5 px within 45 degrees of the axis."""
    near = np.degrees(THETA) < 45.0
    point = np.column_stack([np.sin(THETA[near]), np.zeros(near.sum()), np.cos(THETA[near])])
    pixel = lens.project(lens.start(CURVE), point).pixel_px
    np.testing.assert_allclose(pixel[:, 0], CURVE.cx_px + CURVE.radius_px[near], atol=1.5)


@EVERY_LENS
def test_units_turn_unknowns_into_what_files_hold(lens: Lens) -> None:
    """Each unknown has a name and a unit; the centre is in pixels."""
    assert len(lens.parameters) == lens.units.size == parameters(lens).size
    assert lens.parameters[:2] == ("cx_px", "cy_px")
    assert lens.units[:2].tolist() == [1.0, 1.0]


def test_points_that_a_lens_cannot_see_are_not_valid() -> None:
    """Behind a pinhole, and where a fisheye's radius falls again, there is no pixel."""
    behind = np.array([[0.1, 0.0, -1.0]])
    assert not PinholeLens(*SIZE).project(parameters(LENSES["pinhole"]), behind).valid.any()
    folded = np.array([960.0, 604.0, 500.0, 500.0, -0.5, 0.0, 0.0, 0.0])
    assert not FisheyeLens(*SIZE).project(folded, np.array([[1.0, 0.0, 0.3]])).valid.any()
