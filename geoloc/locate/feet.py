"""Pixels of one camera → feet on the rig's plane, by component: the arithmetic that every method shares."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.cameras.base import Columns, sin_cos
from geoloc.earth.ground import miss_reason
from geoloc.locate.visibility import on_the_car_itself
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.rig.rig import Rig, RigCamera
from geoloc.trajectory.poses import Poses

Rows = slice | IntArray

# Rows that are worked on at a time: their temporaries stay in the processor's cache.
BLOCK = 28_672

_RADIANS = np.pi / 180.0


class Feet(NamedTuple):
    """Where the rays of one camera's pixels meet the plane z = 0 of the rig (FLU), metres.

    Rows with `hit` false are undefined in the numbers; `why_not` gives their reasons.
    """

    x_m: FloatArray
    y_m: FloatArray
    slope_x: FloatArray
    """Of the ray, x by z: the foot moves by minus this for a metre that the camera rises."""
    slope_y: FloatArray
    range_m: FloatArray
    """Horizontal distance from the camera."""
    ray: Columns
    by_u: Columns | None
    """Derivatives of the ray by the pixel, rig frame; None where not asked for."""
    by_v: Columns | None
    in_image: BoolArray
    on_car: BoolArray | None
    """None where the rig has no mask."""
    hit: BoolArray
    pixel_px: FloatArray


def cameras_of(camera: TextArray) -> list[str]:
    """Names that occur, in alphabetical order: `numpy.unique` sorts every row's text for that."""
    names = []
    while camera.size:
        names.append(str(camera[0]))
        camera = camera[camera != camera[0]]
    return sorted(names)


def rows_by_camera(rig: Rig, camera: TextArray) -> Iterator[tuple[RigCamera, Rows]]:
    """Give each camera with its rows: all of them as one slice where there is one camera only.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    left = np.ones(camera.size, dtype=bool)
    while left.any():
        name = camera[int(left.argmax())]
        own = camera == name
        yield rig.camera(str(name)), slice(None) if own.all() else np.flatnonzero(own)
        left &= ~own


def feet_on_plane(camera: RigCamera, pixel_px: FloatArray, max_range_m: float) -> Feet:
    """Cut the rays of pixels ``(n, 2)`` with the plane on which the rig's wheels stand.

    Call it under ``np.errstate(all="ignore")``: rays that miss divide by zero.
    """
    rays = camera.model.rays(pixel_px[:, 0], pixel_px[:, 1], slopes=True)
    ray = turned(camera.rig_R_camera, rays.ray)
    x0, y0, height = (float(value) for value in camera.rig_t_camera_m)
    down = 1.0 / ray.z
    slope_x, slope_y = ray.x * down, ray.y * down
    reach = height * np.sqrt(slope_x * slope_x + slope_y * slope_y)
    hit = rays.inside & (ray.z < 0.0) & (reach <= max_range_m)
    on_car = None if camera.ego_mask is None else on_the_car_itself(camera, pixel_px)
    if on_car is not None:
        hit &= ~on_car
    if height <= 0.0:
        hit[:] = False
    return Feet(
        x_m=x0 - height * slope_x,
        y_m=y0 - height * slope_y,
        slope_x=slope_x,
        slope_y=slope_y,
        range_m=reach,
        ray=ray,
        by_u=None if rays.by_u is None else turned(camera.rig_R_camera, rays.by_u),
        by_v=None if rays.by_v is None else turned(camera.rig_R_camera, rays.by_v),
        in_image=rays.inside,
        on_car=on_car,
        hit=hit,
        pixel_px=pixel_px,
    )


def turned(rotation: FloatArray, vector: Columns) -> Columns:
    """One rotation (3, 3) applied to many vectors."""
    return Columns(*(a * vector.x + b * vector.y + c * vector.z for a, b, c in rotation.tolist()))


class Axes(NamedTuple):
    """The rig's axes x (forward), y (left) and z (normal of the road) in east, north and up."""

    forward: tuple[FloatArray, FloatArray, FloatArray]
    left: tuple[FloatArray, FloatArray, FloatArray]
    normal: tuple[FloatArray, FloatArray]
    """East and north alone."""
    heading: tuple[FloatArray, FloatArray]
    """Level, unit length, east and north."""


def axes_of(poses: Poses) -> Axes:
    """Columns of `rotation_enu_from_rig`, whose yaw is 90° - heading."""
    sin_h, cos_h = sin_cos(_RADIANS * poses.heading_deg)
    sp, cp = sin_cos(_RADIANS * poses.pitch_deg)
    sr, cr = sin_cos(_RADIANS * poses.roll_deg)
    along, across = sp * sr, sp * cr
    return Axes(
        forward=(sin_h * cp, cos_h * cp, -sp),
        left=(sin_h * along - cos_h * cr, cos_h * along + sin_h * cr, cp * sr),
        normal=(sin_h * across + cos_h * sr, cos_h * across - sin_h * sr),
        heading=(sin_h, cos_h),
    )


class Enu(NamedTuple):
    """Metres from the rig's origin."""

    east: FloatArray
    north: FloatArray
    up: FloatArray


def enu_of(axes: Axes, feet: Feet) -> Enu:
    """Feet from the rig's origin."""
    return Enu(*(f * feet.x_m + s * feet.y_m for f, s in zip(axes.forward, axes.left, strict=True)))


class Rejections:
    """Collects why rows were rejected, and makes the column of reasons, which is "" where they were not."""

    def __init__(self) -> None:
        self._parts: list[tuple[IntArray, TextArray]] = []

    def add(
        self,
        camera: RigCamera,
        feet: Feet,
        poses: Poses,
        rows: Rows,
        start: int,
        max_range_m: float,
        *,
        otherwise: Reason | None = None,
    ) -> BoolArray | None:
        """Note the rejected ones among the feet of these rows, and mark them; None where there are none.

        `start` is the place of the first row in the column; `otherwise` a reason, if there is one, why the
        rows that hit the ground are rejected too.
        """
        posed = poses.valid[rows]
        bad = np.asarray(~(feet.hit & posed)) if otherwise is None else np.full(posed.shape, fill_value=True)
        if not bad.any():
            return None
        index = np.flatnonzero(bad)
        row = index if isinstance(rows, slice) else rows[index]
        reason = _why_not(camera, feet, index, max_range_m)
        reason = np.where(reason == "", otherwise or "", reason)
        of_pose = poses.reason[rows][index]
        said = np.where(posed[index] | (of_pose != ""), of_pose, Reason.NO_POSE)
        self._parts.append((start + row, np.where(said == "", reason, said)))
        return bad

    def column(self, n: int) -> TextArray:
        """Reasons (n,)."""
        column = np.zeros(n, dtype=REASON_TYPE if self._parts else "U1")
        for row, text in self._parts:
            column[row] = text
        return column


def _why_not(camera: RigCamera, feet: Feet, index: IntArray, max_range_m: float) -> TextArray:
    """Reasons of those rows of a camera, poses left aside."""
    ray = np.stack([component[index] for component in feet.ray], axis=-1)
    reason = miss_reason(camera.rig_t_camera_m, ray, max_range_m=max_range_m)
    reason = np.where(feet.in_image[index], reason, Reason.OUTSIDE_CAMERA)
    if feet.on_car is None:
        return reason
    return np.where(feet.on_car[index], Reason.ON_CAR, reason)
