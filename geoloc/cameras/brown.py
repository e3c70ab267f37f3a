"""Brown's lens distortion, radial (plain or rational) and tangential, with a thin prism."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.monotonic import (
    MIN_SLOPE_RATIO,
    derivative,
    invert_rising,
    polynomial,
    smallest_root,
)
from geoloc.errors import CalibrationError

_NEWTON_ITERATIONS = 20
# In units of the focal length: 1e-12 of a 2000 px focal length is 2e-9 px.
_NEWTON_TOLERANCE = 1e-12
_OPENCV_ORDER = "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"


@dataclass(frozen=True, slots=True)
class BrownDistortion:
    """Distortion of a plane in units of the focal length, one-to-one up to `r_max`.

    With ``r² = x² + y²`` and the radial factor ``R = over(r²) / under(r²)``::

        x' = x R + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴
        y' = y R + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴

    Attributes
    ----------
    widest : float
        Radius before distortion beyond which there is nothing to see.
    over, under : tuple of float
        Ascending coefficients of r², both beginning with 1: ``(1, k1, k2, …)``.
    tangential : (p1, p2)
    prism : (s1, s2, s3, s4)
        Of a thin prism.
    r_max : float
        Radius before distortion up to which the radial part rises, at most `widest`. Derived.

    Notes
    -----
    OpenCV, "Camera Calibration and 3D Reconstruction", detailed description; Brown (1966); Weng, Cohen and
    Herniou (1992), doi:10.1109/34.159901, of the thin prism. The inverse is our own Newton iteration to
    machine precision: ``cv2.undistortPoints`` stops after 5 fixed-point steps unless told otherwise, 0.14 px
    off at k1 = -0.3.
    """

    widest: float
    over: tuple[float, ...] = (1.0,)
    under: tuple[float, ...] = (1.0,)
    tangential: tuple[float, ...] = (0.0, 0.0)
    prism: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    r_max: float = field(init=False, repr=False, compare=False)
    _radial_slope: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Find the domain."""
        slope = _slope_numerator(self.over, self.under)
        object.__setattr__(self, "_radial_slope", slope)
        object.__setattr__(self, "r_max", _radial_limit(slope, self.under, self.widest))

    @classmethod
    def of_opencv(cls, coefficients: tuple[float, ...], widest: float) -> BrownDistortion:
        """Distortion by OpenCV's coefficients: none, or the first 4, 5, 8 or 12 of `_OPENCV_ORDER`.

        Raises
        ------
        CalibrationError
            If they are of another number.
        """
        if len(coefficients) not in {0, 4, 5, 8, 12}:
            raise CalibrationError(
                f"{len(coefficients)} distortion coefficients given: expected 0, 4, 5, 8 or 12"
                f" ({_OPENCV_ORDER})"
            )
        k1, k2, p1, p2, k3, k4, k5, k6, *prism = (*coefficients, *(0.0,) * (12 - len(coefficients)))
        return cls(widest, (1.0, k1, k2, k3), (1.0, k4, k5, k6), (p1, p2), tuple(prism))

    def distort(self, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted plane coordinates ``(..., 2)`` and their Jacobian ``(..., 2, 2)``."""
        p1, p2 = self.tangential
        x, y = plane[..., 0], plane[..., 1]
        s = x * x + y * y
        over, under = polynomial(self.over, s), polynomial(self.under, s)
        factor = over / under
        # Derivative of the factor by s.
        factor_s = (
            polynomial(derivative(self.over), s) * under - over * polynomial(derivative(self.under), s)
        ) / under**2
        distorted = np.stack(
            [
                x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )
        cross = 2.0 * x * y * factor_s + 2.0 * p1 * x + 2.0 * p2 * y
        jacobian = np.stack(
            [
                np.stack([factor + 2.0 * x * x * factor_s + 2.0 * p1 * y + 6.0 * p2 * x, cross], axis=-1),
                np.stack([cross, factor + 2.0 * y * y * factor_s + 6.0 * p1 * y + 2.0 * p2 * x], axis=-1),
            ],
            axis=-2,
        )
        if any(self.prism):
            s1, s2, s3, s4 = self.prism
            distorted += np.stack([(s1 + s2 * s) * s, (s3 + s4 * s) * s], axis=-1)
            slope = 2.0 * np.stack([s1 + 2.0 * s2 * s, s3 + 2.0 * s4 * s], axis=-1)
            jacobian += slope[..., np.newaxis] * plane[..., np.newaxis, :]
        return distorted, jacobian

    def plane_by_distorted(self, plane: FloatArray) -> tuple[FloatArray, ...]:
        """Derivatives (x by x', y by x', x by y', y by y') of the plane by its distorted coordinates."""
        jacobian = self.distort(plane)[1]
        determinant = _determinant(jacobian)
        return (
            jacobian[..., 1, 1] / determinant,
            -jacobian[..., 1, 0] / determinant,
            -jacobian[..., 0, 1] / determinant,
            jacobian[..., 0, 0] / determinant,
        )

    def undistort(self, distorted: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Plane coordinates ``(..., 2)`` before distortion, and where they were found inside the domain."""
        radius = np.hypot(distorted[..., 0], distorted[..., 1])
        finite = np.isfinite(radius)
        target = np.where(finite[..., np.newaxis], distorted, 0.0)
        radius = np.where(finite, radius, 0.0)
        undistorted = invert_rising(self._radius, self._radius_slope, radius, self.r_max)
        inside = finite & ~np.isnan(undistorted)
        start = np.where(np.isnan(undistorted), self.r_max, undistorted)
        plane = target * (start / np.where(radius > 0.0, radius, 1.0))[..., np.newaxis]
        if not any((*self.tangential, *self.prism)):
            return plane, inside
        return self._polish(plane, target, finite)

    def _radius(self, r: FloatArray) -> FloatArray:
        """Distorted radius of an undistorted one, by the radial part alone."""
        s = r * r
        return r * polynomial(self.over, s) / polynomial(self.under, s)

    def _radius_slope(self, r: FloatArray) -> FloatArray:
        s = r * r
        return polynomial(self._radial_slope, s) / polynomial(self.under, s) ** 2

    def _polish(
        self, plane: FloatArray, target: FloatArray, wanted: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Newton's method in two dimensions from a start near the answer."""
        for _ in range(_NEWTON_ITERATIONS):
            distorted, jacobian = self.distort(plane)
            residual = target - distorted
            if (np.abs(residual) <= _NEWTON_TOLERANCE).all():
                break
            plane = plane + _newton_step(jacobian, residual)
            reached = np.hypot(plane[..., 0], plane[..., 1])
            plane = plane * (self.r_max / np.maximum(reached, self.r_max))[..., np.newaxis]
        distorted, jacobian = self.distort(plane)
        solved = (np.abs(target - distorted) <= 10.0 * _NEWTON_TOLERANCE).all(-1)
        return plane, wanted & solved & one_to_one(jacobian)


def _determinant(jacobian: FloatArray) -> FloatArray:
    return np.asarray(jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0])


def one_to_one(jacobian: FloatArray) -> BoolArray:
    """Where the distortion keeps the plane from folding: well away from a singular Jacobian."""
    return np.asarray(_determinant(jacobian) > MIN_SLOPE_RATIO**2)


def _newton_step(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Residual through the inverse Jacobian; the residual itself where that has no use."""
    usable = one_to_one(jacobian)
    matrix = np.where(usable[..., np.newaxis, np.newaxis], jacobian, np.eye(2))
    x, y = residual[..., 0], residual[..., 1]
    step = np.stack(
        [
            matrix[..., 1, 1] * x - matrix[..., 0, 1] * y,
            matrix[..., 0, 0] * y - matrix[..., 1, 0] * x,
        ],
        axis=-1,
    )
    return np.asarray(step / _determinant(matrix)[..., np.newaxis])


def _slope_numerator(numerator: tuple[float, ...], denominator: tuple[float, ...]) -> tuple[float, ...]:
    """Numerator, in s = r², of the slope by r of r N(s)/D(s); its denominator is D(s)²."""
    N, D = Polynomial(numerator), Polynomial(denominator)
    return tuple((N * D + Polynomial((0.0, 2.0)) * (N.deriv() * D - N * D.deriv())).coef)


def _radial_limit(slope: tuple[float, ...], denominator: tuple[float, ...], widest: float) -> float:
    """Largest r up to which the radial part rises (`MIN_SLOPE_RATIO`) and has no pole."""
    flat = Polynomial(slope) - MIN_SLOPE_RATIO * Polynomial(denominator) ** 2
    # Before a pole the radius grows without bound: no image reaches the last thousandth of the way.
    s = min(smallest_root(tuple(flat.coef), widest**2), 0.999 * smallest_root(denominator, widest**2 / 0.999))
    return math.sqrt(s)
