"""Where things lie in one picture: estimates with their ellipses, NVDB's signs, distances, the horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, rotation_enu_from_rig
from geoloc.locate.visibility import points_in_rig, seen_by
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.poses import Poses
from twin.evidence.sights import Place, ellipse_places, poses_at
from twin.overlay.scene import Click, DriveScene, Standing

RINGS_M = (5.0, 10.0, 15.0, 20.0, 30.0)
"""Horizontal distances from the camera at which lines are drawn on the road."""
FURTHEST_M = 60.0
"""What stands further from the camera is not drawn."""
_LEVEL_M = 1.0e6
_TWICE = 2
"""A row says when it was exposed, and that where the car was: looked up twice."""


@dataclass(frozen=True, slots=True)
class ShownThing:
    """Something that stands at the road, in one picture.

    Attributes
    ----------
    pixel_px : float64 (2,)
    ellipse_px : float64 (k, 2) or None
        The 95 % ellipse of its position, at its foot.
    range_m : float
        Horizontal, from the camera.
    """

    what: Standing
    pixel_px: FloatArray
    ellipse_px: FloatArray | None
    range_m: float


@dataclass(frozen=True, slots=True)
class FrameLines:
    """Everything that is drawn over one picture, in its pixels; lines (k, 2) break where they are NaN.

    Attributes
    ----------
    pose : Poses (1,)
        The car's, at the picture's middle row.
    horizon_px : float64 (k, 2)
        What is as high as the camera, far away.
    rings_px : tuple of (float, float64 (k, 2))
        Distance from the camera [m], and its line on the plane on which the wheels stand.
    shift_px : float64 (2,)
        By how much estimates were moved together, so that they lie where the adjustment, which also corrected
        the car's pose at this picture, expects them.
    """

    pose: Poses
    clicks: tuple[Click, ...]
    estimates: tuple[ShownThing, ...]
    signs: tuple[ShownThing, ...]
    horizon_px: FloatArray
    rings_px: tuple[tuple[float, FloatArray], ...]
    shift_px: FloatArray


def lines_of(scene: DriveScene, camera_name: str, frame: int, epoch_ns: int) -> FrameLines | None:
    """Work out what is drawn over one picture.

    Parameters
    ----------
    epoch_ns : int
        Of its middle row, by the stated clock.

    Returns
    -------
    FrameLines or None
        None where the track has no pose then.
    """
    camera = scene.camera(camera_name)
    middle = np.array([(camera.model.height_px - 1) / 2.0])
    pose = poses_at(scene.poses, scene.row_epochs(camera, epoch_ns, middle))
    if not pose.valid[0]:
        return None
    clicks = tuple(scene.clicks.get((camera_name, frame), ()))
    estimates = _shown(scene, camera, epoch_ns, scene.estimates)
    shift = _shift(clicks, estimates)
    enu_R_rig = rotation_enu_from_rig(pose.heading_deg, pose.pitch_deg, pose.roll_deg)[0]
    return FrameLines(
        pose=pose,
        clicks=clicks,
        estimates=tuple(_moved(one, shift) for one in estimates),
        signs=tuple(_moved(one, shift) for one in _shown(scene, camera, epoch_ns, scene.signs)),
        horizon_px=_line(camera, _level(enu_R_rig)) + shift,
        rings_px=tuple((r, _line(camera, _ring(camera, r)) + shift) for r in RINGS_M),
        shift_px=shift,
    )


def _shown(
    scene: DriveScene, camera: RigCamera, epoch_ns: int, things: tuple[Standing, ...]
) -> list[ShownThing]:
    if not things:
        return []
    pixel, distance, seen = _seen(scene, camera, epoch_ns, [thing.place for thing in things])
    shown = []
    for k in np.flatnonzero(seen & (distance < FURTHEST_M)).tolist():
        thing = things[k]
        ellipse = None
        if thing.covariance_m2 is not None:
            around = ellipse_places(thing.place, thing.covariance_m2)
            ellipse, _, _ = _seen(scene, camera, epoch_ns, around)
        shown.append(ShownThing(thing, pixel[k], ellipse, float(distance[k])))
    return shown


def _seen(
    scene: DriveScene, camera: RigCamera, epoch_ns: int, places: list[Place]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Project places, each from where the car was when its row was exposed."""
    east, north, height = np.array(places, dtype=np.float64).T
    lat, lon = geographic_from_utm33(east, north)
    each: IntArray = np.arange(len(places))
    row = np.full(len(places), (camera.model.height_px - 1) / 2.0)
    for _ in range(_TWICE):
        poses = poses_at(scene.poses, scene.row_epochs(camera, epoch_ns, row))
        pixel, distance, seen = seen_by(camera, points_in_rig(poses, each, lat, lon, height), 0.0)
        row = np.where(np.isfinite(pixel[:, 1]), pixel[:, 1], row)
    return pixel, distance, seen & poses.valid


def _shift(clicks: tuple[Click, ...], estimates: list[ShownThing]) -> FloatArray:
    """Where the adjustment expects what was clicked, minus where the track puts it: the mean of all."""
    at = {one.what.object: one.pixel_px for one in estimates}
    is_face = {one.what.object: one.what.is_face for one in estimates}
    off = [
        np.array(click.pixel_px) - np.array(click.residual_px) - at[click.object]
        for click in clicks
        if click.residual_px is not None
        and click.is_used
        and click.object in at
        and click.is_foot != is_face[click.object]
    ]
    return np.mean(off, axis=0) if off else np.zeros(2)


def _moved(shown: ShownThing, shift: FloatArray) -> ShownThing:
    ellipse = None if shown.ellipse_px is None else shown.ellipse_px + shift
    return ShownThing(shown.what, shown.pixel_px + shift, ellipse, shown.range_m)


def _line(camera: RigCamera, points_m: FloatArray) -> FloatArray:
    """Project points of the rig; NaN where they are not in the picture."""
    pixel, _, seen = seen_by(camera, points_m, 0.0)
    return np.where(seen[:, None], pixel, np.nan)


def _level(enu_R_rig: FloatArray) -> FloatArray:
    """Points of the rig all around, far away and as high as it."""
    azimuth = np.radians(np.arange(0.0, 360.0, 0.5))
    level = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=1)
    # From the heading's back on, so that the line's ends lie behind the car.
    forward = enu_R_rig[:, 0]
    start = int(np.argmin(level @ forward))
    return _LEVEL_M * np.roll(level, -start, axis=0) @ enu_R_rig


def _ring(camera: RigCamera, radius_m: float) -> FloatArray:
    azimuth = np.radians(np.arange(-180.0, 180.5, 0.5))
    x0, y0, _ = camera.rig_t_camera_m
    return np.stack(
        [x0 + radius_m * np.cos(azimuth), y0 + radius_m * np.sin(azimuth), np.zeros_like(azimuth)], axis=1
    )
