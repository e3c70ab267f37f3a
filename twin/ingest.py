"""A recorded drive → estimates in the store."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.combine import Combined, combine
from geoloc.geodesy import (
    euref89_from_itrf2020,
    utm33_covariance_from_enu,
    utm33_from_geographic,
)
from geoloc.locate import ErrorBudget, Located, Sightings, locate_paper, locate_single_frame
from geoloc.trajectory import Poses, Trajectory, trajectory_from_gnss, trajectory_from_poses
from twin import __version__
from twin.drives.drive import Annotations, Drive
from twin.drives.read import read_drive
from twin.drives.timestamps import NO_STAMP
from twin.errors import DriveError
from twin.match import METHODS, blob_from_poses
from twin.store import Store

IntArray = NDArray[np.int64]

_NS_PER_S = 1_000_000_000
_VIEW_STEP_M = 0.3
"""Poses closer together than this add nothing to the question whether a place was in view."""


_NUMBER = re.compile(r"( of)? ?\b\d+(\.\d+)? s\b ?")
"""A duration inside a reason: without it, the same reason counts together."""


@dataclass(frozen=True, slots=True)
class IngestReport:
    """What one drive gave.

    Attributes
    ----------
    n_sightings, n_located : int
        Annotations with a foot in the picture, and those of them that got a position.
    n_estimates : int
        Objects with a position.
    skipped : dict
        "what: reason" → count, for everything that was left out on the way.
    delay_ms : float or None
        Median delay of the GNSS host stamps, the trip's link delay.
    """

    drive_id: str
    name: str
    method: str
    n_annotations: int
    n_sightings: int
    n_located: int
    n_objects: int
    n_estimates: int
    length_m: float
    delay_ms: float | None
    warnings: tuple[str, ...]
    skipped: dict[str, int]


def ingest_drive(
    store: Store,
    path: Path | str,
    *,
    method: str = "single-frame",
    budget: ErrorBudget | None = None,
    progress: Callable[[str], None] | None = None,
) -> IngestReport:
    """Read a drive, locate what was annotated and keep drive, sightings and estimates in the store.

    The same drive ingested twice by the same method replaces itself: nothing is doubled.

    Parameters
    ----------
    store : Store
    path : Path or str
        The drive's folder.
    method : {"single-frame", "paper"}
    budget : ErrorBudget, optional
        One-sigma noise of each source.

    Raises
    ------
    DriveError, GeolocError
        The drive cannot be read or located; the store is unchanged.
    """
    if method not in METHODS:
        raise DriveError(f"There is no method {method!r}: use one of {', '.join(METHODS)}.")
    say = progress or (lambda _text: None)
    drive = read_drive(Path(path), progress=say)
    say("building the trajectory")
    drive = in_euref89(drive)
    trajectory = trajectory_of(drive)
    say(f"locating {len(drive.annotations.frame):,} annotations by {method}")
    sighted = locate_annotations(drive, trajectory, method=method, budget=budget)
    estimates, n_outliers = _estimates(drive, sighted, method)
    line, length_m = _line(trajectory)
    delay = _delay_ms(drive, trajectory)
    store.save_drive(
        {
            "drive_id": drive.drive_id,
            "name": drive.name,
            "started_ns": int(trajectory.span_ns[0]),
            "ended_ns": int(trajectory.span_ns[1]),
            "datum": drive.datum,
            "annotations_complete": drive.annotations_complete,
            "n_frames": sum(int((s != NO_STAMP).sum()) for s in drive.frame_epoch_ns.values()),
            "n_annotations": len(drive.annotations.frame),
            "length_m": length_m,
            "delay_ms": delay,
            "line": line,
            "rig": zlib.compress(drive.rig_document.encode()),
            "poses": blob_from_poses(_view_poses(drive, trajectory)),
            "cameras": sorted({str(c) for c in drive.annotations.camera} or drive.frame_epoch_ns),
            "warnings": list(drive.warnings),
            "skipped": [asdict(s) for s in drive.skipped],
            "software": f"nvdb-twin {__version__}",
        },
        method,
        _sighting_rows(drive, sighted, method),
        estimates,
    )
    return IngestReport(
        drive_id=drive.drive_id,
        name=drive.name,
        method=method,
        n_annotations=len(drive.annotations.frame),
        n_sightings=len(sighted.index),
        n_located=int(sighted.located.valid.sum()),
        n_objects=len(np.unique(drive.annotations.object)),
        n_estimates=len(estimates),
        length_m=length_m,
        delay_ms=delay,
        warnings=drive.warnings,
        skipped=_skipped(drive, trajectory, sighted, n_outliers),
    )


@dataclass(frozen=True, slots=True)
class SightedObjects:
    """The drive's foot points with their epochs and positions.

    Attributes
    ----------
    index : int (n,)
        Row in the drive's annotations.
    epoch_ns : int (n,)
        Epoch of exposure.
    poses : Poses (n,)
    located : Located (n,)
    """

    index: IntArray
    epoch_ns: IntArray
    poses: Poses
    located: Located


def in_euref89(drive: Drive) -> Drive:
    """Return the drive with positions in EUREF89: unchanged, or transformed at the epoch of each fix."""
    if drive.datum == "EUREF89":
        return drive
    gnss = tuple(replace(fixes, **_transformed(fixes)) for fixes in drive.gnss)
    poses = replace(drive.poses, **_transformed(drive.poses)) if drive.poses is not None else None
    return replace(drive, gnss=gnss, poses=poses)


def _transformed(track: Any) -> dict[str, Any]:
    """ITRF2020 → EUREF89; the plate has moved 2.7 cm a year since 1989, so the epoch matters."""
    year = 1970.0 + track.epoch_ns / (_NS_PER_S * 86400 * 365.25)
    result = euref89_from_itrf2020(track.latitude_deg, track.longitude_deg, track.height_m, year)
    changed = {
        "latitude_deg": result.latitude_deg,
        "longitude_deg": result.longitude_deg,
        "height_m": result.height_m,
    }
    if hasattr(track, "sigma_horizontal_m"):
        changed["sigma_horizontal_m"] = np.hypot(track.sigma_horizontal_m, result.extra_sigma_m)
    return changed


def trajectory_of(drive: Drive) -> Trajectory:
    """Build the drive's trajectory from its full poses if it has them, else from its GNSS."""
    if drive.poses is not None:
        return trajectory_from_poses(drive.poses)
    lever_arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    return trajectory_from_gnss(drive.gnss, lever_arms)


def locate_annotations(
    drive: Drive, trajectory: Trajectory, *, method: str, budget: ErrorBudget | None = None
) -> SightedObjects:
    """Give every annotated foot its epoch, pose and position.

    Boxes show a sign's face, not where its pole meets the ground: one frame cannot locate them.
    """
    budget = budget or ErrorBudget()
    index = np.flatnonzero(drive.annotations.kind == "foot")
    camera = drive.annotations.camera[index]
    stamp = _frame_stamps(drive, camera, drive.annotations.frame[index])
    epoch = stamp + drive.camera_offset_ns
    sightings = Sightings(camera=camera, pixel_px=drive.annotations.pixel_px[index])
    poses = trajectory.poses_at(epoch)
    if method == "paper":
        # The paper pairs host stamps, late as they are: that is part of what it is measured by.
        located = locate_paper(
            drive.rig,
            sightings,
            trajectory.nearest_fix(stamp),
            budget,
            fix_interval_s=trajectory.interval_s,
            delay_ms=trajectory.delay_ms()[0],
        )
    else:
        located = locate_single_frame(drive.rig, sightings, poses, budget)
    return SightedObjects(index, epoch, poses, located)


def _frame_stamps(drive: Drive, camera: NDArray[np.str_], frame: IntArray) -> IntArray:
    stamps = np.empty(len(frame), dtype=np.int64)
    for name in np.unique(camera):
        mask = camera == name
        stamps[mask] = drive.frame_epoch_ns[str(name)][frame[mask]]
    return stamps


def _estimates(drive: Drive, sighted: SightedObjects, method: str) -> tuple[list[dict[str, Any]], int]:
    """One row an object that has at least one position, and the number of outliers left out."""
    valid = sighted.located.valid
    names, group = np.unique(drive.annotations.object[sighted.index], return_inverse=True)
    if not valid.any():
        return [], 0
    combined = combine(sighted.located, group)
    east, north = utm33_from_geographic(combined.latitude_deg, combined.longitude_deg)
    covariance = utm33_covariance_from_enu(
        combined.covariance_m2, combined.latitude_deg, combined.longitude_deg
    )
    rows = []
    for g, name in enumerate(names):
        if combined.n_used[g] == 0:
            continue
        member = np.flatnonzero((group == g) & valid)
        rows.append(
            {
                "estimate_id": f"{drive.drive_id}:{name}:{method}",
                "drive_id": drive.drive_id,
                "object": str(name),
                "method": method,
                "east_m": float(east[g]),
                "north_m": float(north[g]),
                "height_m": float(combined.height_m[g]),
                "cov_ee_m2": float(covariance[g, 0, 0]),
                "cov_en_m2": float(covariance[g, 0, 1]),
                "cov_nn_m2": float(covariance[g, 1, 1]),
                "range_min_m": float(combined.range_min_m[g]),
                "flags": _flags(combined, g),
                **_summary(drive.annotations, sighted, member, combined.n_used[g]),
            }
        )
    return rows, int(combined.n_rejected.sum())


def _summary(
    annotations: Annotations, sighted: SightedObjects, member: IntArray, n_used: int
) -> dict[str, Any]:
    """Label, code and counts of one object's located sightings."""
    rows = sighted.index[member]
    frames = {(str(annotations.camera[i]), int(annotations.frame[i])) for i in rows}
    return {
        "label": _commonest(annotations.label[rows]),
        "skiltnummer": _commonest(annotations.skiltnummer[rows]),
        "n_sightings": int(n_used),
        "n_frames": len({frame for _, frame in frames}),
        "n_cameras": len({camera for camera, _ in frames}),
        "first_ns": int(sighted.epoch_ns[member].min()),
        "last_ns": int(sighted.epoch_ns[member].max()),
    }


def _commonest(values: NDArray[np.str_]) -> str:
    """The most frequent value; of equals the first in alphabetical order, so that runs agree."""
    unique, counts = np.unique(values, return_counts=True)
    return str(unique[np.argmax(counts)])


def _flags(combined: Combined, g: int) -> str:
    flags = []
    if combined.n_used[g] == 1:
        flags.append("one sighting")
    if combined.range_min_m[g] > 15.0:
        flags.append("never nearer than 15 m")
    if combined.n_rejected[g]:
        flags.append(f"{combined.n_rejected[g]} outliers left out")
    return ";".join(flags)


def _sighting_rows(drive: Drive, sighted: SightedObjects, method: str) -> list[dict[str, Any]]:
    located = sighted.located
    east, north = utm33_from_geographic(located.latitude_deg, located.longitude_deg)
    notes = drive.annotations
    return [
        {
            "drive_id": drive.drive_id,
            "method": method,
            "number": k,
            "object": str(notes.object[i]),
            "camera": str(notes.camera[i]),
            "frame": int(notes.frame[i]),
            "epoch_ns": int(sighted.epoch_ns[k]),
            "u_px": float(notes.pixel_px[i, 0]),
            "v_px": float(notes.pixel_px[i, 1]),
            "east_m": _finite(east[k]),
            "north_m": _finite(north[k]),
            "range_m": _finite(located.range_m[k]),
            "speed_mps": _finite(sighted.poses.speed_mps[k]),
            "rejected": str(located.rejected[k]),
        }
        for k, i in enumerate(sighted.index)
    ]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _line(trajectory: Trajectory) -> tuple[bytes, float]:
    """The driven line as WKB in EPSG:25833, and its length in metres."""
    import shapely

    east, north = utm33_from_geographic(*trajectory.line())
    if len(east) == 1:  # standing still: a line needs two points
        east, north = np.repeat(east, 2), np.repeat(north, 2)
    line = shapely.LineString(np.column_stack([east, north]))
    return bytes(shapely.to_wkb(line)), float(line.length)


def _delay_ms(drive: Drive, trajectory: Trajectory) -> float | None:
    """Median link delay, or None where the recording has no host stamps of its own."""
    if drive.poses is not None or all(np.array_equal(f.host_ns, f.epoch_ns) for f in drive.gnss):
        return None
    return float(trajectory.delay_ms()[0])


def _view_poses(drive: Drive, trajectory: Trajectory) -> Poses:
    """Poses at the annotated cameras' frames, thinned to steps of 0.3 m."""
    cameras = {str(c) for c in drive.annotations.camera} or set(drive.frame_epoch_ns)
    stamps = [drive.frame_epoch_ns[c] for c in sorted(cameras)]
    known = [s[s != NO_STAMP] for s in stamps]
    epoch = np.unique(np.concatenate([np.empty(0, np.int64), *known])) + drive.camera_offset_ns
    poses = trajectory.poses_at(epoch)
    if not poses.valid.any():
        return poses
    epoch = epoch[poses.valid]
    travelled = np.concatenate(
        [[0.0], np.cumsum(poses.speed_mps[poses.valid][1:] * np.diff(epoch) / _NS_PER_S)]
    )
    step = np.floor(travelled / _VIEW_STEP_M)
    return trajectory.poses_at(epoch[np.diff(step, prepend=-1.0) > 0])


def _skipped(
    drive: Drive, trajectory: Trajectory, sighted: SightedObjects, n_outliers: int
) -> dict[str, int]:
    """Everything that was left out on the way, by what and why."""
    counts: dict[str, int] = {}

    def add(key: str, count: int) -> None:
        if count:
            counts[key] = counts.get(key, 0) + count

    for skipped in drive.skipped:
        add(f"{skipped.what}: {skipped.reason}", skipped.count)
    for count, reason in trajectory.dropped:
        add(f"GNSS fixes: {reason}", count)
    boxes = int((drive.annotations.kind == "box").sum())
    add("boxes: they show the face, not the foot (annotate the foot as a point)", boxes)
    reasons, numbers = np.unique(sighted.located.rejected, return_counts=True)
    for reason, number in zip(reasons, numbers, strict=True):
        if reason:
            add(f"sightings: {_NUMBER.sub('', reason)}", int(number))
    add("sightings: outliers among those of the same object", n_outliers)
    return counts
