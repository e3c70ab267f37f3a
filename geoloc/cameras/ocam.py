"""The omnidirectional camera of Scaramuzza: the ray's depth as a polynomial of the radius in the image."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.polynomial import Polynomial

from geoloc.arrays import FloatArray
from geoloc.cameras.base import SHORTEST_FOCAL_LENGTH_PX, check_parameters
from geoloc.cameras.monotonic import MIN_SLOPE_RATIO, derivative, invert_rising, polynomial, smallest_root
from geoloc.cameras.radial import LinearTerms, RadialCamera
from geoloc.errors import CalibrationError

# No calibration means anything farther out than this many diagonals of its image.
_MAX_DIAGONALS = 10.0


@dataclass(frozen=True, slots=True)
class OcamCamera(RadialCamera):
    """Scaramuzza's intrinsics, as OCamCalib fits them: a `RadialCamera`.

    With ρ the radius in pixels before the linear terms and ``f(ρ) = a0 + a2 ρ² + a3 ρ³ + …``, a0 negative,
    the ray (RDF) is along ``(x, y, -f(ρ))``: ``θ = atan2(ρ, -f(ρ))``. OCamCalib's own axes are row, column
    and backward; its files put the row first in the linear terms, which `geoloc.calibration_files` converts
    without loss.

    The domain is where the angle from the axis rises with ρ, at most ten diagonals of the image: for a
    fisheye far beyond 90°. Pixel → ray is the formula itself; ray → pixel its numerical inverse, so that both
    close to rounding. The inverse polynomial that OCamCalib fits beside it is not used: it leaves up to some
    0.02 px.

    Attributes
    ----------
    width_px, height_px : int
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    polynomial : tuple of float
        ``(a0, 0, a2, a3, …)``, ascending, pixels.
    c, d, e : float
        Linear terms.
    r_max_px, theta_max_rad : float
        Limits of the domain, derived.

    Raises
    ------
    CalibrationError
        If a number is not finite, the image is empty, the polynomial's constant is not negative or its linear
        term not zero, or the linear terms are singular.

    Notes
    -----
    Scaramuzza, Martinelli and Siegwart (2006), doi:10.1109/IROS.2006.282372; OCamCalib toolbox.
    """

    model: ClassVar[str] = "ocam"

    width_px: int
    height_px: int
    cx_px: float
    cy_px: float
    polynomial: tuple[float, ...]
    c: float = 1.0
    d: float = 0.0
    e: float = 0.0
    r_max_px: float = field(init=False, repr=False, compare=False)
    theta_max_rad: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        object.__setattr__(self, "polynomial", tuple(float(coefficient) for coefficient in self.polynomial))
        numbers = (self.cx_px, self.cy_px, self.c, self.d, self.e, *self.polynomial)
        check_parameters("ocam", self.width_px, self.height_px, numbers)
        if not self.polynomial or self.polynomial[0] > -SHORTEST_FOCAL_LENGTH_PX:
            raise CalibrationError(
                f"the ocam polynomial {self.polynomial} must begin with a negative constant, minus the focal"
                " length in pixels"
            )
        if len(self.polynomial) > 1 and self.polynomial[1] != 0.0:
            raise CalibrationError(
                f"the linear term of the ocam polynomial is {self.polynomial[1]}: OCamCalib always has 0"
            )
        if self._linear.singular:
            raise CalibrationError(f"the linear terms c={self.c}, d={self.d}, e={self.e} are singular")
        r_max_px = self._rising_limit()
        object.__setattr__(self, "r_max_px", r_max_px)
        object.__setattr__(self, "theta_max_rad", float(self._theta_from_radius(np.array(r_max_px))))

    @property
    def _linear(self) -> LinearTerms:
        return LinearTerms(self.c, self.d, self.e)

    def _theta_from_radius(self, radius_px: FloatArray) -> FloatArray:
        return np.arctan2(radius_px, -polynomial(self.polynomial, radius_px))

    def _radius_from_theta(self, theta_rad: FloatArray) -> FloatArray:
        return invert_rising(self._theta_from_radius, self._slope, theta_rad, self.r_max_px)

    def _theta_slope(self, radius_px: FloatArray, _theta_rad: FloatArray) -> FloatArray:
        return self._slope(radius_px)

    def _slope(self, radius_px: FloatArray) -> FloatArray:
        z = -polynomial(self.polynomial, radius_px)
        rise = z + radius_px * polynomial(derivative(self.polynomial), radius_px)
        return np.asarray(rise / (radius_px * radius_px + z * z))

    def _rising_limit(self) -> float:
        """Radius at which the slope of the angle falls to `MIN_SLOPE_RATIO` of that on the axis."""
        f, r = Polynomial(self.polynomial), Polynomial((0.0, 1.0))
        flat = (r * f.deriv() - f) * -self.polynomial[0] - MIN_SLOPE_RATIO * (r * r + f * f)
        reach = math.hypot(self.width_px + abs(self.cx_px), self.height_px + abs(self.cy_px))
        return smallest_root(tuple(flat.coef), _MAX_DIAGONALS * reach)
