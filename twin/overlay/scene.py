"""A drive as it is drawn over its own pictures: where everything stands, and how the cameras looked there."""

from __future__ import annotations

import json
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray, IntArray
from geoloc.rig.rig import Rig, RigCamera, rig_from_document
from geoloc.trajectory.poses import Poses
from twin.errors import ConfigError
from twin.evidence.sights import Place
from twin.matching.sites import Site
from twin.reports.estimate import explain_estimate, sites_between
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.records import Corrections, Covariance, Estimate
from twin.store.schema import METHODS
from twin.store.store import Row, Snapshot, Store

_AROUND_M = 60.0
"""NVDB's signs are taken from so far around the car's way."""


@dataclass(frozen=True, slots=True)
class Click:
    """One annotation in one picture.

    Attributes
    ----------
    pixel_px : (float, float)
        The foot, or the middle of a box; (0, 0) is the centre of the first pixel.
    box_px : (float, float, float, float) or None
        Left, top, right, bottom.
    residual_px : (float, float) or None
        Seen minus expected, as the adjustment left it.
    is_used : bool
        Whether it took part.
    """

    object: str
    is_foot: bool
    pixel_px: tuple[float, float]
    box_px: tuple[float, float, float, float] | None
    residual_px: tuple[float, float] | None
    is_used: bool


@dataclass(frozen=True, slots=True)
class Standing:
    """Something that stands at the road: an estimate of the drive, or a sign of NVDB.

    Attributes
    ----------
    name : str
        What is written beside it.
    place : Place
        Its foot, or the middle of its face where only faces were seen.
    """

    object: str
    name: str
    codes: tuple[str, ...]
    place: Place
    is_face: bool
    covariance_m2: Covariance | None


@dataclass(frozen=True, slots=True)
class DriveScene:
    """One drive of the store.

    Attributes
    ----------
    folder : str
        That it was read from last.
    rig : Rig
        As stored: pictures are looked for by it. What an adjustment found is in `camera`.
    poses : Poses
        Of the trajectory, thinned as `twin.ingest.locate.view_poses` does.
    corrections : Corrections or None
        What the adjustment found out; None for other methods.
    clicks : mapping of (camera, frame) to sequence of Click
    """

    drive_id: str
    name: str
    folder: str
    method: str
    rig: Rig
    poses: Poses
    corrections: Corrections | None
    estimates: tuple[Standing, ...]
    signs: tuple[Standing, ...]
    clicks: Mapping[tuple[str, int], Sequence[Click]]

    def camera(self, name: str) -> RigCamera:
        """Return a camera turned as the adjustment found it.

        Raises
        ------
        ConfigError
            The drive has no such camera.
        """
        if name not in self.rig.cameras:
            known = ", ".join(sorted(self.rig.cameras))
            raise ConfigError(f"{self.name} has no camera {name!r}: it has {known}.")
        camera = self.rig.cameras[name]
        turn = None if self.corrections is None else self.corrections.boresight_deg.get(name)
        if turn is None:
            return camera
        from geoloc.calibration.verify_mounting import turned

        return turned(camera, turn.pitch.value, turn.yaw.value, turn.roll.value)

    def row_epochs(self, camera: RigCamera, epoch_ns: int, row_px: FloatArray) -> IntArray:
        """Give the epochs at which rows of a picture were exposed, by the clock and shutter found."""
        if self.corrections is None:
            return np.full(row_px.shape, epoch_ns, dtype=np.int64)
        share = (row_px + 0.5) / camera.model.height_px - 0.5
        late_ms = self.corrections.camera_offset_ms.value + share * self.corrections.rolling_shutter_ms.value
        return np.asarray(epoch_ns + np.rint(late_ms * 1e6).astype(np.int64))

    def frames_of(self, name: str) -> Mapping[str, IntArray]:
        """Give the frames in which an object was annotated, by camera, in increasing order."""
        found: dict[str, list[int]] = defaultdict(list)
        for (camera, frame), clicks in self.clicks.items():
            if any(click.object == name for click in clicks):
                found[camera].append(frame)
        return {camera: np.array(sorted(of_camera)) for camera, of_camera in found.items()}


def scene_of(store: Store, which: str) -> tuple[DriveScene, str | None]:
    """Gather what is drawn over the pictures of a drive.

    Parameters
    ----------
    store : Store
    which : str
        A drive's id or name; or an estimate's or object's, as :func:`twin.reports.explain_estimate` takes it.

    Returns
    -------
    DriveScene
    str or None
        The object that was asked for; None where a drive was.

    Raises
    ------
    ConfigError
        There is nothing of this name, or it has several meanings.
    """
    t = schema.drive.c
    drives = store.rows(sa.select(t.drive_id).where((t.drive_id == which) | (t.name == which)))
    if len(drives) > 1:
        ids = ", ".join(sorted(row["drive_id"] for row in drives))
        raise ConfigError(f"{len(drives)} drives are called {which!r}: name one of {ids}.")
    if drives:
        with store.snapshot() as view:
            drive_id = drives[0]["drive_id"]
            return _scene(view, drive_id, _best_method(view, drive_id)), None
    estimate = explain_estimate(store, which)
    with store.snapshot() as view:
        return _scene(view, estimate.drive_id, estimate.method), estimate.object


def _best_method(view: Snapshot, drive_id: str) -> str:
    t = schema.drive_method.c
    methods: list[str] = [
        row["method"] for row in view.rows(sa.select(t.method).where(t.drive_id == drive_id))
    ]
    if not methods:
        raise ConfigError(f"The drive {drive_id} has no positions: ingest it with its annotations.")
    return min(methods, key=METHODS.index)


def _scene(view: Snapshot, drive_id: str, method: str) -> DriveScene:
    def of(table: sa.Table) -> sa.Select[tuple[object, ...]]:
        return sa.select(table).where(table.c.drive_id == drive_id, table.c.method == method)

    (drive,) = view.rows(sa.select(schema.drive).where(schema.drive.c.drive_id == drive_id))
    (of_method,) = view.rows(of(schema.drive_method))
    sets = schema.annotation_set.c
    current = sa.select(sets.folder).where(sets.drive_id == drive_id, sets.is_current)
    rows = view.rows(of(schema.sighting).where(schema.sighting.c.is_measured))
    with_foot = {row["object"] for row in rows if row["kind"] == "foot"}
    estimates = [Estimate.from_row(row) for row in view.rows(of(schema.estimate))]
    clicks: dict[tuple[str, int], list[Click]] = defaultdict(list)
    for row in rows:
        clicks[row["camera"], row["frame"]].append(_click(row))
    return DriveScene(
        drive_id=drive_id,
        name=drive["name"],
        folder=next((row["folder"] for row in view.rows(current)), ""),
        method=method,
        rig=rig_from_document(json.loads(zlib.decompress(drive["rig"])), drive["name"]),
        poses=poses_from_blob(drive["poses"]),
        corrections=Corrections.from_json(of_method["corrections"]),
        estimates=tuple(_estimate(one, is_face=one.object not in with_foot) for one in estimates),
        signs=_signs(view, estimates),
        clicks=clicks,
    )


def _signs(view: Snapshot, estimates: Sequence[Estimate]) -> tuple[Standing, ...]:
    """NVDB's signs around what the drive saw."""
    if not estimates:
        return ()
    places = np.array([(one.east_m, one.north_m) for one in estimates])
    low, high = places.min(axis=0) - _AROUND_M, places.max(axis=0) + _AROUND_M
    return tuple(_sign(site) for site in sites_between(view, low, high) if site.own_geometry)


def _sign(site: Site) -> Standing:
    codes = tuple(filter(None, site.codes))
    name = f"NVDB {' + '.join(codes) or site.nvdb_id}"
    return Standing(str(site.nvdb_id), name, codes, Place(site.east_m, site.north_m), False, None)


def _estimate(one: Estimate, *, is_face: bool) -> Standing:
    place = Place(one.east_m, one.north_m, one.height_m)
    return Standing(one.object, one.object, tuple(one.codes), place, is_face, one.covariance_m2)


def _click(row: Row) -> Click:
    u, v, width, height = row["u_px"], row["v_px"], row["width_px"], row["height_px"]
    box = (u - width / 2, v - height / 2, u + width / 2, v + height / 2) if width and height else None
    residual = row["residual_u_px"], row["residual_v_px"]
    return Click(
        object=row["object"],
        is_foot=row["kind"] == "foot",
        pixel_px=(u, v),
        box_px=box,
        residual_px=None if None in residual else residual,
        is_used=row["rejected"] == "",
    )
