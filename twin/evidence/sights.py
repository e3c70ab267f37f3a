"""Where a sign's face, NVDB's position and the error ellipse lie in one picture.

What is projected is turned by nothing that an adjustment found out: where an annotation shows the sign in
that very picture, everything is moved by what the projection is off there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, metres_per_degree, rotation_enu_from_rig
from geoloc.locate.combine import ring95_m
from geoloc.locate.visibility import points_in_rig, seen_by
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.interpolation import bracket, linear
from geoloc.trajectory.poses import Poses, part
from twin.store.records import Covariance

FACE_LOW_M, FACE_HIGH_M, FACE_HALF_WIDTH_M = 1.5, 3.6, 0.6
"""Where faces are above the foot of a pole: lower edges from 1.5 m to 2.5 m (above footways), one to three
plates of 0.6 to 1.0 m; faces up to 1 m wide, and 0.1 m on each side for what the pole leans."""
CORE_LOW_M, CORE_HIGH_M, CORE_HALF_WIDTH_M = 2.0, 2.8, 0.35
"""What must be in the picture: the usual place of a single plate."""
WIDE_LOW_M, WIDE_HIGH_M, WIDE_HALF_WIDTH_M = -0.5, 4.2, 2.6
_FACE_UP_M = 2.4
"""Height of a face's middle above its foot, where only the face was seen."""
_PER_SIDE = 6
_ELLIPSE_POINTS = 48
_RIG_RIGHT = np.array([0.0, -1.0, 0.0])
_MAX_GAP_S, _HALT_M = 0.5, 1.0


class Place(NamedTuple):
    """A place in the world: EPSG:25833, and the ellipsoidal height; NaN: on the road's plane."""

    east_m: float
    north_m: float
    height_m: float = float("nan")


@dataclass(frozen=True, slots=True)
class Marked:
    """What was annotated of a sign in one picture.

    Attributes
    ----------
    foot_px : (float, float) or None
    boxes_px : tuple of (left, top, right, bottom)
        Of its faces.
    centres_px : tuple of (float, float)
        Of faces whose boxes are not known.
    """

    foot_px: tuple[float, float] | None = None
    boxes_px: tuple[tuple[float, float, float, float], ...] = ()
    centres_px: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Sight:
    """One sign in one picture, in its pixels.

    Attributes
    ----------
    window_px : float64 (k, 2)
        Outline of where its faces are, by the height that signs are put up at.
    wide_px : float64 (k, 2)
        Outline of its surroundings.
    foot_px : float64 (2,)
    nvdb_px : float64 (2,) or None
        NVDB's position, on the ground.
    ellipse_px : float64 (k, 2) or None
        The 95 % ellipse of the measured position, on the ground.
    metre_px : float64 (2, 2, 2)
        At its face: what a metre to the right is in pixels, and what a metre down; of a face that looks at
        the camera, and of one that looks back along the car's way.
    px_per_m : float
        At the sign.
    range_m : float
        Horizontal, from the camera.
    is_whole : bool
        Whether all of `window_px` is in the picture.
    """

    window_px: FloatArray
    wide_px: FloatArray
    foot_px: FloatArray
    nvdb_px: FloatArray | None
    ellipse_px: FloatArray | None
    metre_px: FloatArray
    px_per_m: float
    range_m: float
    is_whole: bool

    @property
    def focal_px(self) -> float:
        """Pixels a radian, there."""
        return self.px_per_m * max(self.range_m, 1.0)


def poses_at(poses: Poses, epoch_ns: IntArray) -> Poses:
    """Interpolate the store's poses, of which there is one every 0.3 m; invalid outside them."""
    if poses.epoch_ns.size < 2:
        nowhere = np.zeros(epoch_ns.size, dtype=np.bool_)
        return replace(part(poses, np.zeros(epoch_ns.size, dtype=np.int64)), valid=nowhere)
    at = bracket(poses.epoch_ns, epoch_ns)
    # A car that stands still has one pose for the whole halt: both its neighbours are the same place.
    still = np.hypot(*_step_m(poses, at.left, at.right)) < _HALT_M
    return replace(
        part(poses, at.left),
        latitude_deg=linear(poses.latitude_deg, at),
        longitude_deg=linear(poses.longitude_deg, at),
        height_m=linear(poses.height_m, at),
        roll_deg=linear(poses.roll_deg, at),
        pitch_deg=linear(poses.pitch_deg, at),
        heading_deg=np.rad2deg(linear(np.unwrap(np.deg2rad(poses.heading_deg)), at)),
        valid=at.inside() & (still | ~at.in_gap(_MAX_GAP_S)),
    )


def sight_of(
    camera: RigCamera,
    pose: Poses,
    place: Place,
    *,
    is_face: bool = False,
    marked: Marked | None = None,
    nvdb: Place | None = None,
    covariance_m2: Covariance | None = None,
) -> Sight | None:
    """Project a sign into the picture that a camera took at one pose.

    Parameters
    ----------
    pose : Poses (1,)
    place : Place
        The foot of its pole; the middle of its face where `is_face`.
    marked : Marked, optional
        What was annotated of it in that picture.

    Returns
    -------
    Sight or None
        None where the usual place of its face is not in the picture.
    """
    if not pose.valid[0]:
        return None
    up = rotation_enu_from_rig(pose.heading_deg[0], pose.pitch_deg[0], pose.roll_deg[0])[2]
    point = _in_rig(pose, [place])[0]
    foot = point - _FACE_UP_M * up if is_face else point
    right = _right_of(foot - camera.rig_t_camera_m, up)
    if right is None:
        return None

    def rectangle(
        low_m: float, high_m: float, half_m: float, right: FloatArray = right
    ) -> tuple[FloatArray, BoolArray]:
        pixel, _, seen = seen_by(camera, _rectangle(foot, up, right, low_m, high_m, half_m), 0.0)
        return pixel, seen

    core, core_seen = rectangle(CORE_LOW_M, CORE_HIGH_M, CORE_HALF_WIDTH_M)
    across, _ = rectangle(CORE_LOW_M, CORE_HIGH_M, CORE_HALF_WIDTH_M, _RIG_RIGHT)
    window, window_seen = rectangle(FACE_LOW_M, FACE_HIGH_M, FACE_HALF_WIDTH_M)
    if not core_seen.all() or not np.isfinite(window).all():
        return None
    (foot_px, point_px), distance, _ = seen_by(camera, np.stack([foot, point]), 0.0)
    shift = _shift(marked, foot_px, point_px)
    wide, _ = rectangle(WIDE_LOW_M, WIDE_HIGH_M, WIDE_HALF_WIDTH_M)
    wide = wide[np.isfinite(wide).all(axis=1)]
    ground = [] if nvdb is None else [nvdb._replace(height_m=float("nan") if is_face else place.height_m)]
    nvdb_px = _projected(camera, pose, ground, shift)
    around = [] if covariance_m2 is None or is_face else ellipse_places(place, covariance_m2)
    return Sight(
        window_px=window + shift,
        wide_px=wide + shift,
        foot_px=foot_px + shift,
        nvdb_px=None if nvdb_px is None else nvdb_px[0],
        ellipse_px=_projected(camera, pose, around, shift),
        metre_px=np.stack([_metre(core), _metre(across)]),
        px_per_m=float(np.hypot(*_metre(core)[0])),
        range_m=float(distance[1]),
        is_whole=bool(window_seen.all()),
    )


def _metre(core_px: FloatArray) -> FloatArray:
    """What a metre to the right, and one down, is in pixels."""
    left_low, right_low, right_high, left_high = core_px[::_PER_SIDE]
    across = (right_low + right_high - left_low - left_high) / (4 * CORE_HALF_WIDTH_M)
    down = (left_low + right_low - left_high - right_high) / (2 * (CORE_HIGH_M - CORE_LOW_M))
    return np.stack([across, down])


def _shift(marked: Marked | None, foot_px: FloatArray, point_px: FloatArray) -> FloatArray:
    """What the projection is off in this picture; 0 where nothing was annotated."""
    centres = [] if marked is None else list(marked.centres_px)
    if marked is not None and marked.foot_px is not None and np.isfinite(foot_px).all():
        return np.array(marked.foot_px) - foot_px
    if marked is not None:
        centres += [((left + right) / 2, (top + low) / 2) for left, top, right, low in marked.boxes_px]
    if centres and np.isfinite(point_px).all():
        return np.asarray(np.mean(centres, axis=0) - point_px)
    return np.zeros(2)


def _in_rig(pose: Poses, places: list[Place]) -> FloatArray:
    east, north, height = np.array(places, dtype=np.float64).T
    lat, lon = geographic_from_utm33(east, north)
    return points_in_rig(pose, np.zeros(len(places), np.int64), lat, lon, height)


def _projected(camera: RigCamera, pose: Poses, places: list[Place], shift: FloatArray) -> FloatArray | None:
    """Pixels (k, 2) of places; None where there are none, or one is behind the camera."""
    if not places:
        return None
    pixel, _, _ = seen_by(camera, _in_rig(pose, places), 0.0)
    return pixel + shift if np.isfinite(pixel).all() else None


def _right_of(away: FloatArray, up: FloatArray) -> FloatArray | None:
    """Unit vector to the right of who looks along `away`; None where that is straight up or down."""
    right = np.cross(away, up)
    length = float(np.linalg.norm(right))
    return right / length if length > 1e-6 else None


def _rectangle(
    foot: FloatArray, up: FloatArray, right: FloatArray, low_m: float, high_m: float, half_m: float
) -> FloatArray:
    """Points (k, 3) around an upright rectangle that faces the camera: enough of them for a bent picture."""
    t = np.linspace(0.0, 1.0, _PER_SIDE, endpoint=False)
    across = np.concatenate([-1 + 2 * t, np.ones_like(t), 1 - 2 * t, -np.ones_like(t)]) * half_m
    height = np.concatenate([np.zeros_like(t), t, np.ones_like(t), 1 - t]) * (high_m - low_m) + low_m
    return foot + height[:, None] * up + across[:, None] * right


def ellipse_places(place: Place, covariance_m2: Covariance) -> list[Place]:
    """Give places around the 95 % ellipse of a position, at its height."""
    ee, en, nn = covariance_m2
    ring = ring95_m([[ee, en], [en, nn]], _ELLIPSE_POINTS)
    return [Place(place.east_m + e, place.north_m + n, place.height_m) for e, n in ring.tolist()]


def _step_m(poses: Poses, a: IntArray, b: IntArray) -> tuple[FloatArray, FloatArray]:
    per_east, per_north = metres_per_degree(poses.latitude_deg[a])
    return (
        (poses.longitude_deg[b] - poses.longitude_deg[a]) * per_east,
        (poses.latitude_deg[b] - poses.latitude_deg[a]) * per_north,
    )
