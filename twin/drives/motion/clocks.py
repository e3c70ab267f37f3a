"""Times of a recording of motion → UTC."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoloc.arrays import IntArray
from geoloc.trajectory.trajectory import GnssFixes
from twin.drives.epochs import credible, unit_hint, utc_from_gps
from twin.drives.folder.motion_settings import MotionSource
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.frames.clocks import of_host
from twin.errors import DriveError

_NS_PER_HOUR = 3_600_000_000_000
HOST_SIGMA_S = 0.25
"""One sigma of stamps of a host whose clock is known by its receiver's delay alone: the delay of the link."""


def counted_from(stamp_ns: IntArray, source: MotionSource, first: str) -> IntArray:
    """Epochs of times that count from somewhere.

    Parameters
    ----------
    stamp_ns : int64 (n,)
        Nanoseconds since then.
    first : str
        The first of them as it stands in the file, for messages.

    Raises
    ------
    DriveError
        If it is not clear from when they count: neither does ``drive.toml`` say, nor is it 1970.
    """
    if not len(stamp_ns):
        return stamp_ns
    if source.is_gps_time:
        return stamp_ns + (utc_from_gps(int(stamp_ns[0])) - int(stamp_ns[0]))
    if source.time_zero_ns is not None:
        return stamp_ns + source.time_zero_ns
    if not credible(int(np.median(stamp_ns))):
        hint = unit_hint(first, "nanoseconds")
        raise DriveError(
            f"The times of {source.file} ({first:.40}, …) are no years 2000–2099 counted from 1970 in"
            f" {source.time_unit or 'seconds'}{f' ({hint})' if hint else ''}: correct [{source.table}]"
            f' time_unit, or give what they count from, time_zero = "2026-06-10T07:59:59Z" or "gps".'
        )
    return stamp_ns


def in_zone(stamp_ns: IntArray, source: MotionSource) -> IntArray:
    """Epochs of times on a clock for people, given as if they were UTC.

    Raises
    ------
    DriveError
        If ``drive.toml`` does not state their zone.
    """
    if source.utc_offset_hours is None:
        raise DriveError(
            f"{source.file} does not say in which zone its times are: give [{source.table}]"
            f" utc_offset_hours in {SETTINGS_FILE}, 0 for UTC, 2 in Norwegian summer."
        )
    return stamp_ns - round(source.utc_offset_hours * _NS_PER_HOUR)


def host_offset(gnss: Sequence[GnssFixes]) -> tuple[int, str]:
    """How far the host's clock is from UTC, nanoseconds, and a sentence; 0 and "" where it is on UTC.

    The host stamps fixes too, which know UTC: what is more than a link takes is its clock's.
    """
    if of_host(gnss) is None:
        return 0, ""
    delay_ns = round(float(np.median(np.concatenate([fixes.host_ns - fixes.epoch_ns for fixes in gnss]))))
    sentence = (
        f"The host stamped its fixes {delay_ns / 1e9:+.2f} s after their UTC, so the stamps of the car's"
        f" motion are moved by {-delay_ns / 1e9:+.2f} s and taken as good to {HOST_SIGMA_S:g} s."
    )
    return delay_ns, sentence
