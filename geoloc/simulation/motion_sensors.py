"""What a simulated car measures of its own motion: speed of its wheels, turn rate, steering angle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.simulation.motion import WHEELBASE_M, TrueMotion
from geoloc.simulation.noise import gauss_markov, stream
from geoloc.simulation.road import Road
from geoloc.simulation.scenarios import Scenario
from geoloc.trajectory.poses import GnssFixes
from geoloc.trajectory.vehicle_motion import MotionSeries, VehicleMotion

TRUTH_STEP_S = 0.01
"""Everything is measured from poses so far apart, by central differences."""


@dataclass(frozen=True, slots=True)
class MotionSensors:
    """One-sigma values of each source of error (unless a field says otherwise), and how sensors sample."""

    speed_rate_hz: float = 50.0
    """Wheel speeds as a car's bus has them."""
    wheel_scale: float = 0.01
    """Once: tyres of another make, worn by 5 of 650 mm, half a bar too much."""
    wheel_warms: float = 0.003
    """Not a sigma: by how much the radius grows in the first quarter of an hour."""
    wheel_grows_per_mps2: float = 1.5e-6
    """Not a sigma: radius that grows with the square of the speed, 0.15 % at 110 km/h."""
    traction_per_mps2: float = 0.002
    """Once: share by which driven and braked tyres slip a m/s²."""
    speed_noise_mps: float = 0.03
    """Each sample."""
    speed_step_mps: float = 0.01 / 3.6 * 5.0
    """Not a sigma: counts of the bus, 0.05 km/h."""
    still_below_mps: float = 0.25
    """Not a sigma: slower wheels give no pulse."""
    speed_lag_s: tuple[float, float] = (0.02, 0.06)
    """Range of a uniform draw a drive: filter, bus and logger."""
    gyro_rate_hz: float = 100.0
    gyro_bias_degps: float = 0.2
    """Once."""
    gyro_warms_degps: float = 0.05
    """Not a sigma: what of the bias fades within five minutes."""
    gyro_walk_degps: float = 7e-4
    """Random walk of the bias in a second: bias instability of 10 to 20° an hour over minutes."""
    gyro_noise_degps: float = 0.08
    """Each sample: 0.008° a second for the root of a hertz, as automotive MEMS."""
    gyro_scale: float = 0.005
    """Once."""
    gyro_lag_s: tuple[float, float] = (0.01, 0.05)
    steering_noise_deg: float = 0.05
    """Each sample of the front wheels' angle, at 50 Hz."""
    steering_offset_deg: float = 0.5
    """Once."""
    steering_scale: float = 0.05
    """Once: a steering ratio that is not quite that of the data sheet."""
    understeer_deg_per_mps2: float = 0.25
    """Not a sigma: 2.5° a g."""
    lags_stated: bool = False
    """Whether the series say how late they are; else 0 ± 0.1 s."""


@dataclass(frozen=True, slots=True)
class DrawnMotionErrors:
    """What was drawn once: the truth about systematic errors of a drive's motion sensors.

    Attributes
    ----------
    wheel_scale : float
        Reading over true speed, less one, without warming, speed and traction.
    gyro_bias_radps : float64 (n,)
        At each sample of the gyro.
    gyro_scale : float
    speed_lag_s, gyro_lag_s : float
    """

    wheel_scale: float
    gyro_bias_radps: FloatArray
    gyro_scale: float
    speed_lag_s: float
    gyro_lag_s: float


def simulated_motion(
    world: Scenario, seed: int, spec: MotionSensors, *, before_s: float = 1.0
) -> tuple[VehicleMotion, DrawnMotionErrors]:
    """Measure the drive ``simulate_drive(world, seed)`` by the car's own sensors.

    Parameters
    ----------
    world : Scenario
    seed : int
    spec : MotionSensors
    before_s : float
        They begin so long before the first frame, and end so long after the last.
    """
    true = TrueMotion(Road(world.road, seed), world.motion, world.noise, seed)
    time_s = np.arange(-before_s, world.motion.duration_s + before_s, TRUTH_STEP_S)
    parts = [true.at(part) for part in np.array_split(time_s, max(1, time_s.size // 20_000))]
    place_m, axes = (
        np.concatenate([getattr(one, name) for one in parts]) for name in ("position_m", "enu_R_rig")
    )
    return measured_motion(time_s, place_m, axes, world.start_utc_ns, spec, seed)


def measured_motion(
    time_s: FloatArray,
    place_m: FloatArray,
    enu_R_rig: FloatArray,
    start_ns: int,
    spec: MotionSensors,
    seed: int,
) -> tuple[VehicleMotion, DrawnMotionErrors]:
    """Measure a true motion: place of the rear axle ``(n, 3)``, axes of the car ``(n, 3, 3)``, even."""
    step_s = float(time_s[1] - time_s[0])
    velocity = np.gradient(place_m, step_s, axis=0)
    speed = np.einsum("nk,nk->n", velocity, enu_R_rig[:, :, 0])
    turn = _turn_rate(enu_R_rig, step_s)
    rng = stream(seed, "motion sensors")
    scale, gyro_scale = rng.normal(0.0, [spec.wheel_scale, spec.gyro_scale]).tolist()
    traction = float(rng.normal(0.0, spec.traction_per_mps2))
    speed_lag_s, gyro_lag_s = rng.uniform(*spec.speed_lag_s), rng.uniform(*spec.gyro_lag_s)
    pushes = np.gradient(speed, step_s)
    reads = speed * (
        1.0
        + scale
        + spec.wheel_warms * (1.0 - np.exp(-(time_s - time_s[0]) / 300.0))
        - spec.wheel_grows_per_mps2 * speed**2
        + traction * pushes
    )
    clock = _Clock(time_s, start_ns, spec.lags_stated)
    at_s = clock.samples(spec.speed_rate_hz)
    wheels = np.interp(at_s, time_s, reads)
    wheels = wheels + stream(seed, "wheel noise").normal(0.0, 1.0, at_s.size) * spec.speed_noise_mps
    if spec.speed_step_mps:
        wheels = np.round(wheels / spec.speed_step_mps) * spec.speed_step_mps
    wheels = np.where(np.abs(np.interp(at_s, time_s, speed)) < spec.still_below_mps, 0.0, wheels)
    gyro_s = clock.samples(spec.gyro_rate_hz)
    bias = np.radians(_bias_degps(gyro_s, spec, seed))
    rate = np.interp(gyro_s, time_s, turn) * (1.0 + gyro_scale) + bias
    rate = rate + stream(seed, "gyro noise").normal(0.0, np.radians(spec.gyro_noise_degps), gyro_s.size)
    motion = VehicleMotion(
        speed=clock.series(at_s, wheels, speed_lag_s),
        turn_rate=clock.series(gyro_s, rate, gyro_lag_s),
        wheel_angle=clock.series(at_s, _steering(at_s, time_s, speed, turn, spec, seed), speed_lag_s),
        wheelbase_m=WHEELBASE_M,
    )
    return motion, DrawnMotionErrors(scale, bias, gyro_scale, speed_lag_s, gyro_lag_s)


def without_fixes(fixes: GnssFixes, begin_ns: int, end_ns: int) -> GnssFixes:
    """Return fixes without those of an outage, from `begin_ns` up to before `end_ns`."""
    keep = (fixes.epoch_ns < begin_ns) | (fixes.epoch_ns >= end_ns)
    columns = {name: getattr(fixes, name)[keep] for name in GnssFixes.__slots__ if name != "antenna"}
    return replace(fixes, **columns)


@dataclass(frozen=True, slots=True)
class _Clock:
    time_s: FloatArray
    start_ns: int
    lags_stated: bool

    def samples(self, rate_hz: float) -> FloatArray:
        count = int((self.time_s[-1] - self.time_s[0]) * rate_hz)
        return np.asarray(self.time_s[0] + np.arange(count) / rate_hz)

    def series(self, measured_s: FloatArray, values: FloatArray, lag_s: float) -> MotionSeries:
        epoch_ns: IntArray = self.start_ns + np.round((measured_s + lag_s) * 1e9).astype(np.int64)
        stated = (lag_s, 0.005) if self.lags_stated else (0.0, 0.1)
        return MotionSeries(epoch_ns, values, np.full(values.size, np.nan), *stated)


def _turn_rate(enu_R_rig: FloatArray, step_s: float) -> FloatArray:
    """Rate about the car's own z, from the rotation between neighbouring attitudes, by SciPy."""
    from scipy.spatial.transform import Rotation

    turns: FloatArray = Rotation.from_matrix(np.swapaxes(enu_R_rig[:-2], 1, 2) @ enu_R_rig[2:]).as_rotvec()[
        :, 2
    ]
    return np.asarray(np.concatenate([turns[:1], turns, turns[-1:]]) / (2.0 * step_s))


def _bias_degps(time_s: FloatArray, spec: MotionSensors, seed: int) -> FloatArray:
    rng = stream(seed, "gyro bias")
    begins = rng.normal() * spec.gyro_bias_degps
    steps = rng.normal(size=time_s.size) * spec.gyro_walk_degps / np.sqrt(spec.gyro_rate_hz)
    return np.asarray(
        begins + np.cumsum(steps) + spec.gyro_warms_degps * np.exp(-(time_s - time_s[0]) / 300.0)
    )


def _steering(
    at_s: FloatArray,
    time_s: FloatArray,
    speed: FloatArray,
    turn: FloatArray,
    spec: MotionSensors,
    seed: int,
) -> FloatArray:
    """Angle of the front wheels by the bicycle model, with play and crossfall that last for a second."""
    rng = stream(seed, "steering")
    moving = np.abs(speed) > 0.5
    geometric = np.arctan(np.where(moving, WHEELBASE_M * turn / np.where(moving, speed, 1.0), 0.0))
    angle = geometric + np.radians(spec.understeer_deg_per_mps2) * speed * turn
    offset, scale = rng.normal(0.0, [np.radians(spec.steering_offset_deg), spec.steering_scale])
    noise = rng.normal(0.0, np.radians(spec.steering_noise_deg), at_s.size)
    play = gauss_markov(rng, at_s, np.radians(2.0 * spec.steering_noise_deg), 1.0)
    return np.asarray(offset + (1.0 + scale) * np.interp(at_s, time_s, angle) + noise + play)
