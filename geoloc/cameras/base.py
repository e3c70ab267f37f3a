"""The protocol behind which every camera model stands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.errors import CalibrationError

SHORTEST_FOCAL_LENGTH_PX = 1e-3
_MAX_SIDE_PX = 100_000
# Far beyond any lens; powers of what lies within stay finite numbers.
_MAX_NUMBER = 1e12
_MAX_NUMBERS = 32


def check_parameters(model: str, width_px: int, height_px: int, numbers: Sequence[float]) -> None:
    """Refuse an image that is none and numbers that no calibration gives.

    Raises
    ------
    CalibrationError
        If the image is empty or longer than 100,000 pixels, or a number is not finite or beyond 1e12.
    """
    if not all(math.isfinite(number) for number in numbers):
        raise CalibrationError(f"{_article(model)} {model} parameter is not a finite number")
    if min(width_px, height_px) <= 0 or max(width_px, height_px) > _MAX_SIDE_PX:
        raise CalibrationError(
            f"an image of {width_px} x {height_px} pixels is not one: both sides must be positive, at most"
            f" {_MAX_SIDE_PX}"
        )
    if len(numbers) > _MAX_NUMBERS or any(abs(number) > _MAX_NUMBER for number in numbers):
        raise CalibrationError(
            f"{_article(model)} {model} camera of {len(numbers)} parameters, the largest"
            f" {max(abs(number) for number in numbers):g}, is not one: check their order and units"
        )


def check_focal_lengths(model: str, fx_px: float, fy_px: float) -> None:
    """Refuse focal lengths that are not positive, or so short that a number divided by them is none.

    Raises
    ------
    CalibrationError
        If one is below a thousandth of a pixel.
    """
    if not min(fx_px, fy_px) >= SHORTEST_FOCAL_LENGTH_PX:
        raise CalibrationError(
            f"{_article(model)} {model} camera with focal lengths {fx_px:g} and {fy_px:g} is none: both must"
            " be positive"
        )


@dataclass(frozen=True, slots=True)
class FocalCamera:
    """The first fields of models with focal lengths.

    Attributes
    ----------
    width_px, height_px : int
    fx_px, fy_px : float
        Focal lengths.
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float


def check_with_distortion(camera: Any, *shape: float) -> None:
    """Make a camera's distortion coefficients floats, and refuse numbers that no calibration gives.

    Parameters
    ----------
    camera : a camera with focal lengths and `distortion`
    shape : float
        What else describes it.

    Raises
    ------
    CalibrationError
        As `check_parameters` and `check_focal_lengths`.
    """
    object.__setattr__(camera, "distortion", tuple(float(coefficient) for coefficient in camera.distortion))
    numbers = (*shape, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *camera.distortion)
    check_parameters(camera.model, camera.width_px, camera.height_px, numbers)
    check_focal_lengths(camera.model, camera.fx_px, camera.fy_px)


def _article(word: str) -> str:
    return "an" if word[0] in "aeio" else "a"


def on_image(pixel_px: FloatArray, width_px: int, height_px: int) -> BoolArray:
    """Whether pixels ``(..., 2)`` lie on the image, edges of the outermost pixels included; false for NaN."""
    return inside_image(pixel_px[..., 0], pixel_px[..., 1], width_px, height_px)


def inside_image(u_px: FloatArray, v_px: FloatArray, width_px: int, height_px: int) -> BoolArray:
    """`on_image` of columns and rows ``(...)``."""
    across = (u_px >= -0.5) & (u_px <= width_px - 0.5)
    return np.asarray(across & (v_px >= -0.5) & (v_px <= height_px - 0.5))


def nan_where_not(mask: BoolArray, vectors: FloatArray) -> FloatArray:
    """Vectors ``(..., k)`` with NaN in the rows whose mask ``(...)`` is false."""
    return np.where(mask[..., np.newaxis], vectors, np.nan)


class Columns(NamedTuple):
    """Vectors of the camera frame (RDF), one array ``(...)`` a component."""

    x: FloatArray
    y: FloatArray
    z: FloatArray


class PixelRays(NamedTuple):
    """Unit rays by component: the form in which a million of them are worked on."""

    ray: Columns
    """Undefined, not NaN, where `inside` is false."""
    by_u: Columns | None
    """Derivative by the pixel's column; None where not asked for."""
    by_v: Columns | None
    inside: BoolArray
    """True inside the model's domain and on the image."""

    def by_pixel(self) -> FloatArray:
        """Return the derivatives by column and row, ``(..., 3, 2)``; only where they were asked for."""
        if self.by_u is None or self.by_v is None:
            raise ValueError("rays were asked for without their slopes")
        return np.stack([np.stack(self.by_u, axis=-1), np.stack(self.by_v, axis=-1)], axis=-1)


@runtime_checkable
class CameraModel(Protocol):
    """Intrinsics of one camera: pixels from camera points and rays from pixels.

    Camera frame RDF: x right, y down, z forward. Pixel (0, 0) is the *centre* of the first pixel, as in
    OpenCV. All methods take any leading batch axes. Values outside the model's domain come back as NaN
    with ``False`` in the mask: a default coordinate is never invented. What is inside the domain but off the
    image keeps its true value, with ``False`` in the mask.
    """

    @property
    def model(self) -> str:
        """Name of the model, as rig files spell it: ``ftheta``, ``pinhole``, ``ocam`` and so on."""
        ...

    @property
    def width_px(self) -> int:
        """Image width."""
        ...

    @property
    def height_px(self) -> int:
        """Image height."""
        ...

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point.

        NaN if an edge is outside the model's domain.
        """
        ...

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points ``(..., 3)`` (any length, RDF) to pixels ``(..., 2)`` with a mask ``(...)``.

        The mask is true where the point is inside the model's domain *and* falls on the image.
        """
        ...

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit rays ``(..., 3)`` (RDF) of pixels ``(..., 2)`` with a mask ``(...)``.

        The mask is true where the pixel lies on the image and inside the model's domain.
        """
        ...

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> PixelRays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        Parameters
        ----------
        u_px, v_px : float64 (...)
        slopes : bool
        """
        ...


def sin_cos(angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine of each angle, from the tangent of its half.

    ``sin x = 2t / (1 + t²)`` and ``cos x = 2 / (1 + t²) - 1`` with ``t = tan(x / 2)``: NumPy computes eight
    tangents at a time where the processor can, but sines one by one, so that this takes a quarter of the
    time of `numpy.sin` and `numpy.cos`. They agree to 1e-15.

    Parameters
    ----------
    angle_rad : float64 (...)

    Returns
    -------
    sin, cos : float64 (...)
        NaN for NaN.
    """
    half = np.tan(0.5 * angle_rad)
    scale = 2.0 / (1.0 + half * half)
    return half * scale, scale - 1.0
