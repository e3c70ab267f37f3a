"""A car's folder: what the folder of its drives states, but for their recordings."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from geoloc.doubts import Doubt
from geoloc.earth.datum import euref89_from_itrf
from geoloc.rig.rig import Rig
from twin.drives.annotations.labels import LabelMap
from twin.drives.annotations.read import read_drive_labels
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes
from twin.drives.rig.rig_files import rig_of_folder
from twin.drives.track.read import rig_with_antennas
from twin.errors import ConfigError
from twin.ingest.budget import budget_of
from twin.live.engine import LiveCar
from twin.live.sources.address import FIX_SCHEMES, address_of

EUREF89 = "EUREF89"
ONLY_ANTENNA = "gnss"
"""What the antenna of a car is called that names none."""
_IN_NORWAY = (63.43, 10.40, 80.0)
_YEAR_NS = 86400 * 365.25 * 1e9


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

    @property
    def errors(self) -> Mapping[str, float]:
        """Return the terms of the error budget that it states."""
        return self.settings.errors

    @property
    def clock(self) -> None:
        """Return nothing: cameras of a live drive are stamped by a clock that runs on UTC."""
        return

    def antennas(self) -> tuple[str, ...]:
        """Return every antenna that its rig file or its ``drive.toml`` knows, sorted."""
        known = {*self.rig.antennas, *self.settings.lever_arms_m, *(self.settings.gnss or ())}
        return tuple(sorted(known))

    def live_car(self, antennas: Collection[str]) -> LiveCar:
        """Return what the engine needs to know.

        Parameters
        ----------
        antennas : collection of str
            Those that deliver fixes, as `antennas_of` finds them.

        Raises
        ------
        DriveError
            If one of them has no place in the car.
        """
        there = {*self.rig.antennas, *antennas}
        arms = {name: arm for name, arm in self.settings.lever_arms_m.items() if name in there}
        rig = rig_with_antennas(
            self.rig, dict.fromkeys(antennas, ""), replace(self.settings, lever_arms_m=arms)
        )
        datum_sigma_m = 0.0
        if self.settings.datum != EUREF89:
            # The same in all of Norway.
            datum_sigma_m = euref89_from_itrf(
                self.settings.datum, *_IN_NORWAY, year_of(time.time_ns())
            ).extra_sigma_m
        return LiveCar(
            rig=rig,
            antennas=tuple(antennas),
            budget=budget_of(self, None, {}),
            readout_ms=self.settings.rolling_shutter_ms,
            pole_radius_m=self.settings.pole_radius_m,
            track_sigma_m=datum_sigma_m,
        )


def read_car(path: Path | str) -> Car:
    """Read a car's folder: ``drive.toml``, rig, calibrations, masks, ``labels.toml``. A drive's is one too.

    Raises
    ------
    DriveError
        As :func:`twin.drives.read.read_drive`.
    """
    folder, notes = DriveFolder(Path(path)), ReadingNotes()
    named = folder.has(SETTINGS_FILE)
    settings = read_settings(folder.content(SETTINGS_FILE)) if named else DriveSettings()
    rig, _ = rig_of_folder(folder, settings, notes)
    labels = read_drive_labels(folder)
    if settings.motion.sources:
        notes.warn(
            DriveDoubt.TRACK,
            f"[motion] of {SETTINGS_FILE} is not used live: a car's own motion is read of recordings only.",
        )
    return Car(Path(path), rig, settings, labels, tuple(sorted(folder.entered())), tuple(notes.warnings))


def antenna_of(car: Car, named: str | None) -> str:
    """Return the antenna that an address names, or the car's only one.

    Raises
    ------
    ConfigError
        For one that the car does not have, or where it has several and none is named.
    """
    known = car.antennas()
    if named is not None:
        if known and named not in known:
            raise ConfigError(
                f"The car in {car.path} has no antenna {named}: it has {', '.join(known)}. Correct ?antenna=…"
            )
        return named
    if len(known) > 1:
        raise ConfigError(
            f"The car in {car.path} has the antennas {', '.join(known)}: say whose fixes come from the"
            f" address, with ?antenna={known[0]} behind it."
        )
    return known[0] if known else ONLY_ANTENNA


def antennas_of(car: Car, urls: Sequence[str]) -> tuple[str, ...]:
    """Return the antenna of each address of fixes: what `Car.live_car` takes.

    Raises
    ------
    ConfigError
        For one that the car does not have, one that two addresses name, or where none is named and the car
        has several.
    """
    names = [antenna_of(car, address_of(url, FIX_SCHEMES).options.get("antenna")) for url in urls]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(f"Two addresses give fixes of {', '.join(twice)}: keep one for each antenna.")
    return tuple(names)


def year_of(epoch_ns: int) -> float:
    """Decimal year of an epoch."""
    return 1970.0 + epoch_ns / _YEAR_NS
