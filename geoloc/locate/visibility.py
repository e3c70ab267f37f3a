"""Which places on the road the cameras of a drive have seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import metres_per_degree, rotation_enu_from_rig
from geoloc.rig.rig import Rig, RigCamera
from geoloc.trajectory.poses import Poses

MIN_RANGE_M = 4.0
MAX_RANGE_M = 20.0
_MARGIN_PX = 30.0
_CHUNK = 2000
# Poses that are compared with sites at a time: few, so that the box about them is small.
_PART = 50
# So few pairs are not worth a box.
_FEW = 50_000
# No box may cut off what lies just within reach.
_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class Views:
    """Sites that were in view, one row a site, pose and camera.

    Attributes
    ----------
    site, pose : int64 (k,)
        Indices into the asked sites and poses.
    camera : str (k,)
    range_m : float64 (k,)
        Horizontal distance from the camera.
    pixel_px : float64 (k, 2)
        Where the foot must appear.
    """

    site: IntArray
    pose: IntArray
    camera: NDArray[np.str_]
    range_m: FloatArray
    pixel_px: FloatArray


def on_the_car_itself(camera: RigCamera, pixel_px: FloatArray) -> BoolArray:
    """Tell which pixels ``(..., 2)`` show the car's own body, by the camera's mask.

    False everywhere where the rig has no mask, and for pixels outside the image.
    """
    u, v = pixel_px[..., 0], pixel_px[..., 1]
    if camera.ego_mask is None:
        return np.zeros(u.shape, dtype=bool)
    rows, columns = camera.ego_mask.shape
    inside = (
        (u >= -0.5) & (u <= camera.model.width_px - 0.5) & (v >= -0.5) & (v <= camera.model.height_px - 0.5)
    )
    # The mask has its own resolution; both count from the corner of the first pixel.
    column = np.floor((np.where(inside, u, 0.0) + 0.5) / camera.model.width_px * columns).astype(np.int64)
    row = np.floor((np.where(inside, v, 0.0) + 0.5) / camera.model.height_px * rows).astype(np.int64)
    return np.asarray(inside & camera.ego_mask[np.minimum(row, rows - 1), np.minimum(column, columns - 1)])


def views(
    rig: Rig,
    poses: Poses,
    latitude_deg: ArrayLike,
    longitude_deg: ArrayLike,
    *,
    height_m: ArrayLike | None = None,
    min_range_m: float = MIN_RANGE_M,
    max_range_m: float = MAX_RANGE_M,
    cameras: Sequence[str] | None = None,
    margin_px: float = _MARGIN_PX,
) -> Iterator[Views]:
    """Find every site that each camera had in view at each pose, a chunk of poses at a time.

    In view means: a valid pose, inside the camera's image by a margin and inside its model's domain, not on
    the car itself, and within range. Walls and other cars are not known here.

    Parameters
    ----------
    poses : Poses (n,)
        Those of the frames in question.
    latitude_deg, longitude_deg : array_like (m,)
        The sites' feet. NaN is never in view.
    height_m : array_like (m,), optional
        Ellipsoidal. Without it, or where NaN, the foot stands on the rig's ground plane.
    cameras : sequence of str, optional
        Names; all cameras of the rig unless given.

    Yields
    ------
    Views
        In order of poses.

    Raises
    ------
    CalibrationError
        If the rig has no such camera.
    """
    lat, lon = np.atleast_1d(latitude_deg), np.atleast_1d(longitude_deg)
    height = np.full(lat.shape, np.nan) if height_m is None else np.broadcast_to(height_m, lat.shape)
    chosen = [rig.camera(name) for name in (rig.cameras if cameras is None else cameras)]
    reach = max_range_m + max((float(np.hypot(*c.rig_t_camera_m[:2])) for c in chosen), default=0.0)
    usable = np.flatnonzero(poses.valid)
    for start in range(0, usable.size, _CHUNK):
        pose, site = _pairs(poses, usable[start : start + _CHUNK], lat, lon, reach)
        point = points_in_rig(poses, pose, lat[site], lon[site], height[site])
        for camera in chosen:
            pixel, distance, seen = seen_by(camera, point, margin_px)
            with np.errstate(invalid="ignore"):
                seen &= (distance >= min_range_m) & (distance <= max_range_m)
            name = np.full(int(seen.sum()), camera.name)
            yield Views(site[seen], pose[seen], name, distance[seen], pixel[seen])


def _pairs(
    poses: Poses, chunk: IntArray, lat: FloatArray, lon: FloatArray, reach_m: float
) -> tuple[IntArray, IntArray]:
    """Poses and sites within reach of each other: boxes about the chunk and its parts, then by distance."""
    pose_lat, pose_lon = poses.latitude_deg[chunk], poses.longitude_deg[chunk]
    east, north = metres_per_degree(pose_lat)
    reach = reach_m / north.min() * _ROUNDING, reach_m / east.min() * _ROUNDING
    near = _in_box(lat, lon, pose_lat, pose_lon, reach)
    at_once = chunk.size if near.size * chunk.size <= _FEW else _PART
    found_pose, found_site = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for start in range(0, chunk.size, at_once):
        part = slice(start, start + at_once)
        some = near[_in_box(lat[near], lon[near], pose_lat[part], pose_lon[part], reach)]
        if some.size:
            de = (lon[some] - pose_lon[part, None]) * east[part, None]
            dn = (lat[some] - pose_lat[part, None]) * north[part, None]
            i, j = np.nonzero(de**2 + dn**2 <= reach_m**2)
            found_pose.append(chunk[part][i])
            found_site.append(some[j])
    return np.concatenate(found_pose), np.concatenate(found_site)


def _in_box(
    lat: FloatArray, lon: FloatArray, of_lat: FloatArray, of_lon: FloatArray, reach: tuple[float, float]
) -> IntArray:
    """Which sites lie in the box about poses, degrees of latitude and longitude wider on each side."""
    box = (lat >= of_lat.min() - reach[0]) & (lat <= of_lat.max() + reach[0])
    box &= (lon >= of_lon.min() - reach[1]) & (lon <= of_lon.max() + reach[1])
    return np.flatnonzero(box)


def points_in_rig(
    poses: Poses, pose: IntArray, lat: FloatArray, lon: FloatArray, height: FloatArray
) -> FloatArray:
    """Give places in the rig frame of their poses: on its ground plane where the height is unknown.

    Parameters
    ----------
    poses : Poses (n,)
    pose : int64 (m,)
        Which of them each place is seen from.
    lat, lon : float64 (m,)
        Degrees.
    height : float64 (m,)
        Ellipsoidal; NaN where unknown.

    Returns
    -------
    float64 (m, 3)
        FLU, metres.
    """
    east, north = metres_per_degree(poses.latitude_deg[pose])
    de, dn = (lon - poses.longitude_deg[pose]) * east, (lat - poses.latitude_deg[pose]) * north
    enu_R_rig = rotation_enu_from_rig(poses.heading_deg[pose], poses.pitch_deg[pose], poses.roll_deg[pose])
    # z = 0 in the rig: the up component that the third row of the rotation asks for.
    up_on_plane = -(enu_R_rig[:, 0, 2] * de + enu_R_rig[:, 1, 2] * dn) / enu_R_rig[:, 2, 2]
    up = np.where(np.isfinite(height), height - poses.height_m[pose], up_on_plane)
    return np.asarray(np.einsum("nij,ni->nj", enu_R_rig, np.stack([de, dn, up], axis=1)))


def seen_by(
    camera: RigCamera, point_rig_m: FloatArray, margin_px: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Project points of the rig frame.

    Parameters
    ----------
    camera : RigCamera
    point_rig_m : float64 (m, 3)
    margin_px : float
        Nearer to the edge of the picture than this does not count as shown.

    Returns
    -------
    pixel_px : float64 (m, 2)
        NaN outside the camera model's domain.
    distance_m : float64 (m,)
        Horizontal, from the camera.
    seen : bool (m,)
        Whether it shows: inside the picture, and not on the car itself.
    """
    offset = point_rig_m - camera.rig_t_camera_m
    pixel, seen = camera.model.pixel_from_camera_point(offset @ camera.rig_R_camera)
    with np.errstate(invalid="ignore"):
        inner = (pixel[:, 0] >= margin_px - 0.5) & (pixel[:, 0] <= camera.model.width_px - 0.5 - margin_px)
        inner &= (pixel[:, 1] >= margin_px - 0.5) & (pixel[:, 1] <= camera.model.height_px - 0.5 - margin_px)
    seen = seen & inner & ~on_the_car_itself(camera, pixel)
    return pixel, np.hypot(offset[:, 0], offset[:, 1]), seen
