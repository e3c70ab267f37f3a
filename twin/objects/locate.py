"""What was drawn on the ground in a drive's pictures → objects with a place, a size, and their errors."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.locate.outlines import Measure, Outline, cut_to_reach, locate_outline
from geoloc.locate.visibility import MAX_RANGE_M, on_the_car_itself
from geoloc.reasons import Reason, sentence_of
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.poses import Poses, part
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.annotations.labels import LABELS_FILE
from twin.drives.drive import Annotation, Drive
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.ingest.budget import budget_of
from twin.ingest.locate import in_euref89, trajectory_of, view_poses, widened, with_lateness
from twin.objects.same import Reading, same_objects

_BORDER = 0.01
"""A line that ends nearer to the edge of the picture than this share of its width goes on beyond it."""
_TOO_SHORT = f"so little of a line within {MAX_RANGE_M:.0f} m that its errors there are longer"
_TOO_FAR = f"a line no part of which is within {MAX_RANGE_M:.0f} m"


@dataclass(frozen=True, slots=True)
class GroundObject:
    """One object on the ground.

    Attributes
    ----------
    object : str
        The annotator's id or track, else one of the drawing's own.
    label : str
    nvdb_type : int or None
        Vegobjekttype that ``labels.toml`` gives the label.
    kind : str
        ``point``, ``line`` or ``area``.
    outline : Outline
        EUREF89.
    is_whole : bool
        False of a line that was drawn on beyond the reach: it is longer than its length.
    camera, frame : str, int
        The picture that knows it best.
    epoch_ns : int
        When that was taken, UTC.
    n_drawn, n_used : int
        Drawings of it, and those that its place comes from.
    """

    object: str
    label: str
    nvdb_type: int | None
    kind: str
    outline: Outline
    is_whole: bool
    camera: str
    frame: int
    epoch_ns: int
    n_drawn: int
    n_used: int

    @property
    def length(self) -> Measure | None:
        """Of a line, metres."""
        return self.outline.length() if self.kind == "line" else None

    @property
    def area(self) -> Measure | None:
        """Of an area, square metres."""
        return self.outline.area() if self.kind == "area" else None


@dataclass(frozen=True, slots=True)
class DriveObjects:
    """The objects on the ground of one drive.

    Attributes
    ----------
    drive : Drive
    poses : Poses
        The car along the way, in steps: what it could see.
    n_drawn : int
        Drawings that were read.
    objects : tuple of GroundObject
        By label and along the way.
    left_out : mapping of str to int
        Drawings without a place, by reason.
    warnings : tuple of str
    """

    drive: Drive
    poses: Poses
    n_drawn: int
    objects: tuple[GroundObject, ...]
    left_out: Mapping[str, int]
    warnings: tuple[str, ...]

    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north of where the car drove, EPSG:25833."""
        east, north = utm33_from_geographic(self.poses.latitude_deg, self.poses.longitude_deg)
        west, south, last_east, last_north = (
            float(limit(values)) for limit in (np.nanmin, np.nanmax) for values in (east, north)
        )
        return west, south, last_east, last_north


def locate_objects(
    path: Path | str,
    *,
    labels: Path | None = None,
    errors: Mapping[str, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> DriveObjects:
    """Read a drive and locate what was drawn on the ground in its pictures.

    Parameters
    ----------
    path : Path or str
        The drive's folder.
    labels : Path, optional
        What labels mean, instead of the folder's own ``labels.toml``.
    errors : mapping of name to one sigma, optional
        Terms of the error budget that count before all others.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    DriveError, ConfigError, GeolocError
        The drive cannot be read or located, or nothing of it was drawn on the ground.
    """
    drive = read_drive(path, labels=labels, progress=progress)
    if not drive.on_ground:
        raise DriveError(
            f"{path} has no annotation of what lies on the ground: say of its labels so in {LABELS_FILE},"
            ' "kerb" = { type = 9, ground = true } (`twin help objects`).'
        )
    budget = budget_of(drive, None, errors or {})
    drive, datum_sigma_m = in_euref89(drive)
    trajectory = trajectory_of(drive)
    budget = with_lateness(budget, trajectory)
    rows, offset_ns = drive.on_ground, drive.camera_offset_ns
    epoch_ns = np.array([drive.frame_epoch_ns[row.camera][row.frame] + offset_ns for row in rows])
    poses = widened(trajectory.poses_at(epoch_ns), datum_sigma_m)
    if progress is not None:
        progress(f"locating {len(rows):,} drawings on the ground")
    readings, left_out = [], Counter[str]()
    for number, row in enumerate(rows):
        pose = part(poses, np.array([number]))
        camera, pixel_px = drive.rig.camera(row.camera), np.array(row.outline_px)
        kept_px = cut_to_reach(camera, pixel_px, MAX_RANGE_M) if row.kind == "line" else pixel_px
        if row.kind == "line" and len(kept_px) < 2:
            left_out[_TOO_FAR] += 1
            continue
        outline = locate_outline(
            *(drive.rig, row.camera, kept_px, pose, budget),
            frame=f"{row.camera} {row.frame}",
            max_range_m=MAX_RANGE_M,
        )
        if (outline.rejected != "").any():
            left_out[_why(outline, trajectory)] += 1
            continue
        if row.kind == "area" and not _is_simple(outline):
            left_out["sides of the area cross one another"] += 1
            continue
        drawn = [bool(np.array_equal(kept_px[k], pixel_px[k])) for k in (0, -1)]
        if not all(drawn) and _is_too_short(outline):
            left_out[_TOO_SHORT] += 1
            continue
        first, last = (
            there and not _at_border(camera, kept_px[k]) for there, k in zip(drawn, (0, -1), strict=True)
        )
        readings.append(Reading(row, outline, int(epoch_ns[number]), (first, last)))
    if not readings:
        why = "; ".join(f"{count:,} {reason}" for reason, count in left_out.most_common(3))
        raise DriveError(f"None of the {len(rows):,} drawings on the ground of {path} has a place: {why}.")
    return DriveObjects(
        drive=drive,
        poses=view_poses(drive, trajectory, {row.camera for row in rows}),
        n_drawn=len(rows),
        objects=_objects(readings, drive, trajectory),
        left_out=dict(sorted(left_out.items())),
        warnings=tuple(dict.fromkeys(map(str, drive.warnings))),
    )


def _at_border(camera: RigCamera, pixel_px: FloatArray) -> bool:
    """Whether a line goes on out of the picture, or behind the car itself."""
    margin = _BORDER * camera.model.width_px
    last = np.array([camera.model.width_px, camera.model.height_px]) - 1.0
    if (pixel_px <= margin).any() or (pixel_px >= last - margin).any():
        return True
    around = pixel_px + margin * np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    return bool(on_the_car_itself(camera, around).any())


def _is_too_short(outline: Outline) -> bool:
    """Whether the end of a line that lies within reach may as well lie elsewhere altogether."""
    ends_m2 = np.trace(outline.corner_m2[[0, -1]], axis1=1, axis2=2)
    return bool(outline.length().value < np.sqrt(ends_m2.sum()))


def _is_simple(outline: Outline) -> bool:
    import shapely

    return bool(shapely.Polygon(outline.plane_m()).is_valid)


def _why(outline: Outline, trajectory: Trajectory) -> str:
    """Say why a drawing has no place, by the first of its corners that has none."""
    reason = Reason(next(reason for reason in outline.rejected.tolist() if reason))
    return sentence_of(reason, max_range_m=MAX_RANGE_M, span_ns=trajectory.span_ns)


def _objects(readings: Sequence[Reading], drive: Drive, trajectory: Trajectory) -> tuple[GroundObject, ...]:
    types = drive.other_objects
    found = []
    for one in same_objects(readings, trajectory.line()):
        best: Annotation = one.best.row
        found.append(
            GroundObject(
                object=best.object,
                label=best.label,
                nvdb_type=types.get(best.label),
                kind=best.kind,
                outline=one.outline,
                is_whole=one.is_whole,
                camera=best.camera,
                frame=best.frame,
                epoch_ns=one.best.epoch_ns,
                n_drawn=len(one.readings),
                n_used=one.n_used,
            )
        )
    return tuple(sorted(found, key=lambda one: (one.label, one.epoch_ns, one.object)))
