"""What the smoother found of a car's motion in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.trajectory.fix_checks import CODE_LASTS_S
from geoloc.trajectory.smoother.chain import Known
from geoloc.trajectory.smoother.state import (
    ACCELERATION,
    OWN,
    POSITION,
    VELOCITY,
    YAW,
    forward_axis,
    turned,
)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneTrack:
    """The state of the rig's origin at each knot; with one antenna and no lever arm, of that antenna.

    Attributes
    ----------
    state, covariance : float64 (n, d), (n, d, d)
        East, north (m), their rates (m/s, m/s²), yaw (rad, counter-clockwise from east), yaw rate (rad/s),
        then what lasts of the receivers' errors (`geoloc.trajectory.smoother.state`).
    constants, constants_covariance : float64 (c,), (c, c)
        Differences of the antennas' places, x then y (`antenna_modes`), how each heading of a receiver is
        turned against the car (rad), those of the car's own sensors (`odometry.Unknown`), the slip (rad per
        m/s²), and how far the rig's origin is ahead of the rear axle (m).
    weight : float64 (n, m)
        1 for a fix that fits, towards 0 for one that does not, and 0 for none.
    onward : Known or None
        For the window after this one (`chain.Window`).
    wander_m2ps : float
        By how much the variance of the place grows in a second that velocities alone bridge; infinite
        without.
    """

    state: FloatArray
    covariance: FloatArray
    constants: FloatArray
    constants_covariance: FloatArray
    weight: FloatArray
    onward: Known | None = None
    wander_m2ps: float = np.inf

    @property
    def slow_error(self) -> tuple[FloatArray, FloatArray]:
        """What lasts of the first antenna's error, in sigmas, east and north ``(n, 2)``; and its variance."""
        own = slice(OWN, OWN + 2)
        return self.state[:, own], np.diagonal(self.covariance, axis1=1, axis2=2)[:, own]

    @property
    def lasts_s(self) -> float:
        """Correlation time of what places are off.

        That of fixes without corrections, or longer where velocities say how the car went on: by them places
        a second apart differ by no more than they wander.
        """
        return max(CODE_LASTS_S, 2.0 * float(np.median(self.position_sigma_m**2)) / self.wander_m2ps)

    @property
    def position_m(self) -> FloatArray:
        """East and north ``(n, 2)``."""
        return self.state[:, POSITION]

    @property
    def velocity_mps(self) -> FloatArray:
        """East and north ``(n, 2)``."""
        return self.state[:, VELOCITY]

    @property
    def yaw_rad(self) -> FloatArray:
        """Counter-clockwise from east ``(n,)``, not wrapped."""
        return self.state[:, YAW]

    @property
    def yaw_sigma_rad(self) -> FloatArray:
        """One sigma ``(n,)``."""
        return np.sqrt(self.covariance[:, YAW, YAW])

    @property
    def slip_rad_per_mps2(self) -> tuple[float, float]:
        """Slip angle of the rear axle a lateral acceleration, and its sigma."""
        return float(self.constants[-2]), float(np.sqrt(self.constants_covariance[-2, -2]))

    @property
    def position_sigma_m(self) -> FloatArray:
        """One sigma a horizontal axis ``(n,)``, without what all antennas have in common."""
        return np.sqrt(0.5 * (self.covariance[:, 0, 0] + self.covariance[:, 1, 1]))

    @property
    def velocity_sigma_mps(self) -> FloatArray:
        """One sigma a horizontal axis ``(n,)``."""
        return np.sqrt(0.5 * (self.covariance[:, 2, 2] + self.covariance[:, 3, 3]))

    @property
    def forward_mps(self) -> FloatArray:
        """Speed along the heading ``(n,)``: negative where the car reverses."""
        return np.asarray(np.einsum("nk,nk->n", self.velocity_mps, forward_axis(self.yaw_rad)))

    @property
    def lateral_mps2(self) -> FloatArray:
        """Acceleration to the left ``(n,)``."""
        return np.asarray(
            np.einsum("nk,nk->n", self.state[:, ACCELERATION], turned(forward_axis(self.yaw_rad)))
        )
