"""Lenses that are round about their axis, as functions of their parameters: f-theta, ocam, fisheye."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics.lens import Projection, RadialCurve, least_squares
from geoloc.cameras import CameraModel, FisheyeCamera, FThetaCamera, OcamCamera
from geoloc.cameras.monotonic import (
    derivative,
    invert_rising,
    invert_rising_polynomial,
    polynomial,
    rising_limit,
    smallest_root,
)

_ON_AXIS = 1e-12
_FARTHEST = 4.0
"""Half diagonals of the image beyond which no radius is looked for."""


@dataclass(frozen=True, slots=True)
class _PolynomialLens:
    """What f-theta and ocam share: a centre, linear terms, and a polynomial of the radius in the image.

    The radius is counted in half diagonals of the image, so that all coefficients are of the same order.
    `linear` frees c and d, and e is as d. Were e free by itself, the image could turn against the boards'
    poses: nothing in pictures of boards tells the two apart. With d and e alike the image is not turned.
    """

    width_px: int
    height_px: int
    degree: int = 4
    linear: bool = False

    @property
    def half_px(self) -> float:
        """Half the image's diagonal."""
        return 0.5 * math.hypot(self.width_px, self.height_px)

    @property
    def first(self) -> int:
        """Where the polynomial begins among the unknowns."""
        return 4 if self.linear else 2

    @property
    def linear_names(self) -> tuple[str, ...]:
        """Unknowns before the polynomial."""
        return ("cx_px", "cy_px", "c", "d") if self.linear else ("cx_px", "cy_px")

    def image(self, k: FloatArray) -> _Image:
        """From the plane to pixels."""
        c, d = (float(k[2]), float(k[3])) if self.linear else (1.0, 0.0)
        free = (((0, 0),), ((0, 1), (1, 0))) if self.linear else ()
        return _Image(float(k[0]), float(k[1]), np.array([[c, d], [d, 1.0]]), free)

    def assembled(self, curve: RadialCurve, coefficients: FloatArray) -> FloatArray:
        """Unknowns with the identity for the linear terms."""
        linear = (1.0, 0.0) if self.linear else ()
        return np.array([curve.cx_px, curve.cy_px, *linear, *coefficients])


@dataclass(frozen=True, slots=True)
class FThetaLens(_PolynomialLens):
    """F-theta: the angle as a polynomial of the radius (`FThetaCamera.theta_from_r`)."""

    name: ClassVar[str] = "ftheta"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Centre, linear terms, polynomial."""
        return (*self.linear_names, *(f"k{i} [rad/px^{i}]" for i in range(1, self.degree + 1)))

    @property
    def units(self) -> FloatArray:
        """Powers of the half diagonal for the polynomial."""
        return np.append(np.ones(self.first), self.half_px ** -np.arange(1.0, self.degree + 1))

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)``; the polynomial is inverted where it rises."""
        coefficients = (0.0, *k[self.first :].tolist())
        theta, direction = _angle(point_camera)
        limit = rising_limit(coefficients, _FARTHEST)
        if limit <= 0.0:
            return _nowhere(len(theta), len(k))
        q = invert_rising_polynomial(coefficients, theta, limit)
        valid = np.isfinite(q)
        q = np.where(valid, q, 0.0)
        slope = 1.0 / polynomial(derivative(coefficients), q)
        by_k = -slope[:, np.newaxis] * q[:, np.newaxis] ** np.arange(1, self.degree + 1)
        radial = _Radial(self.half_px * q, self.half_px * slope, self.half_px * by_k)
        return _projection(point_camera, direction, radial, self.image(k), valid)

    def start(self, curve: RadialCurve) -> FloatArray:
        """Least squares over the samples."""
        q = curve.radius_px / self.half_px
        powers = q[:, np.newaxis] ** np.arange(1, self.degree + 1)
        return self.assembled(curve, least_squares(powers, curve.theta_rad))

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the `FThetaCamera`."""
        image, rest = self.image(k), (k * self.units)[self.first :].tolist()
        (c, d), _ = image.matrix.tolist()
        size = (self.width_px, self.height_px)
        return FThetaCamera(*size, image.cx_px, image.cy_px, (0.0, *rest), c=c, d=d, e=d)


@dataclass(frozen=True, slots=True)
class OcamLens(_PolynomialLens):
    """OCamCalib: the ray of radius r is (x, y, a0 + a2 r² + a3 r³ + …): `OcamCamera`, its sign turned."""

    name: ClassVar[str] = "ocam"

    @property
    def powers(self) -> tuple[int, ...]:
        """Of the radius: all but the first."""
        return (0, *range(2, self.degree + 1))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Centre, linear terms, polynomial."""
        return (*self.linear_names, "a0 [px]", *(f"a{i} [px^{1 - i}]" for i in self.powers[1:]))

    @property
    def units(self) -> FloatArray:
        """Powers of the half diagonal for the polynomial, with OCamCalib's sign."""
        return np.append(np.ones(self.first), -(self.half_px ** (1.0 - np.array(self.powers))))

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)``; the angle as a function of the radius is inverted where it rises."""
        forward = (float(k[self.first]), 0.0, *k[self.first + 1 :].tolist())
        # Numerator of the slope of the angle: z - q z'.
        rise = tuple((1.0 - i) * a for i, a in enumerate(forward))
        theta, direction = _angle(point_camera)
        if forward[0] <= 0.0:
            return _nowhere(len(theta), len(k))

        def angle(q: FloatArray) -> FloatArray:
            return np.arctan2(q, polynomial(forward, q))

        def angle_slope(q: FloatArray) -> FloatArray:
            z = polynomial(forward, q)
            return np.asarray(polynomial(rise, q) / (z * z + q * q))

        q = invert_rising(angle, angle_slope, theta, 0.999 * smallest_root(rise, _FARTHEST))
        valid = np.isfinite(q)
        q = np.where(valid, q, 0.0)
        slope, z = 1.0 / angle_slope(q), polynomial(forward, q)
        by_z = (slope * q / (z * z + q * q))[:, np.newaxis]
        by_k = by_z * q[:, np.newaxis] ** np.array(self.powers)
        radial = _Radial(self.half_px * q, self.half_px * slope, self.half_px * by_k)
        return _projection(point_camera, direction, radial, self.image(k), valid)

    def start(self, curve: RadialCurve) -> FloatArray:
        """Least squares over the samples."""
        q = curve.radius_px / self.half_px
        powers = q[:, np.newaxis] ** np.array(self.powers)
        # z = q / tan θ, weighted so that the angle's error counts: dθ = sin² θ / q dz.
        weight, z = np.sin(curve.theta_rad) ** 2 / q, q / np.tan(curve.theta_rad)
        return self.assembled(curve, least_squares(weight[:, np.newaxis] * powers, weight * z))

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the `OcamCamera`."""
        image, (a0, *rest) = self.image(k), (k * self.units)[self.first :].tolist()
        (c, d), _ = image.matrix.tolist()
        size = (self.width_px, self.height_px)
        return OcamCamera(*size, image.cx_px, image.cy_px, (a0, 0.0, *rest), c=c, d=d, e=d)


@dataclass(frozen=True, slots=True)
class FisheyeLens:
    """Kannala and Brandt's fisheye as in OpenCV: r = θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹, times fx and fy."""

    name: ClassVar[str] = "fisheye"

    width_px: int
    height_px: int

    @property
    def parameters(self) -> tuple[str, ...]:
        """Centre, focal lengths, distortion."""
        return ("cx_px", "cy_px", "fx_px", "fy_px", "k1", "k2", "k3", "k4")

    @property
    def units(self) -> FloatArray:
        """As in files."""
        return np.ones(8)

    def project(self, k: FloatArray, point_camera: FloatArray) -> Projection:
        """Project points ``(n, 3)``; valid where the radius rises."""
        odd = (0.0, 1.0, 0.0, k[4], 0.0, k[5], 0.0, k[6], 0.0, k[7])
        theta, direction = _angle(point_camera)
        valid = theta <= rising_limit(odd, math.pi)
        powers = theta[:, np.newaxis] ** np.array([3, 5, 7, 9])
        image = _Image(float(k[0]), float(k[1]), np.diag(k[2:4]), (((0, 0),), ((1, 1),)))
        radius, slope = polynomial(odd, theta), polynomial(derivative(odd), theta)
        return _projection(point_camera, direction, _Radial(radius, slope, powers), image, valid)

    def start(self, curve: RadialCurve) -> FloatArray:
        """Least squares over the samples."""
        powers = curve.theta_rad[:, np.newaxis] ** np.array([1, 3, 5, 7, 9])
        focal_px, *rest = least_squares(powers, curve.radius_px).tolist()
        return np.array([curve.cx_px, curve.cy_px, focal_px, focal_px, *(a / focal_px for a in rest)])

    def camera(self, k: FloatArray) -> CameraModel:
        """Build the `FisheyeCamera`."""
        cx, cy, fx, fy, *distortion = k.tolist()
        return FisheyeCamera(self.width_px, self.height_px, fx, fy, cx, cy, tuple(distortion))


class _Radial(NamedTuple):
    """Radius in the image plane of n points."""

    radius: FloatArray
    slope: FloatArray
    """By the angle from the axis."""
    by_k: FloatArray
    """(n, m): by the parameters of the radial function."""


class _Image(NamedTuple):
    """From the plane to pixels: centre, matrix, and the elements (row, column) that each unknown is."""

    cx_px: float
    cy_px: float
    matrix: FloatArray
    free: tuple[tuple[tuple[int, int], ...], ...]


def _projection(
    point: FloatArray,
    direction: FloatArray,
    radial: _Radial,
    image: _Image,
    valid: BoolArray,
) -> Projection:
    """Pixels and derivatives of a radial lens; `direction` is (n, 2), unit vectors in the image plane."""
    radius, slope, by_k = radial
    across, forward = np.hypot(point[:, 0], point[:, 1]), point[:, 2]
    square = across * across + forward * forward
    near_axis = across <= _ON_AXIS
    aside = np.where(near_axis, slope / np.where(near_axis, forward, 1.0), radius / (across + near_axis))
    outer = direction[:, :, np.newaxis] * direction[:, np.newaxis, :]
    along = slope * forward / square
    plane_by_point = np.empty((len(point), 2, 3))
    plane_by_point[:, :, :2] = (
        outer * (along - aside)[:, np.newaxis, np.newaxis] + np.eye(2) * aside[:, np.newaxis, np.newaxis]
    )
    plane_by_point[:, :, 2] = direction * (-slope * across / square)[:, np.newaxis]
    plane = radius[:, np.newaxis] * direction
    pixel = np.array([image.cx_px, image.cy_px]) + plane @ image.matrix.T
    by_matrix = np.zeros((len(point), 2, len(image.free)))
    for column, elements in enumerate(image.free):
        for row, element in elements:
            by_matrix[:, row, column] = plane[:, element]
    by_centre = np.broadcast_to(np.eye(2), (len(point), 2, 2))
    by_radial = (direction @ image.matrix.T)[:, :, np.newaxis] * by_k[:, np.newaxis, :]
    by_lens = np.concatenate([by_centre, by_matrix, by_radial], axis=-1)
    return Projection(pixel, image.matrix @ plane_by_point, by_lens, valid)


def _angle(point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angle from the axis (n,), and direction in the image plane (n, 2)."""
    across = np.hypot(point[:, 0], point[:, 1])
    safe = np.where(across > _ON_AXIS, across, 1.0)
    direction = np.where((across > _ON_AXIS)[:, np.newaxis], point[:, :2] / safe[:, np.newaxis], (1.0, 0.0))
    return np.arctan2(across, point[:, 2]), direction


def _nowhere(n: int, n_parameters: int) -> Projection:
    """Projection by parameters that make no lens."""
    return Projection(
        np.zeros((n, 2)), np.zeros((n, 2, 3)), np.zeros((n, 2, n_parameters)), np.zeros(n, dtype=bool)
    )
