"""The rig's track in the plane, by one least-squares fit to all fixes of a drive.

State at each knot: position, velocity, acceleration, yaw (counter-clockwise from east), yaw rate, and what
multipath adds to each antenna (and to each heading of a receiver). Shared by the drive: how far the antennas
sit from where their lever arms say, relative to each other, how a receiver's heading is turned against the
car, and how much the rear axle slips in bends. Tied together by:

- each fix, at its own epoch, with its lever arm;
- headings and velocities that receivers have of themselves (`geoloc.trajectory.smoother.receiver_motion`);
- a jerk and a yaw acceleration that are noise of the size that driving has;
- the rear axle, which does not move sideways but for that slip;
- the path's curvature: a car that stands does not turn;
- what the car measures of its own motion (`geoloc.trajectory.smoother.odometry`).

Gauss–Newton with iterated weights (Huber's first, then the square of them, so that a fix metres away has no
say) on the banded normal equations of `geoloc.trajectory.smoother.chain`.
"""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.smoother.chain import MEDIAN_2D, Chain, Known, Links, Window, robust_weight
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.odometry import MotionOnRoad, Odometry, shows_slip, unknowns
from geoloc.trajectory.smoother.plane_track import PlaneTrack
from geoloc.trajectory.smoother.receiver_motion import MOUNTED_RAD, Headings, Velocities
from geoloc.trajectory.smoother.state import (
    ACCELERATION,
    OWN,
    POSITION,
    VELOCITY,
    YAW,
    YAW_RATE,
    forward_axis,
    turned,
)

# Jerk of driving, m/s³ √s: its square is a spectral density. By how much the acceleration of five KITTI
# drives is another half a second to four seconds later says 0.5 to 0.9 in towns, along and across, 0.1 to 0.2
# on a straight road. Within a drive 4 seconds have 0.1 to 0.6 half of the time, and 1.4 to 2.2 in the
# sharpest bends: each stretch has its own.
_JERK = 0.7
_CALMEST_JERK = 0.4
_JERK_LAG_S, _JERK_OVER_S = 1.0, 4.0
# What a point on the ground below the axle does besides, m²/s: wheels on a rough road.
_JOLT = 0.002**2
# Jerk across, over the speed, is a yaw acceleration: but for a wheel that turns only so fast; and where the
# speed changes in a bend, so does the yaw rate.
_STEERING_BELOW_MPS = 2.0
_STOPPING_RADPS2 = 0.05
_YAW_WANDER = np.radians(0.02) ** 2
# A standing car does not turn, a moving one along a radius of 10 m (one sigma) or more.
_TURN_STANDING_RADPS = np.radians(0.05)
_CURVATURE_PER_M = 0.1
# What a rear axle does sideways besides its slip: every 0.2 s.
_SIDEWAYS_MPS = 0.01
_SIDEWAYS_RAD = np.radians(0.1)
_SIDEWAYS_EVERY_S = 0.2
_SMOOTHED_S = 1.0
SLIP_RAD_PER_MPS2 = (np.radians(0.25), np.radians(0.15))
"""Slip angle of the rear axle a lateral acceleration, and its sigma: 2 to 3° per g for passenger cars."""
AXLE_KNOWN_M = (0.0, 1e-3)
"""How far ahead of the rear axle the rig's origin is, and its sigma: there, by definition."""
_HEADING_LASTS_S = 10.0
# Before anything is known, at the first knot of a stretch.
_START_SIGMA = np.array([100.0, 100.0, 50.0, 50.0, 5.0, 5.0, 2.0, 1.0])
_GATE = 3.0
_TURN_LIMIT_RAD = 0.7

_JERK_SHAPE = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1.0]])
_TURN_SHAPE = np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])


def sideways_rad(speed_mps: FloatArray) -> FloatArray:
    """One sigma of the angle by which a rear axle rolls aside of its way, besides its slip.

    As the fit takes it, the heading of a moving car trembles by about as much.
    """
    return np.asarray(np.hypot(_SIDEWAYS_MPS / np.maximum(speed_mps, 1e-3), _SIDEWAYS_RAD))


def antenna_modes(antennas: int) -> FloatArray:
    """Orthonormal ways ``(antennas - 1, antennas)`` for antennas to sit wrong without moving their mean.

    An error that they share moves the car and is not observable; it is in no covariance here.
    """
    from scipy.linalg import helmert

    return np.asarray(helmert(antennas)) if antennas > 1 else np.zeros((0, 1))


def smoothed_plane(
    fixes: KnotFixes,
    levers_m: FloatArray,
    lever_sigma_m: float,
    start: PlaneTrack,
    *,
    drift_mps: FloatArray | None = None,
    axle_m: tuple[float, float] = AXLE_KNOWN_M,
    motion: MotionOnRoad | None = None,
    iterations: int = 8,
    window: Window | None = None,
) -> PlaneTrack:
    """Fit the track.

    Parameters
    ----------
    fixes : KnotFixes
    levers_m : float64 (n, m, 2)
        Where each antenna sits ahead of and left of the rig's origin, level: a tilted car leans.
    lever_sigma_m : float
        One sigma of an antenna's place, an axis.
    start : PlaneTrack
        State, constants and weights to start from; without constants, from what is expected of them.
    drift_mps : float64 (n,), optional
        One sigma of a velocity that the antennas show of themselves, an axis: a rear axle that rolls no
        faster says nothing of the heading. Without it the antennas are points that have no heading.
    axle_m : (float, float)
        How far ahead of the rear axle the origin is, and one sigma of that, where lever arms are unknown.
    motion : MotionOnRoad, optional
        Only with `drift_mps`.
    window : Window, optional
        The knots are part of a drive that is followed.
    """
    fit = _Fit(fixes, levers_m, lever_sigma_m, drift_mps, axle_m, motion, start)
    fit.before = None if window is None else window.before
    state, constants, weight = fit.state.copy(), fit.constants.copy(), start.weight
    for i in range(iterations):
        chain = fit.equations(state, constants, weight)
        step, step_constants = chain.solve()
        step[:, YAW:YAW_RATE] = np.clip(step[:, YAW:YAW_RATE], -_TURN_LIMIT_RAD, _TURN_LIMIT_RAD)
        state, constants = state + step, constants + step_constants
        previous, weight = weight, fit.weights(state, constants, power=1 if i < iterations // 2 else 2)
        settled = np.abs(step[:, :OWN]).max() < 1e-4 and np.abs(weight - previous).max() < 0.02
        if settled and i >= iterations // 2:
            break
    covariance, shared = chain.covariances()
    if not fit.slip_shows:  # nothing was learned of it, but the track is no surer for that
        by_slip = chain.by_constants()[:, :, -2]
        covariance = covariance + SLIP_RAD_PER_MPS2[1] ** 2 * by_slip[:, :, None] * by_slip[:, None, :]
        shared[-2, -2] += SLIP_RAD_PER_MPS2[1] ** 2
    onward = None
    if window is not None:
        left = fit.equations(state, constants, weight, until=window.leave)
        onward = left.known_at(window.leave, state, constants)
    wander_m2ps = fit.velocities.wander_m2ps(state)
    return PlaneTrack(state, covariance, constants, shared, weight, onward, wander_m2ps)


class _Fit:
    """The equations of one drive, linearised about any state."""

    def __init__(
        self,
        fixes: KnotFixes,
        levers_m: FloatArray,
        lever_sigma_m: float,
        drift_mps: FloatArray | None,
        axle_m: tuple[float, float],
        motion: MotionOnRoad | None,
        start: PlaneTrack,
    ) -> None:
        self.fixes, self.levers_m, self.drift_mps = fixes, levers_m, drift_mps
        self.modes = antenna_modes(levers_m.shape[1])
        self.velocities = Velocities(fixes)
        self.headings = None if drift_mps is None else Headings(fixes, 2 * len(self.modes))
        told = 0 if self.headings is None else len(self.headings.antennas)
        self.size = 6 if drift_mps is None else OWN + 2 * levers_m.shape[1] + told
        modes = 2 * len(self.modes)
        own = {} if motion is None else unknowns(motion.readings, motion.lasting)
        mean = [one[0] for one in own.values()]
        self.prior = np.concatenate([np.zeros(modes + told), mean, [SLIP_RAD_PER_MPS2[0], axle_m[0]]])
        sigma = [max(lever_sigma_m, 1e-6)] * modes + [MOUNTED_RAD] * told + [one[1] for one in own.values()]
        self.odometry = None if motion is None else Odometry(fixes, motion, self.size, modes + told)
        self.size += 0 if self.odometry is None else len(self.odometry.at_state)
        # One antenna shows a course, and whatever the slip, some heading fits it exactly. Only by how
        # smoothly that heading turns is one slip likelier than another, and drivers' hands are no white
        # noise: found from that, the slip of real drives is off by up to five of its sigmas.
        self.slip_shows = bool(len(self.modes) or told)
        self.slip_shows |= motion is not None and shows_slip(motion.readings)
        slip_sigma = SLIP_RAD_PER_MPS2[1] if self.slip_shows else 1e-6
        self.prior_sigma = np.append(sigma, [slip_sigma, axle_m[1]])
        self.scale = np.ones(levers_m.shape[1])
        self.constants = start.constants if start.constants.size else self.prior
        self.state = np.pad(start.state, ((0, 0), (0, self.size - start.state.shape[1])))
        self.links = self._links(self.state)
        self.before: Known | None = None
        if self.headings is not None:  # a point's velocity is not known to begin with
            self.headings.weigh(self.state, self.constants, power=1)
            self.velocities.weigh(self.state, self._sits(self.constants), power=1)
        if self.odometry is not None:
            self.odometry.weigh(self.state, self.constants, power=1)

    def equations(
        self, state: FloatArray, constants: FloatArray, weight: FloatArray, until: int | None = None
    ) -> Chain:
        """Normal equations at a state."""
        chain = Chain(len(state), self.size, constants.size, until)
        if self.before is None:
            chain.expect_constants(self.prior - constants, self.prior_sigma)
        else:
            off = self.before.mean - np.concatenate([state[0], constants])
            off[YAW] = (off[YAW] + np.pi) % (2.0 * np.pi) - np.pi
            chain.expect_first(off, self.before.information)
        self._start(chain, state)
        chain.tie(self.links, state)
        for antenna in range(self.levers_m.shape[1]):
            jacobian, by_constants, residual = self._fix(antenna, state, constants)
            variance = (self.fixes.white_m[:, antenna] * self.scale[antenna]) ** 2
            known = weight[:, antenna] * self.fixes.count[:, antenna]
            information = known / np.where(self.fixes.seen[:, antenna], variance, 1.0)
            chain.observe(jacobian, residual, np.repeat(information[:, None], 2, axis=1), by_constants)
        self.velocities.observe(chain, state, self._sits(constants))
        if self.headings is not None:
            self.headings.observe(chain, state, constants)
        if self.odometry is not None:
            self.odometry.observe(chain, state, constants)
        if self.drift_mps is not None:
            self._axle(chain, state, constants, self.drift_mps)
        return chain

    def weights(self, state: FloatArray, constants: FloatArray, power: int) -> FloatArray:
        """Weight of each fix by its residual; also widens the noise of an antenna that scatters more.

        Headings and velocities are weighed along with them, and keep their own weights.
        """
        self.velocities.weigh(state, self._sits(constants), power)
        if self.headings is not None:
            self.headings.weigh(state, constants, power)
        if self.odometry is not None:
            self.odometry.weigh(state, constants, power)
        weight = np.zeros(self.fixes.seen.shape)
        for antenna, seen in enumerate(self.fixes.seen.T):
            residual = self._fix(antenna, state, constants)[2][seen]
            off = np.hypot(residual[:, 0], residual[:, 1]) / self.fixes.white_m[seen, antenna]
            weight[seen, antenna], self.scale[antenna] = robust_weight(off, MEDIAN_2D, power)
        return weight

    def _fix(
        self, antenna: int, state: FloatArray, constants: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Jacobian, that of the constants, and residual (n, 2) of one antenna."""
        late = self.fixes.late_s[:, antenna, None]
        expected = state[:, POSITION] + late * state[:, VELOCITY] + 0.5 * late**2 * state[:, ACCELERATION]
        jacobian = np.zeros((len(state), 2, self.size))
        for axis in range(2):
            jacobian[:, axis, axis] = 1.0
            jacobian[:, axis, 2 + axis] = late[:, 0]
            jacobian[:, axis, 4 + axis] = 0.5 * late[:, 0] ** 2
        by_constants = np.zeros((len(state), 2, constants.size))
        if self.drift_mps is not None:
            mode, c = self.modes[:, antenna], len(self.modes)
            sits = self._sits(constants)[:, antenna]
            ahead = forward_axis(state[:, YAW] + late[:, 0] * state[:, YAW_RATE])
            arm = sits[:, :1] * ahead + sits[:, 1:] * turned(ahead)
            jacobian[:, :, YAW] = turned(arm)
            jacobian[:, :, YAW_RATE] = late * turned(arm)
            own = OWN + 2 * antenna
            slow = self.fixes.slow_m[:, antenna] * self.fixes.slow_scale(antenna, self.scale[antenna])
            jacobian[:, 0, own] = jacobian[:, 1, own + 1] = slow
            expected = expected + arm + slow[:, None] * state[:, own : own + 2]
            by_constants[:, :, :c] = ahead[:, :, None] * mode
            by_constants[:, :, c : 2 * c] = turned(ahead)[:, :, None] * mode
            leans = None if self.odometry is None else self.odometry.leans_m(antenna)
            if leans is not None:
                by_constants[:, :, leans[0]] = leans[1][:, None] * turned(ahead)
                expected = expected + constants[leans[0]] * by_constants[:, :, leans[0]]
        residual = np.where(self.fixes.seen[:, antenna, None], self.fixes.plane_m[:, antenna] - expected, 0.0)
        return jacobian, by_constants, residual

    def _sits(self, constants: FloatArray) -> FloatArray:
        """Where the antennas are found to sit ahead of and left of the origin ``(n, m, 2)``."""
        c = len(self.modes)
        return self.levers_m + (self.modes.T @ constants[: 2 * c].reshape(2, c).T)

    def _start(self, chain: Chain, state: FloatArray) -> None:
        """What is known at the first knot of each stretch: next to nothing; yaw and multipath go on."""
        sigma = np.append(_START_SIGMA, np.ones(self.size))[: self.size]
        residual = -state
        residual[:, POSITION] += self.fixes.path_m
        residual[:, YAW:YAW_RATE] = 0.0
        weight = np.where(self.fixes.first[:, None], sigma**-2.0, 0.0)
        goes_on = slice(0 if self.before is not None else 1, None)
        weight[goes_on, YAW:YAW_RATE] *= 1e-2
        weight[goes_on, OWN:] = 0.0
        unit = np.broadcast_to(np.eye(self.size), (len(state), self.size, self.size))
        chain.observe(unit, residual, weight, None)

    def _links(self, start: FloatArray) -> Links:
        """How each state follows from the one before; the driver is as lively as in `start`."""
        h, tied, size = self.fixes.step_s, self.fixes.tied, self.size
        forward = np.zeros((h.size, size, size))
        forward[:] = np.eye(size)
        for axis in range(2):
            forward[:, axis, 2 + axis] = forward[:, 2 + axis, 4 + axis] = h
            forward[:, axis, 4 + axis] = 0.5 * h**2
        information = np.zeros((h.size, size, size))
        acceleration = start[:, ACCELERATION]
        point = self.drift_mps is None  # its accelerations are not known to begin with
        driving = np.full_like(h, _JERK) if point else self._jerk(acceleration)
        jerk = _process(h, driving**2, _JERK_SHAPE)
        jerk[:, 0, 0] += _JOLT * h
        driven = np.where(tied[:, None, None], np.linalg.inv(jerk), 0.0)
        information[:, 0:6:2, 0:6:2] = information[:, 1:6:2, 1:6:2] = driven
        if not point:
            speed = np.hypot(*start[:, VELOCITY].T)
            mean = 0.5 * (speed[1:] + speed[:-1])
            across = np.einsum("nk,nk->n", acceleration, turned(forward_axis(start[:, YAW])))
            steering = self._jerk(across[:, None]) * mean / np.maximum(mean, _STEERING_BELOW_MPS) ** 2
            steering = np.maximum(steering, _STOPPING_RADPS2)
            turn = _process(h, steering**2, _TURN_SHAPE)
            turn[:, 0, 0] += _YAW_WANDER * h
            forward[:, YAW, YAW_RATE] = np.where(tied, h, 0.0)
            information[:, 6:8, 6:8] = np.where(tied[:, None, None], np.linalg.inv(turn), 0.0)
            information[:, YAW, YAW] += np.where(tied, 0.0, self._held())
            own, moved = np.arange(OWN, size), np.zeros((h.size, 0))
            if self.odometry is not None:
                moved = self.odometry.fades
            told = size - OWN - 2 * self.levers_m.shape[1] - moved.shape[1]
            headings = np.repeat(np.exp(-h / _HEADING_LASTS_S)[:, None], told, axis=1)
            fading = np.column_stack([np.repeat(self.fixes.slow_fades, 2, axis=1), headings, moved])
            forward[:, own, own] = fading
            information[:, own, own] = 1.0 / np.maximum(1.0 - fading**2, 1e-9)
        return Links(forward, np.broadcast_to(np.eye(size), forward.shape), information)

    def _jerk(self, acceleration_mps2: FloatArray) -> FloatArray:
        """Jerk at each link ``(n - 1,)``, from by how much accelerations ``(n, k)`` change about it."""
        t_s = self.fixes.t_s
        ends = [
            np.stack([np.interp(t_s + off_s, t_s, axis) for axis in acceleration_mps2.T], axis=1)
            for off_s in (-0.5 * _JERK_LAG_S, 0.5 * _JERK_LAG_S)
        ]
        squares = ((ends[1] - ends[0]) ** 2).sum(axis=1) / _JERK_LAG_S
        jerk = np.sqrt(self.fixes.running_mean(squares, _JERK_OVER_S))
        return np.asarray(np.maximum(_CALMEST_JERK, np.maximum(jerk[1:], jerk[:-1])))

    def _held(self) -> FloatArray:
        """Information that the yaw carries over a gap: little where the car has moved."""
        moved = np.linalg.norm(np.diff(self.fixes.path_m, axis=0), axis=1)
        variance = (np.radians(0.05) * self.fixes.step_s) ** 2 + (np.radians(2.0) * moved) ** 2
        return np.where(variance < np.radians(15.0) ** 2, 1.0 / np.maximum(variance, 1e-9), 0.0)

    def _axle(self, chain: Chain, state: FloatArray, constants: FloatArray, drift_mps: FloatArray) -> None:
        """The rear axle does not move sideways but slips in bends; a car that stands does not turn."""
        ahead = forward_axis(state[:, YAW])
        velocity, acceleration, rate = state[:, VELOCITY], state[:, ACCELERATION], state[:, YAW_RATE]
        slip, axle = constants[-2:]
        forward, left = (np.einsum("nk,nk->n", velocity, axis) for axis in (ahead, turned(ahead)))
        # Smoothed, and known while the states move: what trembles in the accelerations has nothing to do with
        # the heading, so that it would be found to slip by nothing.
        sideways = self.fixes.running_mean(np.einsum("nk,nk->n", acceleration, turned(ahead)), _SMOOTHED_S)
        drift = slip * np.abs(forward)
        jacobian = np.zeros((len(state), 2, self.size))
        jacobian[:, 0, VELOCITY] = turned(ahead)
        jacobian[:, 0, YAW] = -forward
        jacobian[:, 0, YAW_RATE] = -axle
        jacobian[:, 1, YAW_RATE] = 1.0
        by_constants = np.zeros((len(state), 2, constants.size))
        by_constants[:, 0, -2], by_constants[:, 0, -1] = np.abs(forward) * sideways, -rate
        residual = -np.stack([left + drift * sideways - axle * rate, rate], axis=1)
        share = self.fixes.share_s
        speed = np.abs(forward)
        loose = _SIDEWAYS_MPS**2 + (_SIDEWAYS_RAD * speed) ** 2
        turning = (_TURN_STANDING_RADPS + _CURVATURE_PER_M * speed) ** 2
        # Noise in the place of a velocity has a direction too: it must not be taken for the heading.
        real = np.maximum(0.0, 1.0 - (_GATE * drift_mps / np.maximum(speed, 1e-9)) ** 2)
        weight = np.stack([real * share / _SIDEWAYS_EVERY_S / loose, share / turning], axis=1)
        chain.observe(jacobian, residual, weight, by_constants)


def _process(step_s: FloatArray, density: FloatArray | float, shape: FloatArray) -> FloatArray:
    """Covariance of integrated white noise over each step."""
    order = len(shape)
    power = step_s[:, None] ** np.arange(order - 1, -1, -1)
    scale = np.broadcast_to(np.asarray(density) * step_s, step_s.shape)[:, None, None]
    return np.asarray(scale * power[:, :, None] * power[:, None, :] * shape)
