"""Attitudes of an INS beside positions → full poses of the rig."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_enu, rotation_enu_from_rig
from geoloc.trajectory.fix_checks import VERTICAL_FACTOR, sigma_of_fixes
from geoloc.trajectory.trajectory import PoseTrack
from twin.drives.epochs import longest_increasing
from twin.drives.track.fixes import FixesRead, LeftOutError, PosesRead, counted, listed
from twin.errors import DriveError

MAX_APART_NS = 250_000_000
"""A position further than this from the attitude before or after it gets none: a car turns in less."""


@dataclass(frozen=True, slots=True)
class Attitudes:
    """Attitudes in order of time, ISO 8855: heading clockwise from true north, pitch nose *down*.

    Attributes
    ----------
    epoch_ns : int64 (n,)
    roll_deg, pitch_deg, heading_deg : float64 (n,)
    sigma_roll_pitch_deg, sigma_heading_deg : float64 (n,)
    """

    epoch_ns: IntArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    heading_deg: FloatArray
    sigma_roll_pitch_deg: FloatArray
    sigma_heading_deg: FloatArray


def rpy_deg_from_quaternion(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Angles of ``R = Rz(yaw) Ry(pitch) Rx(roll)``, degrees, in the axes of the quaternion.

    Raises
    ------
    LeftOutError
        If its length is far from 1.
    """
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.5 < length < 2.0:
        raise LeftOutError("quaternion that is none")
    w, x, y, z = w / length, x / length, y / length, z / length
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return math.degrees(roll), math.degrees(pitch), math.degrees(yaw)


def attitudes_from_rows(
    rows: Sequence[tuple[int, tuple[float, ...]]], where: str, faults: Counter[str], *, cure: str
) -> Attitudes:
    """Bring attitudes in order of time.

    Parameters
    ----------
    rows : sequence of (epoch_ns, (roll, pitch, heading, sigma of roll and pitch, sigma of heading))
        Degrees; a sigma that is not positive and finite becomes NaN.
    where, faults, cure
        For messages: the file, what was left out so far (added to), and what to do where there is none.

    Raises
    ------
    DriveError
        If there is none.
    """
    epoch_ns = np.array([row[0] for row in rows], dtype=np.int64)
    values = np.array([row[1] for row in rows], dtype=np.float64).reshape(-1, 5)
    finite = np.isfinite(values[:, :3]).all(axis=1)
    faults["attitude not finite"] += int(np.count_nonzero(~finite))
    epoch_ns, values = epoch_ns[finite], values[finite]
    keep = longest_increasing(epoch_ns)
    faults["attitude not after the one before"] += int(np.count_nonzero(~keep))
    if not keep.any():
        reasons = listed(counted("attitudes", where, faults))
        raise DriveError(f"{where} holds no usable attitude ({reasons}): {cure}.")
    roll, pitch, heading, tilt_sigma, heading_sigma = values[keep].T
    return Attitudes(
        epoch_ns[keep],
        roll,
        pitch,
        heading,
        _or_nan(tilt_sigma),
        _or_nan(heading_sigma),
    )


def poses_of_fixes(read: FixesRead, attitudes: Attitudes, where: str, faults: Counter[str]) -> PosesRead:
    """Give each position the attitude of its epoch, on a straight line between the two around it.

    Parameters
    ----------
    read : FixesRead
    attitudes : Attitudes
    where : str
    faults : Counter
        What was left out of the attitudes.

    Raises
    ------
    DriveError
        If no position has an attitude near.
    """
    fixes = read.fixes
    after = np.searchsorted(attitudes.epoch_ns, fixes.epoch_ns).clip(0, attitudes.epoch_ns.size - 1)
    before = np.where(attitudes.epoch_ns[after] > fixes.epoch_ns, after - 1, after).clip(0)
    apart = np.maximum(
        np.abs(attitudes.epoch_ns[after] - fixes.epoch_ns),
        np.abs(attitudes.epoch_ns[before] - fixes.epoch_ns),
    )
    outside = (fixes.epoch_ns < attitudes.epoch_ns[0]) | (fixes.epoch_ns > attitudes.epoch_ns[-1])
    keep = ~outside & (apart <= MAX_APART_NS)
    lonely = Counter({f"position without an attitude within {MAX_APART_NS / 1e9} s": int((~keep).sum())})
    skipped = (*read.skipped, *counted("poses", where, faults + lonely))
    if not keep.any():
        raise DriveError(
            f"{where} holds no usable pose ({listed(skipped)}): positions and attitudes must be of one clock."
        )
    asked = fixes.epoch_ns[keep]
    track = PoseTrack(
        epoch_ns=asked,
        latitude_deg=fixes.latitude_deg[keep],
        longitude_deg=fixes.longitude_deg[keep],
        height_m=fixes.height_m[keep],
        roll_deg=_angle_at(attitudes.roll_deg, attitudes.epoch_ns, asked),
        pitch_deg=_angle_at(attitudes.pitch_deg, attitudes.epoch_ns, asked),
        heading_deg=_angle_at(attitudes.heading_deg, attitudes.epoch_ns, asked) % 360.0,
        **_position_sigmas(read, keep),
        sigma_roll_pitch_deg=attitudes.sigma_roll_pitch_deg[after[keep]],
        sigma_heading_deg=attitudes.sigma_heading_deg[after[keep]],
    )
    return PosesRead(track, skipped, read.warnings)


def moved_to_rig_origin(track: PoseTrack, lever_arm_m: Sequence[float]) -> PoseTrack:
    """Move poses of another point of the car to the rig's origin.

    Parameters
    ----------
    track : PoseTrack
        Positions of that point, attitudes of the rig.
    lever_arm_m : (x, y, z)
        Where the point sits in the rig frame (FLU).
    """
    turn = rotation_enu_from_rig(track.heading_deg, track.pitch_deg, track.roll_deg)
    east, north, up = (turn @ np.asarray(lever_arm_m, dtype=np.float64)).T
    latitude, longitude = geographic_from_enu(track.latitude_deg, track.longitude_deg, -east, -north)
    return replace(track, latitude_deg=latitude, longitude_deg=longitude, height_m=track.height_m - up)


def _position_sigmas(read: FixesRead, keep: NDArray[np.bool_]) -> dict[str, FloatArray]:
    fixes = read.fixes
    horizontal = sigma_of_fixes(fixes.quality, fixes.sigma_horizontal_m)
    stated = np.isfinite(fixes.sigma_vertical_m)
    vertical = np.where(stated, fixes.sigma_vertical_m, VERTICAL_FACTOR * horizontal)
    return {"sigma_horizontal_m": horizontal[keep], "sigma_vertical_m": vertical[keep]}


def _angle_at(angle_deg: FloatArray, epoch_ns: IntArray, asked_ns: IntArray) -> FloatArray:
    """An angle at other epochs, turned the shorter way."""
    first = epoch_ns[0]
    turned = np.unwrap(angle_deg, period=360.0)
    return np.asarray(np.interp((asked_ns - first) / 1e9, (epoch_ns - first) / 1e9, turned))


def _or_nan(sigma_deg: FloatArray) -> FloatArray:
    return np.where(np.isfinite(sigma_deg) & (sigma_deg > 0), sigma_deg, np.nan)
