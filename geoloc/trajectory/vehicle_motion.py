"""What a car measures of its own motion: speed over ground from wheels, rate of turn from a gyro or ESC."""

from __future__ import annotations

from dataclasses import dataclass

from geoloc.arrays import FloatArray, IntArray

__all__ = ["MotionFound", "MotionSeries", "MotionValue", "VehicleMotion"]


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


@dataclass(frozen=True, slots=True)
class MotionValue:
    """What was found, and one sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class MotionFound:
    """What a trajectory found of a car's own sensors; None for what it has not.

    Attributes
    ----------
    wheel_scale : MotionValue or None
        Speed of the wheels over the true one, in the mean over the drive.
    gyro_bias_radps : MotionValue or None
        Of the turn rate, in the mean over the drive.
    gyro_scale : MotionValue or None
        Turn rate over the true one.
    wheel_lag_s, gyro_lag_s : MotionValue or None
        How much later than the measurement the stamps are.
    steering_offset_rad : MotionValue or None
        Angle that is read where the car goes straight.
    speed_sigma_mps, turn_rate_sigma_radps, wheel_angle_sigma_rad : float or None
        One sigma of a sample, where the series states none: from the series itself.
    turns_show : bool
        Whether the drive turned enough for the sign and unit of turns to be checked against the course.
    bridged_s : float
        Time for which there were no fixes, and poses are given all the same.
    """

    wheel_scale: MotionValue | None = None
    gyro_bias_radps: MotionValue | None = None
    gyro_scale: MotionValue | None = None
    wheel_lag_s: MotionValue | None = None
    gyro_lag_s: MotionValue | None = None
    steering_offset_rad: MotionValue | None = None
    speed_sigma_mps: float | None = None
    turn_rate_sigma_radps: float | None = None
    wheel_angle_sigma_rad: float | None = None
    turns_show: bool = False
    bridged_s: float = 0.0
