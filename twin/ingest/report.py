"""What an ingest tells of a drive."""

from __future__ import annotations

from dataclasses import dataclass

from geoloc.trajectory.vehicle_motion import MotionFound
from twin.ingest.located import LocatedDrive
from twin.ingest.save import Saved


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
    annotation_set : int
        Its number among those of the drive (:mod:`twin.store.annotation_sets`).
    delay_ms : float or None
        Median delay of the GNSS host stamps, the trip's link delay.
    fix_quality : dict
        In words → number of fixes, of all antennas; empty for a full-pose track.
    motion : MotionFound or None
        What was found of the car's own sensors; None where it has none.
    """

    drive_id: str
    name: str
    method: str
    n_annotations: int
    n_sightings: int
    n_located: int
    n_objects: int
    n_estimates: int
    annotation_set: int
    length_m: float
    delay_ms: float | None
    fix_quality: dict[str, int]
    motion: MotionFound | None
    warnings: tuple[str, ...]
    skipped: dict[str, int]


def report_of(located: LocatedDrive, saved: Saved) -> IngestReport:
    """Return what is told of a drive that was saved."""
    drive = located.drive
    return IngestReport(
        drive_id=drive.drive_id,
        name=drive.name,
        method=located.result.method,
        n_annotations=drive.n_annotations,
        n_sightings=int(located.sightings.is_measured.sum()),
        n_located=located.sightings.n_located,
        n_objects=located.n_objects,
        n_estimates=len(located.estimates),
        annotation_set=saved.annotation_set.number,
        length_m=drive.length_m,
        delay_ms=drive.delay_ms,
        fix_quality=dict(drive.fix_quality),
        motion=located.motion,
        # What became of the store's other annotations is of this run, not of the drive.
        warnings=(*drive.warnings, *filter(None, [saved.sentence()])),
        skipped=dict(located.skipped),
    )
