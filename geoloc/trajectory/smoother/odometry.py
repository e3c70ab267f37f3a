"""What a car measures of its own motion, as observations of the smoother in the plane.

From each knot to the next the wheels tell the way and the gyro the turn, both as integrals of all samples
between: a gyro of 100 Hz costs no more than one of 5 Hz. At each knot the front wheels tell by how much the
path bends. Scale of the wheels and bias of the gyro wander, and are states; what stays is constants.
The equations, with measured times later than the stamps by an unknown lag:

- way: scale × the integral of the speed ahead, along the road's slope;
- turn: scale × (turn about the car's own vertical axis) + bias × time. That axis leans with the road: of the
  turn about the true vertical it has the cosines of pitch and roll, and a pitching car turns besides by the
  sine of its roll;
- steering angle: offset + scale × (angle of the wheelbase over the radius + understeer × lateral
  acceleration), the bicycle model;
- wheels that are at rest: the car keeps its place and its heading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.trajectory.motion_readings import MotionReadings, Reading
from geoloc.trajectory.smoother.chain import MEDIAN_1D, Chain, robust_weight
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.state import (
    ACCELERATION,
    VELOCITY,
    YAW,
    YAW_RATE,
    forward_axis,
    turned,
)

# Wheels: tyres of another size, worn, or on another pressure; warm tyres, speed and slip change that by
# 0.15 % in a minute.
WHEEL_SCALE_SIGMA = 0.05
_SCALE_WANDERS = 2e-4
# A MEMS gyro that nobody calibrated, and how its bias wanders as it warms up: 0.03° a second in a quarter
# of an hour, by 0.005° in half a minute.
GYRO_BIAS_SIGMA_RADPS = np.radians(2.0)
_BIAS_WANDERS = np.radians(1e-3)
GYRO_SCALE_SIGMA = 0.01
STEERING_OFFSET_SIGMA_RAD = np.radians(3.0)
STEERING_SCALE_SIGMA = 0.1
# Front wheels turn further by this a lateral acceleration: 1 to 4 degrees per g for passenger cars.
UNDERSTEER_RAD_PER_MPS2 = (np.radians(0.25), np.radians(0.15))
# A wheelbase that nobody states; its spread is in the scale.
_WHEELBASE_M = 2.75

# What is in no series: whatever its samples say, the way of a second is known to 1 cm, its turn to 0.01°.
_WAY_FLOOR = 0.01
_TURN_FLOOR = np.radians(0.01)
# A gyro shows slip, since it turns with the body; but a lag of slip times speed looks the same, so that it
# must be known: 0.02 s are 0.08° per m/s² at 50 km/h.
_LAG_KNOWN_S = 0.02
# Where no fix tells a climb, it is another one after so long a way (`smoother.tilt`).
_CLIMB_LASTS_M = 250.0
# Tyres that push or brake slip by this share a m/s², for as long as they do.
_TRACTION_PER_MPS2, _TRACTION_LASTS_S = 0.003, 2.0
# Slower than this a wheel gives no pulse for a while.
_DEAD_MPS, _DEAD_LASTS_S = 0.3, 0.5
# Wheels at rest for so long before and after: the car stands, but for what shakes it.
_REST_MPS, _REST_S = 0.01, 0.5
_CARRIED_MPS = 1.0
_STANDS_M, _STANDS_RAD = 5e-4, np.radians(2e-3)
# A steering angle errs by its play and by the road's crossfall, both for a second.
_STEERING_FLOOR_RAD, _STEERING_LASTS_S = np.radians(0.15), 1.0
_STEERS_ABOVE_MPS = 2.0


class Unknown(StrEnum):
    """Constants of a drive that its motion sensors bring along."""

    WHEEL_LAG = "wheel_lag"
    GYRO_SCALE = "gyro_scale"
    GYRO_LAG = "gyro_lag"
    LEAN = "lean"
    LEAN_IN_BENDS = "lean_in_bends"
    STEERING_OFFSET = "steering_offset"
    STEERING_SCALE = "steering_scale"
    UNDERSTEER = "understeer"
    STEERING_LAG = "steering_lag"


class WanderingState(StrEnum):
    """States, in units of their sigma beforehand: the wheels' scale, and the gyro's bias."""

    WHEEL_SCALE = "wheel_scale"
    GYRO_BIAS = "gyro_bias"


class MotionOnRoad(NamedTuple):
    """What the car's sensors read, and how the car stands on the road.

    Attributes
    ----------
    readings : MotionReadings
    pitch_rad, roll_rad : float64 (n,)
        At each knot: nose down, right side down.
    pitch_sigma_rad, roll_sigma_rad : float64 (n,)
        One sigma; of the roll without what lasts.
    lasting : (float, float)
        One sigma of the roll that is the same for the whole drive (rad), and by the acceleration to the left
        (rad per m/s²).
    lateral_mps2 : float64 (n,)
        That acceleration.
    above_m : float64 (m,)
        Height of each antenna.
    """

    readings: MotionReadings
    pitch_rad: FloatArray
    roll_rad: FloatArray
    pitch_sigma_rad: FloatArray
    roll_sigma_rad: FloatArray
    lasting: tuple[float, float]
    lateral_mps2: FloatArray
    above_m: FloatArray


def wandering_states(readings: MotionReadings) -> list[WanderingState]:
    """States that these series bring along."""
    speed = [WanderingState.WHEEL_SCALE] if readings.speed else []
    return speed + ([WanderingState.GYRO_BIAS] if readings.turn_rate else [])


def unknown_names(readings: MotionReadings) -> list[Unknown]:
    """Constants that these series bring along, in their order."""
    return list(unknowns(readings))


def shows_slip(readings: MotionReadings) -> bool:
    """Whether the turns of the body are known apart from those of its course."""
    return readings.turn_rate is not None and readings.turn_rate.lag_sigma_s <= _LAG_KNOWN_S


def unknowns(
    readings: MotionReadings, lasting: tuple[float, float] = (0.0, 0.0)
) -> dict[Unknown, tuple[float, float]]:
    """Constants that these series bring along, each with what is expected beforehand and one sigma.

    Parameters
    ----------
    readings : MotionReadings
    lasting : (float, float)
        As in `MotionOnRoad`.
    """
    found: dict[Unknown, tuple[float, float]] = {}
    if readings.speed:
        found[Unknown.WHEEL_LAG] = readings.speed.lag_s, readings.speed.lag_sigma_s
    if readings.turn_rate:
        found[Unknown.GYRO_SCALE] = 0.0, GYRO_SCALE_SIGMA
        found[Unknown.GYRO_LAG] = readings.turn_rate.lag_s, readings.turn_rate.lag_sigma_s
        for which, sigma in zip((Unknown.LEAN, Unknown.LEAN_IN_BENDS), lasting, strict=True):
            found[which] = 0.0, max(sigma, 1e-6)
    if readings.wheel_angle:
        found[Unknown.STEERING_OFFSET] = 0.0, STEERING_OFFSET_SIGMA_RAD
        found[Unknown.STEERING_SCALE] = 0.0, STEERING_SCALE_SIGMA
        found[Unknown.UNDERSTEER] = UNDERSTEER_RAD_PER_MPS2
        found[Unknown.STEERING_LAG] = readings.wheel_angle.lag_s, readings.wheel_angle.lag_sigma_s
    return found


def steered_radps(readings: MotionReadings, angle_rad: FloatArray, forward_mps: FloatArray) -> FloatArray:
    """Yaw rate ``(n,)`` that a steering angle makes of a speed, for the car that is expected beforehand."""
    base_m = readings.wheelbase_m or _WHEELBASE_M
    return np.asarray(forward_mps * angle_rad / (base_m + UNDERSTEER_RAD_PER_MPS2[0] * forward_mps**2))


_Rows = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Jacobians by a knot, by the next and by the constants, and residuals."""


@dataclass(slots=True, eq=False)
class _Link:
    """What one series tells between neighbouring knots: its equations, and the variance of what it lacks."""

    one: Reading
    rows: Callable[[Reading, FloatArray, FloatArray], _Rows]
    floor: Callable[[FloatArray, FloatArray], FloatArray]
    known: BoolArray
    weight: FloatArray
    scale: float = 1.0


class Odometry:
    """The equations of a car's own measurements, linearised about any state.

    Parameters
    ----------
    fixes : KnotFixes
    motion : MotionOnRoad
    first_state, first_constant : int
        Where its states and constants stand among those of the track.
    """

    def __init__(self, fixes: KnotFixes, motion: MotionOnRoad, first_state: int, first_constant: int) -> None:
        self.fixes, self.readings, self.motion = fixes, motion.readings, motion
        self.at_state = {one: first_state + i for i, one in enumerate(wandering_states(motion.readings))}
        names = unknown_names(motion.readings)
        self.at_constant = {one: first_constant + i for i, one in enumerate(names)}
        self.pitch_sigma = _middle(motion.pitch_sigma_rad)
        self.level = np.cos(_middle(motion.pitch_rad)) * (1.0 - 0.5 * self.pitch_sigma**2)
        self.roll_rad, self.lateral_mps2 = _middle(motion.roll_rad), _middle(motion.lateral_mps2)
        self.pitching_rad = np.diff(motion.pitch_rad)
        self.roll_sigma = _middle(motion.roll_sigma_rad)
        self.links = [
            _Link(one, rows, floor, self._known(one), np.ones(fixes.step_s.size))
            for one, rows, floor in (
                (self.readings.speed, self._way, self._way_floor),
                (self.readings.turn_rate, self._turn, self._turn_floor),
            )
            if one is not None
        ]
        self.rests = self._rests()
        self.steering_weight, self.steering_scale = np.ones(fixes.t_s.size), 1.0

    @property
    def fades(self) -> FloatArray:
        """What is left of each state at the next knot ``(n - 1, k)``."""
        sizes = {
            WanderingState.WHEEL_SCALE: _SCALE_WANDERS / WHEEL_SCALE_SIGMA,
            WanderingState.GYRO_BIAS: _BIAS_WANDERS / GYRO_BIAS_SIGMA_RADPS,
        }
        rates = np.array([0.5 * sizes[one] ** 2 for one in self.at_state])
        return np.asarray(np.exp(-self.fixes.step_s[:, None] * rates))

    def leans_m(self, antenna: int) -> tuple[int, FloatArray] | None:
        """Which constant moves an antenna to the left, and by how much (n,): a roof that leans in bends.

        With a gyro it shows: roof and car do not turn alike.
        """
        at = self.at_constant.get(Unknown.LEAN_IN_BENDS)
        return None if at is None else (at, -self.motion.above_m[antenna] * self.motion.lateral_mps2)

    def observe(self, chain: Chain, state: FloatArray, constants: FloatArray) -> None:
        """Add the equations at a state."""
        for link in self.links:
            rows = link.rows(link.one, state, constants)
            sigma = self._sigma(link, state) * link.scale
            chain.across(*rows, link.known * link.weight / sigma**2)
        if self.rests.any():
            self._stand(chain, state, constants)
        if self.readings.wheel_angle is not None:
            jacobian, by_constants, residual, sigma = self._steering(
                self.readings.wheel_angle, state, constants
            )
            count = np.minimum(1.0, self.fixes.share_s / _STEERING_LASTS_S)
            weight = self.steering_weight * count / (sigma * self.steering_scale) ** 2
            chain.observe(jacobian, residual[:, None], weight[:, None], by_constants)

    def weigh(self, state: FloatArray, constants: FloatArray, power: int) -> None:
        """Take weight from what does not fit: spinning and locked wheels, glitches of a bus."""
        for link in self.links:
            if link.known.any():
                residual = link.rows(link.one, state, constants)[3]
                off = (np.abs(residual) / self._sigma(link, state))[link.known]
                link.weight[link.known], link.scale = robust_weight(off, MEDIAN_1D, power)
        if self.readings.wheel_angle is not None:
            _, _, residual, sigma = self._steering(self.readings.wheel_angle, state, constants)
            seen = np.isfinite(sigma)
            if seen.any():
                off = np.abs(residual[seen]) / sigma[seen]
                self.steering_weight[seen], self.steering_scale = robust_weight(off, MEDIAN_1D, power)

    def _stand(self, chain: Chain, state: FloatArray, constants: FloatArray) -> None:
        """Place and heading stay where the wheels are at rest."""
        by_constants = np.zeros((len(state) - 1, constants.size))
        # On a ferry wheels are at rest too.
        stands = self.rests & (_middle(np.hypot(*state[:, VELOCITY].T)) < _CARRIED_MPS)
        for column, sigma in ((0, _STANDS_M), (1, _STANDS_M), (YAW, _STANDS_RAD)):
            jacobian = np.zeros((len(state) - 1, state.shape[1]))
            jacobian[:, column] = 1.0
            weight = stands / (self.fixes.step_s * sigma**2)
            chain.across(-jacobian, jacobian, by_constants, -np.diff(state[:, column]), weight)

    def _constant(self, constants: FloatArray, which: Unknown) -> float:
        return float(constants[self.at_constant[which]])

    def _known(self, one: Reading) -> BoolArray:
        """Steps ``(n - 1,)`` that a series covers."""
        t_s = self.fixes.t_s + one.lag_s
        return np.asarray(self.fixes.tied & one.covers(t_s[:-1], t_s[1:]))

    def _rests(self) -> BoolArray:
        """Steps ``(n - 1,)`` all through which the wheels are at rest."""
        one = self.readings.speed
        if one is None:
            return np.zeros(self.fixes.t_s.size - 1, dtype=bool)
        moving = np.concatenate([[0], np.cumsum(np.abs(one.values) > _REST_MPS)])
        t_s = self.fixes.t_s + one.lag_s
        first = np.searchsorted(one.t_s, t_s[:-1] - _REST_S)
        last = np.searchsorted(one.t_s, t_s[1:] + _REST_S, side="right")
        return np.asarray(self._known(one) & (last > first) & (moving[last] == moving[first]))

    def _sigma(self, link: _Link, state: FloatArray) -> FloatArray:
        """One sigma ``(n - 1,)`` of a way or of a turn."""
        speed, pushes = (np.abs(_middle(one)) for one in self._ahead(state)[:2])
        own = link.one.variance(self.fixes.t_s + link.one.lag_s)
        return np.asarray(np.sqrt(own + link.floor(speed, pushes)))

    def _way_floor(self, speed_mps: FloatArray, pushes_mps2: FloatArray) -> FloatArray:
        """Variance of what is in no series of speeds: slip, a dead zone, and climbs that are not known."""
        slips = (_TRACTION_PER_MPS2 * pushes_mps2 * speed_mps) ** 2 * _TRACTION_LASTS_S
        creeps = (speed_mps < 2.0 * _DEAD_MPS) & ~self.rests
        dead = np.where(creeps, _DEAD_MPS**2 / 12.0 * _DEAD_LASTS_S, 0.0)
        climbs = (self.pitch_sigma * np.maximum(self.pitch_sigma, 1.0 - self.level)) ** 2
        return np.asarray(
            (_WAY_FLOOR**2 + slips + dead + climbs * _CLIMB_LASTS_M * speed_mps) * self.fixes.step_s
        )

    def _turn_floor(self, speed_mps: FloatArray, _pushes_mps2: FloatArray) -> FloatArray:
        """Variance of what is in no turn rate; a car that pitches while it leans turns by it."""
        pitching = 2.0 * self.pitch_sigma**2 * speed_mps * self.fixes.step_s / _CLIMB_LASTS_M
        leans = self.roll_rad**2 + self.roll_sigma**2
        leans = leans + self.motion.lasting[0] ** 2 + (self.motion.lasting[1] * self.lateral_mps2) ** 2
        known = (self.pitching_rad * self.roll_sigma) ** 2
        return np.asarray(_TURN_FLOOR**2 * self.fixes.step_s + known + leans * pitching)

    @staticmethod
    def _ahead(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Speed and acceleration ahead, and to the left ``(n,)`` each."""
        ahead = forward_axis(state[:, YAW])
        axes = (ahead, turned(ahead))
        forward, left = (np.einsum("nk,nk->n", state[:, VELOCITY], axis) for axis in axes)
        pushes, aside = (np.einsum("nk,nk->n", state[:, ACCELERATION], axis) for axis in axes)
        return forward, pushes, left, aside

    def _way(self, one: Reading, state: FloatArray, constants: FloatArray) -> _Rows:
        """Jacobians by a knot, by the next and by the constants, and residual, of the ways."""
        h, ahead = self.fixes.step_s, forward_axis(state[:, YAW])
        forward, pushes, left, aside = self._ahead(state)
        half, twelfth = 0.5 * h, h**2 / 12.0
        at = self.at_state[WanderingState.WHEEL_SCALE]
        scale = (1.0 + WHEEL_SCALE_SIGMA * 0.5 * (state[1:, at] + state[:-1, at])) / self.level
        way = half * (forward[1:] + forward[:-1]) + twelfth * (pushes[:-1] - pushes[1:])
        sides = []
        for rows, sign in ((slice(None, -1), 1.0), (slice(1, None), -1.0)):
            jacobian = np.zeros((h.size, state.shape[1]))
            jacobian[:, VELOCITY] = (scale * half)[:, None] * ahead[rows]
            jacobian[:, ACCELERATION] = (sign * scale * twelfth)[:, None] * ahead[rows]
            jacobian[:, YAW] = scale * (half * left[rows] + sign * twelfth * aside[rows])
            jacobian[:, at] = 0.5 * WHEEL_SCALE_SIGMA * way / self.level
            sides.append(jacobian)
        by_constants = np.zeros((h.size, constants.size))
        by_constants[:, self.at_constant[Unknown.WHEEL_LAG]] = -np.diff(forward)
        measured = np.diff(one.integral(self.fixes.t_s + self._constant(constants, Unknown.WHEEL_LAG)))
        if self.readings.unsigned:
            measured = np.where(way < 0.0, -measured, measured)
        return sides[0], sides[1], by_constants, measured - scale * way

    def _turn(self, one: Reading, state: FloatArray, constants: FloatArray) -> _Rows:
        """The same of the turns."""
        h, at = self.fixes.step_s, self.at_state[WanderingState.GYRO_BIAS]
        scale = 1.0 + self._constant(constants, Unknown.GYRO_SCALE)
        leans = self._constant(constants, Unknown.LEAN_IN_BENDS) * self.lateral_mps2
        roll = self.roll_rad + self._constant(constants, Unknown.LEAN) + leans
        upright, turned_rad = self.level * np.cos(roll), np.diff(state[:, YAW])
        about_own = upright * turned_rad - np.sin(roll) * self.pitching_rad
        by_roll = -self.level * np.sin(roll) * turned_rad - np.cos(roll) * self.pitching_rad
        bias = GYRO_BIAS_SIGMA_RADPS * 0.5 * (state[1:, at] + state[:-1, at])
        sides = []
        for sign in (-1.0, 1.0):
            jacobian = np.zeros((h.size, state.shape[1]))
            jacobian[:, YAW] = sign * scale * upright
            jacobian[:, at] = 0.5 * GYRO_BIAS_SIGMA_RADPS * h
            sides.append(jacobian)
        by_constants = np.zeros((h.size, constants.size))
        by_constants[:, self.at_constant[Unknown.GYRO_SCALE]] = about_own
        by_constants[:, self.at_constant[Unknown.LEAN]] = scale * by_roll
        by_constants[:, self.at_constant[Unknown.LEAN_IN_BENDS]] = scale * by_roll * self.lateral_mps2
        by_constants[:, self.at_constant[Unknown.GYRO_LAG]] = -np.diff(state[:, YAW_RATE])
        measured = np.diff(one.integral(self.fixes.t_s + self._constant(constants, Unknown.GYRO_LAG)))
        return sides[0], sides[1], by_constants, measured - scale * about_own - bias * h

    def _steering(
        self, one: Reading, state: FloatArray, constants: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Jacobian, that of the constants, residual and sigma (infinite: says nothing) of steering angles."""
        forward, rate = self._ahead(state)[0], state[:, YAW_RATE]
        t_s = self.fixes.t_s + self._constant(constants, Unknown.STEERING_LAG)
        share = 0.5 * self.fixes.share_s
        drives = np.abs(forward) > _STEERS_ABOVE_MPS
        seen = drives & one.covers(t_s - share, t_s + share)
        measured = (one.integral(t_s + share) - one.integral(t_s - share)) / (2.0 * share)
        speed = np.where(drives, forward, 1.0)
        base_m = self.readings.wheelbase_m or _WHEELBASE_M
        scale = 1.0 + self._constant(constants, Unknown.STEERING_SCALE)
        more = self._constant(constants, Unknown.UNDERSTEER)
        geometric, pushed = np.arctan(base_m * rate / speed), speed * rate
        angle = geometric + more * pushed
        by_rate = base_m / speed / (1.0 + (base_m * rate / speed) ** 2) + more * speed
        jacobian = np.zeros((len(state), 1, state.shape[1]))
        jacobian[:, 0, YAW_RATE] = scale * by_rate
        by_constants = np.zeros((len(state), 1, constants.size))
        columns = {
            Unknown.STEERING_OFFSET: np.ones_like(angle),
            Unknown.STEERING_SCALE: angle,
            Unknown.UNDERSTEER: scale * pushed,
            Unknown.STEERING_LAG: -np.gradient(angle, self.fixes.t_s),
        }
        for which, column in columns.items():
            by_constants[:, 0, self.at_constant[which]] = column
        offset = self._constant(constants, Unknown.STEERING_OFFSET)
        sigma = np.where(seen, np.hypot(one.sigma.mean(), _STEERING_FLOOR_RAD), np.inf)
        return jacobian, by_constants, np.where(seen, measured - offset - scale * angle, 0.0), sigma


def _middle(values: FloatArray) -> FloatArray:
    """Between each knot and the next."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))
