"""A drive's annotated feet → epochs, poses and positions, in EUREF89."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.geodesy import euref89_from_itrf2020
from geoloc.locate import ErrorBudget, Located, Sightings, locate_paper, locate_single_frame
from geoloc.trajectory import Poses, Trajectory, trajectory_from_gnss, trajectory_from_poses
from twin.drives.drive import Drive

IntArray = NDArray[np.int64]

_NS_PER_S = 1_000_000_000


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


def in_euref89(drive: Drive) -> tuple[Drive, float]:
    """Return the drive with positions in EUREF89, and what the change of datum adds to their sigma.

    Positions that are EUREF89 already come back unchanged, with 0.
    """
    if drive.datum == "EUREF89":
        return drive, 0.0
    moved = [_transformed(track) for track in (*drive.gnss, *([drive.poses] if drive.poses else []))]
    sigma_m = max((sigma for _, sigma in moved), default=0.0)
    tracks = [track for track, _ in moved]
    gnss = tuple(tracks[: len(drive.gnss)])
    return replace(drive, gnss=gnss, poses=tracks[-1] if drive.poses else None), sigma_m


def _transformed(track: Any) -> tuple[Any, float]:
    """ITRF2020 → EUREF89; the plate has moved 2.7 cm a year since 1989, so the epoch matters."""
    year = 1970.0 + track.epoch_ns / (_NS_PER_S * 86400 * 365.25)
    result = euref89_from_itrf2020(track.latitude_deg, track.longitude_deg, track.height_m, year)
    moved = replace(
        track,
        latitude_deg=result.latitude_deg,
        longitude_deg=result.longitude_deg,
        height_m=result.height_m,
    )
    return moved, result.extra_sigma_m


def trajectory_of(drive: Drive) -> Trajectory:
    """Build the drive's trajectory from its full poses if it has them, else from its GNSS."""
    if drive.poses is not None:
        return trajectory_from_poses(drive.poses)
    lever_arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    return trajectory_from_gnss(drive.gnss, lever_arms)


def locate_annotations(
    drive: Drive,
    trajectory: Trajectory,
    *,
    method: str,
    budget: ErrorBudget | None = None,
    datum_sigma_m: float = 0.0,
) -> SightedObjects:
    """Give every annotated foot its epoch, pose and position.

    Boxes show a sign's face, not where its pole meets the ground: one frame cannot locate them.

    Parameters
    ----------
    datum_sigma_m : float
        One sigma a horizontal axis that the change of datum adds, the same for the whole drive.
    """
    budget = budget or ErrorBudget()
    index = np.flatnonzero(drive.annotations.kind == "foot")
    camera = drive.annotations.camera[index]
    stamp = _frame_stamps(drive, camera, drive.annotations.frame[index])
    epoch = stamp + drive.camera_offset_ns
    sightings = Sightings(camera=camera, pixel_px=drive.annotations.pixel_px[index])
    poses = _widened(trajectory.poses_at(epoch), datum_sigma_m)
    if method == "paper":
        # The paper pairs host stamps, late as they are: that is part of what it is measured by.
        located = locate_paper(
            drive.rig,
            sightings,
            _widened(trajectory.nearest_fix(stamp), datum_sigma_m),
            budget,
            fix_interval_s=trajectory.interval_s,
            delay_ms=trajectory.delay_ms()[0],
        )
    else:
        located = locate_single_frame(drive.rig, sightings, poses, budget)
    return SightedObjects(index, epoch, poses, located)


def _widened(poses: Poses, sigma_m: float) -> Poses:
    return replace(poses, sigma_horizontal_m=np.hypot(poses.sigma_horizontal_m, sigma_m))


def _frame_stamps(drive: Drive, camera: NDArray[np.str_], frame: IntArray) -> IntArray:
    stamps = np.empty(len(frame), dtype=np.int64)
    for name in np.unique(camera):
        mask = camera == name
        stamps[mask] = drive.frame_epoch_ns[str(name)][frame[mask]]
    return stamps
