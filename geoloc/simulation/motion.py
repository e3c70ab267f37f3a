"""How the car truly moves: the pose of its body at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.errors import GeolocError
from geoloc.simulation.noise import (
    NoiseSpec,
    damped_oscillation,
    drawn_slip_deg_per_mps2,
    gauss_markov,
    stream,
)
from geoloc.simulation.road import MARGIN_M, Road

WHEELBASE_M = 2.85
REFERENCE_SPEED_MPS = 50.0 / 3.6
JITTER_STEP_S = 0.005
RUN_IN_S = 2.0
SIDEWAYS_EVERY_S = 0.2
UNREST_LASTS_S = {"pitch": 1.0, "roll": 6.0}
FULL_UNREST_MPS, IDLE_SHARE = 3.0, 0.1
STANDING_RATE, CRAWLING_MPS = 0.001, 0.5
PATH_STEP_M = 0.05


@dataclass(frozen=True, slots=True)
class MotionSpec:
    """What the driver does, and how fast the sensors sample it."""

    duration_s: float = 10.0
    speed: tuple[tuple[float, float], ...] = ((0.0, 11.1),)
    """(time, speed) in seconds and metres per second, joined by smooth steps: no jump in the acceleration."""
    start_station_m: float = 0.0
    against: bool = False
    """Whether the car drives against the stations: its lane's offset is then a positive one."""
    lane_offset_m: float = -1.65
    """Of the rear axle's middle from the centre line, left positive: in the middle of the right lane."""
    wander_m: float = 0.12
    """Amplitude of the driver's wander in the lane; lane-keeping studies give 0.1 to 0.3 m."""
    wander_length_m: float = 90.0
    """One period of the wander along the road."""
    wheelbase_m: float = WHEELBASE_M
    gnss_rate_hz: float = 5.0
    """Rate of the paper's receivers."""
    frame_rate_hz: float = 30.0
    """Rate of the car's cameras."""


@dataclass(frozen=True, slots=True)
class BodyState:
    """The rig in the road's frame: position ``(n, 3)``, axes ``(n, 3, 3)`` as columns, speed ``(n,)``."""

    position_m: FloatArray
    enu_R_rig: FloatArray
    speed_mps: FloatArray


class TrueMotion:
    """A car on a road: position of the rig's origin and attitude of its body at any time of the drive."""

    def __init__(self, road: Road, spec: MotionSpec, noise: NoiseSpec, seed: int) -> None:
        self.road, self.spec, self.noise = road, spec, noise
        self._ahead = -1.0 if spec.against else 1.0
        self._slip_deg_per_mps2 = drawn_slip_deg_per_mps2(noise, seed)
        self._station = np.arange(-MARGIN_M, road.spec.length_m + MARGIN_M, PATH_STEP_M)
        path = road.plan_m(self._station, self._offset(self._station)[0])
        steps = np.linalg.norm(np.diff(path, axis=0), axis=-1)
        travelled = np.concatenate([[0.0], np.cumsum(steps)])
        self._travelled = travelled - np.interp(spec.start_station_m, self._station, travelled)
        self._jitter_s = np.arange(-RUN_IN_S, spec.duration_s + RUN_IN_S, JITTER_STEP_S)
        self._jitter = np.stack([self._body_noise(seed, name) for name in ("pitch", "roll", "heave")])

        sizes_deg = zip(UNREST_LASTS_S.items(), (noise.pitch_unrest_deg, noise.roll_unrest_deg), strict=True)
        self._unrest_deg = {
            name: self._unrest_of(seed, name, sigma, lasts_s) for (name, lasts_s), sigma in sizes_deg
        }
        self._sideways_m = self._sideways(seed)

    def speed_mps(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speed, acceleration and distance since time 0."""
        knots = np.array(self.spec.speed, dtype=float)
        before = min(float(np.min(time_s, initial=0.0)), knots[0, 0]) - 1.0
        after = max(float(np.max(time_s, initial=0.0)), knots[-1, 0]) + 1.0
        time = np.concatenate([[before], knots[:, 0], [after]])
        speed = np.concatenate([knots[:1, 1], knots[:, 1], knots[-1:, 1]])
        at, start = _smooth_steps(time, speed, time_s), _smooth_steps(time, speed, np.zeros(1))
        return at[0], at[1], at[2] - start[2]

    def station_m(self, time_s: FloatArray) -> FloatArray:
        """Where along the road the rig's origin is at times ``(n,)``."""
        return np.asarray(np.interp(self._ahead * self.speed_mps(time_s)[2], self._travelled, self._station))

    def at(self, time_s: FloatArray, *, bounces: bool = True) -> BodyState:
        """State of the body at times ``(n,)`` in seconds since the first frame.

        Without its bounce it stands as the road below it, and what lies below its wheels, have it.

        Raises
        ------
        GeolocError
            If the car has left the road by then.
        """
        speed, acceleration, driven = self.speed_mps(time_s)
        distance = self._ahead * driven
        low, high = float(np.min(distance, initial=0.0)), float(np.max(distance, initial=0.0))
        if low < self._travelled[0] or high > self._travelled[-1]:
            raise GeolocError(
                f"the car drives {high - low:.0f} m, and the simulated road ends {self._travelled[-1]:.0f} m "
                "from its start: make the road longer or the drive shorter"
            )
        station = np.interp(distance, self._travelled, self._station)
        offset, offset_slope = self._offset(station)
        curvature = self.road.curvature_per_m(station)
        sideways = self._ahead * speed**2 * self._path_curvature_per_m(station, offset)
        yaw = self.road.yaw_rad(station) + np.arctan2(offset_slope, 1.0 - curvature * offset)
        yaw = yaw + np.pi * self.spec.against
        # The path's tangent is the course; the body points further into the bend by the rear tyres' slip.
        yaw = yaw + np.radians(self._slip_deg_per_mps2 * sideways)
        bounce = self._bounce_deg(time_s, speed) * float(bounces)
        unrest = np.stack(
            [np.interp(time_s, self._jitter_s, self._unrest_deg[name]) for name in UNREST_LASTS_S]
        )
        in_road_axes = 0.0 if self.noise.bounce_lasts_s else 1.0
        pitch, roll = self._attitude(station, offset, acceleration, sideways, in_road_axes * bounce)
        liveliness = np.sqrt(speed / REFERENCE_SPEED_MPS)
        heave = np.interp(time_s, self._jitter_s, self._jitter[2]) * self.noise.heave_m * liveliness
        offset = offset + np.interp(time_s, self._jitter_s, self._sideways_m)
        plan = self.road.plan_m(station, offset)
        up = self.road.surface_m(station, offset) + heave
        axes = _rotation(yaw, pitch, roll)
        if self.noise.bounce_lasts_s:
            axes = axes @ self._in_car_axes(np.radians(bounce + unrest))
        return BodyState(np.concatenate([plan, up[:, None]], axis=-1), axes, speed)

    def _attitude(
        self,
        station: FloatArray,
        offset: FloatArray,
        acceleration: FloatArray,
        sideways: FloatArray,
        bounce_deg: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Pitch (nose down) and roll (right side down) in radians: road plus body."""
        noise, wheelbase_m = self.noise, self.spec.wheelbase_m
        rear, front = (
            self.road.surface_m(at, offset) for at in (station, station + self._ahead * wheelbase_m)
        )
        pitch = -np.arctan2(front - rear, wheelbase_m)
        pitch = pitch + np.radians(bounce_deg[0] - acceleration * noise.dive_deg_per_mps2)
        roll = np.arctan(self._ahead * self.road.across_slope(station, offset)) + np.radians(
            bounce_deg[1] + sideways * noise.roll_deg_per_mps2
        )
        return pitch, roll

    def _in_car_axes(self, turned_rad: FloatArray) -> FloatArray:
        """Rotations ``(n, 3, 3)`` of a body that pitches and rolls ``(2, n)`` about its own axes."""
        from scipy.spatial.transform import Rotation

        pitch, roll = turned_rad
        vectors = np.stack([roll, pitch, self.noise.pitching_axis * pitch], axis=-1)
        return np.asarray(Rotation.from_rotvec(vectors).as_matrix())

    def _bounce_deg(self, time_s: FloatArray, speed: FloatArray) -> FloatArray:
        """What springs add to pitch and roll ``(2, n)``."""
        noise = self.noise
        full = np.array([[noise.pitch_jitter_deg], [noise.roll_jitter_deg]])
        if noise.bounce_lasts_s:
            size = full * np.clip(speed / FULL_UNREST_MPS, IDLE_SHARE, 1.0)
        else:
            size = noise.idle_jitter_deg + full * np.sqrt(speed / REFERENCE_SPEED_MPS)
        unit = [np.interp(time_s, self._jitter_s, row) for row in self._jitter[:2]]
        return np.asarray(np.stack(unit) * size)

    def _unrest_of(self, seed: int, name: str, sigma_deg: float, lasts_s: float) -> FloatArray:
        """What lies below the wheels, on a clock that all but stops with the car."""
        if sigma_deg == 0.0:
            return np.zeros(self._jitter_s.size)
        rate = np.clip(self.speed_mps(self._jitter_s)[0] / FULL_UNREST_MPS, STANDING_RATE, 1.0)
        age_s = np.cumsum(rate) * JITTER_STEP_S
        return gauss_markov(stream(seed, f"unrest {name}"), age_s, sigma_deg, lasts_s)

    def _sideways(self, seed: int) -> FloatArray:
        """How far the axle has rolled to the left."""
        speed = self.speed_mps(self._jitter_s)[0]
        steps = np.arange(self._jitter_s[0], self._jitter_s[-1] + SIDEWAYS_EVERY_S, SIDEWAYS_EVERY_S)
        each = stream(seed, "sideways").normal(size=steps.size)
        each = each[np.searchsorted(steps, self._jitter_s, side="right") - 1]
        loose_mps = np.hypot(self.noise.sideways_mps, np.radians(self.noise.sideways_deg) * speed)
        return np.asarray(np.cumsum(each * loose_mps * (speed > CRAWLING_MPS)) * JITTER_STEP_S)

    def _offset(self, station: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offset from the centre line and its slope along the road."""
        omega = 2.0 * np.pi / self.spec.wander_length_m
        offset = self.spec.lane_offset_m + self.spec.wander_m * np.sin(omega * station)
        return offset, self.spec.wander_m * omega * np.cos(omega * station)

    def _path_curvature_per_m(self, station: FloatArray, offset: FloatArray) -> FloatArray:
        """Curvature of the way that the rear axle takes: the road's, and the driver's wander in the lane."""
        curvature = self.road.curvature_per_m(station)
        omega = 2.0 * np.pi / self.spec.wander_length_m
        wander = -self.spec.wander_m * omega**2 * np.sin(omega * station)
        return np.asarray(curvature / (1.0 - curvature * offset) + wander)

    def _body_noise(self, seed: int, name: str) -> FloatArray:
        if self.noise.bounce_lasts_s:
            return gauss_markov(stream(seed, f"body {name}"), self._jitter_s, 1.0, self.noise.bounce_lasts_s)
        return damped_oscillation(
            stream(seed, f"body {name}"),
            self._jitter_s.size,
            JITTER_STEP_S,
            self.noise.body_frequency_hz,
            self.noise.body_damping,
        )


def _rotation(yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
    """ISO 8855 attitude by SciPy, which knows nothing of this project's own rotation formulas."""
    from scipy.spatial.transform import Rotation

    angles = np.stack([yaw_rad, pitch_rad, roll_rad], axis=-1)
    return np.asarray(Rotation.from_euler("ZYX", angles).as_matrix())


def _smooth_steps(
    knot_s: FloatArray, knot_value: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value, slope and integral (from the first knot) of knots joined by the smooth step 3u² - 2u³."""
    width, rise = np.diff(knot_s), np.diff(knot_value)
    whole = np.concatenate([[0.0], np.cumsum(width * (knot_value[:-1] + 0.5 * rise))])
    i = np.clip(np.searchsorted(knot_s, time_s, side="right") - 1, 0, width.size - 1)
    u = (time_s - knot_s[i]) / width[i]
    value = knot_value[i] + rise[i] * (3.0 * u**2 - 2.0 * u**3)
    slope = rise[i] / width[i] * 6.0 * u * (1.0 - u)
    integral = whole[i] + width[i] * (knot_value[i] * u + rise[i] * (u**3 - 0.5 * u**4))
    return value, slope, integral
