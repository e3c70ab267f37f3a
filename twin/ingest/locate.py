"""A drive's annotations → epochs, poses and positions, in EUREF89."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypedDict, TypeVar

import numpy as np

from geoloc.adjustment.adjust import adjust
from geoloc.adjustment.result import Adjusted
from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.doubts import Doubt
from geoloc.earth.datum import euref89_from_itrf
from geoloc.earth.terrain import Terrain
from geoloc.locate.observations import Observations
from geoloc.locate.on_terrain import locate_on_terrain
from geoloc.locate.paper_readings import PaperReadings
from geoloc.locate.records import Kind, Located, Sightings
from geoloc.locate.single_frame import ErrorBudget, locate_paper, locate_single_frame
from geoloc.reasons import Reason
from geoloc.trajectory.trajectory import (
    GnssFixes,
    Poses,
    PoseTrack,
    Trajectory,
    trajectory_from_gnss,
    trajectory_from_poses,
)
from twin.drives.drive import Drive
from twin.drives.folder.notes import DriveDoubt
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.track.read import Track

_Track = TypeVar("_Track", GnssFixes, PoseTrack)

_NS_PER_S = 1_000_000_000
_VIEW_STEP_M = 0.3
"""Poses closer together than this add nothing to the question whether a place was in view."""


@dataclass(frozen=True, slots=True)
class SightedObjects:
    """The drive's sightings with their epochs and positions.

    Attributes
    ----------
    index : int (n,)
        Row in the drive's annotations.
    name : str (g,)
        The objects, in alphabetical order.
    group : int64 (n,)
        Which of them each sighting shows.
    epoch_ns : int (n,)
        Epoch of exposure.
    poses : Poses (n,)
    located : Located (n,)
        What each sighting says by itself; a box says nothing.
    is_foot : bool (n,)
    adjusted : Adjusted or None
        What all sightings say together; None for the methods of one frame. Its objects are those of
        `name`.
    """

    index: IntArray
    name: TextArray
    group: IntArray
    epoch_ns: IntArray
    poses: Poses
    located: Located
    is_foot: BoolArray
    adjusted: Adjusted | None = None

    @property
    def reasons(self) -> TextArray:
        """Why each sighting took no part, a `geoloc.reasons.Reason`; "" where it did."""
        return self.located.rejected if self.adjusted is None else self.adjusted.rejected


def in_euref89(drive: Drive) -> tuple[Drive, tuple[float, float]]:
    """Return the drive with positions in EUREF89, and what the change of datum adds to their sigmas.

    Positions that are EUREF89 already come back unchanged, with 0. Otherwise a warning of the drive says by
    which transformation they were brought there.

    Returns
    -------
    Drive
    (float, float)
        One sigma a horizontal axis, and of the height, metres: the same for the whole drive.
    """
    if drive.datum == "EUREF89":
        return drive, (0.0, 0.0)
    tracks: list[GnssFixes | PoseTrack] = [*drive.gnss, *([drive.poses] if drive.poses else [])]
    # All tracks at once: none of them may take another way than the others.
    lat, lon, height, epoch_ns = (
        np.concatenate([getattr(track, name) for track in tracks])
        for name in ("latitude_deg", "longitude_deg", "height_m", "epoch_ns")
    )
    # The plate has moved 2.7 cm a year since 1989, so the epoch matters.
    year = 1970.0 + epoch_ns / (_NS_PER_S * 86400 * 365.25)
    result = euref89_from_itrf(drive.datum, lat, lon, height, year)
    ends = np.cumsum([len(track.epoch_ns) for track in tracks])[:-1]
    places = list(zip(*(np.split(column, ends) for column in result[:3]), strict=True))
    moved = replace(
        drive,
        gnss=tuple(_placed(track, *place) for track, place in zip(drive.gnss, places, strict=False)),
        poses=_placed(drive.poses, *places[-1]) if drive.poses else None,
        warnings=(*drive.warnings, Doubt(DriveDoubt.TRACK, result.how)),
    )
    return moved, (result.extra_sigma_m, result.extra_sigma_up_m)


def _placed(track: _Track, lat: FloatArray, lon: FloatArray, height: FloatArray) -> _Track:
    return replace(track, latitude_deg=lat, longitude_deg=lon, height_m=height)


def trajectory_of(drive: Drive | Track) -> Trajectory:
    """Build the trajectory of a drive, or of its track alone: from its poses if it has them, or its GNSS."""
    if drive.poses is not None:
        return trajectory_from_poses(drive.poses)
    lever_arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    return trajectory_from_gnss(drive.gnss, lever_arms, motion=drive.motion)


def locate_annotations(
    drive: Drive,
    trajectory: Trajectory,
    *,
    method: str,
    budget: ErrorBudget | None = None,
    datum_sigma_m: tuple[float, float] = (0.0, 0.0),
    terrain: Terrain | None = None,
    readings: PaperReadings | None = None,
) -> SightedObjects:
    """Give every annotation its epoch, pose and position.

    Boxes show a sign's face, not where its pole meets the ground: one frame cannot locate them, only the
    adjustment can.

    Parameters
    ----------
    method : {"adjusted", "single-frame", "paper"}
    datum_sigma_m : (float, float)
        One sigma a horizontal axis and of the height that the change of datum adds, from `in_euref89`.
    terrain : Terrain, optional
        Ground to use instead of the plane of the road.
    readings : PaperReadings, optional
        Of the paper's method.
    """
    budget = budget or ErrorBudget()
    notes = drive.annotations
    index = np.flatnonzero((notes.kind == Kind.FOOT) | (method == "adjusted"))
    is_foot = notes.kind[index] == Kind.FOOT
    name, group = np.unique(notes.object[index], return_inverse=True)
    camera = notes.camera[index]
    stamp = _frame_stamps(drive, camera, notes.frame[index])
    epoch = stamp + drive.camera_offset_ns
    sightings = Sightings(camera=camera, pixel_px=notes.pixel_px[index])
    poses = widened(trajectory.poses_at(epoch), datum_sigma_m)
    late = with_lateness(budget, trajectory)
    if method == "paper":
        # The paper pairs host stamps, late as they are: that is part of what it is measured by.
        located = locate_paper(
            drive.rig,
            sightings,
            widened(trajectory.nearest_fix(stamp), datum_sigma_m),
            budget,
            readings=readings or PaperReadings(),
            fix_interval_s=trajectory.interval_s,
            delay_ms=trajectory.delay_ms()[0],
        )
    elif terrain is not None:
        located = locate_on_terrain(drive.rig, sightings, poses, terrain, late)
    else:
        located = locate_single_frame(drive.rig, sightings, poses, late)
    if method != "adjusted":
        return SightedObjects(index, name, group, epoch, poses, located, is_foot)
    adjusted = adjust(
        Observations(drive.rig, sightings, notes.kind[index], group, epoch, trajectory),
        budget,
        **_adjust_options(drive, index),
        track_sigma_m=datum_sigma_m[0],
        terrain=terrain,
    )
    return SightedObjects(
        index, name, group, epoch, poses, _without_boxes(located, is_foot), is_foot, adjusted
    )


def view_poses(drive: Drive, trajectory: Trajectory, cameras: set[str]) -> Poses:
    """Poses at the frames of these cameras, or of all: one every 0.3 m, or a second where it is slower."""
    cameras = cameras or set(drive.frame_epoch_ns)
    stamps = [drive.frame_epoch_ns[c] for c in sorted(cameras)]
    stamped = [s[s != NO_STAMP] for s in stamps]
    epoch = np.unique(np.concatenate([np.empty(0, np.int64), *stamped])) + drive.camera_offset_ns
    poses = trajectory.poses_at(epoch)
    if not poses.valid.any():
        return poses
    epoch = epoch[poses.valid]
    travelled = np.concatenate(
        [[0.0], np.cumsum(poses.speed_mps[poses.valid][1:] * np.diff(epoch) / _NS_PER_S)]
    )
    first = np.diff(np.floor(travelled / _VIEW_STEP_M), prepend=-1.0) > 0
    seconds = (epoch - epoch[first][np.cumsum(first) - 1]) // _NS_PER_S
    return trajectory.poses_at(epoch[first | (np.diff(seconds, prepend=0) > 0)])


def adjust_camera(drive: Drive, trajectory: Trajectory, camera: str, budget: ErrorBudget) -> Adjusted:
    """Adjust the annotations of one camera by themselves: what that camera alone says of its clock."""
    notes = drive.annotations
    index = np.flatnonzero(notes.camera == camera)
    observations = Observations(
        drive.rig,
        Sightings(notes.camera[index], notes.pixel_px[index]),
        notes.kind[index],
        np.unique(notes.object[index], return_inverse=True)[1],
        _frame_stamps(drive, notes.camera[index], notes.frame[index]) + drive.camera_offset_ns,
        trajectory,
    )
    return adjust(observations, budget, **_adjust_options(drive, index))


class _AdjustOptions(TypedDict):
    """What a drive says of its annotations and cameras, as `adjust` takes it."""

    size_px: FloatArray
    readout_ms: float | None
    pole_radius_m: float


def _adjust_options(drive: Drive, index: IntArray) -> _AdjustOptions:
    box_px = drive.annotations.box_px[index]
    return _AdjustOptions(
        size_px=box_px[:, 3] - box_px[:, 1],
        readout_ms=drive.rolling_shutter_ms,
        pole_radius_m=drive.pole_radius_m,
    )


def _without_boxes(located: Located, is_foot: BoolArray) -> Located:
    """One frame cannot say where a face is: its ray meets the road somewhere else."""

    def feet(values: FloatArray) -> FloatArray:
        return np.where(is_foot.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    return replace(
        located,
        latitude_deg=feet(located.latitude_deg),
        longitude_deg=feet(located.longitude_deg),
        height_m=feet(located.height_m),
        covariance_m2=feet(located.covariance_m2),
        range_m=feet(located.range_m),
        rejected=np.where(is_foot, located.rejected, Reason.FACE_ALONE),
    )


def widened(poses: Poses, datum_sigma_m: tuple[float, float]) -> Poses:
    """Add what the change of datum adds, horizontally and of the height, to the sigmas of poses."""
    horizontal, up = datum_sigma_m
    return replace(
        poses,
        sigma_horizontal_m=np.hypot(poses.sigma_horizontal_m, horizontal),
        sigma_vertical_m=np.hypot(poses.sigma_vertical_m, up),
    )


def with_lateness(budget: ErrorBudget, trajectory: Trajectory) -> ErrorBudget:
    """Add how late the positions may be to the clock's sigma; `adjust` adds it by itself."""
    return replace(budget, time_ms=float(np.hypot(budget.time_ms, 1e3 * trajectory.late_sigma_s)))


def _frame_stamps(drive: Drive, camera: TextArray, frame: IntArray) -> IntArray:
    stamps = np.empty(len(frame), dtype=np.int64)
    for name in np.unique(camera):
        mask = camera == name
        stamps[mask] = drive.frame_epoch_ns[str(name)][frame[mask]]
    return stamps
