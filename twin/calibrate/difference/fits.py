"""A calibration as people name it on a command line → its cameras, with covariances where there are any."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.rig.rig import FLU_R_RDF, RigCamera
from twin.calibrate.camera_files import RIG_NAME
from twin.calibrate.extrinsics.given_rig import read_given_rig
from twin.calibrate.result_files import (
    LENS_REPORT,
    MOUNTING_REPORT,
    LensResult,
    MountingResult,
    lens_result,
    lens_result_in,
    mounting_results,
)

_SAME_DEG, _SAME_M = 1e-6, 1e-6


@dataclass(frozen=True, slots=True)
class CameraFit:
    """One camera of a calibration.

    Attributes
    ----------
    camera : RigCamera
    lens : LensResult or None
        Its fit; None where no report of this lens lies beside the file.
    mounting_covariance : float64 (6, 6) or None
        Of a small rotation about the rig's axes and of the position; None where it is not known.
    """

    camera: RigCamera
    lens: LensResult | None
    mounting_covariance: FloatArray | None


def read_fits(path: Path) -> Mapping[str, CameraFit]:
    """Read the cameras of a calibration.

    Parameters
    ----------
    path : Path
        A folder that ``calibrate intrinsics`` or ``extrinsics`` wrote, its ``rig.json``, ``report.json`` or
        ``extrinsics.json``; or anything else that `read_given_rig` reads, which has no covariances.

    Raises
    ------
    CalibrationError, FileError, DriveError
        If it cannot be read.
    """
    if path.name == LENS_REPORT or (path / LENS_REPORT).is_file():
        alone = lens_result(path / LENS_REPORT if path.is_dir() else path)
        if alone is not None:
            camera = RigCamera(alone.camera, alone.model, FLU_R_RDF, np.zeros(3))
            return {alone.camera: CameraFit(camera, alone, None)}
    if path.name == MOUNTING_REPORT:
        path = path.parent
    written = path / RIG_NAME if (path / RIG_NAME).is_file() and not (path / "drive.toml").exists() else path
    cameras = read_given_rig(written).rig.cameras
    folder = written if written.is_dir() else written.parent
    mountings = mounting_results(folder)
    return {
        name: CameraFit(camera, _lens(folder, camera), _mounting(mountings.get(name), camera))
        for name, camera in cameras.items()
    }


def _lens(folder: Path, camera: RigCamera) -> LensResult | None:
    result = lens_result_in(folder, camera.name)
    return result if result is not None and result.is_of(camera.model) else None


def _mounting(result: MountingResult | None, camera: RigCamera) -> FloatArray | None:
    """The covariance, if the rig has the pose that it is of: it may have been changed since."""
    if result is None:
        return None
    rotation = rotation_from_rpy(*result.roll_pitch_yaw_deg.tolist()) @ FLU_R_RDF
    turned = np.abs(rotation - camera.rig_R_camera).max()
    moved = np.abs(result.position_m - camera.rig_t_camera_m).max()
    return result.covariance if turned < np.radians(_SAME_DEG) and moved < _SAME_M else None
