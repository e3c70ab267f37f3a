"""Height, climb and crossfall of the road below the rig, by one least-squares fit to all heights of a drive.

State at each knot: height of the rig's origin, rise a metre ahead, rise a metre to the left beyond what roads
have, by how much the climb grows a metre ahead, and what multipath adds to each antenna's height. Climb and
crossfall change with the way driven, so that a car that stands keeps them. Vertical velocities of receivers
tell the climb too. With the track in the plane known, all of it is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.poses import LastingRoll
from geoloc.trajectory.smoother.chain import MEDIAN_1D, Chain, Known, Links, Window, robust_weight
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.plane import antenna_modes
from geoloc.trajectory.smoother.receiver_motion import VELOCITY_EVERY_S

# Roads climb by about 4 %, and their climb is another after a few hundred metres; crests and dips are metres
# to tens of metres long, so that it does not change at once. On five KITTI drives of 10.8 km together it
# changes by 0.6, 1.1, 1.4, 2.0, 2.7, 3.4 and 4.0 degrees (rms) in 10, 20, 30, 60, 120, 250 and 1000 m, in
# 60 m by 0.2 to 3.1 from drive to drive. These constants give 0.6, 0.9, 1.1, 1.6, 2.2, 2.8 and 3.5.
_CLIMB = np.tan(np.radians(2.5))
_CLIMB_LASTS_M, _CREST_LASTS_M = 250.0, 2.5
_CREST_PER_M = _CLIMB * np.sqrt((_CLIMB_LASTS_M + _CREST_LASTS_M) / _CREST_LASTS_M) / _CLIMB_LASTS_M
# A road falls to both sides of its crown, by 3 % where it is straight (Statens vegvesen, håndbok N100), so
# that a car on the right leans to the right. Bends that fall inwards, by up to 8 % and either way, yards and
# the car's springs make that 2 ± 3 %. Half of that is the drive's own mean, which no length of road averages
# out.
_CROSSFALL, _LEAN, _LASTING_LEAN = 0.02, 0.03, 0.015
_LEAN_LASTS_M = 300.0
# By the acceleration to the left, s²/m: roads fall inwards by up to 8 % in a bend, bodies lean outwards by 4
# degrees per g. Of accelerations as they tremble, a lean would be found that is too small.
_LEAN_IN_BENDS = 0.06
_SMOOTHED_S = 2.0
# Height over the road, m²/s: heave and roughness.
_HEAVE = 0.003**2
_RESTLESS = 1e-8
# What heave adds to a vertical velocity.
_RISE_FLOOR_MPS = 0.05
# A car stands on both its axles: its pitch is the road's slope half a wheelbase, 2.5 to 3.1 m, ahead of the
# rear axle. Taken for the slope below the rear axle, it is 85 ms ahead of its time at 60 km/h.
_HALF_WHEELBASE_M = 1.4
_ITERATIONS = 6
_OWN = 4


@dataclass(frozen=True, slots=True, eq=False)
class TiltTrack:
    """Attributes are float64 (n,), angles in degrees, ISO 8855; sigmas are one sigma.

    `height_m` is the rig's origin's; `height_sigma_m` lacks what a wrong roll moves that below antennas that
    sit aside.
    """

    height_m: FloatArray
    height_sigma_m: FloatArray
    pitch_deg: FloatArray
    pitch_sigma_deg: FloatArray
    roll_deg: FloatArray
    roll_sigma_deg: FloatArray
    lasting_roll: LastingRoll
    onward: Known | None = None
    """For the window after this one (`chain.Window`)."""


def smoothed_tilt(
    fixes: KnotFixes,
    levers_m: FloatArray,
    lever_sigma_m: float,
    forward_mps: FloatArray,
    lateral_mps2: FloatArray,
    window: Window | None = None,
) -> TiltTrack:
    """Fit heights, climb and crossfall.

    Parameters
    ----------
    fixes : KnotFixes
    levers_m : float64 (m, 3)
    lever_sigma_m : float
        One sigma of an antenna's height over the car, against the other antennas.
    forward_mps : float64 (n,)
        Speed along the heading, negative where the car reverses.
    lateral_mps2 : float64 (n,)
        Acceleration to the left.
    window : Window, optional
        The knots are part of a drive that is followed.
    """
    fit = _Fit(fixes, levers_m, forward_mps, fixes.running_mean(lateral_mps2, _SMOOTHED_S))
    fit.before = None if window is None else window.before
    state = np.zeros((len(forward_mps), _OWN + len(levers_m)))
    state[:, 0] = np.where(fixes.seen, fixes.height_m - levers_m[:, 2], 0.0).sum(axis=1) / np.maximum(
        fixes.seen.sum(axis=1), 1
    )
    constants = np.zeros(len(levers_m) + 1)
    weight = fixes.seen.astype(np.float64)
    for i in range(_ITERATIONS):
        chain = fit.equations(state, constants, weight, lever_sigma_m)
        step, step_constants = chain.solve()
        state, constants = state + step, constants + step_constants
        previous, weight = weight, fit.weights(state, constants, power=1 if i < _ITERATIONS // 2 else 2)
        if np.abs(weight - previous).max() < 0.02:
            break
    onward = None
    if window is not None:
        left = fit.equations(state, constants, weight, lever_sigma_m, until=window.leave)
        onward = left.known_at(window.leave, state, constants)
    covariance, shared = chain.covariances()
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    # The roll is the state's and the constants' own: how it moves with each of these.
    by_state = chain.by_constants()[:, 2]
    by_constants = by_state + np.pad(fit.of_the_drive, ((0, 0), (constants.size - 2, 0)))
    own = variance[:, 2] - np.einsum("nc,cd,nd->n", by_state, shared, by_state)
    lasting = np.einsum("nc,cd,nd->n", by_constants, shared, by_constants)
    part = np.linalg.lstsq(fit.of_the_drive, by_constants)[0]
    lean_sigma, shown_m = np.sqrt(own + lasting), np.mean(fit.aside_m)
    slope, slope_variance = _between_axles(fixes, forward_mps, state, covariance)
    return TiltTrack(
        height_m=state[:, 0],
        height_sigma_m=np.sqrt(np.maximum(variance[:, 0] - (shown_m * lean_sigma) ** 2, 0.0)),
        pitch_deg=-np.degrees(np.arctan(slope)),
        pitch_sigma_deg=np.degrees(np.sqrt(slope_variance)),
        roll_deg=np.degrees(np.arctan(_CROSSFALL + fit.of_the_drive @ constants[-2:] + state[:, 2])),
        roll_sigma_deg=np.degrees(lean_sigma),
        lasting_roll=LastingRoll(
            *np.degrees(np.sqrt(np.diagonal(part @ shared @ part.T))).tolist(),
            *np.degrees(part @ constants).tolist(),
        ),
        onward=onward,
    )


def _between_axles(
    fixes: KnotFixes, forward_mps: FloatArray, state: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Slope (n,) of the road between the axles, from that at the rear axle, and its variance.

    Where the drive ends nothing has rolled over what lies below the front axle: there the slope is that at
    the end, and known less by how roads grow steeper. By the growth that was found it would go on worse, for
    that is mostly noise: feet at 19 m came out a quarter farther off.
    """
    steps_m = np.linalg.norm(np.diff(fixes.path_m, axis=0), axis=1)
    tied_m = fixes.step_s * 0.5 * np.abs(forward_mps[1:] + forward_mps[:-1])
    way_m = np.concatenate([[0.0], np.cumsum(np.where(fixes.tied, tied_m, steps_m))])
    ahead_m = way_m + np.where(forward_mps < 0.0, -_HALF_WHEELBASE_M, _HALF_WHEELBASE_M)
    slope, variance = np.interp(ahead_m, way_m, state[:, 1]), covariance[:, 1, 1].copy()
    beyond = ahead_m > way_m[-1]
    left, noise = _road(ahead_m[beyond] - way_m[-1], np.ones(int(beyond.sum())))
    climbs = np.array([1, 3])
    last = covariance[-1][np.ix_(climbs, climbs)]
    variance[beyond] = np.einsum("nj,jk,nk->n", left[:, 0], last, left[:, 0]) + noise[:, 0, 0]
    return np.asarray(slope), variance


def _road(way_m: FloatArray, ahead: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How climb and its growth go on along a road: what is left of them, and the noise's covariance.

    The growth fades in `_CREST_LASTS_M`, the climb in `_CLIMB_LASTS_M`; both have their sigmas everywhere.

    Parameters
    ----------
    way_m, ahead : float64 (n,)
        How far, and 1 ahead or -1 backwards.

    Returns
    -------
    float64 (n, 2, 2), float64 (n, 2, 2)
    """
    climb, growth = np.exp(-way_m / _CLIMB_LASTS_M), np.exp(-way_m / _CREST_LASTS_M)
    left, everywhere = np.zeros((way_m.size, 2, 2)), np.zeros((way_m.size, 2, 2))
    left[:, 0, 0], left[:, 1, 1] = climb, growth
    left[:, 0, 1] = ahead * (climb - growth) / (1.0 / _CREST_LASTS_M - 1.0 / _CLIMB_LASTS_M)
    everywhere[:, 0, 0], everywhere[:, 1, 1] = _CLIMB**2, _CREST_PER_M**2
    everywhere[:, 0, 1] = everywhere[:, 1, 0] = ahead * _CLIMB**2 / _CLIMB_LASTS_M
    return left, everywhere - left @ everywhere @ left.swapaxes(1, 2)


def climb_ahead(way_m: FloatArray) -> FloatArray:
    """One sigma (n,) of how a road's climb, in the mean over so far, differs from that at its beginning.

    Of a climb that is another one after `_CLIMB_LASTS_M`: 0.4 degrees over 10 m, 0.8 over 40 m.
    """
    x = np.maximum(way_m, 1e-3) / _CLIMB_LASTS_M
    mean = (1.0 - np.exp(-x)) / x
    of_mean = 2.0 * (x - 1.0 + np.exp(-x)) / x**2
    return np.asarray(_CLIMB * np.sqrt(np.maximum(1.0 + of_mean - 2.0 * mean, 0.0)))


class _Fit:
    def __init__(
        self, fixes: KnotFixes, levers_m: FloatArray, forward_mps: FloatArray, lateral_mps2: FloatArray
    ) -> None:
        self.of_the_drive = np.stack([np.ones_like(lateral_mps2), lateral_mps2], axis=1)
        self.fixes, self.levers_m, self.forward_mps = fixes, levers_m, forward_mps
        self.modes = antenna_modes(len(levers_m))
        # How far aside each antenna shows a lean. The height of one alone shows none: the road climbs as
        # well, and a hill in a bend would be found to lean by degrees, which moves the roof aside.
        self.aside_m = levers_m[:, 1] if len(levers_m) > 1 else np.zeros(1)
        self.size = _OWN + len(levers_m)
        self.white_m, self.slow_m = fixes.up_over_plane * fixes.white_m, fixes.up_over_plane * fixes.slow_m
        self.rising = np.isfinite(fixes.velocity_mps[:, :, 2])
        self.scale = np.ones(len(levers_m))
        self.links = self._links()
        self.before: Known | None = None

    def equations(
        self,
        state: FloatArray,
        constants: FloatArray,
        weight: FloatArray,
        lever_sigma_m: float,
        until: int | None = None,
    ) -> Chain:
        chain = Chain(len(state), self.size, constants.size, until)
        if self.before is None:
            levers = np.full(len(self.modes), max(lever_sigma_m, 1e-6))
            sigma = np.append(levers, [_LASTING_LEAN, _LEAN_IN_BENDS])
            chain.expect_constants(-constants, sigma)
        else:
            off = self.before.mean - np.concatenate([state[0], constants])
            chain.expect_first(off, self.before.information)
        self._start(chain, state)
        chain.tie(self.links, state)
        for antenna in range(len(self.levers_m)):
            jacobian, by_constants, residual = self._fix(antenna, state, constants)
            variance = (self.white_m[:, antenna] * self.scale[antenna]) ** 2
            known = weight[:, antenna] * self.fixes.count[:, antenna]
            information = known / np.where(self.fixes.seen[:, antenna], variance, 1.0)
            chain.observe(jacobian, residual, information[:, None], by_constants)
            if self.rising[:, antenna].any():
                self._rise(chain, state, antenna)
        return chain

    def _rise(self, chain: Chain, state: FloatArray, antenna: int) -> None:
        """What a receiver's vertical velocity says of the climb."""
        rising = self.rising[:, antenna]
        jacobian = np.zeros((len(state), 1, self.size))
        jacobian[:, 0, 1] = self.forward_mps
        residual = (
            np.where(rising, self.fixes.velocity_mps[:, antenna, 2], 0.0) - self.forward_mps * state[:, 1]
        )
        sigma = np.maximum(self.fixes.velocity_sigma_mps[rising, antenna, 1], _RISE_FLOOR_MPS)
        weight, scale = robust_weight(np.abs(residual[rising]) / sigma, MEDIAN_1D, power=2)
        information = np.zeros(len(state))
        count = np.minimum(1.0, self.fixes.fix_share_s[rising, antenna] / VELOCITY_EVERY_S)
        information[rising] = weight * count / (sigma * scale) ** 2
        chain.observe(jacobian, residual[:, None], information[:, None], None)

    def weights(self, state: FloatArray, constants: FloatArray, power: int) -> FloatArray:
        weight = np.zeros(self.fixes.seen.shape)
        for antenna, seen in enumerate(self.fixes.seen.T):
            residual = np.abs(self._fix(antenna, state, constants)[2][seen, 0])
            off = residual / self.white_m[seen, antenna]
            weight[seen, antenna], self.scale[antenna] = robust_weight(off, MEDIAN_1D, power)
        return weight

    def _fix(
        self, antenna: int, state: FloatArray, constants: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        (x, y, z), aside = self.levers_m[antenna], self.aside_m[antenna]
        slow = self.slow_m[:, antenna] * self.fixes.slow_scale(antenna, self.scale[antenna])
        jacobian = np.zeros((len(state), 1, self.size))
        jacobian[:, 0, 0] = 1.0
        jacobian[:, 0, 1] = x + self.fixes.late_s[:, antenna] * self.forward_mps
        jacobian[:, 0, 2] = aside
        jacobian[:, 0, _OWN + antenna] = slow
        crossfall = _CROSSFALL + self.of_the_drive @ constants[-2:]
        upright = z / np.sqrt(1.0 + state[:, 1] ** 2 + (crossfall + state[:, 2]) ** 2)
        expected = (jacobian @ state[:, :, None])[:, 0, 0] + y * crossfall + upright
        expected += self.modes[:, antenna] @ constants[:-2]
        residual = np.where(self.fixes.seen[:, antenna], self.fixes.height_m[:, antenna] - expected, 0.0)
        by_constants = np.zeros((len(state), 1, constants.size))
        by_constants[:, 0, :-2] = self.modes[:, antenna]
        by_constants[:, 0, -2:] = aside * self.of_the_drive
        return jacobian, by_constants, residual[:, None]

    def _start(self, chain: Chain, state: FloatArray) -> None:
        sigma = np.append([100.0, _CLIMB, _LEAN, _CREST_PER_M], np.ones(self.size - _OWN))
        weight = np.where(self.fixes.first[:, None], sigma**-2.0, 0.0)
        weight[1 if self.before is None else 0 :, 1:] = 0.0
        residual = -state
        residual[:, 0] = 0.0
        chain.observe(
            np.broadcast_to(np.eye(self.size), (len(state), self.size, self.size)), residual, weight, None
        )

    def _links(self) -> Links:
        h, size = self.fixes.step_s, self.size
        tied = self.fixes.tied
        along = h * 0.5 * (self.forward_mps[1:] + self.forward_mps[:-1])
        way = np.where(tied, np.abs(along), np.linalg.norm(np.diff(self.fixes.path_m, axis=0), axis=1))
        here, there = np.zeros((h.size, size, size)), np.zeros((h.size, size, size))
        here[:], there[:] = np.eye(size), np.eye(size)
        here[:, 0, 1], there[:, 0, 1] = 0.5 * along, -0.5 * along
        information = np.zeros((h.size, size, size))
        information[:, 0, 0] = np.where(tied, 1.0 / (_HEAVE * h), 0.0)
        climbs = np.ix_(np.arange(h.size), np.array([1, 3]), np.array([1, 3]))
        here[climbs], noise = _road(way, np.where(along < 0.0, -1.0, 1.0))
        restless = _RESTLESS * h[:, None, None] * np.diag([1.0, _CREST_LASTS_M**-2])
        information[climbs] = np.linalg.inv(noise + restless)
        fading = np.exp(-way / _LEAN_LASTS_M)
        here[:, 2, 2] = fading
        information[:, 2, 2] = 1.0 / (_LEAN**2 * (1.0 - fading**2) + _RESTLESS * h)
        fading = self.fixes.slow_fades
        own = np.arange(_OWN, size)
        here[:, own, own] = fading
        information[:, own, own] = 1.0 / np.maximum(1.0 - fading**2, 1e-9)
        return Links(here, there, information)
