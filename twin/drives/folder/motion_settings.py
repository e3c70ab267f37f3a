"""``[motion]`` of ``drive.toml``: which files say how the car moved, and what their numbers mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from twin.drives.folder.keys import MOTION_KEYS
from twin.drives.folder.toml_values import (
    SETTINGS_FILE,
    choice_of,
    moment_of,
    number_of,
    refuse_unknown,
    table_of,
    text_of,
    wrong_value,
)
from twin.errors import DriveError

TIME_UNITS = ("s", "ms", "us", "ns", "iso")
GPS_ZERO = "gps"
UNIX_ZERO = "unix"
AXES = ("x", "y", "z", "-x", "-y", "-z")
LAG_SIGMA_S = 0.1
"""One sigma of how late stamps are where nobody states it: buses and drivers take tens of milliseconds."""
_SIDES = ("left", "right")
_MOST = {
    "wheelbase_m": (0.5, 20.0),
    "wheel_radius_m": (0.1, 2.0),
    "metres_per_tick": (1e-6, 10.0),
    "steering_ratio": (0.5, 50.0),
    "utc_offset_hours": (-14.0, 14.0),
    "lag_ms": (-10_000.0, 10_000.0),
    "lag_sigma_ms": (0.1, 10_000.0),
    "speed_sigma_mps": (1e-4, 10.0),
    "turn_rate_sigma_deg_s": (1e-4, 30.0),
    "wheel_angle_sigma_deg": (1e-4, 30.0),
}
"""Least and largest value of each number: what lies beyond is in another unit."""


class Quantity(StrEnum):
    """What a car measures of its own motion."""

    SPEED = "speed"
    TURN_RATE = "turn_rate"
    WHEEL_ANGLE = "wheel_angle"


_SIGMA_KEYS = {
    Quantity.SPEED: "speed_sigma_mps",
    Quantity.TURN_RATE: "turn_rate_sigma_deg_s",
    Quantity.WHEEL_ANGLE: "wheel_angle_sigma_deg",
}


@dataclass(frozen=True, slots=True)
class QuantitySettings:
    """What ``drive.toml`` says of one quantity.

    Attributes
    ----------
    names : tuple of str
        Columns, signals or topics, of which the mean counts; empty where the format itself says which.
    unit : str or None
        None leaves it to the recording.
    sigma : float or None
        One sigma of a value: m/s, degrees a second or degrees.
    positive_left : bool
        Whether what turns the car to the left is positive.
    """

    names: tuple[str, ...] = ()
    unit: str | None = None
    sigma: float | None = None
    positive_left: bool = True


@dataclass(frozen=True, slots=True)
class MotionSource:
    """One file, or folder, that says how the car moved.

    Attributes
    ----------
    table : str
        Where it stands in ``drive.toml``, for messages: ``motion``, ``motion.can``.
    file : str
    dbc : str or None
        What the messages of a CAN log mean.
    time, time_unit : str or None
        Column of a table's times and its unit, one of `TIME_UNITS`.
    time_zero_ns : int or None
        Epoch from which the times count; None: from 1970, if that gives a credible year.
    is_gps_time : bool
        Whether they count on GPS time, which knows no leap seconds.
    utc_offset_hours : float or None
        Zone of times on a clock for people.
    quantities : mapping of Quantity to QuantitySettings
        Those that have a name, a unit or a sigma; empty where the format says all.
    turn_rate_axis : str or None
        Which axis of the gyro points up in the car, one of `AXES`.
    steering_ratio : float
        Turn of the steering wheel for one of the front wheels; 1 where the angle is that of the wheels.
    wheel_radius_m, metres_per_tick : float or None
    lag_s, lag_sigma_s : float
    """

    table: str
    file: str
    dbc: str | None = None
    time: str | None = None
    time_unit: str | None = None
    time_zero_ns: int | None = None
    is_gps_time: bool = False
    utc_offset_hours: float | None = None
    quantities: Mapping[Quantity, QuantitySettings] = field(default_factory=dict)
    turn_rate_axis: str | None = None
    steering_ratio: float = 1.0
    wheel_radius_m: float | None = None
    metres_per_tick: float | None = None
    lag_s: float = 0.0
    lag_sigma_s: float = LAG_SIGMA_S

    def of(self, quantity: Quantity) -> QuantitySettings:
        """What is said of a quantity."""
        return self.quantities.get(quantity, QuantitySettings())

    @property
    def names(self) -> tuple[str, ...]:
        """Every column, signal or topic that is asked for."""
        return tuple(name for said in self.quantities.values() for name in said.names)

    @property
    def named(self) -> tuple[Quantity, ...]:
        """Quantities of which the names are given."""
        return tuple(quantity for quantity, said in self.quantities.items() if said.names)


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """All sources, and the wheelbase where ``drive.toml`` states it."""

    sources: tuple[MotionSource, ...] = ()
    wheelbase_m: float | None = None


def motion_settings(document: Mapping[str, Any]) -> MotionSettings:
    """Read ``[motion]``: one source itself, or a table for each, ``[motion.can]``.

    Raises
    ------
    DriveError
        If a key is unknown, or a value is not what it must be.
    """
    root = table_of(document, "motion")
    tables = {key: value for key, value in root.items() if isinstance(value, dict)}
    plain = {key: value for key, value in root.items() if key not in tables}
    wheelbase_m = _number(plain, "wheelbase_m", "motion")
    plain.pop("wheelbase_m", None)
    sources = [_source(plain, "motion")] if plain else []
    sources += [_source(table, f"motion.{name}") for name, table in tables.items()]
    if "motion" in document and not sources:
        raise DriveError(
            f"{SETTINGS_FILE} has a table [motion] that names no file: give file = …, or a table for each"
            " source, [motion.can] (`twin help drive-folder`)."
        )
    return MotionSettings(tuple(sources), wheelbase_m)


def _source(table: Mapping[str, Any], name: str) -> MotionSource:
    refuse_unknown(table, [key for key in MOTION_KEYS if key != "wheelbase_m"], f"[{name}] ")
    file = text_of(table, "file", f"{name}.file")
    if file is None:
        raise DriveError(f"{SETTINGS_FILE} gives no file under [{name}]: name the recording, file = …")
    unit = table.get("time_unit")
    if unit is not None and unit not in TIME_UNITS:
        raise wrong_value(f"{name}.time_unit", unit, " or ".join(f'"{one}"' for one in TIME_UNITS))
    axis = table.get("turn_rate_axis")
    if axis is not None and axis not in AXES:
        raise wrong_value(f"{name}.turn_rate_axis", axis, " or ".join(f'"{one}"' for one in AXES))
    zero = table.get("time_zero")
    counted = zero in (None, UNIX_ZERO, GPS_ZERO)
    wanted = f'"{UNIX_ZERO}", "{GPS_ZERO}"'
    lag_ms, lag_sigma_ms = (_number(table, key, name) for key in ("lag_ms", "lag_sigma_ms"))
    return MotionSource(
        table=name,
        file=file,
        dbc=text_of(table, "dbc", f"{name}.dbc"),
        time=text_of(table, "time", f"{name}.time"),
        time_unit=unit,
        time_zero_ns=None if counted else moment_of(zero, f"{name}.time_zero", wanted),
        is_gps_time=zero == GPS_ZERO,
        utc_offset_hours=_number(table, "utc_offset_hours", name),
        quantities={quantity: said for quantity in Quantity if (said := _quantity(table, quantity, name))},
        turn_rate_axis=axis,
        steering_ratio=_number(table, "steering_ratio", name) or 1.0,
        wheel_radius_m=_number(table, "wheel_radius_m", name),
        metres_per_tick=_number(table, "metres_per_tick", name),
        lag_s=(lag_ms or 0.0) / 1e3,
        lag_sigma_s=LAG_SIGMA_S if lag_sigma_ms is None else lag_sigma_ms / 1e3,
    )


def _quantity(table: Mapping[str, Any], quantity: Quantity, name: str) -> QuantitySettings | None:
    """What is said of one quantity; None for nothing."""
    value = table.get(quantity, [])
    names = value if isinstance(value, list) else [value]
    if (quantity in table and not names) or not all(isinstance(n, str) and n.strip() for n in names):
        raise wrong_value(f"{name}.{quantity}", value, "a column, signal or topic, or a list of them")
    said = QuantitySettings(
        names=tuple(names),
        unit=text_of(table, f"{quantity}_unit", f"{name}.{quantity}_unit"),
        sigma=_number(table, _SIGMA_KEYS[quantity], name),
        positive_left=choice_of(table, f"{quantity}_positive", _SIDES) == _SIDES[0],
    )
    return None if said == QuantitySettings() else said


def _number(table: Mapping[str, Any], key: str, name: str) -> float | None:
    if key not in table:
        return None
    value, (least, most) = number_of(table[key], f"{name}.{key}"), _MOST[key]
    if not least <= value <= most:
        raise wrong_value(f"{name}.{key}", value, f"a number from {least:g} to {most:g}")
    return value
