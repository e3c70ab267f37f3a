"""Folders of comma.ai's logs as NumPy arrays, laid out as comma2k19: ``processed_log/CAN/speed/value``.

Each quantity is a folder with two arrays, times in seconds since the device started and values. The IMU's
axes are forward, right, down; wheels stand in the order front left, front right, rear left, rear right. The
times become UTC by the GPS times of the frames (``global_pose``), else by the fixes of the device's receiver.

comma.ai, "comma2k19", https://github.com/commaai/comma2k19 (README, "Log Format").
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from twin.drives.epochs import WEEK_NS, credible, utc_from_gps
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.clocks import counted_from
from twin.drives.motion.samples import MotionRead, Samples
from twin.errors import DriveError

_NS_PER_S = 1_000_000_000
_REAR_WHEELS = (2, 3)
_LOG, _POSES = "processed_log", "global_pose"
_RECEIVERS = ("GNSS/live_gnss_ublox", "GNSS/live_gnss_qcom")
_UTC_COLUMN = 3
_LATEST_S = 9e9


class _Kept(NamedTuple):
    """What the folders of one quantity are called, their unit and which axis of three points up."""

    names: tuple[str, ...]
    unit: str
    axis: str | None = None


_KEPT: Mapping[Quantity, _Kept] = {
    Quantity.SPEED: _Kept(("CAN/wheel_speed", "CAN/wheel_speeds", "CAN/speed", "CAN/car_speed"), "m/s"),
    Quantity.TURN_RATE: _Kept(("IMU/gyro", "IMU/gyro_uncalibrated"), "rad/s", "-z"),
    Quantity.WHEEL_ANGLE: _Kept(("CAN/steering_angle",), "deg"),
}


def is_comma(folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a folder holds such a log."""
    return folder.is_folder(source.file) and _log_of(folder, source.file) is not None


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the quantities that ``drive.toml`` names, or speed and rate of turn where it names none.

    The angle is that of the steering wheel, and read only where it is named.

    Raises
    ------
    DriveError
        If an array cannot be read, or nothing in the folder says when the device started.
    """
    log = _log_of(folder, source.file) or source.file
    samples: dict[Quantity, list[Samples]] = {}
    wanted = source.named or (Quantity.SPEED, Quantity.TURN_RATE)
    for quantity in wanted:
        kept = _KEPT[quantity]
        there = [name for name in kept.names if folder.is_folder(f"{log}/{name}")]
        for name in source.of(quantity).names or there[:1]:
            samples.setdefault(quantity, []).append(_samples(folder, log, name, kept, source))
    if not samples:
        told = ", ".join(name for one in _KEPT.values() for name in one.names)
        raise DriveError(
            f"{source.file} holds none of {told}: name the folder processed_log of a comma log"
            f" under [{source.table}] in {SETTINGS_FILE}."
        )
    return MotionRead(samples)


def _log_of(folder: DriveFolder, name: str) -> str | None:
    """The folder that holds CAN and IMU: the one that is named, or ``processed_log`` in it."""
    for log in (name, f"{name}/{_LOG}"):
        if any(folder.is_folder(f"{log}/{kept}") for one in _KEPT.values() for kept in one.names):
            return log
    return None


def _samples(folder: DriveFolder, log: str, name: str, kept: _Kept, source: MotionSource) -> Samples:
    t_s = _array(folder, f"{log}/{name}/t").ravel()
    values = _array(folder, f"{log}/{name}/value").reshape(len(t_s), -1)
    if values.shape[1] == 4:  # of four wheels those on the rear axle
        values = values[:, _REAR_WHEELS].mean(axis=1, keepdims=True)
    if values.shape[1] not in (1, 3):
        raise DriveError(
            f"{log}/{name} holds {values.shape[1]} values a time: name another folder of the log."
        )
    stamp_ns, known = _epochs(folder, log, t_s, source)
    is_gyro = values.shape[1] == 3
    return Samples(
        stamp_ns, values if is_gyro else values.ravel(), unit=kept.unit, axis=kept.axis, of_receiver=known
    )


def _epochs(folder: DriveFolder, log: str, t_s: FloatArray, source: MotionSource) -> tuple[IntArray, bool]:
    """UTC of times since the device started, and whether a receiver tells it."""
    if source.time_zero_ns is None:
        offset_ns = _boot_ns(folder, log)
        if offset_ns is not None:
            return np.round(t_s * _NS_PER_S).astype(np.int64) + offset_ns, True
    return counted_from(np.round(t_s * _NS_PER_S).astype(np.int64), source, f"{t_s[0]:.3f}"), False


def _boot_ns(folder: DriveFolder, log: str) -> int | None:
    """UTC of the device's start; None where the log does not say."""
    parent = log.rpartition("/")[0]
    poses = f"{parent}/{_POSES}" if parent else _POSES
    if folder.has(f"{poses}/frame_gps_times") and folder.has(f"{poses}/frame_times"):
        gps = _array(folder, f"{poses}/frame_gps_times").reshape(-1, 2)
        week, tow_s = np.nan_to_num(gps[len(gps) // 2]).tolist()
        utc_ns = utc_from_gps(round(week) * WEEK_NS + round(tow_s * _NS_PER_S))
        t_s = _array(folder, f"{poses}/frame_times").ravel()[len(gps) // 2]
        boot_ns = utc_ns - round(float(t_s) * _NS_PER_S)
        return boot_ns if credible(boot_ns) else None
    for receiver in _RECEIVERS:
        if folder.is_folder(f"{log}/{receiver}"):
            t_s = _array(folder, f"{log}/{receiver}/t").ravel()
            value = _array(folder, f"{log}/{receiver}/value").reshape(len(t_s), -1)
            if value.shape[1] > _UTC_COLUMN and len(t_s):
                return _of_receiver(t_s, value[:, _UTC_COLUMN])
    return None


def _of_receiver(t_s: FloatArray, utc: FloatArray) -> int | None:
    """Start by the UTC of fixes, which the README has in seconds and some logs in milliseconds."""
    for unit in (1.0, 1e-3):
        offset_ns = round(float(np.median(utc * unit - t_s)) * _NS_PER_S)
        if credible(offset_ns):
            return offset_ns
    return None


def _array(folder: DriveFolder, name: str) -> FloatArray:
    """Read an array, with or without ``.npy`` at the end of its name; nothing in it is run."""
    name = name if folder.has(name) or not folder.has(f"{name}.npy") else f"{name}.npy"
    try:
        array = np.load(io.BytesIO(folder.content(name)), allow_pickle=False)
        numbers = np.asarray(array, np.float64)
    except Exception as error:  # damage shows in NumPy's header as errors of nearly every kind
        told = str(error).partition("\n")[0]
        raise DriveError(f"{name} is no NumPy array of numbers ({told:.80}): copy it again.") from error
    if not numbers.size or not np.abs(np.nan_to_num(numbers)).max() < _LATEST_S * 1e3:
        raise DriveError(f"{name} is empty or holds numbers that are none: copy it again.")
    return numbers
