"""A car's folder: what the folder of its drives states, but for their recordings."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from geoloc.doubts import Doubt
from geoloc.rig.rig import Rig
from twin.drives.annotations.labels import LabelMap
from twin.drives.folder.drive_toml import DriveSettings
from twin.live.engine import LiveCar


@dataclass(frozen=True, slots=True)
class Car:
    """What ``--car FOLDER`` says.

    Attributes
    ----------
    path : Path
    rig : Rig
    settings : DriveSettings
    labels : LabelMap
    files : tuple of str
        In the folder, that were read: a recorded drive gets a copy of each.
    warnings : tuple of Doubt
    """

    path: Path
    rig: Rig
    settings: DriveSettings
    labels: LabelMap
    files: tuple[str, ...]
    warnings: tuple[Doubt, ...]

    def live_car(self, antennas: Collection[str]) -> LiveCar:
        """Return what the engine needs to know; `antennas` are those of `antennas_of` the sources' addresses."""
        raise NotImplementedError


def read_car(path: Path) -> Car:
    """Read a car's folder: ``drive.toml``, rig, calibrations, masks, ``labels.toml``; a drive's folder is one.

    Raises
    ------
    DriveError
        As :func:`twin.drives.read.read_drive`.
    """
    raise NotImplementedError


def antennas_of(car: Car, urls: Collection[str]) -> tuple[str, ...]:
    """Return the antenna of each address of fixes: ``?antenna=``, else the only one of the car.

    Raises
    ------
    ConfigError
        For one that the car does not have, one that two addresses name, or where it is not said.
    """
    raise NotImplementedError
