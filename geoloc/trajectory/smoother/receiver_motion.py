"""Headings and velocities of receivers, as observations of the smoother in the plane.

A heading comes from two antennas of the receiver's own. Part of its error is new at every epoch, part lasts
as multipath does, and the antennas are mounted along the car only so well: that is a constant of the drive,
found where the car drives and kept where it stands, as the places of antennas are. A velocity comes from
Doppler shifts. Its errors last for about a second, by the receiver's filter and by the swaying of the roof:
two seconds of velocities count as one.
"""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.trajectory.smoother.chain import MEDIAN_1D, MEDIAN_2D, Chain, robust_weight
from geoloc.trajectory.smoother.knot_fixes import KnotFixes
from geoloc.trajectory.smoother.state import ACCELERATION, OWN, VELOCITY, YAW, YAW_RATE, forward_axis, turned

MOUNTED_RAD = np.radians(1.5)
"""How well the antennas of a heading are mounted along the car, one sigma: each to 2 cm, a metre apart."""
VELOCITY_EVERY_S = 2.0
"""Velocities of this time count as one."""
# As of fixes that are not carrier-phase solutions: what is new at every epoch, and what lasts.
_WHITE_SHARE, _LASTING_SHARE = 0.4, 0.9
# Antennas a metre apart do not do better than 2 mm of carrier-phase noise.
_HEADING_FLOOR_RAD = np.radians(0.1)
# A body that sways on its springs moves the roof by this, whatever the receiver says.
_VELOCITY_FLOOR_MPS = 0.03
# How late a filtered velocity may be.
_FILTER_LAG_S = 0.1


class Headings:
    """Headings at the knots, and the equations that they give.

    Parameters
    ----------
    fixes : KnotFixes
    first_constant : int
        Where the mounting errors stand among the constants of the drive, one an antenna with headings.
    """

    def __init__(self, fixes: KnotFixes, first_constant: int) -> None:
        self.fixes, self.first_constant = fixes, first_constant
        self.antennas: list[int] = fixes.heading_antennas.tolist()
        self.first_state = OWN + 2 * fixes.seen.shape[1]
        self.told: BoolArray = np.isfinite(fixes.heading_rad)
        self.sigma_rad = np.where(self.told, np.maximum(fixes.heading_sigma_rad, _HEADING_FLOOR_RAD), 1.0)
        self.weight: FloatArray = self.told.astype(np.float64)
        self.scale = np.ones(self.told.shape[1])

    def observe(self, chain: Chain, state: FloatArray, constants: FloatArray) -> None:
        """Add the equations at a state."""
        for i, antenna in enumerate(self.antennas):
            jacobian = np.zeros((len(state), 1, state.shape[1]))
            jacobian[:, 0, YAW], jacobian[:, 0, YAW_RATE] = 1.0, self.fixes.late_s[:, antenna]
            jacobian[:, 0, self.first_state + i] = self._lasting(antenna)
            by_constants = np.zeros((len(state), 1, constants.size))
            by_constants[:, 0, self.first_constant + i] = 1.0
            white = _WHITE_SHARE * self.sigma_rad[:, antenna] * self.scale[antenna]
            information = self.weight[:, antenna] / white**2
            residual = self._residual(i, antenna, state, constants)
            chain.observe(jacobian, residual[:, None], information[:, None], by_constants)

    def weigh(self, state: FloatArray, constants: FloatArray, power: int) -> None:
        """Take weight from headings that do not fit."""
        for i, antenna in enumerate(self.antennas):
            told = self.told[:, antenna]
            residual = np.abs(self._residual(i, antenna, state, constants)[told])
            off = residual / (_WHITE_SHARE * self.sigma_rad[told, antenna])
            self.weight[told, antenna], self.scale[antenna] = robust_weight(off, MEDIAN_1D, power)

    def _lasting(self, antenna: int) -> FloatArray:
        return np.asarray(_LASTING_SHARE * self.sigma_rad[:, antenna] * self.scale[antenna])

    def _residual(self, i: int, antenna: int, state: FloatArray, constants: FloatArray) -> FloatArray:
        late = self.fixes.late_s[:, antenna]
        expected = state[:, YAW] + late * state[:, YAW_RATE] + constants[self.first_constant + i]
        expected = expected + self._lasting(antenna) * state[:, self.first_state + i]
        off = (self.fixes.heading_rad[:, antenna] - expected + np.pi) % (2.0 * np.pi) - np.pi
        return np.where(self.told[:, antenna], off, 0.0)


class Velocities:
    """Velocities at the knots, and the equations that they give.

    Parameters
    ----------
    fixes : KnotFixes
    """

    def __init__(self, fixes: KnotFixes) -> None:
        self.fixes = fixes
        self.told: BoolArray = np.asarray(np.isfinite(fixes.velocity_mps[:, :, :2]).all(axis=2))
        sigma_mps = np.maximum(fixes.velocity_sigma_mps[:, :, 0], _VELOCITY_FLOOR_MPS)
        self.sigma_mps = np.where(self.told, sigma_mps, 1.0)
        self.antennas: list[int] = np.flatnonzero(self.told.any(axis=0)).tolist()
        self.weight: FloatArray = self.told.astype(np.float64)
        self.scale = np.ones(self.told.shape[1])

    def observe(self, chain: Chain, state: FloatArray, arms_m: FloatArray) -> None:
        """Add the equations at a state; `arms_m` as in `_residual`."""
        for antenna in self.antennas:
            late = self.fixes.late_s[:, antenna]
            jacobian = np.zeros((len(state), 2, state.shape[1]))
            for axis in range(2):
                jacobian[:, axis, VELOCITY.start + axis] = 1.0
                jacobian[:, axis, ACCELERATION.start + axis] = late
            if state.shape[1] > YAW:
                arm, rate = _arm(state, arms_m[:, antenna]), state[:, YAW_RATE, None]
                jacobian[:, :, YAW], jacobian[:, :, YAW_RATE] = -rate * arm, turned(arm)
            information = self._information(antenna, state)
            residual = self._residual(antenna, state, arms_m)
            chain.observe(jacobian, residual, np.repeat(information[:, None], 2, axis=1), None)

    def weigh(self, state: FloatArray, arms_m: FloatArray, power: int) -> None:
        """Take weight from velocities that do not fit."""
        for antenna in self.antennas:
            told = self.told[:, antenna]
            residual = self._residual(antenna, state, arms_m)[told]
            off = np.hypot(residual[:, 0], residual[:, 1]) / self._sigma(antenna, state)[told]
            self.weight[told, antenna], self.scale[antenna] = robust_weight(off, MEDIAN_2D, power)

    def wander_m2ps(self, state: FloatArray) -> float:
        """By how much the variance of a place grows in a second that velocities alone bridge.

        The median of the drive, an axis; infinite where half of it has no velocities.
        """
        a_second = np.zeros(len(state))
        for antenna in self.antennas:
            a_second += self._information(antenna, state) / self.fixes.fix_share_s[:, antenna]
        known = float(np.median(a_second))
        return 1.0 / known if known > 0.0 else np.inf

    def _information(self, antenna: int, state: FloatArray) -> FloatArray:
        count = np.minimum(1.0, self.fixes.fix_share_s[:, antenna] / VELOCITY_EVERY_S)
        # What velocities scatter beyond what is stated does not last: a roof that sways comes back.
        scatter = 1.0 + (self.scale[antenna] ** 2 - 1.0) * count
        return np.asarray(self.weight[:, antenna] * count / scatter / self._sigma(antenna, state) ** 2)

    def _sigma(self, antenna: int, state: FloatArray) -> FloatArray:
        lag = _FILTER_LAG_S * np.hypot(*state[:, ACCELERATION].T)
        return np.asarray(np.hypot(self.sigma_mps[:, antenna], lag))

    def _residual(self, antenna: int, state: FloatArray, arms_m: FloatArray) -> FloatArray:
        """Observed less expected ``(n, 2)``; `arms_m` ``(n, m, 2)`` lie ahead and left, level."""
        expected = state[:, VELOCITY] + self.fixes.late_s[:, antenna, None] * state[:, ACCELERATION]
        if state.shape[1] > YAW:
            expected = expected + state[:, YAW_RATE, None] * turned(_arm(state, arms_m[:, antenna]))
        off = self.fixes.velocity_mps[:, antenna, :2] - expected
        return np.where(self.told[:, antenna, None], off, 0.0)


def _arm(state: FloatArray, arm_m: FloatArray) -> FloatArray:
    """Where an antenna is from the rig's origin, east and north ``(n, 2)``."""
    axis = forward_axis(state[:, YAW])
    return np.asarray(arm_m[:, :1] * axis + arm_m[:, 1:] * turned(axis))
