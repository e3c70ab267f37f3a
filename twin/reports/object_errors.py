"""The error of each estimate against its surveyed position: a row an object, for tables and spreadsheets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, cast

import numpy as np
import sqlalchemy as sa

from geoloc.locate.accuracy import nees
from geoloc.locate.combine import ellipse
from twin.reports.pairing import Placed
from twin.reports.truth import Truth
from twin.store import schema
from twin.store.store import Store
from twin.tables import csv_bytes

if TYPE_CHECKING:
    import shapely

_INSIDE_95 = -2.0 * math.log(0.05)
"""χ² with two degrees of freedom."""
_STEP_M = 1.0
"""Half of the stretch of the driven line that tells which way the car went past an object."""


@dataclass(frozen=True, slots=True)
class ObjectError:
    """Estimate minus survey of one object; None where a survey or a method does not tell.

    Attributes
    ----------
    error_east_m, error_north_m : float
        Grid axes of EPSG:25833.
    error_along_m, error_across_m : float or None
        The same forward and to the left of the way in which the car passed; None of a car that stood.
    error_m : float
        Horizontal.
    error_height_m : float or None
        Ellipsoidal.
    sigma_major_m, sigma_minor_m, sigma_height_m : float or None
        One sigma along and across the estimate's error ellipse, and of its height.
    nees, height_nees : float or None
        Squared error in sigmas, divided by its degrees of freedom (2 and 1): 1 on average where the stated
        errors are honest.
    inside95 : bool or None
        Whether the survey lies inside the 95 % ellipse.
    """

    method: str
    drive_id: str
    object: str
    truth: str
    error_east_m: float
    error_north_m: float
    error_along_m: float | None
    error_across_m: float | None
    error_m: float
    error_height_m: float | None
    sigma_major_m: float | None
    sigma_minor_m: float | None
    sigma_height_m: float | None
    nees: float | None
    height_nees: float | None
    inside95: bool | None


@dataclass(frozen=True, slots=True)
class HeightErrors:
    """Errors in height of the objects whose survey has one; None where there is none.

    Attributes
    ----------
    nees : float or None
        Mean squared error in sigmas, of the estimates that state one.
    """

    n: int
    mean: float | None
    rmse: float | None
    nees: float | None


def object_errors(
    pairs: Sequence[tuple[Placed, Truth]], lines: Mapping[str, shapely.LineString]
) -> tuple[ObjectError, ...]:
    """Compare estimates with their surveyed positions, one by one.

    Parameters
    ----------
    pairs : sequence of (Placed, Truth)
    lines : mapping of drive id → LineString
        Where each car drove, EPSG:25833, in its order of time.
    """
    return tuple(_object_error(placed, truth, lines.get(placed.drive_id)) for placed, truth in pairs)


def driven_lines(store: Store) -> dict[str, shapely.LineString]:
    """Where each drive of a store went, EPSG:25833."""
    from shapely import wkb

    rows = store.rows(sa.select(schema.drive.c.drive_id, schema.drive.c.line))
    return {row["drive_id"]: cast("shapely.LineString", wkb.loads(row["line"])) for row in rows}


def mean_nees(errors: Sequence[ObjectError]) -> float | None:
    """Mean horizontal NEES; None where none is known."""
    return _mean([one.nees for one in errors if one.nees is not None])


def height_errors(errors: Sequence[ObjectError]) -> HeightErrors:
    """Summarise the errors in height."""
    known = [one.error_height_m for one in errors if one.error_height_m is not None]
    square = _mean([value**2 for value in known])
    return HeightErrors(
        n=len(known),
        mean=_mean(known),
        rmse=None if square is None else math.sqrt(square),
        nees=_mean([one.height_nees for one in errors if one.height_nees is not None]),
    )


def csv_of(errors: Sequence[ObjectError], *, excel: bool = False) -> bytes:
    """Write a line an object, under the names of `ObjectError`; what is not known is empty.

    Parameters
    ----------
    excel : bool
        As :func:`twin.tables.csv_bytes` takes it.
    """
    rows = [
        {name: round(v, 4) if isinstance(v, float) else v for name, v in asdict(one).items()}
        for one in errors
    ]
    return csv_bytes([field.name for field in fields(ObjectError)], rows, excel=excel)


def _object_error(placed: Placed, truth: Truth, line: shapely.LineString | None) -> ObjectError:
    east, north = placed.east_m - truth.east_m, placed.north_m - truth.north_m
    ee, en, nn = placed.covariance_m2
    covariance = np.array([[ee, en], [en, nn]])
    square = _known(float(nees([east, north], covariance)))
    major, minor, _ = ellipse(covariance[None])
    along, across = _along_and_across(line, truth, east, north)
    height = None if truth.height_m is None else _known(placed.height_m - truth.height_m)
    sigma = _known(placed.sigma_height_m)
    return ObjectError(
        method=placed.method,
        drive_id=placed.drive_id,
        object=placed.object,
        truth=truth.object,
        error_east_m=east,
        error_north_m=north,
        error_along_m=along,
        error_across_m=across,
        error_m=math.hypot(east, north),
        error_height_m=height,
        sigma_major_m=_known(float(major[0])),
        sigma_minor_m=_known(float(minor[0])),
        sigma_height_m=sigma,
        nees=None if square is None else square / 2.0,
        height_nees=None if height is None or not sigma else (height / sigma) ** 2,
        inside95=None if square is None else square <= _INSIDE_95,
    )


def _along_and_across(
    line: shapely.LineString | None, truth: Truth, east: float, north: float
) -> tuple[float | None, float | None]:
    """Turn an error into the way of the car where it came nearest."""
    import shapely

    if line is None:
        return None, None
    at = line.project(shapely.Point(truth.east_m, truth.north_m))
    before, after = (line.interpolate(min(max(d, 0.0), line.length)) for d in (at - _STEP_M, at + _STEP_M))
    way = math.hypot(after.x - before.x, after.y - before.y)
    if way == 0.0:
        return None, None
    forward = (after.x - before.x) / way, (after.y - before.y) / way
    return forward[0] * east + forward[1] * north, forward[0] * north - forward[1] * east


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
