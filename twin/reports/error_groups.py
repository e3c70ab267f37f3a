"""Errors grouped by camera, speed of the car and distance: ``twin evaluate --by``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import inf

from geoloc.locate.accuracy import RANGE_EDGES_M, error_stats
from twin.errors import ConfigError
from twin.reports.object_errors import ObjectError
from twin.reports.sighting_errors import SightingError
from twin.tables import records_csv

GROUPS = ("camera", "speed", "range")
SPEED_EDGES_KMH = (0.0, 1.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, inf)
"""Below the first of them after 0 a car stands."""
_Band = tuple[float, float]
_Key = tuple[str, str, str | None, _Band | None, _Band | None]


@dataclass(frozen=True, slots=True)
class GroupErrors:
    """Horizontal errors, metres, of one group; None for what was not asked for, and for no upper limit.

    Attributes
    ----------
    kind : str
        ``objects``, or ``sightings`` of the methods of one frame.
    camera : str or None
        Of an object all that saw it, joined by +.
    speed_from_kmh, speed_to_kmh, range_from_m, range_to_m : float or None
        From the one to below the other.
    coverage95 : float or None
        Share of the truths inside the 95 % ellipse.
    """

    method: str
    kind: str
    camera: str | None
    speed_from_kmh: float | None
    speed_to_kmh: float | None
    range_from_m: float | None
    range_to_m: float | None
    n: int
    mean: float
    median: float
    p95: float
    max: float
    rmse: float
    coverage95: float | None


def check_groups(by: Sequence[str]) -> tuple[str, ...]:
    """Return what to group by, each once and in the order of `GROUPS`.

    Raises
    ------
    ConfigError
        It names something else.
    """
    if unknown := [name for name in by if name not in GROUPS]:
        raise ConfigError(
            f"Errors are grouped --by {', '.join(GROUPS)}, not {unknown[0]:.80}: --by camera,range; how "
            "estimates find their truth is --pair-by."
        )
    return tuple(name for name in GROUPS if name in by)


def grouped(
    objects: Iterable[ObjectError], sightings: Iterable[SightingError], by: Sequence[str]
) -> tuple[GroupErrors, ...]:
    """Summarise errors by method and what else is asked for; what has no such value is in no group.

    Parameters
    ----------
    objects : iterable of ObjectError
    sightings : iterable of SightingError
    by : sequence of {"camera", "speed", "range"}
    """
    asked = check_groups(by)
    members: dict[_Key, list[ObjectError | SightingError]] = {}
    for kind, errors in (("objects", objects), ("sightings", sightings)):
        for one in errors:
            camera = one.camera if "camera" in asked else None
            speed = _band(_kmh(one), SPEED_EDGES_KMH) if "speed" in asked else None
            distance = _band(one.range_m, RANGE_EDGES_M) if "range" in asked else None
            if (speed is not None) == ("speed" in asked) and (distance is not None) == ("range" in asked):
                members.setdefault((one.method, kind, camera, speed, distance), []).append(one)
    return tuple(_group(key, members[key]) for key in sorted(members, key=_order))


def groups_csv(groups: Sequence[GroupErrors], *, excel: bool = False) -> bytes:
    """Write a line a group, under the names of `GroupErrors`; what was not asked for is empty.

    Parameters
    ----------
    excel : bool
        As :func:`twin.tables.csv_bytes` takes it.
    """
    return records_csv(GroupErrors, groups, excel=excel)


def _band(value: float | None, edges: Sequence[float]) -> _Band | None:
    bands = () if value is None else pairwise(edges)
    return next(((low, high) for low, high in bands if value is not None and low <= value < high), None)


def _kmh(one: ObjectError | SightingError) -> float | None:
    return None if one.speed_mps is None else 3.6 * one.speed_mps


def _order(key: _Key) -> tuple[str, str, str, _Band, _Band]:
    method, kind, camera, speed, distance = key
    return kind, method, camera or "", speed or (0.0, 0.0), distance or (0.0, 0.0)


def _group(key: _Key, members: Sequence[ObjectError | SightingError]) -> GroupErrors:
    method, kind, camera, speed, distance = key
    inside = [one.inside95 for one in members if one.inside95 is not None]
    return GroupErrors(
        *(method, kind, camera, *_limits(speed), *_limits(distance)),
        **asdict(error_stats([one.error_m for one in members])),
        coverage95=sum(inside) / len(inside) if inside else None,
    )


def _limits(band: _Band | None) -> tuple[float | None, float | None]:
    if band is None:
        return None, None
    return band[0], None if band[1] == inf else band[1]
