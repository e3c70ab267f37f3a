"""One pass of the smoother: the track in the plane with lever arms that lean, then heights and tilt along it.

A recorded drive takes a few passes over all of it; a drive that is followed takes one over its last seconds,
from where it stood (`geoloc.live`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import rotation_enu_from_rig
from geoloc.trajectory.motion_readings import MotionReadings
from geoloc.trajectory.smoother.chain import Window
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.odometry import MotionOnRoad
from geoloc.trajectory.smoother.plane import AXLE_KNOWN_M, smoothed_plane
from geoloc.trajectory.smoother.plane_track import PlaneTrack
from geoloc.trajectory.smoother.tilt import TiltTrack, smoothed_tilt

LEVER_SIGMA_M = 0.02
"""A tape measure on a car body: an antenna against the others, an axis."""
# Speeds of wheels say that a velocity is no noise.
_WHEEL_SIGMA_MPS = 0.05
# A lean in bends does not tremble as accelerations do.
_SMOOTHED_S = 2.0


class CarOfDrive(NamedTuple):
    """What holds for a car all through a drive.

    Attributes
    ----------
    arms_m : float64 (m, 3)
        Lever arms of the antennas.
    arm_sigma_m : float
        One sigma of an antenna's place against the others, an axis.
    axle_m : (float, float)
        How far ahead of the rear axle the origin is, and one sigma of that.
    readings : MotionReadings or None
        What the car measured of its own motion.
    """

    arms_m: FloatArray
    arm_sigma_m: float = LEVER_SIGMA_M
    axle_m: tuple[float, float] = AXLE_KNOWN_M
    readings: MotionReadings | None = None

    def drift_mps(self, knots: KnotFixes, alone: Sequence[PlaneTrack]) -> FloatArray:
        """One sigma (n,) of a velocity that antennas by themselves (`of_one_antenna`), or wheels, show."""
        drift = np.min([one.velocity_sigma_mps for one in alone], axis=0)
        speed = None if self.readings is None else self.readings.speed
        if speed is not None:
            t_s = knots.t_s + speed.lag_s
            drift = np.where(speed.covers(t_s, t_s), np.minimum(drift, _WHEEL_SIGMA_MPS), drift)
        return np.asarray(drift)


class Windows(NamedTuple):
    """Where a drive is followed: the windows of its track and of its tilt."""

    track: Window
    tilt: Window


def of_one_antenna(knots: KnotFixes, antenna: int, iterations: int = 6) -> PlaneTrack:
    """Smooth one antenna as a point that has no heading."""
    own = knots.only(antenna)
    state = np.zeros((knots.t_s.size, 6))
    state[:, :2] = knots.path_m
    begin = PlaneTrack(state, np.zeros(0), np.zeros(0), np.zeros(0), own.seen.astype(np.float64))
    return smoothed_plane(own, np.zeros((knots.t_s.size, 1, 2)), 0.0, begin, iterations=iterations)


def track_and_tilt(
    knots: KnotFixes,
    car: CarOfDrive,
    drift_mps: FloatArray,
    track: PlaneTrack,
    tilt: TiltTrack,
    iterations: int,
    windows: Windows | None = None,
) -> tuple[PlaneTrack, TiltTrack]:
    """Fit the track from where it stands, with so many iterations, then the tilt.

    Parameters
    ----------
    knots : KnotFixes
    car : CarOfDrive
    drift_mps : float64 (n,)
        From `CarOfDrive.drift_mps`.
    track, tilt
        To start from.
    iterations : int
    windows : Windows, optional
        The knots are part of a drive that is followed.
    """
    tilted = rotation_enu_from_rig(90.0, tilt.pitch_deg, tilt.roll_deg) @ car.arms_m.T
    aside = knots.running_mean(track.lateral_mps2, _SMOOTHED_S)
    track = smoothed_plane(
        knots,
        tilted[:, :2].swapaxes(1, 2),
        car.arm_sigma_m,
        track,
        drift_mps=drift_mps,
        axle_m=car.axle_m,
        motion=_on_road(car.readings, tilt, aside, car.arms_m[:, 2]),
        iterations=iterations,
        window=None if windows is None else windows.track,
    )
    window = None if windows is None else windows.tilt
    forward, lateral = track.forward_mps, track.lateral_mps2
    return track, smoothed_tilt(knots, car.arms_m, LEVER_SIGMA_M, forward, lateral, window)


def _on_road(
    readings: MotionReadings | None, tilt: TiltTrack, lateral_mps2: FloatArray, above_m: FloatArray
) -> MotionOnRoad | None:
    if readings is None:
        return None
    lasting = tilt.lasting_roll
    by_bends = lasting.sigma_deg_per_mps2 * lateral_mps2
    own = np.sqrt(np.maximum(tilt.roll_sigma_deg**2 - lasting.sigma_deg**2 - by_bends**2, 0.0))
    return MotionOnRoad(
        readings,
        np.radians(tilt.pitch_deg),
        np.radians(tilt.roll_deg),
        np.radians(tilt.pitch_sigma_deg),
        np.radians(own),
        (float(np.radians(lasting.sigma_deg)), float(np.radians(lasting.sigma_deg_per_mps2))),
        lateral_mps2,
        above_m,
    )
