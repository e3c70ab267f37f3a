"""What calibrations keep of a fit beside the rig: lenses and mountings with their covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.intrinsics.coverage import MAP_PX
from geoloc.calibration.intrinsics.known_lens import KnownLens, known_lens
from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError
from twin.calibrate.camera_files import file_name

LENS_REPORT, MOUNTING_REPORT = "report.json", "extrinsics.json"
COVERED = "#"
_SAME_RAD = 1e-9
_Document = TypeVar("_Document")


@dataclass(frozen=True, slots=True)
class LensResult:
    """A lens as ``report.json`` has it.

    Attributes
    ----------
    camera : str
    known : KnownLens
    covered : bool (rows, columns) or None
        Cells of `MAP_PX` pixels that boards covered; None in reports of before these were kept.
    """

    camera: str
    known: KnownLens
    covered: BoolArray | None

    @property
    def model(self) -> CameraModel:
        """The lens."""
        return self.known.camera

    def is_of(self, model: CameraModel) -> bool:
        """Whether a camera has this lens: the same rays, to the last digits that files keep."""
        if (model.width_px, model.height_px) != (self.model.width_px, self.model.height_px):
            return False
        size = np.array([model.width_px - 1.0, model.height_px - 1.0])
        pixel = size * np.stack(np.meshgrid([0.1, 0.3, 0.5, 0.7, 0.9], [0.2, 0.5, 0.8]), axis=-1)
        (mine, known), (other, inside) = (c.camera_ray_from_pixel(pixel) for c in (self.model, model))
        off = np.linalg.norm(mine - other, axis=-1)[known & inside]
        return bool((known == inside).all() and (off < _SAME_RAD).all())


class _Number(msgspec.Struct):
    name: str
    value: float


class _Covered(msgspec.Struct):
    cells: list[str] = []


class _LensDocument(msgspec.Struct):
    camera: str
    properties: dict[str, str]
    parameters: list[_Number]
    covariance: list[list[float]]
    coverage: _Covered


class _MountedCamera(msgspec.Struct):
    camera: str
    roll_pitch_yaw_deg: list[float]
    position_m: list[float]
    covariance_rad_m: list[list[float]]


class _MountingDocument(msgspec.Struct):
    cameras: list[_MountedCamera]


@dataclass(frozen=True, slots=True)
class MountingResult:
    """Where a camera sits as ``extrinsics.json`` has it: angles, place, and their covariance (6, 6)."""

    roll_pitch_yaw_deg: FloatArray
    position_m: FloatArray
    covariance: FloatArray


def lens_result(path: Path) -> LensResult | None:
    """Read a ``report.json`` of ``calibrate intrinsics``; None if there is no such file.

    Raises
    ------
    CalibrationError
        If it is damaged.
    """
    document = _document(path, _LensDocument, "calibrate intrinsics")
    if document is None:
        return None
    try:
        size = int(document.properties["width"]), int(document.properties["height"])
        covariance = np.array(document.covariance, dtype=np.float64)
        values = np.array([number.value for number in document.parameters])
        known = known_lens([number.name for number in document.parameters], values, covariance, *size)
    except (KeyError, ValueError) as error:
        raise _damaged(path, "calibrate intrinsics", error) from error
    rows, columns = (-(-n // MAP_PX) for n in size[::-1])
    cells = document.coverage.cells
    fits = len(cells) == rows and all(len(row) == columns for row in cells)
    covered = np.array([[cell == COVERED for cell in row] for row in cells]) if fits else None
    return LensResult(document.camera, known, covered)


def lens_result_in(folder: Path, camera: str) -> LensResult | None:
    """Read the report of one camera in the folder that a rig was written to; None if there is none."""
    return lens_result(folder / file_name(camera) / LENS_REPORT)


def mounting_results(folder: Path) -> dict[str, MountingResult]:
    """Read ``extrinsics.json`` of ``calibrate extrinsics`` by camera; nothing if there is no such file.

    Raises
    ------
    CalibrationError
        If it is damaged.
    """
    path = folder / MOUNTING_REPORT
    document = _document(path, _MountingDocument, "calibrate extrinsics")
    results = {}
    for one in () if document is None else document.cameras:
        numbers = np.array(one.roll_pitch_yaw_deg), np.array(one.position_m), np.array(one.covariance_rad_m)
        if [n.shape for n in numbers] != [(3,), (3,), (6, 6)]:
            raise _damaged(path, "calibrate extrinsics", ValueError(f"of camera {one.camera}"))
        results[one.camera] = MountingResult(*numbers)
    return results


def lens_reports(folder: Path, cameras: Sequence[str]) -> dict[str, str]:
    """Give the text of the lens reports beside a rig, by their names inside its folder."""
    names = [f"{file_name(camera)}/{LENS_REPORT}" for camera in cameras]
    return {name: (folder / name).read_text(encoding="utf-8") for name in names if (folder / name).is_file()}


def _document(path: Path, kind: type[_Document], command: str) -> _Document | None:
    if not path.is_file():
        return None
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read ({error.strerror}): check it.") from error
    except (msgspec.DecodeError, RecursionError) as error:
        raise _damaged(path, command, error) from error


def _damaged(path: Path, command: str, error: Exception) -> CalibrationError:
    return CalibrationError(
        f"{path} is not as twin {command} writes it ({error}): run the calibration again, or take the file "
        "away to compare without its uncertainty."
    )
