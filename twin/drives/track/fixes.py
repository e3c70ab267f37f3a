"""What every reader of GNSS recordings and poses returns, and the checks that they share."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.earth.geodesy import metres_per_degree
from geoloc.trajectory.trajectory import GnssFixes, PoseTrack
from twin.drives.epochs import HOST_DELAY_LIMIT_S, credible, longest_increasing
from twin.drives.folder.notes import Skipped
from twin.errors import DriveError

HIGHEST_M = 20_000
"""No road lies further from the ellipsoid, up or down."""

LARGEST_SIGMA_M = 10_000.0
"""A fix that may be anywhere in the county says nothing already."""


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class LeftOutError(Exception):
    """A line, message or point that is left out; its text is the reason, one clause."""


class Fix(NamedTuple):
    """One usable fix.

    Epochs are nanoseconds UTC, `height_m` is ellipsoidal, `quality` is GGA's. The sigmas are that of a
    horizontal axis and that of the height, NaN where the recording does not say. `heading_deg` is that of the
    receiver, `velocity_mps` east, north and up, with one sigma of a horizontal axis and of the vertical; NaN
    for none.
    """

    epoch_ns: int
    host_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quality: int
    sigma_horizontal_m: float = math.nan
    sigma_vertical_m: float = math.nan
    heading_deg: float = math.nan
    heading_sigma_deg: float = math.nan
    velocity_mps: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    velocity_sigma_mps: tuple[float, float] = (math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class FixesRead:
    """Fixes of one recording, with what was left out and what a user should know."""

    fixes: GnssFixes
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PosesRead:
    """Poses of one recording, with what was left out and what a user should know."""

    track: PoseTrack
    skipped: tuple[Skipped, ...]
    warnings: tuple[str, ...]


def fixes_read(
    rows: Sequence[Fix],
    antenna: str,
    where: str,
    *,
    faults: Counter[str],
    cure: str,
    what: str = "GNSS fixes",
    warnings: Iterable[str] = (),
) -> FixesRead:
    """Bring usable fixes in order of time, and tell what was left out.

    Parameters
    ----------
    rows : sequence of Fix
        In the order of the recording.
    antenna, where : str
        Name of the antenna, and of the file for messages.
    faults : Counter
        Reasons of what was left out so far.
    cure : str
        What to do where nothing is usable, one clause.
    what : str
        What `faults` counts.
    warnings : iterable of str

    Raises
    ------
    DriveError
        If there is no usable fix.
    """
    keep = longest_increasing(np.array([row.epoch_ns for row in rows], dtype=np.int64))
    kept = [row for row, good in zip(rows, keep, strict=True) if good]
    held = _held(kept)
    late = Counter({"epoch not after the fix before": int(np.count_nonzero(~keep)), FROZEN: sum(held)})
    skipped = counted(what, where, faults + late)
    kept = [row for row, repeats in zip(kept, held, strict=True) if not repeats]
    if not kept:
        raise DriveError(f"{where} holds no usable GNSS fix ({listed(skipped)}): {cure}.")
    columns = list(zip(*kept, strict=True))
    epoch_ns, host_ns, quality = (np.array(columns[i], dtype=np.int64) for i in (0, 1, 5))
    latitude, longitude, height = (np.array(columns[i], dtype=np.float64) for i in (2, 3, 4))
    optional = (np.array(column, dtype=np.float64) for column in columns[6:])
    fixes = GnssFixes(antenna, epoch_ns, host_ns, latitude, longitude, height, quality, *optional)
    return FixesRead(fixes, skipped, (*_clock_warnings(fixes, where), *warnings, *_stands(fixes, where)))


def _held(rows: Sequence[Fix]) -> list[bool]:
    """Which fixes a receiver repeated while the car drove."""
    epoch_ns = np.array([row.epoch_ns for row in rows], dtype=np.int64)
    position = np.array([row[2:5] for row in rows], dtype=np.float64).reshape(-1, 3)
    held: list[bool] = frozen(epoch_ns, *position.T).tolist()
    return held


def _stands(fixes: GnssFixes, where: str) -> list[str]:
    if not never_moves(fixes.latitude_deg, fixes.longitude_deg, fixes.height_m):
        return []
    warning = (
        f"All {len(fixes.epoch_ns):,} fixes of {where} are the same place to the last digit: the car stood"
        " all the time, or the receiver was frozen; do not use the drive if the car moved."
    )
    return [warning]


def _clock_warnings(fixes: GnssFixes, where: str) -> list[str]:
    """Tell of a host clock that does not run on UTC: the cameras are stamped by the same clock."""
    delay_s = float(np.median(fixes.host_ns - fixes.epoch_ns)) / 1e9
    if abs(delay_s) <= HOST_DELAY_LIMIT_S:
        return []
    warning = (
        f"The host clock of {where} is {delay_s:+.1f} s from the UTC of its fixes (18 s would be GPS"
        " time, whole hours local time): if the same clock stamped the frames, give"
        f" camera_offset_ms = {-1000 * delay_s:.0f} in drive.toml."
    )
    return [warning]


def counted(what: str, where: str, faults: Counter[str]) -> tuple[Skipped, ...]:
    """Reasons and how often each, by reason."""
    return tuple(Skipped(what, where, n, reason) for reason, n in sorted(faults.items()) if n)


def listed(skipped: Sequence[Skipped]) -> str:
    """The same as one clause."""
    return "; ".join(f"{s.count} × {s.reason}" for s in skipped) or "there is none in it"


def check_position(latitude_deg: float, longitude_deg: float, height_m: float) -> None:
    """Refuse a position that is none.

    Raises
    ------
    LeftOutError
    """
    if not all(math.isfinite(value) for value in (latitude_deg, longitude_deg, height_m)):
        raise LeftOutError("position not finite")
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        raise LeftOutError("position outside the globe")
    if latitude_deg == 0 and longitude_deg == 0:
        raise LeftOutError("position 0° N 0° E (null island)")
    if abs(height_m) > HIGHEST_M:
        raise LeftOutError("height absurd")


def check_epoch(epoch_ns: int) -> None:
    """Refuse a stamp that no recording of a car has.

    Raises
    ------
    LeftOutError
    """
    if not credible(epoch_ns):
        raise LeftOutError("stamp outside the years 2000–2099")


def epoch_of(text: str) -> int:
    """Nanoseconds UTC of an instant in ISO 8601, to the microsecond.

    Raises
    ------
    LeftOutError
        If it is none, or without a zone.
    """
    if not text:
        raise LeftOutError("no time")
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise LeftOutError("time unreadable") from None
    if moment.tzinfo is None:
        raise LeftOutError("time without a zone (Z for UTC)")
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def sigma_or_nan(value_m: float) -> float:
    """A sigma as stated, at most `LARGEST_SIGMA_M`; NaN for what is none."""
    return min(value_m, LARGEST_SIGMA_M) if math.isfinite(value_m) and value_m > 0 else math.nan


def headings_and_velocities(fixes: GnssFixes) -> list[str]:
    """How many fixes have a heading and a velocity that will be used: nothing of what none has."""
    headings = int(np.isfinite(fixes.heading_deg).sum())
    velocities = int(np.isfinite(fixes.velocity_mps[:, 0]).sum())
    return [f"{n:,} {what}" for n, what in ((headings, "headings"), (velocities, "velocities")) if n]


def fix_rate_hz(fixes: GnssFixes) -> float:
    """Rate of the fixes, from the median of their intervals; NaN for fewer than two."""
    if len(fixes.epoch_ns) < 2:
        return math.nan
    return float(1e9 / np.median(np.diff(fixes.epoch_ns)))


FROZEN = "position repeated while the car drove (frozen fix)"
"""Why such fixes are left out."""


LEAST_FIXES = 5
"""Fewer may be those of a logger that asks its receiver too often."""


_LEAST_NS = 2_000_000_000


_LONGEST_STEP_S = 2.0


_HARDEST_MPS2 = 10.0
"""No car brakes or starts harder than that: a repeat that begins or ends with more is the receiver's."""


_NOISE_MPS = 1.0


def frozen(
    epoch_ns: NDArray[np.int64],
    latitude_deg: NDArray[np.float64],
    longitude_deg: NDArray[np.float64],
    height_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Mask the positions that repeat the one before to the last digit although the car drove.

    A car that stands repeats its position too, where the receiver holds it; but it stops and starts no harder
    than a car can. At least `LEAST_FIXES` in a row over 2 s count.

    Parameters
    ----------
    epoch_ns : int64 (n,)
        Rising.
    latitude_deg, longitude_deg, height_m : float64 (n,)

    Returns
    -------
    bool (n,)
        False for the first of each row of repeats, which was measured.
    """
    mask = np.zeros(epoch_ns.size, dtype=np.bool_)
    east, north = metres_per_degree(latitude_deg)
    step_m = np.hypot(np.diff(longitude_deg) * east[1:], np.diff(latitude_deg) * north[1:])
    step_s = np.diff(epoch_ns) / 1e9
    repeats = (step_m == 0) & (np.diff(height_m) == 0)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], repeats, [False])).astype(np.int8)))
    # No step longer than a car can stop or start in tells anything.
    beyond = (step_m > (_HARDEST_MPS2 * step_s + _NOISE_MPS) * step_s) & (step_s <= _LONGEST_STEP_S)
    for first, last in edges.reshape(-1, 2).tolist():
        long = last - first + 1 >= LEAST_FIXES and epoch_ns[last] - epoch_ns[first] >= _LEAST_NS
        if long and (beyond[max(first - 1, 0)] or beyond[min(last, beyond.size - 1)]):
            mask[first + 1 : last + 1] = True
    return mask


def never_moves(
    latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64], height_m: NDArray[np.float64]
) -> bool:
    """Whether there are `LEAST_FIXES` or more, all of them the same to the last digit."""
    if latitude_deg.size < LEAST_FIXES:
        return False
    return not any(np.ptp(values) for values in (latitude_deg, longitude_deg, height_m))


SIGMAS = ("sigma_horizontal_m", "sigma_vertical_m", "sigma_roll_pitch_deg", "sigma_heading_deg")
"""What poses may state, one sigma each; NaN where they do not (`geoloc.trajectory.pose_noise`)."""
