"""A recorded drive → everything that the store gets of it, and into the store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypedDict, Unpack

import numpy as np

from geoloc.doubts import Doubt
from geoloc.locate.records import Kind
from geoloc.locate.single_frame import ErrorBudget
from geoloc.reasons import stands_far_away
from geoloc.trajectory.trajectory import Trajectory
from geoloc.trajectory.vehicle_motion import MotionFound
from twin.drives.annotations.gather import only
from twin.drives.annotations.key_frames import never_measured
from twin.drives.drive import Drive
from twin.drives.folder.notes import DriveDoubt
from twin.drives.objects.identify import has_tracks_to_join, id_warnings, with_objects
from twin.drives.plausibility import (
    annotation_warnings,
    check_enough_read,
    check_track,
    mostly_left_out,
)
from twin.drives.read import read_drive
from twin.drives.track.pose_sigmas import pose_sigma_doubts
from twin.errors import ConfigError, DriveError
from twin.ingest.budget import budget_of, clock_doubts, lens_doubts
from twin.ingest.drive_record import drive_record, left_out
from twin.ingest.locate import SightedObjects, in_euref89, locate_annotations, trajectory_of
from twin.ingest.located import LocatedDrive
from twin.ingest.misfits import absence_gap, clocks_apart, misfits_of, turned_cameras
from twin.ingest.paper import paper_readings, told_readings, with_paper_antenna
from twin.ingest.report import IngestReport, report_of
from twin.ingest.rows import corrections_of, estimates_of, positions_of, sightings_of
from twin.ingest.save import save_drive
from twin.ingest.terrain import ground_of
from twin.store.drive_records import MethodRecord
from twin.store.kinds import Method
from twin.store.records import Estimate
from twin.store.schema import METHODS
from twin.store.store import Store

if TYPE_CHECKING:
    from twin.drives.detection.run import DetectorOptions

_TYRES_WEAR = 0.05
"""Wheels and the constants of their sensors are better known than this."""


class LocateOptions(TypedDict, total=False):
    """How a drive is located: what :func:`locate_drive` takes beside the folder, each with its default."""

    method: str
    budget: ErrorBudget | None
    errors: Mapping[str, float] | None
    terrain: Path | str | None
    terrain_heights: str | None
    labels: Path | str | None
    detector: DetectorOptions | None
    paper: Mapping[str, str]
    partial: bool


def ingest_drive(
    store: Store,
    path: Path | str,
    *,
    replace: bool = False,
    progress: Callable[[str], None] | None = None,
    **options: Unpack[LocateOptions],
) -> IngestReport:
    """Read a drive, locate what was annotated and keep drive, sightings and estimates in the store.

    The same drive ingested twice by the same method replaces itself: nothing is doubled. Other annotations of
    the same recording are a set of their own (:func:`twin.ingest.save.save_drive`).

    Parameters
    ----------
    store : Store
    path : Path or str
        The drive's folder.
    replace : bool
        Whether the drive's other annotation sets are deleted, also by a folder without annotations.
    progress : callable, optional
        Called with one sentence a step.
    **options
        As :func:`locate_drive` takes them.

    Raises
    ------
    ConfigError, DriveError, TerrainError, GeolocError
        As :func:`locate_drive`; the store is unchanged.
    RefusedError
        It has no annotations, and the store has some of the same recording; the store is unchanged.
    """
    located = locate_drive(path, progress=progress, **options)
    return report_of(located, save_drive(store, located, replace=replace))


def locate_drive(
    path: Path | str,
    *,
    method: str = METHODS[0],
    budget: ErrorBudget | None = None,
    errors: Mapping[str, float] | None = None,
    terrain: Path | str | None = None,
    terrain_heights: str | None = None,
    labels: Path | str | None = None,
    detector: DetectorOptions | None = None,
    paper: Mapping[str, str] = MappingProxyType({}),
    partial: bool = False,
    progress: Callable[[str], None] | None = None,
) -> LocatedDrive:
    """Read a drive and locate what was annotated: everything that a store gets of it, and no store.

    What comes out depends on the folder and the options alone, on every machine.

    The adjustment, by far the most of the work, runs once for the positions. Where the track is worse than
    association takes for granted, it runs before that at most twice to tell objects apart (annotations
    without ids, or tracks of a detector), and then once to check ids, which a detector's drive is not asked.
    Where the cameras disagree, it runs once more for each of them. Each has sightings or objects of its own,
    so that none could take another's result: four and the number of cameras at the most.

    Parameters
    ----------
    path : Path or str
        The drive's folder.
    method : {"adjusted", "single-frame", "paper"}
    budget : ErrorBudget, optional
        One-sigma noise of each source, in place of the usual ones and of what the drive states.
    errors : mapping of name to one sigma, optional
        Terms of the error budget that count before all others.
    terrain : Path or str, optional
        Raster of the ground (GeoTIFF) to use instead of the plane of the road.
    terrain_heights : {"NN2000", "ellipsoidal"}, optional
        What its heights are, where it does not say so itself.
    labels : Path or str, optional
        What labels mean (:mod:`twin.drives.annotations.labels`), instead of the folder's own ``labels.toml``.
    detector : DetectorOptions, optional
        A network that finds the signs in the drive's pictures; annotations are then left unread.
    paper : mapping of str to str, optional
        How the paper's method is read (:mod:`twin.ingest.paper`): ``distance``, ``fov``, ``fov.CAMERA``,
        ``start``, ``antenna``.
    partial : bool
        Whether a drive of whose annotations more than half were left out is taken all the same: as one that
        is not completely annotated.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    ConfigError, DriveError, TerrainError, GeolocError
        The drive cannot be read or located, or more than half of its annotations were left out.
    """
    _check_method(method, detector, paper)
    say = progress or (lambda _text: None)
    meanings = None if labels is None else Path(labels)
    drive = read_drive(Path(path), labels=meanings, detector=detector, progress=say)
    drive = with_paper_antenna(drive, paper)
    readings = paper_readings(drive, paper)
    budget = budget_of(drive, budget, errors or {})
    track_doubts = check_track(drive)
    if not partial:
        check_enough_read(drive)
    say("building the trajectory")
    drive, datum_sigma_m = in_euref89(drive)
    trajectory = trajectory_of(drive)
    drive = _with_objects(drive, trajectory, detector, say)
    ground = ground_of(terrain, terrain_heights, trajectory, method)
    say(f"locating {len(drive.annotations.frame):,} annotations by {method}")
    sighted = locate_annotations(
        drive,
        trajectory,
        method=method,
        budget=budget,
        datum_sigma_m=datum_sigma_m,
        terrain=ground,
        readings=readings,
    )
    positions = positions_of(sighted)
    estimates = estimates_of(drive, sighted, positions, method)
    n_unplaced = _unplaced(drive, sighted, {estimate.object for estimate in estimates})
    id_doubts = () if detector is not None else _id_doubts(drive, trajectory, sighted, budget, say)
    misfits = misfits_of(drive, sighted, budget, id_doubts)
    gap = absence_gap(drive, sighted)
    warnings = (
        *drive.warnings,
        *track_doubts,
        *_adjustment_doubts(drive, trajectory, sighted, budget),
        *id_doubts,
        *(misfit.sentence for misfit in misfits),
        *_annotation_doubts(drive, sighted, estimates, n_unplaced, gap),
        *told_readings(paper),
    )
    return LocatedDrive(
        drive=drive_record(drive, trajectory, tuple(dict.fromkeys(map(str, warnings)))),
        result=MethodRecord(
            Method(method),
            n_unplaced,
            corrections_of(sighted.adjusted, trajectory),
            tuple(misfit.kind for misfit in misfits),
            gap,
        ),
        sightings=sightings_of(drive, sighted, trajectory),
        estimates=tuple(estimates),
        annotations_sha256=drive.annotations_sha256,
        folder=str(Path(path).absolute()),  # evidence looks there later, from wherever it is asked
        n_objects=len(np.unique(drive.annotations.object)),
        motion=trajectory.motion,
        skipped=left_out(drive, trajectory, sighted, int(positions.n_rejected.sum())),
    )


def _adjustment_doubts(
    drive: Drive, trajectory: Trajectory, sighted: SightedObjects, budget: ErrorBudget
) -> tuple[Doubt, ...]:
    """Say what a user should know of clocks, lenses, poses and wheels."""
    return (
        *(sighted.adjusted.doubts if sighted.adjusted else ()),
        *clock_doubts(drive, budget, sighted.adjusted),
        *lens_doubts(sighted.adjusted),
        *_pose_doubts(trajectory, sighted),
        *_motion_doubts(trajectory.motion),
    )


def _annotation_doubts(
    drive: Drive, sighted: SightedObjects, estimates: Sequence[Estimate], n_unplaced: int, gap: str
) -> tuple[Doubt | str, ...]:
    """Say what a user should know of the annotations, and what they cannot show."""
    placed = {estimate.object for estimate in estimates}
    lost = mostly_left_out(drive)
    return (
        *annotation_warnings(drive, int((sighted.reasons == "").sum()), placed),
        *_absence_warning(drive, n_unplaced, gap),
        *([f"{lost}: this drive does not count as completely annotated."] if lost else []),
    )


def _pose_doubts(trajectory: Trajectory, sighted: SightedObjects) -> tuple[Doubt, ...]:
    """Say what poses without sigmas were taken as."""
    adjusted = sighted.adjusted
    if adjusted is None or adjusted.pose_sigmas is None:
        return pose_sigma_doubts(trajectory.estimated)
    return pose_sigma_doubts(adjusted.pose_sigmas, adjusted=True)


def _motion_doubts(motion: MotionFound | None) -> tuple[Doubt, ...]:
    """Say that wheels are further off than tyres wear: a constant added to the speed looks like a scale."""
    scale = None if motion is None else motion.wheel_scale
    if scale is None or abs(scale.value - 1.0) < _TYRES_WEAR:
        return ()
    told = (
        f"The car's speed is {scale.value:.3f} times that of the fixes, more than tyres explain: a constant"
        " was added to it, or it is the speedometer's. Where it bridges a gap places may be off by metres:"
        " give the speed of the wheels under [motion], or none."
    )
    return (Doubt(DriveDoubt.TRACK, told),)


def _check_method(method: str, detector: DetectorOptions | None, paper: Mapping[str, str]) -> None:
    if method not in METHODS:
        raise DriveError(f"There is no method {method!r}: use one of {', '.join(METHODS)}.")
    if paper and method != Method.PAPER:
        raise ConfigError("How the paper's method is read (--paper) matters to --method paper alone.")
    if detector is not None and method != METHODS[0]:
        raise ConfigError(
            f"A detector finds the faces of signs, not their feet: only --method {METHODS[0]} places them."
        )


def _with_objects(
    drive: Drive, trajectory: Trajectory, detector: DetectorOptions | None, say: Callable[[str], None]
) -> Drive:
    """Settle which annotations show the same object."""
    if detector is not None:
        from twin.drives.objects.join_tracks import with_joined_tracks

        say("joining the detector's tracks")
        return with_joined_tracks(drive, trajectory)
    if not drive.annotations.has_id.all() or has_tracks_to_join(drive.annotations):
        say("finding out which annotations show the same object")
    return with_objects(drive, trajectory)


def _id_doubts(
    drive: Drive,
    trajectory: Trajectory,
    sighted: SightedObjects,
    budget: ErrorBudget,
    say: Callable[[str], None],
) -> tuple[Doubt, ...]:
    """Check what annotators marked as one object.

    Not where a camera is turned: its rays miss one another, which looks as if ids marked two signs. So they
    do with the stated clock where the adjustment found another one: the ids are held against that.
    """
    in_time = drive
    if sighted.adjusted is not None:
        if any(turned_cameras(sighted.adjusted)):
            return ()
        later_ns = round(1e6 * sighted.adjusted.time_offset_ms.value)
        in_time = replace(drive, camera_offset_ns=drive.camera_offset_ns + later_ns)
    say("checking the annotators' ids")
    focal_share = max((budget.lens_of(one).focal_share for one in drive.rig.cameras.values()), default=0.0)
    return clocks_apart(id_warnings(in_time, trajectory, focal_share), drive, trajectory, budget)


def _unplaced(drive: Drive, sighted: SightedObjects, placed: set[str]) -> int:
    """Count annotated signs without a position that may stand near the car.

    One whose every ray ends beyond flat ground's reach, or above the horizon, stands far away; a box, a foot
    that was rejected for any other reason, or what has no key frame may be any sign that the car passed.
    """
    far = stands_far_away(sighted.located.rejected)
    is_sign = drive.is_sign()
    near = set(drive.annotations.object[is_sign & (drive.annotations.kind == Kind.BOX)].tolist())
    in_reach = sighted.index[~far]
    near |= set(drive.annotations.object[in_reach[is_sign[in_reach]]].tolist())
    seen = drive.interpolated
    near |= never_measured(drive.annotations, only(seen, drive.is_sign(seen)))
    return len(near - placed)


def _absence_warning(drive: Drive, n_unplaced: int, gap: str) -> tuple[str, ...]:
    """Say why a drive that is declared complete cannot show that a sign is missing."""
    if not drive.annotations_complete:
        return ()
    if gap:
        return (f"This drive cannot show that a sign is missing: {gap}.",)
    if not n_unplaced:
        return ()
    missing = (
        f"{n_unplaced} annotated objects have no position (see what was left out), so this drive cannot show"
        " that a sign is missing: annotate the foot of each pole as a point."
    )
    return (missing,)
