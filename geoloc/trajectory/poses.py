"""What goes into a trajectory and what comes out: fixes, recorded poses, poses at asked epochs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray

_OPTIONAL: Mapping[str, tuple[int, ...]] = {
    "sigma_horizontal_m": (),
    "sigma_vertical_m": (),
    "heading_deg": (),
    "heading_sigma_deg": (),
    "velocity_mps": (3,),
    "velocity_sigma_mps": (2,),
}
"""Columns that `GnssFixes` may lack, and the shape of a row."""


@dataclass(frozen=True, slots=True)
class GnssFixes:
    """Fixes of one antenna, in time order, only usable ones (quality > 0, finite).

    Attributes
    ----------
    antenna : str
        Name of the sensor in the rig file, e.g. ``gnss50:vehicle``.
    epoch_ns : int64 (n,)
        UTC of the *measurement*, from the sentence, nanoseconds since 1970.
    host_ns : int64 (n,)
        When the host received the sentence (late by the link delay). Equal to `epoch_ns` where unknown.
    latitude_deg, longitude_deg : float64 (n,)
        EUREF89 (or the datum that the drive declares).
    height_m : float64 (n,)
        Ellipsoidal: GGA altitude plus geoid separation.
    quality : int64 (n,)
        GGA fix quality: 4 RTK fixed, 5 float, 2 DGNSS, 1 single, 6 dead reckoning.
    sigma_horizontal_m, sigma_vertical_m : float64 (n,)
        One sigma a horizontal axis and of the height, as the receiver states it; NaN where it does not.
    heading_deg, heading_sigma_deg : float64 (n,)
        Of the car, as the receiver has it from antennas of its own: clockwise from true north. The sigma is
        that of the receiver (NaN for `fix_checks.HEADING_SIGMA_DEG`); how its antennas are mounted is another
        matter (`smoother.receiver_motion`). NaN for no heading.
    velocity_mps : float64 (n, 3)
        Of the antenna, east, north and up, as the receiver has it from Doppler shifts; NaN for none.
    velocity_sigma_mps : float64 (n, 2)
        One sigma of a horizontal axis, and of the vertical one; NaN for `fix_checks.VELOCITY_SIGMA_MPS`.

    Columns from the first sigma on may be left out: all NaN then.
    """

    antenna: str
    epoch_ns: IntArray
    host_ns: IntArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    quality: IntArray
    sigma_horizontal_m: FloatArray = field(default_factory=lambda: np.empty(0))
    sigma_vertical_m: FloatArray = field(default_factory=lambda: np.empty(0))
    heading_deg: FloatArray = field(default_factory=lambda: np.empty(0))
    heading_sigma_deg: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_mps: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_sigma_mps: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        n = self.epoch_ns.size
        for name, shape in _OPTIONAL.items():
            if getattr(self, name).size == 0:
                object.__setattr__(self, name, np.full((n, *shape), np.nan))


def without_headings(fixes: GnssFixes) -> GnssFixes:
    """Return the fixes without the headings of their receiver."""
    none = np.full(fixes.epoch_ns.shape, np.nan)
    return replace(fixes, heading_deg=none, heading_sigma_deg=none)


@dataclass(frozen=True, slots=True)
class PoseTrack:
    """Full poses of the rig from an INS or SLAM, in time order.

    Position is that of the rig's origin: on the ground below the middle of the rear axle. Attitude is ISO
    8855: heading clockwise from true north, positive pitch nose *down*, positive roll right side down.

    Attributes
    ----------
    epoch_ns : int64 (n,)
    latitude_deg, longitude_deg, height_m : float64 (n,)
        `height_m` is ellipsoidal.
    roll_deg, pitch_deg, heading_deg : float64 (n,)
    sigma_horizontal_m, sigma_vertical_m, sigma_roll_pitch_deg, sigma_heading_deg : float64 (n,)
        One sigma; NaN where the file states none.
    """

    epoch_ns: IntArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    heading_deg: FloatArray
    sigma_horizontal_m: FloatArray
    sigma_vertical_m: FloatArray
    sigma_roll_pitch_deg: FloatArray
    sigma_heading_deg: FloatArray


@dataclass(frozen=True, slots=True)
class Poses:
    """Poses of the rig's origin at asked epochs: what a trajectory answers.

    Same frames and signs as `PoseTrack`. Rows with ``valid`` false are NaN, and `reason` says why.

    Attributes
    ----------
    epoch_ns : int64 (n,)
    latitude_deg, longitude_deg, height_m : float64 (n,)
        The rig's origin on the ground; `height_m` ellipsoidal.
    roll_deg, pitch_deg, heading_deg : float64 (n,)
    speed_mps : float64 (n,)
    sigma_horizontal_m, sigma_vertical_m, sigma_roll_deg, sigma_pitch_deg, sigma_heading_deg : float64 (n,)
        One sigma.
    valid : bool (n,)
    reason : str (n,)
        A `geoloc.reasons.Reason`; "" where valid.
    """

    epoch_ns: IntArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    roll_deg: FloatArray
    pitch_deg: FloatArray
    heading_deg: FloatArray
    speed_mps: FloatArray
    sigma_horizontal_m: FloatArray
    sigma_vertical_m: FloatArray
    sigma_roll_deg: FloatArray
    sigma_pitch_deg: FloatArray
    sigma_heading_deg: FloatArray
    valid: BoolArray
    reason: TextArray


class LastingRoll(NamedTuple):
    """That part of a trajectory's roll which is the same for the whole drive: one sigma of its error, and it.

    Parts of it are the same everywhere, and in proportion to the acceleration to the left: antennas that sit
    higher than their lever arms say, the road's mean crossfall, superelevation and the body's lean in bends.
    A trajectory that goes on learns them: what it takes them for by now tells its rolls from those before.
    """

    sigma_deg: float = 0.0
    sigma_deg_per_mps2: float = 0.0
    deg: float = 0.0
    deg_per_mps2: float = 0.0


def part(poses: Poses, rows: slice | IntArray) -> Poses:
    """Give some rows of poses."""
    return Poses(*(getattr(poses, column.name)[rows] for column in fields(Poses)))
