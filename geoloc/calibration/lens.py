"""Camera models as functions of their parameters, with derivatives: what a calibration fits.

`geoloc.cameras` has the models with their parameters fixed. Here the parameters are unknowns: a lens projects
points for any of them, and says how the pixel moves with each. `Lens.camera` builds the fixed model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from geoloc.cameras import CameraModel

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Projection(NamedTuple):
    """Pixels of n points and how they move; undefined where `valid` is false."""

    pixel_px: FloatArray
    """(n, 2)"""
    by_point: FloatArray
    """(n, 2, 3), pixels a metre."""
    by_lens: FloatArray
    """(n, 2, p)"""
    valid: BoolArray
    """(n,): inside the model's domain."""


@dataclass(frozen=True, slots=True)
class RadialCurve:
    """A lens as samples of angle from the axis and radius in the image, both rising, and its centre."""

    theta_rad: FloatArray
    radius_px: FloatArray
    cx_px: float
    cy_px: float


class Lens(Protocol):
    """One camera model with unknown parameters."""

    @property
    def name(self) -> str:
        """Name of the model: ``ftheta``, ``fisheye``, ``pinhole``, ``ocam``."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the p unknowns, units included."""
        ...

    @property
    def units(self) -> FloatArray:
        """(p,): an unknown times this is the parameter as calibration files write it."""
        ...

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)`` (RDF) with parameters ``(p,)``."""
        ...

    def start(self, curve: RadialCurve) -> FloatArray:
        """Parameters ``(p,)`` that come near a radial curve."""
        ...

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the model with these parameters.

        Raises
        ------
        CalibrationError
            If they make no camera.
        """
        ...


def least_squares(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve ``matrix @ x = right`` in the sense of least squares."""
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])
