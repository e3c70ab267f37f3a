"""What a receiver has of itself beside positions: a heading from two antennas of its own, and a velocity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import gauss_markov, stream
from geoloc.simulation.road import Road
from geoloc.simulation.scenarios import Scenario
from geoloc.simulation.simulate import SimulatedDrive, simulate_drive
from geoloc.trajectory.trajectory import GnssFixes

# Central difference of positions: shorter than anything a car does.
_HALF_STEP_S = 0.005
ASSUMED_LATE_S = 0.15
"""No receiver is early: the positive half of a normal distribution with this sigma is assumed."""
_OF_CAR = 0.9
"""As much of its variance is taken to be the same in all drives of a car."""


@dataclass(frozen=True, slots=True)
class ReceiverSpec:
    """One-sigma values of what a receiver has of itself; 0 leaves that out."""

    heading_deg: float = 0.5
    """Of each heading: 40 % of it white, 90 % a Gauss–Markov process, as the pair's multipath changes."""
    heading_tau_s: float = 10.0
    mounted_deg: float = 1.5
    """Once: how far the pair is askew. Two antennas a metre apart, each taped to 2 cm along the car."""
    velocity_mps: float = 0.05
    """Each horizontal axis; twice that up. Doppler of a good receiver under an open sky."""
    velocity_tau_s: float = 1.0
    """Correlation time of velocities: the receiver's tracking loops and filter."""
    averaged_s: float = 2.0 * _HALF_STEP_S
    """A velocity is the mean over so long."""


def with_receiver_motion(
    fixes: GnssFixes, world: Scenario, seed: int, arm_m: FloatArray, spec: ReceiverSpec
) -> GnssFixes:
    """Add headings and velocities to the fixes of a simulated drive.

    Parameters
    ----------
    fixes : GnssFixes
        Of ``simulate_drive(world, seed)``.
    world : Scenario
    seed : int
    arm_m : float64 (3,)
        Where the antenna truly sits in the rig frame.
    spec : ReceiverSpec
    """
    motion = TrueMotion(Road(world.road, seed), world.motion, world.noise, seed)
    time_s = (fixes.epoch_ns - world.start_utc_ns) / 1e9
    if spec.heading_deg:
        heading = _true_heading_deg(motion, time_s) + _heading_error_deg(fixes.antenna, time_s, seed, spec)
        fixes = replace(
            fixes, heading_deg=heading % 360.0, heading_sigma_deg=np.full(time_s.size, spec.heading_deg)
        )
    if spec.velocity_mps:
        sigma = spec.velocity_mps * np.array([1.0, 1.0, 2.0])
        noise = [
            gauss_markov(stream(seed, f"velocity {fixes.antenna} {axis}"), time_s, s, spec.velocity_tau_s)
            for axis, s in zip("enu", sigma, strict=True)
        ]
        velocity = _true_velocity_mps(motion, time_s, arm_m, spec.averaged_s) + np.stack(noise, axis=1)
        stated = np.repeat(sigma[None, 1:], time_s.size, axis=0)
        fixes = replace(fixes, velocity_mps=velocity, velocity_sigma_mps=stated)
    return fixes


def _heading_error_deg(antenna: str, time_s: FloatArray, seed: int, spec: ReceiverSpec) -> FloatArray:
    random = stream(seed, f"receiver heading {antenna}")
    mounted = random.normal() * spec.mounted_deg
    white = random.normal(size=time_s.size) * 0.4 * spec.heading_deg
    return np.asarray(
        mounted + white + gauss_markov(random, time_s, 0.9 * spec.heading_deg, spec.heading_tau_s)
    )


def _true_heading_deg(motion: TrueMotion, time_s: FloatArray) -> FloatArray:
    body = motion.at(time_s)
    turn = _local_from_frame(motion, body.position_m)
    ahead = (turn @ body.enu_R_rig)[:, :, 0]
    return np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1]))


def _true_velocity_mps(
    motion: TrueMotion, time_s: FloatArray, arm_m: FloatArray, averaged_s: float
) -> FloatArray:
    before, after = (motion.at(time_s + half) for half in (-0.5 * averaged_s, 0.5 * averaged_s))
    ends = [body.position_m + body.enu_R_rig @ arm_m for body in (before, after)]
    velocity = (ends[1] - ends[0]) / averaged_s
    return np.asarray((_local_from_frame(motion, ends[0]) @ velocity[:, :, None])[:, :, 0])


def _local_from_frame(motion: TrueMotion, position_m: FloatArray) -> FloatArray:
    latitude, longitude, _ = motion.road.frame.geographic_from_enu(position_m)
    return np.asarray(motion.road.frame.rotation_local_from_frame(latitude, longitude))


def metre_fixes(world: Scenario, sigma_m: float) -> Scenario:
    """Return the same world with fixes that are as noisy as that, 40 % of it white and 90 % for 10 s."""
    noise = replace(
        world.noise,
        gnss_white_horizontal_m=0.4 * sigma_m,
        gnss_white_vertical_m=0.4 * 1.7 * sigma_m,
        gnss_multipath_m=0.9 * sigma_m,
        gnss_multipath_tau_s=10.0,
    )
    return replace(world, noise=noise)


def as_single_fixes(fixes: GnssFixes, sigma_m: float) -> GnssFixes:
    """Return fixes of `metre_fixes` as a receiver without corrections states them."""
    n = fixes.epoch_ns.size
    return replace(fixes, quality=np.ones(n, dtype=np.int64), sigma_horizontal_m=np.full(n, sigma_m))


@dataclass(frozen=True, slots=True)
class ConsumerSpec:
    """A receiver without corrections, in a phone or a dashboard camera; ranges of a uniform draw a drive."""

    error_m: tuple[float, float] = (2.0, 4.0)
    """Horizontal error of its fixes, root mean square of both axes together."""
    lasts_s: tuple[float, float] = (60.0, 180.0)
    """Correlation time of 95 % of that: atmosphere, and which satellites are in view."""
    late_s: tuple[float, float] | None = (0.1, 0.2)
    """By how much its filter is late, positions and velocities alike; None for what is assumed of it."""
    multipath_share: float = 0.3
    """Of the error: reflections, 10 s."""
    white_m: float = 0.1
    velocity_mps: float | None = 0.05
    """Of its Doppler velocities, each horizontal axis; None for a receiver that has none."""
    velocity_stated_mps: float = 0.05

    @property
    def late(self) -> tuple[float, float]:
        """Mean and sigma of by how much it is late, seconds."""
        if self.late_s is None:
            share = 2.0 / np.pi
            return ASSUMED_LATE_S * float(np.sqrt(share)), ASSUMED_LATE_S * float(np.sqrt(1.0 - share))
        return float(np.mean(self.late_s)), float(np.ptp(self.late_s)) / float(np.sqrt(12.0))


class ConsumerErrors(NamedTuple):
    """By what one drive's fixes and velocities are off.

    Attributes
    ----------
    time_s : float64 (n,)
        True time of each fix, since the first frame.
    fixes_m : float64 (n, 2)
        East and north.
    reckoned_m : float64 (n, 2) or None
        By how much the way is off that velocities, added up since the first fix, tell; None without any.
    axis_m, lasts_s, late_s : float
        Drawn: one sigma an axis of a fix, how long most of that lasts, and by how much all of it is late.
    """

    time_s: FloatArray
    fixes_m: FloatArray
    reckoned_m: FloatArray | None
    axis_m: float
    lasts_s: float
    late_s: float


def consumer_drive(
    world: Scenario, seed: int, spec: ConsumerSpec
) -> tuple[SimulatedDrive, GnssFixes, ConsumerErrors]:
    """Drive once with a consumer receiver at the first antenna; its fixes, which state no sigma."""
    rng = stream(seed, "consumer receiver")
    axis_m = rng.uniform(*spec.error_m) / np.sqrt(2.0)
    lasts_s = rng.uniform(*spec.lasts_s)
    if spec.late_s is None:
        # One car drives a road: most of its receiver's lateness is the same every day.
        car = seed if world.road.seed is None else world.road.seed
        of_car = stream(car, "a car's receiver").normal()
        shared = np.sqrt(_OF_CAR) * of_car + np.sqrt(1.0 - _OF_CAR) * rng.normal()
        late_s = ASSUMED_LATE_S * abs(float(shared))
    else:
        late_s = rng.uniform(*spec.late_s)
    slow_m = np.sqrt(1.0 - spec.multipath_share**2) * axis_m
    noise = replace(
        world.noise,
        gnss_white_horizontal_m=spec.white_m,
        gnss_white_vertical_m=1.7 * spec.white_m,
        gnss_slow_horizontal_m=slow_m,
        gnss_slow_vertical_m=1.7 * slow_m,
        gnss_slow_tau_s=lasts_s,
        gnss_multipath_m=spec.multipath_share * axis_m,
        gnss_multipath_tau_s=10.0,
    )
    drive = simulate_drive(replace(world, noise=noise), seed)
    fixes = drive.gnss[0]
    n = fixes.epoch_ns.size
    arm_m = drive.rig.antennas[fixes.antenna].rig_t_antenna_m + drive.drawn.lever_arm_m[fixes.antenna]
    motion = TrueMotion(Road(drive.scenario.road, seed), drive.scenario.motion, drive.scenario.noise, seed)
    if spec.velocity_mps is not None:
        # From fix to fix: velocities of an instant miss what a roof does between them, and on one road all
        # drives would miss the same.
        receiver = ReceiverSpec(
            heading_deg=0.0,
            velocity_mps=spec.velocity_mps,
            averaged_s=1.0 / world.motion.gnss_rate_hz,
        )
        fixes = with_receiver_motion(fixes, drive.scenario, seed, arm_m, receiver)
        stated = np.full((n, 2), spec.velocity_stated_mps) * [1.0, 2.0]
        fixes = replace(fixes, velocity_sigma_mps=stated)
    errors = ConsumerErrors(
        *_errors(fixes, motion, drive.scenario.start_utc_ns, arm_m), axis_m, lasts_s, late_s
    )
    late_ns = round(1e9 * late_s)
    late = replace(fixes, quality=np.ones(n, dtype=np.int64), epoch_ns=fixes.epoch_ns + late_ns)
    return drive, late, errors


def _errors(
    fixes: GnssFixes, motion: TrueMotion, start_ns: int, arm_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Time of each fix, and by what fixes and added-up velocities are off."""
    time_s = (fixes.epoch_ns - start_ns) / 1e9
    body = motion.at(time_s)
    latitude, longitude, _ = motion.road.frame.geographic_from_enu(body.position_m + body.enu_R_rig @ arm_m)
    off_m = enu_offset(latitude, longitude, fixes.latitude_deg, fixes.longitude_deg)
    fixes_m = np.stack(off_m, axis=1)
    if not np.isfinite(fixes.velocity_mps).all():
        return time_s, fixes_m, None
    way = np.stack(enu_offset(latitude[:-1], longitude[:-1], latitude[1:], longitude[1:]), axis=1)
    velocity = fixes.velocity_mps[:, :2]
    told = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time_s)[:, None]
    return time_s, fixes_m, np.concatenate([np.zeros((1, 2)), np.cumsum(told - way, axis=0)])
