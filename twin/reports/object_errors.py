"""The error of each estimate against its surveyed position: a row an object, for tables and spreadsheets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import grid_convergence_deg, utm33_from_geographic
from geoloc.locate.accuracy import nees
from geoloc.locate.combine import SIGMAS_95, ellipse
from twin.reports.pairing import Placed
from twin.reports.truth import Truth
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Store
from twin.tables import records_csv

INSIDE_95 = SIGMAS_95**2
"""95 % of χ² with two degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Way:
    """Where a car was and which way it pointed, in the order of time.

    Attributes
    ----------
    place_m : float64 (n, 2)
        EPSG:25833.
    forward : float64 (n, 2)
        Unit vectors, grid axes.
    epoch_ns : int64 (n,)
        Increasing.
    """

    place_m: FloatArray
    forward: FloatArray
    epoch_ns: IntArray

    def at(self, epoch_ns: IntArray) -> FloatArray:
        """Where the car was at some epochs (m,): float64 (m, 2); outside, where it was first or last."""
        since = self.epoch_ns[0]
        asked, passed = (epoch_ns - since).astype(np.float64), (self.epoch_ns - since).astype(np.float64)
        return np.column_stack([np.interp(asked, passed, self.place_m[:, axis]) for axis in (0, 1)])

    def passing(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Which way the car pointed where it came nearest to a place; of several such, the first."""
        nearest = int(np.argmin(np.hypot(self.place_m[:, 0] - east_m, self.place_m[:, 1] - north_m)))
        east, north = self.forward[nearest]
        return float(east), float(north)


@dataclass(frozen=True, slots=True)
class ObjectError:
    """Estimate minus survey of one object; None where a survey or a method does not tell.

    Attributes
    ----------
    error_east_m, error_north_m : float
        Grid axes of EPSG:25833.
    error_forward_m, error_left_m : float
        The same forward, and to the left, of the car where it came nearest to the object; where it stopped
        before, that is where it saw it best.
    error_m : float
        Horizontal.
    error_height_m : float or None
        Ellipsoidal.
    sigma_major_m, sigma_minor_m, sigma_height_m : float or None
        One sigma along and across the estimate's error ellipse, and of its height.
    nees_per_dof, height_nees_per_dof : float or None
        Squared error in sigmas, divided by its degrees of freedom (2 and 1): 1 on average where the stated
        errors are honest.
    inside95 : bool or None
        Whether the survey lies inside the 95 % ellipse.
    camera : str
        Those that saw it, joined by +.
    range_m, speed_mps : float or None
        Of its nearest sighting, from the camera; the car's mean while it saw the object.
    """

    method: str
    drive_id: str
    object: str
    truth: str
    error_east_m: float
    error_north_m: float
    error_forward_m: float
    error_left_m: float
    error_m: float
    error_height_m: float | None
    sigma_major_m: float | None
    sigma_minor_m: float | None
    sigma_height_m: float | None
    nees_per_dof: float | None
    height_nees_per_dof: float | None
    inside95: bool | None
    camera: str
    range_m: float | None
    speed_mps: float | None


@dataclass(frozen=True, slots=True)
class HeightErrors:
    """Errors in height of the objects whose survey has one; None where there is none.

    Attributes
    ----------
    nees_per_dof : float or None
        Mean squared error in sigmas, of the estimates that state one; its degree of freedom is 1.
    """

    n: int
    mean: float | None
    rmse: float | None
    nees_per_dof: float | None


def object_errors(pairs: Sequence[tuple[Placed, Truth]], ways: Mapping[str, Way]) -> tuple[ObjectError, ...]:
    """Compare estimates with their surveyed positions, one by one.

    Parameters
    ----------
    pairs : sequence of (Placed, Truth)
    ways : mapping of drive id → Way
        Of every drive that has estimates.
    """
    return tuple(_object_error(placed, truth, ways[placed.drive_id]) for placed, truth in pairs)


def driven_ways(store: Store) -> dict[str, Way]:
    """Where each drive of a store went."""
    rows = store.rows(sa.select(schema.drive.c.drive_id, schema.drive.c.poses))
    return {row["drive_id"]: _way(row["poses"]) for row in rows}


def _way(blob: bytes) -> Way:
    poses = poses_from_blob(blob)
    lat, lon = poses.latitude_deg, poses.longitude_deg
    grid = np.radians(poses.heading_deg - grid_convergence_deg(lat, lon))
    return Way(
        np.column_stack(utm33_from_geographic(lat, lon)),
        np.column_stack([np.sin(grid), np.cos(grid)]),
        poses.epoch_ns,
    )


def mean_nees(errors: Sequence[ObjectError]) -> float | None:
    """Mean horizontal NEES; None where none is known."""
    return _mean([one.nees_per_dof for one in errors if one.nees_per_dof is not None])


def height_errors(errors: Sequence[ObjectError]) -> HeightErrors:
    """Summarise the errors in height."""
    known = [one.error_height_m for one in errors if one.error_height_m is not None]
    square = _mean([value**2 for value in known])
    return HeightErrors(
        n=len(known),
        mean=_mean(known),
        rmse=None if square is None else math.sqrt(square),
        nees_per_dof=_mean(
            [one.height_nees_per_dof for one in errors if one.height_nees_per_dof is not None]
        ),
    )


def csv_of(errors: Sequence[ObjectError], *, excel: bool = False) -> bytes:
    """Write a line an object, under the names of `ObjectError`; what is not known is empty.

    Parameters
    ----------
    excel : bool
        As :func:`twin.tables.csv_bytes` takes it.
    """
    return records_csv(ObjectError, errors, excel=excel)


def _object_error(placed: Placed, truth: Truth, way: Way) -> ObjectError:
    east, north = placed.east_m - truth.east_m, placed.north_m - truth.north_m
    ee, en, nn = placed.covariance_m2
    covariance = np.array([[ee, en], [en, nn]])
    square = known(float(nees([east, north], covariance)))
    major, minor, _ = ellipse(covariance[None])
    forward = way.passing(truth.east_m, truth.north_m)
    height = None if truth.height_m is None else known(placed.height_m - truth.height_m)
    sigma = known(placed.sigma_height_m)
    return ObjectError(
        method=placed.method,
        drive_id=placed.drive_id,
        object=placed.object,
        truth=truth.object,
        error_east_m=east,
        error_north_m=north,
        error_forward_m=forward[0] * east + forward[1] * north,
        error_left_m=forward[0] * north - forward[1] * east,
        error_m=math.hypot(east, north),
        error_height_m=height,
        sigma_major_m=known(float(major[0])),
        sigma_minor_m=known(float(minor[0])),
        sigma_height_m=sigma,
        nees_per_dof=None if square is None else square / 2.0,
        height_nees_per_dof=None if height is None or not sigma else (height / sigma) ** 2,
        inside95=None if square is None else square <= INSIDE_95,
        camera=placed.camera,
        range_m=known(placed.range_m),
        speed_mps=known(placed.speed_mps),
    )


def known(value: float) -> float | None:
    """Give None for NaN, as tables and JSON have it."""
    return value if math.isfinite(value) else None


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
