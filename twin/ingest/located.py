"""What comes of a drive, before any store: everything that is kept of it, and what is told of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from geoloc.trajectory.vehicle_motion import MotionFound
from twin.store.drive_records import DriveRecord, MethodRecord, Sightings
from twin.store.records import Estimate


@dataclass(frozen=True, slots=True, eq=False)
class LocatedDrive:
    """Everything that a store gets of one drive by one method: plain values that any process can take.

    Attributes
    ----------
    drive : DriveRecord
        With its poses.
    result : MethodRecord
        What the method found out about the drive.
    sightings : Sightings
    estimates : tuple of Estimate
    annotations_sha256 : str
        By which the same annotations are known.
    folder : str
        Where it was read from: a folder, or the address that it was fetched from.
    n_objects : int
        Annotated, with a position or without.
    motion : MotionFound or None
        What was found of the car's own sensors; None where it has none.
    skipped : mapping
        "what: reason" → count, for everything that was left out on the way.
    """

    drive: DriveRecord
    result: MethodRecord
    sightings: Sightings
    estimates: tuple[Estimate, ...]
    annotations_sha256: str = ""
    folder: str = ""
    n_objects: int = 0
    motion: MotionFound | None = None
    skipped: Mapping[str, int] = field(default_factory=dict)
