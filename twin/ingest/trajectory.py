"""The smoothed trajectory of a recorded drive, by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geoloc.trajectory.poses import Poses, part
from twin.drives.folder.notes import Progress
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.ingest.locate import in_euref89, trajectory_of, widened


def smoothed_poses(path: Path | str, *, progress: Progress | None = None) -> tuple[Poses, tuple[str, ...]]:
    """Read a drive and smooth its track, as ingest does before it adjusts.

    What an adjustment finds out besides holds where signs were seen, and is not in it.

    Parameters
    ----------
    path : Path or str
        The drive's folder; annotations are not needed.
    progress : callable, optional
        Called with one sentence a step.

    Returns
    -------
    poses : Poses
        Of the rig's origin, EUREF89, at each recorded epoch that has a pose.
    warnings : tuple of str
        What a user should know of the track.

    Raises
    ------
    DriveError, GeolocError
        The drive cannot be read, or no epoch of it has a pose.
    """
    drive, datum_sigma_m = in_euref89(read_drive(path, progress=progress))
    trajectory = trajectory_of(drive)
    poses = widened(trajectory.knots, datum_sigma_m)
    valid = np.flatnonzero(poses.valid)
    if not valid.size:
        raise DriveError(
            f"{path} has no pose: one antenna that never drove has no heading; record while the car drives."
        )
    dropped = (f"{count} left out: {why}." for count, why in trajectory.dropped)
    return part(poses, valid), (*map(str, drive.warnings), *dropped)
