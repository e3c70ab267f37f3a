"""One pixel of a recorded drive → where on the ground it points."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.earth.heights import nn2000_from_ellipsoidal
from geoloc.locate.combine import SIGMAS_95, ellipse
from geoloc.reasons import Reason, sentence_of
from twin.drives.drive import Annotation, Annotations, Drive
from twin.drives.folder.notes import Progress
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.read import read_drive
from twin.errors import ConfigError, DriveError
from twin.ingest.budget import budget_of
from twin.ingest.locate import in_euref89, locate_annotations, trajectory_of
from twin.ingest.rows import finite
from twin.store.kinds import Method

_NO_BOX = (float("nan"),) * 4


@dataclass(frozen=True, slots=True)
class PixelPosition:
    """Where a pixel points to on the ground.

    Attributes
    ----------
    epoch_ns : int
        UTC, of exposure.
    east_m, north_m : float
        EPSG:25833.
    latitude_deg, longitude_deg : float
        EUREF89.
    height_m, height_nn2000_m : float
        Above the ellipsoid, and NN2000; NaN where not known.
    covariance_m2 : float64 (2, 2)
        Grid east, grid north.
    major95_m, minor95_m, azimuth_deg : float
        Half axes of the ellipse that holds the place with 95 %; the long one clockwise from true north.
    range_m : float
        Horizontal, from the camera.
    speed_mps : float
        Of the car.
    warnings : tuple of str
        What a user should know of the drive.
    """

    epoch_ns: int
    east_m: float
    north_m: float
    latitude_deg: float
    longitude_deg: float
    height_m: float
    height_nn2000_m: float
    covariance_m2: FloatArray
    major95_m: float
    minor95_m: float
    azimuth_deg: float
    range_m: float
    speed_mps: float
    warnings: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Return it in types that JSON has; unknown numbers are None."""
        plain = {one.name: getattr(self, one.name) for one in fields(self)}
        numbers = {name: finite(value) for name, value in plain.items() if isinstance(value, float)}
        return {**plain, **numbers, "covariance_m2": self.covariance_m2.tolist()}


def locate_pixel(
    path: Path | str,
    camera: str,
    frame: int,
    pixel_px: tuple[float, float],
    *,
    method: str = "single-frame",
    progress: Progress | None = None,
) -> PixelPosition:
    """Locate what a pixel shows, taken to be on the road's plane.

    Parameters
    ----------
    path : Path or str
        The drive's folder; annotations are not needed.
    frame : int
        Absolute number in the camera's recording.
    pixel_px : (float, float)
        Column and row as annotation tools count: (0, 0) is the corner of the first pixel.
    method : {"single-frame", "paper"}
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    ConfigError
        There is no such camera or frame.
    DriveError, GeolocError
        The drive cannot be read, or the pixel has no place: the sky, the car itself, no fix at that time.
    """
    drive, datum_sigma_m = in_euref89(read_drive(path, cameras=[camera], progress=progress))
    _check_frame(drive, camera, frame)
    u, v = (value - 0.5 for value in pixel_px)
    row = Annotation(camera, frame, "pixel", True, "", "", "", "foot", (u, v), _NO_BOX, "")
    asked = replace(drive, annotations=Annotations.of([row]))
    trajectory = trajectory_of(asked)
    budget = budget_of(asked, None, {})
    sighted = locate_annotations(asked, trajectory, method=method, budget=budget, datum_sigma_m=datum_sigma_m)
    located, poses = sighted.located, sighted.poses
    if not located.valid[0]:
        why = sentence_of(
            Reason(str(located.rejected[0])), max_range_m=MAX_RANGE_M, span_ns=trajectory.span_ns
        )
        raise DriveError(
            f"{camera}, frame {frame}: pixel {pixel_px[0]:g} {pixel_px[1]:g} has no place on the road: {why}."
        )
    place = located.latitude_deg[0], located.longitude_deg[0]
    east, north = utm33_from_geographic(*place)
    major, minor, azimuth = (float(value[0]) for value in ellipse(located.covariance_m2))
    # The paper gives no height: its rows carry that of the antenna.
    height_m = float("nan") if method == Method.PAPER else float(located.height_m[0])
    heights = nn2000_from_ellipsoidal(*place, height_m)
    return PixelPosition(
        epoch_ns=int(sighted.epoch_ns[0]),
        east_m=float(east),
        north_m=float(north),
        latitude_deg=float(place[0]),
        longitude_deg=float(place[1]),
        height_m=height_m,
        height_nn2000_m=float(heights.height_m),
        covariance_m2=utm33_covariance_from_enu(located.covariance_m2, *(np.array([x]) for x in place))[0],
        major95_m=SIGMAS_95 * major,
        minor95_m=SIGMAS_95 * minor,
        azimuth_deg=azimuth,
        range_m=float(located.range_m[0]),
        speed_mps=float(poses.speed_mps[0]),
        warnings=tuple(map(str, drive.warnings)),
    )


def _check_frame(drive: Drive, camera: str, frame: int) -> None:
    if camera not in drive.frame_epoch_ns:
        known = ", ".join(sorted(drive.rig.cameras))
        raise ConfigError(f"{drive.name} has no camera {camera!r}: it has {known}.")
    stamps = drive.frame_epoch_ns[camera]
    if not 0 <= frame < stamps.size:
        raise ConfigError(f"{camera} has no frame {frame}: it has frames 0 to {stamps.size - 1}.")
    if stamps[frame] == NO_STAMP:
        raise ConfigError(f"Frame {frame} of {camera} has no time stamp: take a neighbour.")
