"""How the car truly moves: the pose of its body at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.errors import GeolocError
from geoloc.simulation.noise import NoiseSpec, damped_oscillation, drawn_slip_deg_per_mps2, stream
from geoloc.simulation.road import MARGIN_M, Road

WHEELBASE_M = 2.85
REFERENCE_SPEED_MPS = 50.0 / 3.6
JITTER_STEP_S = 0.005
RUN_IN_S = 2.0
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

    def at(self, time_s: FloatArray) -> BodyState:
        """State of the body at times ``(n,)`` in seconds since the first frame.

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
        pitch, roll, heave = self._attitude(time_s, station, offset, acceleration, sideways, speed)
        plan = self.road.plan_m(station, offset)
        up = self.road.surface_m(station, offset) + heave
        axes = _rotation(yaw, pitch, roll)
        return BodyState(np.concatenate([plan, up[:, None]], axis=-1), axes, speed)

    def _attitude(
        self,
        time_s: FloatArray,
        station: FloatArray,
        offset: FloatArray,
        acceleration: FloatArray,
        sideways: FloatArray,
        speed: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pitch (nose down), roll (right side down) in radians and heave in metres: road plus body."""
        noise = self.noise
        jitter = [np.interp(time_s, self._jitter_s, row) for row in self._jitter]
        liveliness = np.sqrt(speed / REFERENCE_SPEED_MPS)
        rear, front = (
            self.road.surface_m(at, offset) for at in (station, station + self._ahead * WHEELBASE_M)
        )
        pitch = -np.arctan2(front - rear, WHEELBASE_M)
        pitch = pitch + np.radians(
            jitter[0] * (noise.idle_jitter_deg + noise.pitch_jitter_deg * liveliness)
            - acceleration * noise.dive_deg_per_mps2
        )
        roll = np.arctan(self._ahead * self.road.across_slope(station, offset)) + np.radians(
            jitter[1] * (noise.idle_jitter_deg + noise.roll_jitter_deg * liveliness)
            + sideways * noise.roll_deg_per_mps2
        )
        return pitch, roll, np.asarray(jitter[2] * noise.heave_m * liveliness)

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
