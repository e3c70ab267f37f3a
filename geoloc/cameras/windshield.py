"""A camera behind a windscreen that bends its rays: NVIDIA's bivariate windshield model."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray
from geoloc.cameras.base import CameraModel, Columns, PixelRays, check_parameters, nan_where_not
from geoloc.errors import CalibrationError

_MOST_DEG = 10.0
"""No screen turns the ray along the axis so far; polynomials in another order or unit do."""
_MOST_STRETCH = 0.5
_STEPS = 20
_CLOSED_RAD = 1e-14
_EDGE = 1.0 - 1e-9


@dataclass(frozen=True, slots=True)
class Windshield:
    """How a windscreen bends rays, as the polynomials of a rig file say.

    A ray ``(x, y, z)`` of the camera frame (RDF), unit length, has the angles ``φ = asin x`` and ``θ = asin
    y``. Each polynomial gives one of the angles on the other side of the screen, ``φ' = Σ c φ^i θ^j`` and
    likewise θ', with the terms in the order of rising i within rising j: ``1 φ φ² θ φθ θ²`` of degree 2. The
    ray there is ``(sin φ', sin θ', √(1 - sin² φ' - sin² θ'))``. The other direction is always the numerical
    inverse of these polynomials, so that pixel → ray → pixel closes to rounding.

    Attributes
    ----------
    horizontal, vertical : tuple of float
        Of φ and θ: 3, 6, 10, 15 or 21 numbers, degrees 1 to 5. NVIDIA's have 6 and 15.
    forward : bool
        Whether they lead from the ray outside to the ray into the camera, or from within to outside.
    horizontal_inverse, vertical_inverse : tuple of float
        Approximations of the inverse, which a file may have for programs that do not invert: not computed
        with, but written again. Empty where there are none.

    Raises
    ------
    CalibrationError
        If the numbers are of another count or not finite, or are no screen's: a ray along the axis is turned
        by more than 10 degrees, or rays near it are spread or squeezed by more than half.

    Notes
    -----
    NVIDIA DriveWorks, ``RigTypes.h``, ``dwWindshieldModelConfig``; NVIDIA ncore, "Sensor models",
    ``BivariateWindshieldModel``.
    """

    horizontal: tuple[float, ...]
    vertical: tuple[float, ...]
    forward: bool = True
    horizontal_inverse: tuple[float, ...] = ()
    vertical_inverse: tuple[float, ...] = ()
    _tables: tuple[FloatArray, FloatArray] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("horizontal", "vertical", "horizontal_inverse", "vertical_inverse"):
            object.__setattr__(self, name, tuple(float(number) for number in getattr(self, name)))
            check_parameters("windshield", 1, 1, (*getattr(self, name), 0.0))
        tables = (_table("horizontal", self.horizontal), _table("vertical", self.vertical))
        object.__setattr__(self, "_tables", tables)
        (phi, theta), slopes = self._reference(np.zeros(()), np.zeros(()))
        turned_deg = math.degrees(math.hypot(float(phi), float(theta)))
        if turned_deg > _MOST_DEG or np.abs(np.reshape(slopes, (2, 2)) - np.eye(2)).max() > _MOST_STRETCH:
            raise CalibrationError(
                f"polynomials that turn the ray along the axis by {turned_deg:.1f}° and the rays beside it by"
                " another part of their angle are no windshield's: check their order and unit"
            )

    @property
    def is_identity(self) -> bool:
        """Whether no ray is bent."""
        wanted = (np.array([0.0, 1.0]), np.array([1.0, 0.0]))
        return all(
            table[1, 0] == i and table[0, 1] == j and np.count_nonzero(table) == 1
            for table, (j, i) in zip(self._tables, wanted, strict=True)
        )

    def into_camera(self, ray: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Rays ``(..., 3)`` inside the car of rays outside (any length, RDF), with a mask ``(...)``.

        NaN with a false mask where the polynomials are no longer one-to-one, and behind the camera.
        """
        with np.errstate(all="ignore"):
            unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
            bent, _, inside = self._bent(*np.moveaxis(unit, -1, 0), direct=self.forward)
        return nan_where_not(inside, np.stack(bent, axis=-1)), inside

    def out_of_camera(
        self, ray: Columns, slopes: tuple[Columns, Columns] | None = None
    ) -> tuple[Columns, tuple[Columns, Columns] | None, BoolArray]:
        """Unit rays outside of unit rays inside the car, by component.

        Parameters
        ----------
        ray : Columns
        slopes : (Columns, Columns), optional
            Derivatives of `ray` by two variables.

        Returns
        -------
        ray : Columns
            Undefined where `inside` is false.
        slopes : (Columns, Columns) or None
            Derivatives of it by the same two.
        inside : bool (...)
        """
        with np.errstate(all="ignore"):
            bent, jacobian, inside = self._bent(*ray, direct=not self.forward)
            if slopes is None:
                return bent, None, inside
            by_one, by_other = (_chained(ray, bent, jacobian, by) for by in slopes)
        return bent, (by_one, by_other), inside

    def _bent(
        self, x: FloatArray, y: FloatArray, z: FloatArray, *, direct: bool
    ) -> tuple[Columns, tuple[FloatArray, ...], BoolArray]:
        """The ray on the other side, the derivatives of its angles by these angles, and whether it is one."""
        phi, theta = np.arcsin(x), np.arcsin(y)
        if direct:
            (far_phi, far_theta), slopes = self._reference(phi, theta)
            jacobian, closed = slopes, _determinant(slopes) > 0.0
        else:
            far_phi, far_theta, slopes, closed = self._inverted(phi, theta)
            a, b, c, d = slopes
            det = _determinant(slopes)
            jacobian = (d / det, -b / det, -c / det, a / det)
        far_x, far_y = np.sin(far_phi), np.sin(far_theta)
        square = far_x * far_x + far_y * far_y
        folded = np.maximum(np.abs(far_phi), np.abs(far_theta)) >= 0.5 * math.pi
        inside = closed & ~folded & (z > 0.0) & (square < _EDGE)
        return Columns(far_x, far_y, np.sqrt(1.0 - square)), jacobian, inside

    def _reference(
        self, phi: FloatArray, theta: FloatArray
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, ...]]:
        """Both polynomials, and their derivatives: φ' by φ and θ, θ' by φ and θ."""
        values = [_value(table, phi, theta) for table in self._tables]
        slopes = [
            _value(poly.polyder(table, axis=axis), phi, theta) for table in self._tables for axis in (0, 1)
        ]
        return (values[0], values[1]), tuple(slopes)

    def _inverted(
        self, phi: FloatArray, theta: FloatArray
    ) -> tuple[FloatArray, FloatArray, tuple[FloatArray, ...], BoolArray]:
        """Angles whose polynomials are these, by Newton's method from these: screens bend little."""
        x, y = np.array(phi), np.array(theta)
        for _ in range(_STEPS):
            (at_x, at_y), slopes = self._reference(x, y)
            det = _determinant(slopes)
            off_x, off_y = at_x - phi, at_y - theta
            x = x - (slopes[3] * off_x - slopes[1] * off_y) / det
            y = y - (slopes[0] * off_y - slopes[2] * off_x) / det
            if not (np.hypot(off_x, off_y) > _CLOSED_RAD).any():
                break
        (at_x, at_y), slopes = self._reference(x, y)
        closed = np.hypot(at_x - phi, at_y - theta) <= 10.0 * _CLOSED_RAD
        return x, y, slopes, closed & (_determinant(slopes) > 0.0)


@dataclass(frozen=True, slots=True)
class WindshieldCamera:
    """A camera behind a windscreen: its lens, and the screen that bends the rays before they reach it.

    Attributes
    ----------
    lens : CameraModel
        The camera without the screen.
    windshield : Windshield
    """

    lens: CameraModel
    windshield: Windshield

    @property
    def model(self) -> str:
        """Name of the lens's model, and that it is behind a screen."""
        return f"{self.lens.model} behind a windshield"

    @property
    def width_px(self) -> int:
        """See `CameraModel`."""
        return self.lens.width_px

    @property
    def height_px(self) -> int:
        """See `CameraModel`."""
        return self.lens.height_px

    @property
    def horizontal_fov_rad(self) -> float:
        """See `CameraModel`: both angles from the axis together, in the row of the lens's principal point."""
        row_px = self.lens.pixel_from_camera_point(np.array([0.0, 0.0, 1.0]))[0][1]
        edges_px = np.array([[-0.5, row_px], [self.width_px - 0.5, row_px]])
        rays = self.camera_ray_from_pixel(edges_px)[0]
        left, right = np.copysign(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2]), rays[:, 0])
        return float(right - left)

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        ray, inside = self.windshield.into_camera(np.asarray(point_camera, dtype=np.float64))
        pixel, seen = self.lens.pixel_from_camera_point(ray)
        return pixel, seen & inside

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `CameraModel`."""
        ray, seen = self.lens.camera_ray_from_pixel(pixel_px)
        outside, _, inside = self.windshield.out_of_camera(Columns(*np.moveaxis(ray, -1, 0)))
        return nan_where_not(inside, np.stack(outside, axis=-1)), seen & inside

    def rays(self, u_px: FloatArray, v_px: FloatArray, *, slopes: bool = False) -> PixelRays:
        """See `CameraModel`."""
        rays = self.lens.rays(u_px, v_px, slopes=slopes)
        by_pixel = None if rays.by_u is None or rays.by_v is None else (rays.by_u, rays.by_v)
        ray, turned, inside = self.windshield.out_of_camera(rays.ray, by_pixel)
        by_u, by_v = turned or (None, None)
        return PixelRays(ray, by_u, by_v, rays.inside & inside)


def _table(name: str, coefficients: tuple[float, ...]) -> FloatArray:
    """Coefficients ``[i, j]`` of φ^i θ^j."""
    degree = (math.isqrt(8 * len(coefficients) + 1) - 3) // 2
    if not 1 <= degree <= 5 or len(coefficients) != (degree + 1) * (degree + 2) // 2:
        raise CalibrationError(
            f"the {name} windshield polynomial has {len(coefficients)} numbers: expected 3, 6, 10, 15 or 21"
        )
    table = np.zeros((degree + 1, degree + 1))
    left = iter(coefficients)
    for j in range(degree + 1):
        for i in range(degree + 1 - j):
            table[i, j] = next(left)
    return table


def _value(table: NDArray[np.floating[Any]], phi: FloatArray, theta: FloatArray) -> FloatArray:
    return np.asarray(poly.polyval2d(phi, theta, table), dtype=np.float64)


def _determinant(slopes: tuple[FloatArray, ...]) -> FloatArray:
    a, b, c, d = slopes
    return a * d - b * c


def _chained(ray: Columns, bent: Columns, jacobian: tuple[FloatArray, ...], by: Columns) -> Columns:
    """Derivative of the bent ray from that of the ray: dφ = dx / cos φ, and back."""
    cos_phi, cos_theta = (np.sqrt(1.0 - part * part) for part in ray[:2])
    d_phi, d_theta = by.x / cos_phi, by.y / cos_theta
    a, b, c, d = jacobian
    x = np.sqrt(1.0 - bent.x * bent.x) * (a * d_phi + b * d_theta)
    y = np.sqrt(1.0 - bent.y * bent.y) * (c * d_phi + d * d_theta)
    return Columns(x, y, -(bent.x * x + bent.y * y) / bent.z)
