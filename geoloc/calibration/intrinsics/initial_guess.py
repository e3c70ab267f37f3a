"""A first camera and first poses, from corners alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.lens import RadialCurve
from geoloc.calibration.intrinsics.views import Corners
from geoloc.errors import CalibrationError

_FOCALS = 60
"""Focal lengths that are tried, 0.15 to 6 image widths: fields of view from 300° to 10°."""
_SAMPLES = 60
_WIDEST_RAD = 0.95 * math.pi


class BoardPoses(NamedTuple):
    """The board in the camera frame, view by view."""

    rotation: FloatArray
    """(v, 3, 3)"""
    position_m: FloatArray
    """(v, 3)"""


def first_guess(corners: Corners, width_px: int, height_px: int) -> tuple[RadialCurve, BoardPoses]:
    """Radius proportional to the angle, about the image's middle: the focal length at which boards are flat.

    Every focal length of a scan turns corners into rays; a flat board then has a pose whose rays are those,
    up to the angle that the wrong focal length leaves. The smallest such angle wins.

    Raises
    ------
    CalibrationError
        If the boards are seen from behind: their corners are numbered as in a mirror.
    """
    centre = 0.5 * np.array([width_px - 1.0, height_px - 1.0])
    offset = corners.pixel_px - centre
    radius = np.hypot(offset[:, 0], offset[:, 1])
    tried = []
    for focal_px in np.geomspace(max(radius.max() / _WIDEST_RAD, 0.15 * width_px), 6.0 * width_px, _FOCALS):
        rays = rays_at(offset, radius, radius / focal_px)
        poses = planar_poses(corners, rays)
        tried.append((float(np.median(angles_off(corners, poses, rays))), float(focal_px), poses))
    _, focal_px, poses = min(tried, key=lambda t: t[0])
    check_not_mirrored(corners, poses)
    theta = np.linspace(0.0, float(radius.max()) / focal_px, _SAMPLES + 1)[1:]
    return RadialCurve(theta, focal_px * theta, float(centre[0]), float(centre[1])), poses


def rays_at(offset_px: FloatArray, radius_px: FloatArray, theta_rad: FloatArray) -> FloatArray:
    """Unit rays (n, 3) of pixels at an offset from the centre, given their angle from the axis."""
    across = np.sin(theta_rad) / np.where(radius_px > 0.0, radius_px, 1.0)
    return np.column_stack([across[:, np.newaxis] * offset_px, np.cos(theta_rad)])


def planar_poses(corners: Corners, rays: FloatArray) -> BoardPoses:
    """Pose of each view's board from rays (n, 3) to its corners: direct linear transformation.

    A corner (x, y) of the board lies on its ray d: d × (h1 x + h2 y + h3) = 0, with h1 and h2 the board's
    axes and h3 its origin, up to one scale. Rays instead of image points: fields of view beyond 180° are
    nothing special. Hartley and Zisserman, "Multiple View Geometry", section 4.1.
    """
    middle, half = corners.middle_m, corners.half_size_m
    plane = (corners.board_m - middle) / half
    n_views = corners.n_views
    rotation, position = np.empty((n_views, 3, 3)), np.empty((n_views, 3))
    ends = np.append(corners.first, len(plane))
    for number in range(n_views):
        rows = slice(ends[number], ends[number + 1])
        axes = _homography(plane[rows], rays[rows])
        scale = math.sqrt(np.linalg.norm(axes[:, 0]) * np.linalg.norm(axes[:, 1])) / half
        u, _, v = np.linalg.svd(axes[:, :2], full_matrices=False)
        first_two = u @ v
        rotation[number] = np.column_stack([first_two, np.cross(first_two[:, 0], first_two[:, 1])])
        position[number] = axes[:, 2] / scale - first_two @ middle
    return BoardPoses(rotation, position)


def _homography(plane: FloatArray, rays: FloatArray) -> FloatArray:
    """Matrix (3, 3) that takes (x, y, 1) to a multiple of the ray, positive for most corners."""
    point = np.column_stack([plane, np.ones(len(plane))])
    x, y, z = rays.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    # Rows of the cross product; unknowns are the matrix's nine elements, row by row.
    equations = np.einsum("nij,nk->nijk", skew, point).reshape(-1, 9)
    matrix = np.linalg.eigh(equations.T @ equations)[1][:, 0].reshape(3, 3)
    ahead = np.einsum("ni,ij,nj->n", rays, matrix, point)
    return np.asarray(matrix if np.median(ahead) > 0.0 else -matrix)


def angles_off(corners: Corners, poses: BoardPoses, rays: FloatArray) -> FloatArray:
    """Angles (n,) between rays and the corners of the posed boards, in radians."""
    board = np.column_stack([corners.board_m, np.zeros(len(corners.board_m))])
    turned = np.einsum("nij,nj->ni", poses.rotation[corners.view], board)
    point = turned + poses.position_m[corners.view]
    return angle_between(rays, point)


def angle_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angle (...) between vectors (..., 3), exact for small ones too."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def check_not_mirrored(corners: Corners, poses: BoardPoses) -> None:
    """Refuse boards that are seen from behind.

    Raises
    ------
    CalibrationError
    """
    middle = np.append(corners.middle_m, 0.0)
    towards = poses.position_m + poses.rotation @ middle
    behind = np.sum(towards * poses.rotation[:, :, 2], axis=-1) < 0.0
    if behind.sum() > 0.5 * len(behind):
        raise CalibrationError(
            f"The board is seen mirrored in {behind.sum()} of {len(behind)} views: flip the pictures back, "
            "or number the corners as the board's reader sees them (x right, y down)."
        )
