"""Drives as the map of a finding shows them: where the car was, where its cameras looked, what they saw."""

from __future__ import annotations

import json
import threading
import zlib
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, metres_per_degree
from geoloc.locate.visibility import views
from geoloc.rig.rig import Rig, rig_from_document
from geoloc.trajectory.poses import Poses
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Snapshot

_KEPT = 8
"""Drives whose poses are kept in memory: an hour at 10 Hz is 5 MB."""
_CAR_M = 10.0
"""No camera sits farther from the middle of the rear axle."""
_MAX_CAMERAS = 24
"""Camera places shown of one drive: more hide the sign."""


@dataclass(frozen=True, slots=True)
class DriveShown:
    """One drive.

    Attributes
    ----------
    drive_id, name : str
    started_ns : int
    cameras : tuple of str
        That were annotated.
    track_m : float64 (n, 2)
        EPSG:25833.
    rig : Rig
    poses : Poses
    """

    drive_id: str
    name: str
    started_ns: int
    cameras: tuple[str, ...]
    track_m: FloatArray
    rig: Rig
    poses: Poses


@dataclass(frozen=True, slots=True)
class Glance:
    """A camera at the moment of a picture: its place in degrees, and where it looks from true north."""

    camera: str
    lon: float
    lat: float
    facing_deg: float


class Drives:
    """Drives read from a store, the last few kept."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[str, str], DriveShown] = OrderedDict()

    def get(self, view: Snapshot, drive_ids: Sequence[str]) -> list[DriveShown]:
        """Return the drives that are in the store, in order of time."""
        drive = schema.drive.c
        rows = view.rows(
            sa.select(drive.drive_id, drive.content_sha256, drive.started_ns)
            .where(drive.drive_id.in_(drive_ids))
            .order_by(drive.started_ns)
        )
        return [self._one(view, (row["drive_id"], row["content_sha256"])) for row in rows]

    def _one(self, view: Snapshot, key: tuple[str, str]) -> DriveShown:
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        row = view.rows(sa.select(schema.drive).where(schema.drive.c.drive_id == key[0]))[0]
        shown = DriveShown(
            drive_id=row["drive_id"],
            name=row["name"],
            started_ns=row["started_ns"],
            cameras=tuple(row["cameras"]),
            track_m=np.asarray(shapely.get_coordinates(shapely.from_wkb(row["line"])), dtype=np.float64),
            rig=rig_from_document(json.loads(zlib.decompress(row["rig"])), source=row["name"]),
            poses=poses_from_blob(row["poses"]),
        )
        with self._lock:
            self._kept[key] = shown
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        return shown


def track_near(drive: DriveShown, east_m: float, north_m: float, radius_m: float) -> list[FloatArray]:
    """Return the pieces (n, 2) of a track within a distance of a place, EPSG:25833."""
    near = np.hypot(drive.track_m[:, 0] - east_m, drive.track_m[:, 1] - north_m) <= radius_m
    rows = np.flatnonzero(near)
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return [drive.track_m[piece] for piece in pieces if len(piece) > 1]


def glances_at(drive: DriveShown, epochs_ns: Sequence[int], cameras: Sequence[str]) -> list[Glance]:
    """Return the cameras at the moments of some pictures, a few of them spread over all."""
    chosen = _spread(len(epochs_ns))
    if not len(drive.poses.epoch_ns):
        return []
    times, epochs = drive.poses.epoch_ns, np.asarray(epochs_ns, dtype=np.int64)
    after = np.minimum(np.searchsorted(times, epochs), len(times) - 1)
    before = np.maximum(after - 1, 0)
    pose = np.where(np.abs(times[before] - epochs) <= np.abs(times[after] - epochs), before, after)
    return [_glance(drive.rig, drive.poses, int(pose[at]), cameras[at]) for at in chosen]


def glances_towards(drive: DriveShown, lon: float, lat: float, range_m: float) -> list[Glance]:
    """Return the cameras while they had a place in view, a few of them spread over all."""
    poses = _poses_near(drive.poses, lon, lat, range_m)
    cameras = [name for name in drive.cameras if name in drive.rig.cameras]
    seen = [
        (int(pose), str(camera))
        for found in views(drive.rig, poses, [lat], [lon], max_range_m=range_m, cameras=cameras)
        for pose, camera in zip(found.pose, found.camera, strict=True)
    ]
    seen.sort()
    return [_glance(drive.rig, poses, *seen[at]) for at in _spread(len(seen))]


def _poses_near(poses: Poses, lon: float, lat: float, range_m: float) -> Poses:
    per_east, per_north = metres_per_degree(lat)
    east, north = (poses.longitude_deg - lon) * per_east, (poses.latitude_deg - lat) * per_north
    near = np.hypot(east, north) <= range_m + _CAR_M
    return Poses(**{name: getattr(poses, name)[near] for name in Poses.__slots__})


def _spread(n: int) -> list[int]:
    return np.unique(np.linspace(0, n - 1, min(n, _MAX_CAMERAS)).round().astype(int)).tolist() if n else []


def _glance(rig: Rig, poses: Poses, pose: int, camera: str) -> Glance:
    heading = float(poses.heading_deg[pose])
    lat, lon = float(poses.latitude_deg[pose]), float(poses.longitude_deg[pose])
    ahead_m = left_m = yaw_deg = 0.0
    if camera in rig.cameras:
        one = rig.camera(camera)
        ahead_m, left_m = float(one.rig_t_camera_m[0]), float(one.rig_t_camera_m[1])
        axis = one.rig_R_camera[:, 2]
        yaw_deg = float(np.rad2deg(np.arctan2(axis[1], axis[0])))
    turn = np.deg2rad(heading)
    east = ahead_m * np.sin(turn) - left_m * np.cos(turn)
    north = ahead_m * np.cos(turn) + left_m * np.sin(turn)
    per_east, per_north = metres_per_degree(lat)
    return Glance(
        camera,
        round(lon + float(east / per_east), 7),
        round(lat + float(north / per_north), 7),
        round((heading - yaw_deg) % 360.0, 1),
    )


def degrees_from_utm33(xy_m: FloatArray) -> list[list[float]]:
    """EPSG:25833 (n, 2) → longitude and latitude for GeoJSON, to a centimetre."""
    lat, lon = geographic_from_utm33(xy_m[:, 0], xy_m[:, 1])
    return np.round(np.stack([lon, lat], axis=1), 7).tolist()  # type: ignore[no-any-return]
