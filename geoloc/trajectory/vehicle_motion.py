"""What a car measures of its own motion: speed over ground from wheels, rate of turn from a gyro or ESC."""

from __future__ import annotations

from dataclasses import dataclass

from geoloc.arrays import FloatArray, IntArray

__all__ = ["MotionSeries", "VehicleMotion"]


@dataclass(frozen=True, slots=True, eq=False)
class MotionSeries:
    """One measured quantity over time.

    Attributes
    ----------
    epoch_ns : int64 (n,)
        UTC epochs as stamped, increasing.
    values : float64 (n,)
        In the unit that the holder states.
    sigma : float64 (n,)
        One sigma of each value's own noise, in the same unit; NaN where nothing states it.
    lag_s : float
        How much later than the measurement the stamps are, as stated (0: not stated).
    lag_sigma_s : float
        One sigma of `lag_s`.
    """

    epoch_ns: IntArray
    values: FloatArray
    sigma: FloatArray
    lag_s: float = 0.0
    lag_sigma_s: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class VehicleMotion:
    """A drive's own measurements of motion, in the rig's frame (x forward, y left, z up).

    Scale of the wheels and bias of the gyro are unknowns of the smoother, not corrected here.

    Attributes
    ----------
    speed : MotionSeries or None
        Speed of the rear axle's middle along x, m/s; backwards is negative.
    turn_rate : MotionSeries or None
        Rate about z, rad/s; to the left (anticlockwise from above) is positive.
    wheel_angle : MotionSeries or None
        Angle of the front wheels against x, rad; to the left is positive.
    wheelbase_m : float or None
        Rear axle to front axle, as the rig's vehicle data have it.
    """

    speed: MotionSeries | None = None
    turn_rate: MotionSeries | None = None
    wheel_angle: MotionSeries | None = None
    wheelbase_m: float | None = None
