"""The protocol behind which every camera model stands."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


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


class Rays(NamedTuple):
    """Unit rays by component: the form in which a million of them are worked on."""

    ray: Columns
    """Undefined, not NaN, where `inside` is false."""
    by_u: Columns | None
    """Derivative by the pixel's column; None where not asked for."""
    by_v: Columns | None
    inside: BoolArray
    """True inside the model's domain and on the image."""


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
        """Name of the model as rig files spell it: ``ftheta``, ``pinhole``."""
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

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> Rays:
        """Give the rays of `camera_ray_from_pixel` by component, with their derivatives by pixel if asked.

        Parameters
        ----------
        u_px, v_px : float64 (...)
        slopes : bool
        """
        ...
