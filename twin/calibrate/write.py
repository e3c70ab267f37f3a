"""The folder that a calibration of intrinsics writes."""

from __future__ import annotations

import json
from pathlib import Path

from geoloc.calibration_files.document import json_document
from geoloc.errors import CalibrationError
from twin.calibrate.camera_files import (
    check_has_camera,
    new_rig_document,
    other_formats,
    rig_text,
    rig_with_camera,
)
from twin.calibrate.intrinsics import Calibrated
from twin.calibrate.plots import coverage_picture, curve_picture, residual_picture
from twin.calibrate.report import report_document, report_markdown
from twin.export.atomic import replacing
from twin.folders import make_folder


def write_calibration(made: Calibrated, out: Path, camera: str, rig: Path | None = None) -> list[Path]:
    """Write the camera's files, the report and its pictures: all of them, or none.

    Parameters
    ----------
    made : Calibrated
    out : Path
        Folder; made if it does not exist.
    camera : str
        Its name.
    rig : Path, optional
        A DriveWorks rig in which that camera takes the place of the one of this name: written as ``rig.json``
        into the folder; the file itself is not touched.

    Returns
    -------
    list of Path

    Raises
    ------
    CalibrationError
        If the rig cannot be read or has no such camera.
    RefusedError
        If the folder cannot be written.
    """
    files = _contents(made, camera, rig)
    folder = make_folder(out)
    with replacing(folder, list(files)) as staging:
        for name, content in files.items():
            (staging / name).write_bytes(content)
    return [folder / name for name in files]


def check_rig(rig: Path, camera: str) -> None:
    """Refuse a rig that cannot be read or has no such camera: before the work, not after it.

    Raises
    ------
    CalibrationError
    """
    check_has_camera(_rig_document(rig), str(rig), camera)


def _rig_text(made: Calibrated, camera: str, rig: Path | None) -> str:
    """Write the rig with the calibrated camera."""
    if rig is None:
        return rig_text(new_rig_document(camera, made.intrinsics.camera))
    return rig_text(rig_with_camera(_rig_document(rig), str(rig), camera, made.intrinsics.camera))


def _rig_document(rig: Path) -> dict[str, object]:
    """Read a rig file as it is, unknown keys and all."""
    try:
        content = rig.read_bytes()
    except OSError as error:
        raise CalibrationError(f"Cannot read the rig file {rig}: {error.strerror or error}.") from error
    return dict(json_document(content, str(rig)))


def _contents(made: Calibrated, camera: str, rig: Path | None) -> dict[str, bytes]:
    """File name → content."""
    pictures = {
        "residuals.png": residual_picture(made.intrinsics),
        "coverage.png": coverage_picture(made.intrinsics),
        "curve.png": curve_picture(made.intrinsics),
    }
    others = other_formats(made.intrinsics.candidates, camera)
    document = report_document(made, camera)
    document["files"] = {
        "rig.json": made.intrinsics.fit.label,
        **{name: candidate.label for name, (_, candidate) in others.items()},
    }
    texts = {
        "rig.json": _rig_text(made, camera, rig),
        **{name: text for name, (text, _) in others.items()},
        "report.json": json.dumps(document, indent=2, ensure_ascii=False) + "\n",
        "report.md": report_markdown(document, list(pictures)),
    }
    return {**{name: text.encode() for name, text in texts.items()}, **pictures}
