"""The smoothed trajectory on real drives' speeds, headings and heights: errors, and what was stated of them.

Usage: python benchmarks/real_profiles.py [--antennas 1 2] [--cars 3]

People do not steer as simulated drivers do, and real roads do not climb as simulated ones. So speed, heading
and height of recorded drives (``../shared/real``: five KITTI sequences, the two long ones in four parts, an
Argoverse 2 log and a Cosmos clip) are smoothed and taken for the truth: of a car whose rear axle rolls along
that heading, whose body points further into bends by its slip, and which sways on its springs. What an
antenna on its roof would have recorded is made of that. Cars differ in their slip: 0.25 ± 0.15° per m/s².

NEES is the squared error over its variance: 1 is honest. Bar: 0.7 to 2.0 for the heading of each drive, and
the slip within three sigmas. Errors do not depend on the machine; nothing here is a timing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from real_drives import REAL, TRONDHEIM
from real_kitti import SEQUENCES, START_NS, camera_poses, rig_in_enu

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_enu, rotation_enu_from_rig, wrap_deg
from geoloc.simulation.car import ANTENNAS
from geoloc.simulation.motion import REFERENCE_SPEED_MPS, WHEELBASE_M
from geoloc.simulation.noise import NoiseSpec, damped_oscillation, gauss_markov, stream
from geoloc.trajectory.poses import GnssFixes
from geoloc.trajectory.rig_poses import fitted
from twin.cli.output import print_table

PARTS = {"00": 4, "02": 4}
"""Sequences of eight minutes, cut into as many drives."""
STEP_S = 0.02
# What smooths the recorded heading, speed and height, one sigma: less than a driver's hands or a road's
# shape, more than the noise of an INS at ten poses a second.
_HEADING_SMOOTHED_S, _SPEED_SMOOTHED_S, _HEIGHT_SMOOTHED_M = 0.15, 0.3, 4.0
_CROSSFALL_DEG = 1.72
SLIP_DEG_PER_MPS2 = (0.25, 0.15)
# Real axles move sideways besides: the Argoverse car against its own heading by 0.1° (rms over 0.3 s).
_SIDEWAYS_DEG, _SIDEWAYS_LASTS_S = 0.1, 0.5
RECEIVERS: dict[str, tuple[float, NoiseSpec]] = {
    "5 Hz, 1.3 cm": (5.0, NoiseSpec()),
    "10 Hz, 1.8 cm": (10.0, replace(NoiseSpec(), gnss_white_horizontal_m=0.010, gnss_multipath_m=0.010)),
}
"""Rate, and noise of fixed solutions: what is new at every fix, lasts for 8 s, and lasts for 100 s."""


@dataclass(frozen=True, slots=True)
class Profile:
    """A recorded drive: speed ``(n,)``, yaw (counter-clockwise from east) and height, `step_s` apart."""

    name: str
    step_s: float
    speed_mps: FloatArray
    yaw_rad: FloatArray
    height_m: FloatArray


@dataclass(frozen=True, slots=True)
class Truth:
    """What the car truly did, every `STEP_S`: rear axle on the ground ``(n, 3)``, attitude in degrees."""

    time_s: FloatArray
    position_m: FloatArray
    heading_deg: FloatArray
    pitch_deg: FloatArray
    roll_deg: FloatArray


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors and stated sigmas ``(knots, 3)`` of heading, pitch (degrees) and height, and of the slip."""

    error: FloatArray
    sigma: FloatArray
    slip_sigmas: float

    def nees(self) -> FloatArray:
        """Mean of each squared error over its variance ``(3,)``."""
        return np.asarray(np.mean((self.error / self.sigma) ** 2, axis=0))


def profiles(source: Path = REAL) -> list[Profile]:
    """All recorded drives."""
    found = []
    for sequence in SEQUENCES:
        place, axes = rig_in_enu(camera_poses(sequence, source / "kitti_signs"))
        parts = np.array_split(np.arange(len(place)), PARTS.get(sequence, 1))
        for number, rows in enumerate(parts, start=1):
            name = f"KITTI {sequence}" + (f", part {number}" if len(parts) > 1 else "")
            found.append(_profile(name, 0.1, place[rows], axes[rows, :, 0]))
    return [*found, _argoverse(source / "av2"), _cosmos(source / "cosmos_ftheta")]


def _argoverse(source: Path) -> Profile:
    import pandas as pd
    from scipy.spatial.transform import Rotation

    poses = pd.read_feather(source / "city_SE3_egovehicle.feather").drop_duplicates("timestamp_ns")
    time_s = (poses.timestamp_ns - poses.timestamp_ns.iloc[0]).to_numpy() / 1e9
    ahead = Rotation.from_quat(poses[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()[:, :, 0]
    even_s = np.arange(0.0, time_s[-1], 0.1)
    columns = np.column_stack([poses[["tx_m", "ty_m", "tz_m"]].to_numpy(), ahead])
    even = np.stack([np.interp(even_s, time_s, column) for column in columns.T], axis=1)
    return _profile("Argoverse 7fab2350", 0.1, even[:, :3], even[:, 3:])


def _cosmos(source: Path) -> Profile:
    poses = np.load(source / "vehicle_poses.npy")
    return _profile("Cosmos", 1.0 / 30.0, poses[:, :3, 3], poses[:, :3, 0])


def _profile(name: str, step_s: float, place_m: FloatArray, ahead: FloatArray) -> Profile:
    level = ahead[:, :2] / np.linalg.norm(ahead[:, :2], axis=1, keepdims=True)
    speed = np.einsum("nk,nk->n", np.gradient(place_m[:, :2], step_s, axis=0), level)
    yaw = np.unwrap(np.arctan2(level[:, 1], level[:, 0]))
    return Profile(name, step_s, speed, yaw, place_m[:, 2])


def truth_of(profile: Profile, slip_deg_per_mps2: float, seed: int) -> Truth:
    """Drive a profile by a car with this slip."""
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import gaussian_filter1d

    step, noise = profile.step_s, NoiseSpec()
    recorded_s = step * np.arange(profile.yaw_rad.size)
    time_s = np.arange(0.0, recorded_s[-1], STEP_S)
    speed = CubicSpline(recorded_s, gaussian_filter1d(profile.speed_mps, _SPEED_SMOOTHED_S / step))(time_s)
    curve = CubicSpline(recorded_s, gaussian_filter1d(profile.yaw_rad, _HEADING_SMOOTHED_S / step))
    course, sideways = curve(time_s), speed * curve(time_s, 1)
    middle = 0.5 * (course[1:] + course[:-1])
    way = 0.5 * STEP_S * (speed[1:] + speed[:-1])
    plan = np.cumsum(way[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)
    along_m = np.concatenate([[0.0], np.cumsum(np.abs(way))])
    every_m = np.arange(0.0, along_m[-1], 1.0)
    height = np.interp(every_m, np.interp(recorded_s, time_s, along_m), profile.height_m)
    road = CubicSpline(every_m, gaussian_filter1d(height, _HEIGHT_SMOOTHED_M))
    between_axles = np.minimum(along_m + 0.5 * WHEELBASE_M, every_m[-1])
    sway = np.sqrt(np.abs(speed) / REFERENCE_SPEED_MPS) * np.stack(
        [
            damped_oscillation(
                stream(seed, name), time_s.size, STEP_S, noise.body_frequency_hz, noise.body_damping
            )
            for name in ("pitch", "roll")
        ]
    )
    beside = gauss_markov(stream(seed, "sideways"), time_s, _SIDEWAYS_DEG, _SIDEWAYS_LASTS_S)
    return Truth(
        time_s,
        np.column_stack([np.vstack([np.zeros(2), plan]), road(along_m)]),
        90.0 - np.degrees(course) - slip_deg_per_mps2 * sideways - beside,
        -np.degrees(np.arctan(road(between_axles, 1))) + noise.pitch_jitter_deg * sway[0],
        _CROSSFALL_DEG + noise.roll_deg_per_mps2 * sideways + noise.roll_jitter_deg * sway[1],
    )


def fixes_of(truth: Truth, antenna: str, seed: int, rate_hz: float, noise: NoiseSpec) -> GnssFixes:
    """Fixed solutions of an antenna of the simulated car."""
    rows = np.arange(0, truth.time_s.size, round(1.0 / rate_hz / STEP_S))
    time_s = truth.time_s[rows]
    turn = rotation_enu_from_rig(truth.heading_deg[rows], truth.pitch_deg[rows], truth.roll_deg[rows])
    place = truth.position_m[rows] + turn @ np.array(ANTENNAS[antenna][0])
    for axis, (white, slow, multipath) in enumerate(
        [(noise.gnss_white_horizontal_m, noise.gnss_slow_horizontal_m, noise.gnss_multipath_m)] * 2
        + [(noise.gnss_white_vertical_m, noise.gnss_slow_vertical_m, 1.7 * noise.gnss_multipath_m)]
    ):
        own = stream(seed, f"{antenna} {axis}")
        place[:, axis] += gauss_markov(
            stream(seed, f"atmosphere {axis}"), time_s, slow, noise.gnss_slow_tau_s
        )
        place[:, axis] += gauss_markov(own, time_s, multipath, noise.gnss_multipath_tau_s)
        place[:, axis] += own.normal(0.0, white, time_s.size)
    epoch_ns = START_NS + np.round(time_s * 1e9).astype(np.int64)
    latitude, longitude = geographic_from_enu(*TRONDHEIM, place[:, 0], place[:, 1])
    fixed = np.full(time_s.size, 4)
    return GnssFixes(antenna, epoch_ns, epoch_ns, latitude, longitude, place[:, 2], fixed)


def errors_of(
    profile: Profile, slip_deg_per_mps2: float, antennas: int, rate_hz: float, noise: NoiseSpec, seed: int
) -> Errors:
    """Drive once, smooth, and hold the poses against the truth."""
    from geoloc.trajectory.trajectory import trajectory_from_gnss

    truth = truth_of(profile, slip_deg_per_mps2, seed)
    arms = {name: np.array(arm_m) for name, (arm_m, _) in list(ANTENNAS.items())[:antennas]}
    fixes = [fixes_of(truth, name, seed, rate_hz, noise) for name in arms]
    found = trajectory_from_gnss(fixes, arms).knots
    rows = np.round((found.epoch_ns - START_NS) / 1e9 / STEP_S).astype(int)
    error = (
        wrap_deg(found.heading_deg - truth.heading_deg[rows]),
        found.pitch_deg - truth.pitch_deg[rows],
        found.height_m - truth.position_m[rows, 2],
    )
    sigma = (found.sigma_heading_deg, found.sigma_pitch_deg, found.sigma_vertical_m)
    track = fitted(fixes, list(arms.values()), found.epoch_ns, 1.0).track
    slip, slip_sigma = np.degrees(track.slip_rad_per_mps2)
    known = found.valid
    return Errors(
        np.stack(error, axis=1)[known],
        np.stack(sigma, axis=1)[known],
        float(slip - slip_deg_per_mps2) / float(slip_sigma),
    )


def slips(cars: int) -> FloatArray:
    """Slips ``(cars,)`` of cars, evenly about the mean, as far apart as cars differ."""
    off = np.arange(cars) - 0.5 * (cars - 1)
    return np.asarray(SLIP_DEG_PER_MPS2[0] + SLIP_DEG_PER_MPS2[1] * off / max(float(np.std(off)), 1e-9))


def cells(found: Iterable[Errors]) -> tuple[object, ...]:
    """What is printed of the drives of a profile."""
    drives = list(found)
    error = np.concatenate([one.error for one in drives])
    rms = np.sqrt(np.mean(error**2, axis=0))
    nees = np.mean([one.nees() for one in drives], axis=0)
    slip = max(abs(one.slip_sigmas) for one in drives)
    return *(f"{r:.2f} / {n:.2f}" for r, n in zip(rms, nees, strict=True)), f"{slip:.1f}"


def main() -> None:
    """Print one table for each receiver and number of antennas."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--antennas", type=int, choices=(1, 2), nargs="+", default=[1, 2])
    parser.add_argument("--cars", type=int, default=3, help="cars of different slip (default 3)")
    options = parser.parse_args()
    if not REAL.exists():
        sys.exit(f"The real recordings are not in {REAL}: put them there, their licences forbid a copy here.")
    drives = profiles()
    for antennas in options.antennas:
        for receiver, (rate_hz, noise) in RECEIVERS.items():
            table = [
                (
                    one.name,
                    f"{one.yaw_rad.size * one.step_s:.0f}",
                    *cells(
                        errors_of(one, slip, antennas, rate_hz, noise, 100 * number + car)
                        for car, slip in enumerate(slips(options.cars).tolist())
                    ),
                )
                for number, one in enumerate(drives)
            ]
            print_table(
                f"{antennas} antenna{'s' * (antennas > 1)}, {receiver}: rms error / NEES",
                ["drive", "s", "heading [°]", "pitch [°]", "height [m]", "slip off by [sigma]"],
                table,
            )


if __name__ == "__main__":
    main()
