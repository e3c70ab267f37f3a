"""A drive round a circle, whose truth is a formula, and what antennas on the car would say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig
from geoloc.trajectory.trajectory import GnssFixes, Trajectory

LAT0, LON0, HEIGHT = 63.4149, 10.3991, 65.7
EPOCH0 = 1_781_078_400_000_000_000
LEFT, RIGHT = np.array([0.9, 0.55, 1.6]), np.array([0.9, -0.55, 1.6])
PAIR = {"left": LEFT, "right": RIGHT}


@dataclass(frozen=True)
class Circle:
    """A drive round a circle: the rig's origin runs exactly along it, heading along the tangent."""

    radius_m: float = 60.0
    speed_mps: float = 12.0
    start_deg: float = 20.0
    climb: float = 0.0

    def heading_deg(self, t_s: ArrayLike) -> FloatArray:
        """Clockwise from north."""
        turned_deg = np.degrees(self.speed_mps / self.radius_m) * np.asarray(t_s, dtype=np.float64)
        return np.asarray((self.start_deg - turned_deg) % 360.0)

    def enu(self, t_s: FloatArray) -> FloatArray:
        """Metres from where it starts."""
        psi, psi0 = np.radians(90.0 - self.heading_deg(t_s)), np.radians(90.0 - self.start_deg)
        return np.stack(
            [
                self.radius_m * (np.sin(psi) - np.sin(psi0)),
                -self.radius_m * (np.cos(psi) - np.cos(psi0)),
                self.climb * self.speed_mps * t_s,
            ],
            axis=1,
        )


def epochs(t_s: ArrayLike) -> NDArray[np.int64]:
    """UTC nanoseconds of seconds into the drive."""
    return EPOCH0 + np.round(np.asarray(t_s) * 1e9).astype(np.int64)


EXPECTED_ROLL_DEG = float(np.degrees(np.arctan(0.02)))
"""The fall to the right that a trajectory expects: with it, nothing is left to be found out."""


def record(
    drive: Circle,
    lever: FloatArray,
    name: str = "left",
    *,
    rate_hz: float = 10.0,
    length_s: float = 30.0,
    noise_m: float = 0.0,
    delay_ms: float = 0.0,
    roll_deg: float = EXPECTED_ROLL_DEG,
    seed: int = 1,
) -> GnssFixes:
    """What an antenna on the car of this drive would say."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, length_s, 1.0 / rate_hz)
    pitch = np.full_like(t, -np.degrees(np.arctan(drive.climb)))
    enu_R_rig = rotation_enu_from_rig(drive.heading_deg(t), pitch, np.full_like(t, roll_deg))
    at = drive.enu(t) + enu_R_rig @ lever + rng.normal(0.0, 1.0, (t.size, 3)) * noise_m
    lat, lon = geographic_from_enu(LAT0, LON0, at[:, 0], at[:, 1])
    stamp = epochs(t)
    return GnssFixes(
        name, stamp, stamp + int(delay_ms * 1e6), lat, lon, HEIGHT + at[:, 2], np.full(t.size, 4)
    )


def horizontal_errors(trajectory: Trajectory, drive: Circle, t_s: FloatArray) -> FloatArray:
    """Distance of the trajectory from the drive."""
    poses = trajectory.poses_at(epochs(t_s))
    assert poses.valid.all()
    east, north = enu_offset(LAT0, LON0, poses.latitude_deg, poses.longitude_deg)
    truth = drive.enu(t_s)
    return np.hypot(east - truth[:, 0], north - truth[:, 1])


def turned(a_deg: FloatArray, b_deg: ArrayLike) -> FloatArray:
    """Angle between two headings."""
    return np.asarray(np.abs((a_deg - np.asarray(b_deg) + 180.0) % 360.0 - 180.0))


def still(lever: FloatArray, name: str, heading_deg: float, n: int = 60, noise_m: float = 0.0) -> GnssFixes:
    """A car that stands."""
    rng = np.random.default_rng(7)
    offset = (
        rotation_enu_from_rig(heading_deg, 0.0, EXPECTED_ROLL_DEG) @ lever
        + rng.normal(0.0, 1.0, (n, 3)) * noise_m
    )
    lat, lon = geographic_from_enu(LAT0, LON0, offset[:, 0], offset[:, 1])
    stamp = epochs(np.arange(n) * 0.2)
    return GnssFixes(name, stamp, stamp, lat, lon, HEIGHT + offset[:, 2], np.full(n, 4))


FRAMES_S = np.arange(1.0, 28.0, 1.0 / 30.0)
