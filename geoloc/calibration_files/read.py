"""A calibration file of any known format → its cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from geoloc.calibration_files.colmap import looks_like_colmap, read_colmap
from geoloc.calibration_files.document import CalibratedCamera, json_document
from geoloc.calibration_files.kalibr import looks_like_kalibr, read_kalibr
from geoloc.calibration_files.mrcal import looks_like_mrcal, read_mrcal
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

HEAD_BYTES = 65_536
"""So much of a file tells its format."""


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


class _Format(NamedTuple):
    """What people call a format, how a file of it is told by its first bytes, and how it is read."""

    name: str
    looks_like: Callable[[bytes], bool]
    read: Callable[[bytes, str], Mapping[str, CalibratedCamera]]


_FORMATS: Final[Mapping[str, _Format]] = {
    "driveworks": _Format("DriveWorks rig", _looks_like_driveworks, _read_driveworks),
    "mrcal": _Format("mrcal .cameramodel", looks_like_mrcal, read_mrcal),
    "opensfm": _Format("OpenSfM camera_models.json", looks_like_opensfm, read_opensfm),
    "kalibr": _Format("Kalibr camchain", looks_like_kalibr, read_kalibr),
    "ocam-yaml": _Format("Lafida and MultiCol-SLAM YAML", looks_like_ocam_yaml, read_ocam_yaml),
    "opencv": _Format("OpenCV or ROS YAML or JSON", looks_like_opencv, read_opencv),
    "colmap": _Format("COLMAP cameras.txt", looks_like_colmap, read_colmap),
    "ocamcalib": _Format("OCamCalib calib_results.txt", looks_like_ocamcalib, read_ocamcalib),
}
"""In the order in which they are tried: a new format is one module and one line here."""

CALIBRATION_KINDS: Final[Mapping[str, str]] = {kind: form.name for kind, form in _FORMATS.items()}
"""Formats that are read, and what people call them."""


def calibration_kind(head: bytes) -> str | None:
    """Tell the format of a calibration file by its first bytes: a key of `CALIBRATION_KINDS`, or None."""
    return next((kind for kind, form in _FORMATS.items() if form.looks_like(head)), None)


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
    kind = calibration_kind(content[:HEAD_BYTES])
    if kind is None:
        raise CalibrationError(
            f"{where} is no calibration file that is known here: export it as one of"
            f" {', '.join(CALIBRATION_KINDS.values())}."
        )
    return _FORMATS[kind].read(content, where)
