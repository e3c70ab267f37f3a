"""What sensors deliver one by one while a drive goes on, and the arrays that estimators take."""

from __future__ import annotations

from bisect import insort
from collections.abc import Mapping, Sequence
from enum import StrEnum
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from geoloc.trajectory.poses import GnssFixes
from geoloc.trajectory.vehicle_motion import MotionSeries, VehicleMotion

_NAN = float("nan")
_by_epoch = attrgetter("epoch_ns")


class Fix(NamedTuple):
    """One position of an antenna; the meanings are those of `GnssFixes`."""

    antenna: str
    epoch_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    quality: int
    sigma_horizontal_m: float = _NAN
    sigma_vertical_m: float = _NAN
    heading_deg: float = _NAN
    heading_sigma_deg: float = _NAN
    velocity_mps: tuple[float, float, float] = (_NAN, _NAN, _NAN)
    velocity_sigma_mps: tuple[float, float] = (_NAN, _NAN)


class Quantity(StrEnum):
    """What a sensor of the car's own motion measures; the meanings are those of `VehicleMotion`."""

    SPEED = "speed"
    TURN_RATE = "turn_rate"
    WHEEL_ANGLE = "wheel_angle"


class MotionSample(NamedTuple):
    """One value of the car's own motion: m/s or rad/s or rad, and one sigma of its noise (NaN: unknown)."""

    quantity: Quantity
    epoch_ns: int
    value: float
    sigma: float = _NAN


class Lag(NamedTuple):
    """How much later than the measurement the stamps of a quantity are, as stated, and one sigma of that."""

    lag_s: float = 0.0
    sigma_s: float = 0.1


def gnss_fixes(antenna: str, fixes: Sequence[Fix]) -> GnssFixes:
    """Lay out fixes of one antenna, in order of time, as columns."""
    epoch_ns = np.array([one.epoch_ns for one in fixes], dtype=np.int64)
    rows = np.array([one[2:10] for one in fixes], dtype=np.float64).reshape(-1, 8)
    latitude, longitude, height, quality, sigma, sigma_up, heading, heading_sigma = rows.T
    return GnssFixes(
        antenna=antenna,
        epoch_ns=epoch_ns,
        host_ns=epoch_ns,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        quality=quality.astype(np.int64),
        sigma_horizontal_m=sigma,
        sigma_vertical_m=sigma_up,
        heading_deg=heading,
        heading_sigma_deg=heading_sigma,
        velocity_mps=np.array([one.velocity_mps for one in fixes], dtype=np.float64).reshape(-1, 3),
        velocity_sigma_mps=np.array([one.velocity_sigma_mps for one in fixes]).reshape(-1, 2),
    )


class MotionBuffer:
    """The last samples of the car's own motion, in order of time however late they arrive."""

    def __init__(self, lags: Mapping[Quantity, Lag], wheelbase_m: float | None) -> None:
        self._lags, self._wheelbase_m = lags, wheelbase_m
        self._samples: dict[Quantity, list[MotionSample]] = {}

    def add(self, sample: MotionSample) -> None:
        """Take a sample; a second one of the same epoch is left out."""
        held = self._samples.setdefault(sample.quantity, [])
        if held and sample.epoch_ns <= held[-1].epoch_ns:
            if any(one.epoch_ns == sample.epoch_ns for one in held):
                return
            insort(held, sample, key=_by_epoch)
        else:
            held.append(sample)

    def forget(self, before_ns: int) -> None:
        """Drop samples before an epoch."""
        for held in self._samples.values():
            keep = next((i for i, one in enumerate(held) if one.epoch_ns >= before_ns), len(held))
            del held[:keep]

    def motion(self) -> VehicleMotion | None:
        """All that is held; None without a speed or a turning of two samples."""
        series = {
            quantity.value: self._series(quantity, held)
            for quantity, held in self._samples.items()
            if len(held) > 1
        }
        return VehicleMotion(**series, wheelbase_m=self._wheelbase_m) if series else None

    def _series(self, quantity: Quantity, held: Sequence[MotionSample]) -> MotionSeries:
        lag = self._lags.get(quantity, Lag())
        return MotionSeries(
            np.array([one.epoch_ns for one in held], dtype=np.int64),
            np.array([one.value for one in held]),
            np.array([one.sigma for one in held]),
            lag.lag_s,
            lag.sigma_s,
        )
