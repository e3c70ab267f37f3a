"""What DriveWorks' own tools write out of its recordings: JSON of the ingestion tools, and egomotion as text.

Of frames (:mod:`twin.drives.track.formats.framedata`) those of a CAN bus, recorded with its DBC, have a
``signal_name``, ``value`` and ``unit``, those of an IMU ``turnrate`` about the sensor's own axes.

The egomotion sample writes ``timestamp_us,x,y,z`` in metres of a frame of its own, ten times a second and
rounded to centimetres: its steps are the car's speed.

NVIDIA DriveWorks 3.5, "Frame Parsing Ingestion Tool" and "Frame Data Time Synchronization Ingestion Tool";
DriveWorks 5, ``sample_egomotion --output`` and ``dwIMUFrame`` (turnrate in rad/s).
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Mapping

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.sensor_names import which_of
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.clocks import counted_from
from twin.drives.motion.samples import MotionRead, Samples
from twin.drives.track.formats.framedata import frames, is_framedata
from twin.errors import DriveError

TURN_RATE = "turnrate"
_EGOMOTION = re.compile(rb"\d{10,19}(,-?\d+\.\d\d){3}\r?\n")
_US_NS = 1_000
_ROUNDED_M = 0.01 / np.sqrt(12.0)


def is_egomotion(head: bytes) -> bool:
    """Whether a file begins as text of DriveWorks' egomotion sample."""
    return _EGOMOTION.match(head) is not None


def is_driveworks(folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a file is one of the two."""
    if folder.is_folder(source.file) or source.time is not None:
        return False
    head = folder.head(source.file)
    return is_framedata(head) or is_egomotion(head)


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the signals that ``drive.toml`` names, or the rate of turn of an IMU.

    Raises
    ------
    DriveError
        If a signal is not in the file, or nothing of it can be used.
    """
    content = folder.content(source.file)
    if is_egomotion(content[:200]):
        return _egomotion(content, source)
    faults: Counter[str] = Counter()
    signals: dict[str, list[tuple[int, float]]] = defaultdict(list)
    units: dict[str, str] = {}
    turns: list[tuple[int, tuple[float, ...]]] = []
    for stamp_us, payload in frames(content, source.file):
        name, value = payload.get("signal_name"), payload.get("value")
        rate = payload.get(TURN_RATE)
        if isinstance(name, str) and isinstance(value, int | float) and _is_number(value):
            signals[name].append((stamp_us, float(value)))
            units.setdefault(name, str(payload.get("unit") or ""))
        elif isinstance(rate, list) and len(rate) == 3 and all(map(_is_number, rate)):
            turns.append((stamp_us, tuple(map(float, rate))))
        else:
            faults["frame without a signal or a rate of turn"] += 1
    if signals or source.named:
        return MotionRead(_of_signals(signals, units, source), faults=faults)
    if not turns:
        raise DriveError(
            f"{source.file} holds neither signals of a CAN bus nor rates of turn: export the recording of the"
            " CAN bus or the IMU with ingest_framedata --format=json."
        )
    stamp_ns = _stamps([stamp_us for stamp_us, _ in turns], source)
    values = np.array([rate for _, rate in turns], np.float64)
    return MotionRead({Quantity.TURN_RATE: [Samples(stamp_ns, values, unit="rad/s")]}, faults=faults)


def _of_signals(
    signals: Mapping[str, list[tuple[int, float]]], units: Mapping[str, str], source: MotionSource
) -> dict[Quantity, list[Samples]]:
    if not source.names:
        raise DriveError(
            f"{SETTINGS_FILE} does not say which signals of {source.file} are what: give [{source.table}]"
            f" speed, turn_rate or wheel_angle; its signals: {', '.join(signals):.300}."
        )
    for name in source.names:
        if name not in signals:
            raise DriveError(
                f"{SETTINGS_FILE} names the signal {name}, which {source.file} does not have"
                f" ({which_of('signals', name, signals)}): correct [{source.table}]."
            )
    samples = {}
    for quantity in source.named:
        samples[quantity] = [
            Samples(
                _stamps([stamp for stamp, _ in signals[name]], source),
                np.array([value for _, value in signals[name]], np.float64),
                unit=units[name],
            )
            for name in source.of(quantity).names
        ]
    return samples


def _egomotion(content: bytes, source: MotionSource) -> MotionRead:
    """Speeds between the places of a car, in the middle of the time between."""
    faults: Counter[str] = Counter()
    rows = []
    for line in content.splitlines():
        if _EGOMOTION.fullmatch(line + b"\n"):
            stamp, *place = line.split(b",")
            rows.append((int(stamp), *map(float, place)))
        elif line.strip():
            faults["line that is no place"] += 1
    stamp_ns = _stamps([int(row[0]) for row in rows], source)
    place_m = np.array([row[1:] for row in rows], np.float64)
    step_s = np.diff(stamp_ns) / 1e9
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.linalg.norm(np.diff(place_m, axis=0), axis=1) / step_s
        sigma = np.sqrt(2.0) * _ROUNDED_M / step_s
    speed[step_s <= 0] = np.nan
    between_ns = stamp_ns[:-1] + np.diff(stamp_ns) // 2
    warning = (
        f"{source.file} is DriveWorks' egomotion: its speed is made of the car's own wheels and IMU, and has"
        " no sign: where the car reversed it is wrong."
    )
    return MotionRead({Quantity.SPEED: [Samples(between_ns, speed, "m/s", sigma=sigma)]}, (warning,), faults)


def _stamps(stamps_us: list[int], source: MotionSource) -> IntArray:
    if not stamps_us:
        raise DriveError(f"{source.file} holds nothing that has a time: export it again.")
    return counted_from(np.array(stamps_us, np.int64) * _US_NS, source, str(stamps_us[0]))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e15
