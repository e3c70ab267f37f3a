"""What a user says of how the paper's method is to be read: ``--paper KEY=VALUE``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

from geoloc.locate.paper_readings import Distance, PaperReadings
from twin.drives.drive import Drive
from twin.errors import ConfigError

_KEYS = ("distance", "fov", "start", "antenna")
_FOV_OF = "fov."
_STARTS = ("antenna", "rear-axle")
_LENSES = ("calibrated", "nominal")
# DriveWorks names a camera camera:front:wide:120fov, NTNU C3_tricam120.
_IN_NAME = re.compile(r"(?<!\d)(\d{2,3})(?!\d)")
_NOMINAL_DEG = (20.0, 220.0)


def with_paper_antenna(drive: Drive, asked: Mapping[str, str]) -> Drive:
    """Return the drive with the antenna first that the paper's method starts from.

    Raises
    ------
    ConfigError
        The drive has no fixes of such an antenna.
    """
    name = asked.get("antenna")
    if name is None:
        return drive
    first = [fixes for fixes in drive.gnss if fixes.antenna == name]
    if not first:
        held = ", ".join(fixes.antenna for fixes in drive.gnss) or "none: it has poses"
        raise ConfigError(f"--paper antenna={name:.80}: {drive.name} has no such antenna; it has {held}.")
    return replace(drive, gnss=(*first, *(fixes for fixes in drive.gnss if fixes.antenna != name)))


def paper_readings(drive: Drive, asked: Mapping[str, str]) -> PaperReadings:
    """Read ``distance``, ``fov``, ``fov.CAMERA`` (of the annotated cameras) and ``start``.

    Parameters
    ----------
    drive : Drive
        From `with_paper_antenna`.
    asked : mapping of str to str
        What was said, by key; nothing for the usual reading.

    Raises
    ------
    ConfigError
        No such key or value, or a camera whose name has no nominal field of view.
    """
    unknown = [key for key in asked if key not in _KEYS and not key.startswith(_FOV_OF)]
    if unknown:
        raise ConfigError(
            f"--paper knows no {unknown[0]:.80}: its keys are distance, fov, fov.CAMERA, start and antenna "
            "(twin help paper)."
        )
    distance = _one_of("distance", asked.get("distance", Distance.REAR_AXLE), tuple(Distance))
    lens = _one_of("fov", asked.get("fov", _LENSES[0]), _LENSES)
    stated = {
        key.removeprefix(_FOV_OF): _degrees(key, value)
        for key, value in asked.items()
        if key.startswith(_FOV_OF)
    }
    if strangers := sorted(set(stated) - set(drive.rig.cameras)):
        raise ConfigError(
            f"--paper {_FOV_OF}{strangers[0]:.80}: the rig has no such camera; it has "
            f"{', '.join(drive.rig.cameras)}."
        )
    if lens == "nominal":
        cameras = drive.annotated_cameras() - set(stated)
        stated |= {camera: _nominal_deg(camera) for camera in sorted(cameras)}
    start = _one_of("start", asked.get("start", _STARTS[0]), _STARTS)
    arm_m = (0.0, 0.0)
    if start == "rear-axle" and drive.gnss:  # poses are the rear axle's already
        ahead_m, left_m, _ = drive.rig.antennas[drive.gnss[0].antenna].rig_t_antenna_m.tolist()
        arm_m = ahead_m, left_m
    return PaperReadings(Distance(distance), stated, arm_m)


def told_readings(asked: Mapping[str, str]) -> tuple[str, ...]:
    """Say how the method was read, where that was asked for."""
    told = ", ".join(f"{key}={value}" for key, value in asked.items())
    return (f"The paper's method was read with {told}.",) if told else ()


def _one_of(key: str, value: str, allowed: tuple[str, ...]) -> str:
    if value not in allowed:
        raise ConfigError(f"--paper {key}={value:.80}: write {' or '.join(allowed)}.")
    return value


def _degrees(key: str, value: str) -> float:
    try:
        degrees = float(value)
    except ValueError:
        degrees = math.nan
    if not 0.0 < degrees < 360.0:
        raise ConfigError(f"--paper {key:.80}={value:.80}: write degrees between 0 and 360.")
    return degrees


def _nominal_deg(camera: str) -> float:
    """The field of view that a camera is called by."""
    found = {float(one) for one in _IN_NAME.findall(camera)}
    fits = [degrees for degrees in found if _NOMINAL_DEG[0] <= degrees <= _NOMINAL_DEG[1]]
    if len(fits) != 1:
        raise ConfigError(
            f"--paper fov=nominal: the name of camera {camera} does not say how wide it sees; "
            f"say it by --paper {_FOV_OF}{camera}=DEGREES."
        )
    return fits[0]
