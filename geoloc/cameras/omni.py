"""Omnidirectional cameras behind one or two spheres: Mei, double sphere and extended unified."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import Columns, check_with_distortion
from geoloc.cameras.brown import BrownDistortion
from geoloc.cameras.monotonic import MIN_SLOPE_RATIO
from geoloc.cameras.planar import PlanarCamera
from geoloc.errors import CalibrationError

# Where the plane is a tangent, 89° for ξ = 0; the bound keeps every radius finite.
_WIDEST = math.tan(math.radians(89.0))
_THETA_STEPS = 3_601
# Radii up to here come back from the closed form of the inverse as the angle that they came from.
_SAME_ANGLE_RAD = 1e-6
# Keeps roots real beyond the domain, where what comes out is not used.
_LEAST_SQUARE = 1e-12


@dataclass(frozen=True, slots=True)
class OmniCamera(PlanarCamera):
    """Intrinsics of Mei (Kalibr's ``omni``), of the double sphere (``ds``) and extended unified (``eucm``).

    With ``w = Z + ξ`` and ``d = sqrt(β (X² + Y²) + w²)``, the point (X, Y, Z) at distance 1 is seen in the
    plane of this `PlanarCamera` at ``(X, Y) / (α d + (1 - α) w)``.

    ======================  =============  ======  ======
    model                   ξ              α       β
    ======================  =============  ======  ======
    Mei, ``omni``           0 or more      0       1
    double sphere, ``ds``   more than -1   0 to 1  1
    ``eucm``                0              0 to 1  over 0
    ======================  =============  ======  ======

    All zero, with β = 1, is the pinhole camera. The domain is the part of the plane over which the radius
    rises with the angle and the distortion is one-to-one.

    Attributes
    ----------
    width_px, height_px : int
    xi : float
    fx_px, fy_px : float
        Focal lengths: of the plane; on the axis a radian is ``f / (1 + ξ)`` pixels.
    cx_px, cy_px : float
        Principal point; (0, 0) is the centre of the first pixel.
    distortion : tuple of float
        As in `PinholeCamera`.
    alpha, beta : float
    theta_max_rad : float
        Angle from the axis at which the domain ends, distortion aside. Derived.

    Raises
    ------
    CalibrationError
        If a number is not finite or outside its range, a focal length or the image is not positive, or
        `distortion` is of another length.

    Notes
    -----
    Mei and Rives (2007), doi:10.1109/ROBOT.2007.364084; Usenko, Demmel and Cremers (2018),
    doi:10.1109/3DV.2018.00069; Khomutenko, Garcia and Martinet (2016), doi:10.1109/LRA.2015.2502921.
    """

    model: ClassVar[str] = "omni"

    width_px: int
    height_px: int
    xi: float
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = ()
    alpha: float = 0.0
    beta: float = 1.0
    theta_max_rad: float = field(init=False, repr=False, compare=False)
    _brown: BrownDistortion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers and find the domain."""
        check_with_distortion(self, self.xi, self.alpha, self.beta)
        if not (self.xi > -1.0 and 0.0 <= self.alpha <= 1.0 and self.beta > 0.0):
            raise CalibrationError(
                f"an omni camera with xi {self.xi:g}, alpha {self.alpha:g} and beta {self.beta:g} is none: xi"
                " must be over -1, alpha from 0 to 1, beta over 0"
            )
        theta_max_rad, r_max = self._limits()
        object.__setattr__(self, "theta_max_rad", theta_max_rad)
        object.__setattr__(self, "_brown", BrownDistortion.of_opencv(self.distortion, r_max))

    def _plane_from_point(self, point: FloatArray) -> tuple[FloatArray, BoolArray]:
        length = np.linalg.norm(point, axis=-1)
        inside = np.isfinite(length) & (length > 0.0)
        x, y, z = (
            np.where(inside, point[..., i], z) / np.where(inside, length, 1.0)
            for i, z in enumerate((0, 0, 1))
        )
        across = np.hypot(x, y)
        inside &= np.arctan2(across, z) <= self.theta_max_rad
        depth = np.where(inside, self._depth(across, z), 1.0)
        inside &= across <= self._brown.r_max * depth
        plane = np.stack([x / depth, y / depth], axis=-1)
        return np.where(inside[..., np.newaxis], plane, 0.0), inside

    def _depth(self, across: FloatArray, z: FloatArray) -> FloatArray:
        """What the plane divides by, at a unit ray's distance from the axis and along it."""
        w = z + self.xi
        return np.asarray(self.alpha * np.sqrt(self.beta * across * across + w * w) + (1.0 - self.alpha) * w)

    def _limits(self) -> tuple[float, float]:
        """Angle and radius up to which the plane's radius rises and the inverse is the inverse."""
        theta = np.linspace(0.0, math.pi, _THETA_STEPS)
        across, z = np.sin(theta), np.cos(theta)
        depth = self._depth(across, z)
        seen = across <= _WIDEST * depth
        radius = np.where(seen, across, 0.0) / np.where(seen, depth, 1.0)
        ray = self._lifted(np.stack([radius, np.zeros_like(radius)], axis=-1), slopes=False)[0]
        seen &= np.abs(np.arctan2(ray.x, ray.z) - theta) <= _SAME_ANGLE_RAD
        steepness = np.gradient(radius, theta[1])
        seen &= steepness >= MIN_SLOPE_RATIO * steepness[0]
        last = int(np.argmin(seen)) - 1 if not seen.all() else _THETA_STEPS - 1
        if last < 1:
            raise CalibrationError("the omni camera sees nothing beside its axis: check xi, alpha and beta")
        return float(theta[last]), float(radius[last])

    def _lifted(self, plane: FloatArray, *, slopes: bool) -> tuple[Columns, tuple[Columns, Columns] | None]:
        """Rays ``s (x, y, m) - (0, 0, ξ)``, where s and m depend on r² = x² + y² alone."""
        x, y = plane[..., 0], plane[..., 1]
        square = x * x + y * y
        a, b = self.alpha, self.beta
        # The plane's point is at depth m before the second sphere, …
        bent = (1.0 - 2.0 * a) * b
        root = np.sqrt(np.maximum(1.0 + bent * square, _LEAST_SQUARE))
        under = a * root + 1.0 - a
        m = (1.0 - b * a * a * square) / under
        m_slope = (-b * a * a - 0.5 * m * a * bent / root) / under
        # … and s times as far on the first.
        bent = 1.0 - self.xi * self.xi
        root = np.sqrt(np.maximum(m * m + bent * square, _LEAST_SQUARE))
        under = m * m + square
        s = (m * self.xi + root) / under
        ray = Columns(s * x, s * y, s * m - self.xi)
        if not slopes:
            return ray, None
        root_slope = (m * m_slope + 0.5 * bent) / root
        # Twice the slopes of s and z by r²: r² changes by 2 x dx + 2 y dy.
        ds = 2.0 * (m_slope * self.xi + root_slope - s * (2.0 * m * m_slope + 1.0)) / under
        dz = ds * m + 2.0 * s * m_slope
        cross = x * y * ds
        return ray, (Columns(s + x * x * ds, cross, x * dz), Columns(cross, s + y * y * ds, y * dz))
