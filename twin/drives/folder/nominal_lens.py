"""``lens`` or ``fov_deg`` of a camera in ``drive.toml``: nominal intrinsics where nobody calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from geoloc.cameras.base import CameraModel
from geoloc.cameras.nominal import FISHEYE, PINHOLE, LensSigmas, NominalLens, nominal_lenses
from geoloc.errors import CalibrationError
from twin.drives.folder.toml_values import SETTINGS_FILE, number_of, text_of, wrong_value
from twin.errors import DriveError

_MOST_PX = 100_000


@dataclass(frozen=True, slots=True)
class NominalCamera:
    """A nominal lens, and the size of the pictures that it is for."""

    lens: NominalLens
    width_px: int
    height_px: int

    @property
    def model(self) -> CameraModel:
        """Its intrinsics."""
        return self.lens.camera(self.width_px, self.height_px)

    @property
    def sigmas(self) -> LensSigmas:
        """How far these may be off."""
        return self.lens.sigmas(self.width_px, self.height_px)


def lens_called(name: str) -> NominalLens:
    """Return the lens of the table that is called so, whatever the case.

    Raises
    ------
    DriveError
        If there is none, with the names that there are.
    """
    lenses = nominal_lenses()
    found = lenses.get(" ".join(name.casefold().split()))
    if found is None:
        raise DriveError(
            f"There is no lens {name[:80]!r} in the table of common cameras ({', '.join(lenses)}): take one"
            " of them, or state the field of view across the longer side, fov_deg."
        )
    return found


def nominal_camera(entry: Mapping[str, Any], name: str) -> NominalCamera | None:
    """Read a nominal lens of ``[cameras.NAME]``; None where it states none.

    Raises
    ------
    DriveError
        If it names both a lens and a field of view, or intrinsics as well, lacks the size of the pictures, or
        states what no lens is.
    """
    called = text_of(entry, "lens", f"{name}.lens")
    if called is None and "fov_deg" not in entry:
        alone = [key for key in ("projection", "size") if key in entry]
        if alone:
            raise DriveError(
                f"{SETTINGS_FILE} gives {alone[0]} under [{name}] without lens or fov_deg: state one of them,"
                f" or take {alone[0]} out."
            )
        return None
    if "intrinsics" in entry or (called is not None and "fov_deg" in entry):
        raise DriveError(
            f"{SETTINGS_FILE} states the lens under [{name}] twice: keep one of intrinsics, lens and fov_deg."
        )
    width, height = _size(entry.get("size"), f"{name}.size")
    if called is not None:
        return NominalCamera(lens_called(called), width, height)
    return NominalCamera(_of_fov(entry, name), width, height)


def _of_fov(entry: Mapping[str, Any], name: str) -> NominalLens:
    projection = entry.get("projection")
    if projection not in (None, PINHOLE, FISHEYE):
        raise wrong_value(f"{name}.projection", projection, f'"{PINHOLE}" or "{FISHEYE}"')
    fov_deg = number_of(entry["fov_deg"], f"{name}.fov_deg")
    try:
        return NominalLens.of_fov(fov_deg, projection)
    except CalibrationError as error:
        wanted = "the field of view across the longer side of the picture, in degrees"
        raise wrong_value(f"{name}.fov_deg", fov_deg, wanted) from error


def _size(value: object, name: str) -> tuple[int, int]:
    wanted = "[width, height] of the pictures in pixels, [1920, 1080]"
    whole = isinstance(value, list) and len(value) == 2 and all(type(side) is int for side in value)
    if not whole or not isinstance(value, list) or not all(0 < side <= _MOST_PX for side in value):
        raise wrong_value(name, value, wanted)
    return value[0], value[1]
