"""The f-theta camera of NVIDIA DriveWorks: radius in the image as a polynomial of the ray's angle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.base import check_parameters
from geoloc.cameras.monotonic import derivative, invert_rising_polynomial, polynomial, reach, rising_limit
from geoloc.cameras.radial import LinearTerms, RadialCamera
from geoloc.errors import CalibrationError

# A constant term below this (about a thousandth of a pixel) is rounding in a file, above it another model.
_CONSTANT_TOLERANCE = {"theta_from_r": 1e-6, "r_from_theta": 1e-3}
_MAX_DISAGREEMENT_PX = 2.0
# No calibration means anything farther out than this many diagonals of its image.
_MAX_DIAGONALS = 10.0


@dataclass(frozen=True, slots=True)
class FThetaCamera(RadialCamera):
    """F-theta intrinsics: a `RadialCamera` with a polynomial, in either of its directions.

    One polynomial is the *reference*, and the other direction is always its numerical inverse, so that pixel
    → ray → pixel closes to rounding. Where both are given, `theta_from_r` is the reference and
    `r_from_theta`, usually a fitted approximation of the inverse, is only checked against it.

    The domain is where the reference rises (`r_max_px`, `theta_max_rad`), at most θ = π and ten diagonals of
    the image.

    Attributes
    ----------
    width_px, height_px : int
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    theta_from_r : tuple of float or None
        Ascending coefficients, pixels to radians (``bw-poly``, ``pixeldistance-to-angle``). No constant term.
    r_from_theta : tuple of float or None
        Ascending coefficients, radians to pixels (``angle-to-pixeldistance``). No constant term.
    c, d, e : float
        Linear terms. All zero means none were calibrated: the identity.
    r_max_px, theta_max_rad : float
        Limits of the domain, derived.

    Raises
    ------
    CalibrationError
        If there is no polynomial, it does not rise from zero, the linear terms are singular, a number is not
        finite, or the two polynomials differ by more than 2 pixels on the image.

    Notes
    -----
    NVIDIA DriveWorks 4.0, "Camera models"; pixel centres as in NVIDIA ncore, "Sensor models".
    """

    model: ClassVar[str] = "ftheta"

    width_px: int
    height_px: int
    cx_px: float
    cy_px: float
    theta_from_r: tuple[float, ...] | None = None
    r_from_theta: tuple[float, ...] | None = None
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    r_max_px: float = field(init=False, repr=False, compare=False)
    theta_max_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        if self.c == 0.0 and self.d == 0.0 and self.e == 0.0:
            object.__setattr__(self, "c", 1.0)
        for name, tolerance in _CONSTANT_TOLERANCE.items():
            if getattr(self, name) is not None:
                coefficients = tuple(float(coefficient) for coefficient in getattr(self, name))
                object.__setattr__(self, name, _without_constant(name, coefficients, tolerance))
        self._check_numbers()
        r_max_px, theta_max_rad = self._domain()
        object.__setattr__(self, "r_max_px", r_max_px)
        object.__setattr__(self, "theta_max_rad", theta_max_rad)
        self._check_agreement()

    @property
    def _linear(self) -> LinearTerms:
        return LinearTerms(self.c, self.d, self.e)

    def _theta_from_radius(self, radius_px: FloatArray) -> FloatArray:
        if self.theta_from_r is not None:
            return polynomial(self.theta_from_r, radius_px)
        return invert_rising_polynomial(self.r_from_theta or (), radius_px, self.theta_max_rad)

    def _theta_slope(self, radius_px: FloatArray, theta_rad: FloatArray) -> FloatArray:
        """Derivative of the angle by the radius, at a pair of both."""
        if self.theta_from_r is not None:
            return polynomial(derivative(self.theta_from_r), radius_px)
        return 1.0 / polynomial(derivative(self.r_from_theta or ()), theta_rad)

    def _radius_from_theta(self, theta_rad: FloatArray) -> FloatArray:
        if self.theta_from_r is not None:
            return invert_rising_polynomial(self.theta_from_r, theta_rad, self.r_max_px)
        return polynomial(self.r_from_theta or (), theta_rad)

    def _domain(self) -> tuple[float, float]:
        """Largest radius and angle up to which the reference polynomial rises."""
        reference = self.theta_from_r or self.r_from_theta
        if reference is None:
            raise CalibrationError("an f-theta camera needs a polynomial: theta_from_r or r_from_theta")
        widest = (_MAX_DIAGONALS * self._diagonal_px(), math.pi)
        x_max, y_max = widest if self.theta_from_r is not None else widest[::-1]
        limit = rising_limit(reference, x_max)
        if limit <= 0.0:
            raise CalibrationError(f"the f-theta polynomial {reference} does not rise from zero")
        limit = reach(reference, y_max, limit)
        value = float(polynomial(reference, np.array(limit)))
        return (limit, value) if self.theta_from_r is not None else (value, limit)

    def _diagonal_px(self) -> float:
        """A length no shorter than the way from the principal point to any corner of the image."""
        return math.hypot(self.width_px + abs(self.cx_px), self.height_px + abs(self.cy_px))

    def _check_numbers(self) -> None:
        numbers = [self.cx_px, self.cy_px, self.c, self.d, self.e]
        numbers += [*(self.theta_from_r or ()), *(self.r_from_theta or ())]
        check_parameters("f-theta", self.width_px, self.height_px, numbers)
        if self._linear.singular:
            raise CalibrationError(f"the linear terms c={self.c}, d={self.d}, e={self.e} are singular")

    def _check_agreement(self) -> None:
        if self.theta_from_r is None or self.r_from_theta is None:
            return
        corner = math.hypot(
            max(self.cx_px, self.width_px - self.cx_px), max(self.cy_px, self.height_px - self.cy_px)
        )
        radius = np.linspace(0.0, min(corner, self.r_max_px), 64)
        apart = np.abs(polynomial(self.r_from_theta, polynomial(self.theta_from_r, radius)) - radius)
        if apart.max() > _MAX_DISAGREEMENT_PX:
            raise CalibrationError(
                f"the two f-theta polynomials differ by up to {apart.max():.1f} px at r = "
                f"{radius[apart.argmax()]:.0f} px: they are not inverses of each other"
            )


def _without_constant(name: str, coefficients: tuple[float, ...], tolerance: float) -> tuple[float, ...]:
    if len(coefficients) < 2 or not abs(coefficients[0]) <= tolerance:
        raise CalibrationError(
            f"{name} = {coefficients} must be a constant term of 0 and at least a linear one"
        )
    return (0.0, *coefficients[1:])
