"""The folder that a calibration of intrinsics writes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geoloc.calibration_files import json_document
from geoloc.errors import CalibrationError
from geoloc.rig.rig import looks_like_rig
from twin.calibrate.camera_files import (
    RIG_NAME,
    cameras_of,
    check_has_camera,
    file_name,
    new_rig_document,
    other_formats,
    rig_text,
    rig_with_camera,
)
from twin.calibrate.intrinsics.calibrate import Calibrated
from twin.calibrate.intrinsics.plots import coverage_picture, curve_picture, residual_picture
from twin.calibrate.intrinsics.report import intrinsics_report, report_markdown
from twin.calibrate.sign_metres import lens_metres
from twin.errors import RefusedError
from twin.figures import png
from twin.store.atomic_files import replace_file, replacing
from twin.store.folders import make_folder

_REPORT = "report.json"


def write_calibration(
    calibrated: Calibrated,
    out: Path,
    camera: str,
    rig: Path | None = None,
    *,
    add: bool = False,
    windshield: str | None = None,
) -> tuple[list[Path], Path | None]:
    """Write the rig, and the camera's files, report and pictures in a folder of its own.

    Files of an earlier calibration of this camera are set aside, in a folder beside.

    Parameters
    ----------
    calibrated : Calibrated
    out : Path
        Folder for ``rig.json``; made if it does not exist. The camera's own files go into its sub-folder of
        the camera's name, so that several cameras share one rig.
    camera : str
        Its name.
    rig : Path, optional
        A DriveWorks rig in which that camera takes the place of the one of this name: written as ``rig.json``
        into the folder, which may be the same file; another file is not touched.
    add : bool
        Put the camera into a rig that does not have it yet.
    windshield : str, optional
        ``keep`` or ``drop``: what becomes of the windshield model that the rig has of the camera.

    Returns
    -------
    files : list of Path
        The rig first.
    earlier : Path or None
        Where the files of an earlier calibration of this camera are now.

    Raises
    ------
    CalibrationError
        If the rig cannot be read or has no such camera.
    RefusedError
        If the folder cannot be written, or its ``rig.json`` holds other cameras and is not the rig given.
    """
    check_rig(out, camera, rig, add=add, windshield=windshield)
    text = _rig_text(calibrated, camera, rig, add, windshield)
    files = _contents(calibrated, camera)
    folder = make_folder(out)
    own = folder / file_name(camera)
    earlier = _set_aside(own)
    with replacing(own, list(files)) as staging:
        for name, content in files.items():
            (staging / name).write_bytes(content)
    replace_file(folder / RIG_NAME, text.encode())
    return [folder / RIG_NAME, *(own / name for name in files)], earlier


def _set_aside(own: Path) -> Path | None:
    """Give the folder of an earlier calibration another name; None where there is none."""
    if not (own / _REPORT).exists():
        return None
    free = (own.with_name(f"{own.name}.{n}") for n in itertools.count(1))
    return own.rename(next(path for path in free if not path.exists()))


def check_rig(
    out: Path, camera: str, rig: Path | None, *, add: bool = False, windshield: str | None = None
) -> None:
    """Refuse a rig that cannot take the camera, or that would be lost: before the work, not after it.

    Raises
    ------
    CalibrationError, RefusedError
    """
    given: Mapping[str, object] = {}
    if rig is not None:
        document = _rig_document(rig)
        check_has_camera(document, str(rig), camera, add=add, windshield=windshield)
        given = _intrinsics_of(document)
    there = out / RIG_NAME
    held = _intrinsics_in(there)
    lost = [name for name in held if name != camera and held[name] != given.get(name)]
    if lost:
        option = "" if camera in held else " --add"
        raise RefusedError(
            f"{there} holds a calibration of {', '.join(lost)}, which would be lost: put {camera} into it"
            f" with --rig {there}{option}, or name another folder with --out."
        )


def _intrinsics_in(path: Path) -> dict[str, object]:
    """Cameras of a rig file with their properties; none where there is no file, or another one."""
    try:
        document = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return _intrinsics_of(document) if looks_like_rig(document) else {}


def _intrinsics_of(document: Mapping[str, Any]) -> dict[str, object]:
    sensors = {
        str(s.get("name", "")).strip(): s for s in document["rig"]["sensors"] if isinstance(s, Mapping)
    }
    return {name: sensors[name].get("properties") for name in cameras_of(document)}


def _rig_text(
    calibrated: Calibrated, camera: str, rig: Path | None, add: bool, windshield: str | None
) -> str:
    """Write the rig with the calibrated camera."""
    model = calibrated.intrinsics.camera
    if rig is None:
        return rig_text(new_rig_document({camera: model}))
    document = _rig_document(rig)
    return rig_text(rig_with_camera(document, str(rig), camera, model, add=add, windshield=windshield))


def _rig_document(rig: Path) -> dict[str, object]:
    """Read a rig file as it is, unknown keys and all."""
    try:
        content = rig.read_bytes()
    except OSError as error:
        raise CalibrationError(f"Cannot read the rig file {rig}: {error.strerror or error}.") from error
    return dict(json_document(content, str(rig)))


def _contents(calibrated: Calibrated, camera: str) -> dict[str, bytes]:
    """File name → content."""
    pictures = {
        "residuals.png": residual_picture(calibrated.intrinsics),
        "coverage.png": coverage_picture(calibrated.intrinsics),
        "curve.png": curve_picture(calibrated.intrinsics),
        "metres.png": png(lens_metres(calibrated.intrinsics, camera)),
    }
    others = other_formats(calibrated.intrinsics.candidates, camera)
    report = intrinsics_report(calibrated, camera)
    models = {name: candidate.label for name, (_, candidate) in others.items()}
    document = report.document({RIG_NAME: report.model, **models})
    texts = {
        **{name: text for name, (text, _) in others.items()},
        _REPORT: json.dumps(document, indent=2, ensure_ascii=False) + "\n",
        "report.md": report_markdown(report, list(pictures)),
    }
    return {**{name: text.encode() for name, text in texts.items()}, **pictures}
