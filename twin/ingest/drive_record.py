"""A drive as it was read → its record, and what of it was left out."""

from __future__ import annotations

import numpy as np

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.locate.records import Kind
from geoloc.reasons import Reason, sentence_of
from geoloc.trajectory.fix_checks import quality_counts
from geoloc.trajectory.trajectory import Trajectory
from twin import __version__
from twin.drives.drive import Drive
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.plausibility import mostly_left_out
from twin.ingest.locate import SightedObjects, view_poses
from twin.store.drive_records import DriveRecord


def drive_record(drive: Drive, trajectory: Trajectory, warnings: tuple[str, ...]) -> DriveRecord:
    """Return what the store keeps of the drive itself."""
    line, length_m = _line(trajectory)
    annotated = drive.annotated_cameras()
    return DriveRecord(
        drive_id=drive.drive_id,
        name=drive.name,
        started_ns=int(trajectory.span_ns[0]),
        ended_ns=int(trajectory.span_ns[1]),
        datum=drive.datum,
        annotations_complete=drive.annotations_complete and not mostly_left_out(drive),
        n_frames=sum(int((s != NO_STAMP).sum()) for s in drive.frame_epoch_ns.values()),
        n_annotations=len(drive.annotations.frame),
        length_m=length_m,
        delay_ms=_delay_ms(drive, trajectory),
        line=line,
        rig_document=drive.rig_document,
        poses=view_poses(drive, trajectory, annotated),
        content_sha256=drive.content_sha256,
        # Of all antennas, in words.
        fix_quality=quality_counts(
            np.concatenate([np.empty(0, np.int64), *(fixes.quality for fixes in drive.gnss)])
        ),
        cameras=tuple(sorted(annotated or drive.frame_epoch_ns)),
        warnings=warnings,
        skipped=tuple(s.as_row() for s in drive.skipped),
        software=f"nvdb-twin {__version__}",
    )


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


def left_out(
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
    if sighted.adjusted is None:
        boxes = int((drive.annotations.kind == Kind.BOX).sum())
        add("boxes: they show the face, not the foot (use --method adjusted)", boxes)
    reasons, numbers = np.unique(sighted.reasons, return_counts=True)
    for reason, number in zip(reasons, numbers, strict=True):
        if reason not in ("", Reason.OUTLIER):
            why = sentence_of(Reason(reason), max_range_m=MAX_RANGE_M, span_ns=trajectory.span_ns)
            add(f"sightings: {why}", int(number))
    add("sightings: outliers among those of the same object", n_outliers)
    return counts
