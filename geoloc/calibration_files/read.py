"""A calibration file of any known format → its cameras: the door of :mod:`geoloc.calibration_files`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from geoloc.calibration_files.colmap import looks_like_colmap, read_colmap
from geoloc.calibration_files.document import CalibratedCamera, json_document
from geoloc.calibration_files.kalibr import looks_like_kalibr, read_kalibr
from geoloc.calibration_files.ocamcalib import (
    looks_like_ocam_yaml,
    looks_like_ocamcalib,
    read_ocam_yaml,
    read_ocamcalib,
)
from geoloc.calibration_files.opencv_file import looks_like_opencv, read_opencv
from geoloc.calibration_files.opensfm import looks_like_opensfm, read_opensfm
from geoloc.errors import CalibrationError
from geoloc.rig.rig import rig_from_document

__all__ = ["CALIBRATION_KINDS", "CalibratedCamera", "calibration_kind", "read_cameras"]

_HEAD_BYTES = 65_536
_Reader = Callable[[bytes, str], Mapping[str, CalibratedCamera]]

CALIBRATION_KINDS: Final[Mapping[str, str]] = {
    "driveworks": "DriveWorks rig",
    "opensfm": "OpenSfM camera_models.json",
    "kalibr": "Kalibr camchain",
    "ocam-yaml": "Lafida and MultiCol-SLAM YAML",
    "opencv": "OpenCV or ROS YAML or JSON",
    "colmap": "COLMAP cameras.txt",
    "ocamcalib": "OCamCalib calib_results.txt",
}
"""Formats that are read, and what people call them."""


def calibration_kind(head: bytes) -> str | None:
    """Tell the format of a calibration file by its first bytes: a key of `CALIBRATION_KINDS`, or None."""
    tests: dict[str, Callable[[bytes], bool]] = {
        "driveworks": _looks_like_driveworks,
        "opensfm": looks_like_opensfm,
        "kalibr": looks_like_kalibr,
        "ocam-yaml": looks_like_ocam_yaml,
        "opencv": looks_like_opencv,
        "colmap": looks_like_colmap,
        "ocamcalib": looks_like_ocamcalib,
    }
    return next((kind for kind, test in tests.items() if test(head)), None)


def read_cameras(content: bytes, where: str) -> Mapping[str, CalibratedCamera]:
    """Read the cameras of a calibration file, whatever its format.

    Parameters
    ----------
    content : bytes
    where : str
        The file's name, for messages.

    Returns
    -------
    mapping of name to camera
        At least one. Formats that name no camera call it ``camera``.

    Raises
    ------
    CalibrationError
        If the format is not known, or the file is damaged or holds a camera that cannot be computed with.
    """
    kind = calibration_kind(content[:_HEAD_BYTES])
    if kind is None:
        raise CalibrationError(
            f"{where} is no calibration file that is known here: export it as one of"
            f" {', '.join(CALIBRATION_KINDS.values())}."
        )
    readers: dict[str, _Reader] = {
        "driveworks": _read_driveworks,
        "opensfm": read_opensfm,
        "kalibr": read_kalibr,
        "ocam-yaml": read_ocam_yaml,
        "opencv": read_opencv,
        "colmap": read_colmap,
        "ocamcalib": read_ocamcalib,
    }
    return readers[kind](content, where)


def _looks_like_driveworks(head: bytes) -> bool:
    return b'"sensors"' in head and b'"rig"' in head


def _read_driveworks(content: bytes, where: str) -> Mapping[str, CalibratedCamera]:
    """Intrinsics of the cameras of a rig file that can be computed with."""
    rig = rig_from_document(json_document(content, where), where)
    if not rig.cameras:
        raise CalibrationError(
            f"{where} holds no camera that can be used: export the rig with its intrinsics."
        )
    return {name: CalibratedCamera(camera.model) for name, camera in rig.cameras.items()}
