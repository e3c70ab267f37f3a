"""A table of a car's motion (CSV): which column is what stands in ``drive.toml``."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from decimal import Decimal
from functools import partial

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource
from twin.drives.folder.sensor_names import which_of
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.clocks import counted_from, in_zone
from twin.drives.motion.samples import MotionRead, Samples
from twin.errors import DriveError
from twin.tables import NotTextError, Table

_UNIT_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_LARGEST_TIME = 10**20
_LARGEST_NS = 2**62
_UTC_1970 = datetime(1970, 1, 1)  # noqa: DTZ001
"""What times without a zone are counted from."""


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the columns that ``drive.toml`` names.

    Raises
    ------
    DriveError
        If a column is not there, it is not said which holds the times and what they count, or the file is no
        table.
    """
    content, faults = folder.content(source.file), Counter[str]()
    try:
        table = Table(content)
        names = _columns(table, source)
        rows = list(_rows(table, [*names.values()], faults))
    except (NotTextError, csv.Error) as error:
        raise DriveError(f"{source.file} is no table ({error}): export it again as CSV.") from error
    times, *columns = zip(*rows, strict=True) if rows else ((),) * (len(names) or 1)
    stamp_ns, sound = _stamps(times, source, faults)
    by_name = {
        name: np.array([_number(table.plain(cell)) for cell in column], np.float64)[sound]
        for name, column in zip(list(names)[1:], columns, strict=True)
    }
    samples = {
        quantity: [Samples(stamp_ns, by_name[name]) for name in source.of(quantity).names]
        for quantity in source.named
    }
    return MotionRead(samples, faults=faults)


def _columns(table: Table, source: MotionSource) -> dict[str, int]:
    """Place of the column of times, and of each that is asked for."""
    there = [name for name in table.header if name]
    if not source.names:
        raise DriveError(
            f"{SETTINGS_FILE} does not say which columns of {source.file} are what: give [{source.table}]"
            f" time, time_unit and speed, turn_rate or wheel_angle; its columns: {', '.join(there):.300}."
        )
    if source.time is None or source.time_unit is None:
        key = "time" if source.time is None else "time_unit"
        raise DriveError(
            f"{SETTINGS_FILE} does not say in which column and unit the times of {source.file} are: give"
            f" [{source.table}] {key}; its columns: {', '.join(there):.300}."
        )
    for name in (source.time, *source.names):
        if name not in there:
            raise DriveError(
                f"{SETTINGS_FILE} names the column {name} of {source.file}, which has none of that name"
                f" ({which_of('columns', name, there)}): correct [{source.table}]."
            )
    return {name: table.header.index(name) for name in (source.time, *source.names)}


def _rows(table: Table, places: Sequence[int], faults: Counter[str]) -> Iterator[tuple[str, ...]]:
    """The cells that are asked for, of each row that has them."""
    last = max(places)
    for cells in table:
        if len(cells) > last:
            yield tuple(cells[place].strip() for place in places)
        elif any(cell.strip() for cell in cells):
            faults["row too short"] += 1


def _stamps(
    times: Sequence[str], source: MotionSource, faults: Counter[str]
) -> tuple[IntArray, Sequence[int]]:
    """Epochs, and the rows that have one."""
    of_cell: Callable[[str], int] = _naive_ns
    if source.time_unit == "iso":
        zoned = [_zone_of(text) for text in times[:1]]
        of_cell = _zoned_ns if zoned == [True] else _naive_ns
    else:
        unit_ns = _UNIT_NS[source.time_unit or "s"]
        of_cell = partial(_whole_ns, unit_ns)
    stamps, sound = [], []
    for row, text in enumerate(times):
        try:
            stamps.append(of_cell(text))
        except (ValueError, ArithmeticError):
            faults["time that is none"] += 1
            continue
        sound.append(row)
    if not sound:
        raise DriveError(
            f"{source.file} holds no time in the column {source.time}: it begins"
            f" {', '.join(times[:2])!r:.60}, no {source.time_unit}; correct time and time_unit under"
            f" [{source.table}]."
        )
    stamp_ns = np.array(stamps, np.int64)
    if source.time_unit != "iso":
        return counted_from(stamp_ns, source, times[sound[0]]), sound
    return (stamp_ns if of_cell is _zoned_ns else in_zone(stamp_ns, source)), sound


def _whole_ns(unit_ns: int, text: str) -> int:
    """Nanoseconds, exact whatever the unit."""
    value = Decimal(text.replace(",", ".", 1))
    if not abs(value) < _LARGEST_TIME:
        raise ValueError(text)
    whole_ns = int((value * unit_ns).to_integral_value())
    if not -_LARGEST_NS < whole_ns < _LARGEST_NS:
        raise ValueError(text)
    return whole_ns


def _zone_of(text: str) -> bool:
    try:
        return datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        return False


def _zoned_ns(text: str) -> int:
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is None:
        raise ValueError(text)
    return _naive_ns((moment.replace(tzinfo=None) - moment.utcoffset()).isoformat())  # type: ignore[operator]


def _naive_ns(text: str) -> int:
    since = datetime.fromisoformat(text) - _UTC_1970
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
