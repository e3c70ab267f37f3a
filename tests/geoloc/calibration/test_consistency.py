"""One camera or two, and whether a model fits: what residuals and views' own cameras tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoloc.calibration.intrinsics import Fit, View, calibrate_intrinsics
from geoloc.calibration.intrinsics.consistency import alikeness, two_cameras
from geoloc.calibration.intrinsics.fit import fit, lenses
from geoloc.calibration.intrinsics.initial_guess import first_guess
from geoloc.calibration.intrinsics.views import corners_of
from geoloc.cameras import FThetaCamera
from geoloc.errors import CalibrationError
from geoloc.simulation.pictures.board_views import draw_board_poses

LENS = FThetaCamera(1920, 1208, 962.0, 609.0, theta_from_r=(0.0, 9.9e-4, 3.0e-8, 5.0e-11, 2.2e-15))
BOARD_M = 0.08 * (np.argwhere(np.ones((9, 6))).astype(np.float64) + 1.0)
BENT = np.column_stack([BOARD_M, np.zeros(54)])


def board_views(n: int, noise_px: float = 0.03) -> list[View]:
    """Views through the lens."""
    rng, views = np.random.default_rng(4), []
    for number, (rotation, position) in enumerate(
        draw_board_poses(LENS, (0.80, 0.56), n, rng, fill=(0.4, 0.7))
    ):
        pixel, _ = LENS.pixel_from_camera_point(BENT @ rotation.T + position)
        views.append(View(str(number), BOARD_M, pixel + rng.normal(scale=noise_px, size=pixel.shape)))
    return views


def fitted(views: list[View], model: str = "ftheta") -> Fit:
    """The simplest lens of a model."""
    corners = corners_of(views)
    return fit(lenses(model, 1920, 1208)[0], corners, *first_guess(corners, 1920, 1208))


def changed(view: View, turned: bool) -> View:
    """A view turned by half a turn, or zoomed out to 0.9 about the middle of the image."""
    middle = np.array([959.5, 603.5])
    return replace(view, pixel_px=middle + (-1.0 if turned else 0.9) * (view.pixel_px - middle))


@pytest.fixture(scope="module")
def views() -> list[View]:
    """Seventeen views of one camera."""
    return board_views(17)


def test_residuals_of_the_right_model_are_noise(views: list[View]) -> None:
    """Neighbours of a model that fits are not alike, those of a wrong one are."""
    assert abs(alikeness(fitted(views))) < 0.15
    assert alikeness(fitted(views, "pinhole")) > 0.3


def test_one_camera_is_not_taken_for_two(views: list[View]) -> None:
    """Neither one lens nor a model that does not fit it gives two groups of views."""
    assert two_cameras(fitted(views)) is None
    assert two_cameras(fitted(views, "pinhole")) is None


@pytest.mark.parametrize(
    ("turned", "zoom", "shift_px"), [(False, 0.9, (-0.25, -0.55)), (True, 1.0, (-5.0, -11.0))]
)
def test_views_of_another_zoom_or_turned_are_told(
    views: list[View], turned: bool, zoom: float, shift_px: tuple[float, float]
) -> None:
    """Views that were zoomed or turned are named, with their focal length and principal point."""
    mixed = [changed(v, turned) if n % 2 else v for n, v in enumerate(views)]
    found = two_cameras(fitted(mixed))
    assert found is not None
    assert found.other.tolist() == [1, 3, 5, 7, 9, 11, 13, 15]
    assert found.zoom == pytest.approx(zoom, abs=0.005)
    np.testing.assert_allclose(found.shift_px, shift_px, atol=1.0)


def test_views_of_two_cameras_are_refused_by_name(views: list[View]) -> None:
    """Half of the pictures upside down: no camera comes out, but the names of those that are apart."""
    mixed = [changed(v, True) if n % 2 else v for n, v in enumerate(views)]
    with pytest.raises(CalibrationError, match=r"1, 3, 5, 7, 9 and 3 more \(8 of 17\) look like another"):
        calibrate_intrinsics(mixed, 1920, 1208, models=["ftheta"])


def test_model_that_does_not_fit_is_a_fault(views: list[View]) -> None:
    """A lens that the given model cannot be: the error bars are called too small."""
    narrow = [v for v in board_views(40) if np.abs(v.pixel_px - (962.0, 609.0)).max() < 700.0]
    made = calibrate_intrinsics(narrow[:12], 1920, 1208, models=["pinhole"])
    (sentence,) = [fault.sentence for fault in made.faults if fault.kind == "misfit"]
    assert "The error bars are too small" in sentence


def test_pictures_that_are_scaled_unevenly_fit_no_camera(views: list[View]) -> None:
    """Pixels much higher than wide leave pixels, alike between neighbours: refused."""
    squeezed = [replace(v, pixel_px=v.pixel_px * (1.0, 0.96)) for v in views]
    with pytest.raises(CalibrationError, match="do not fit one camera: the best model"):
        calibrate_intrinsics(squeezed, 1920, 1208, models=["ftheta"])
