"""Where to drive next: roads by what one more drive along them is expected to settle."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from twin.belief.belief import Believed
from twin.belief.filter import settled_bits
from twin.belief.state import State

LEAST_KM = 0.5
"""No road is shorter to drive: one has to turn into it and out of it."""
_PLACE = re.compile(r"(?P<road>.+) m(?P<first>\d+)(?:-(?P<last>\d+))?")
_STROKE_M = 10.0
_TO_LOOK_AT = frozenset({State.UNSURE, State.GONE, State.PROBABLY})


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadToDrive:
    """A road in a kommune, and what one more drive past every sign of it is expected to tell.

    Attributes
    ----------
    road : str
        Vegsystemreferanse without the metre: ``FV6680 S1D1``.
    kommune : str
        Its number; "" where it is not known.
    km : float
        From the first of its signs to the last, at least `LEAST_KM`.
    n_places : int
        Signs that NVDB has there, or drives found.
    n_unsure : int
        Of these, signs that drives passed and that are not sure to stand.
    n_not_passed : int
        Of these, signs that no drive that counts has ever passed.
    unsure_bits : float
        Entropy of all its signs today.
    settled_bits : float
        By how much a drive is expected to lower that.
    settled_bits_per_km : float
    line_m : tuple of (float, float)
        Through its signs in the order of the road, EPSG:25833; of a single one a stroke of 20 m.
    """

    road: str
    kommune: str
    km: float
    n_places: int
    n_unsure: int
    n_not_passed: int
    unsure_bits: float
    settled_bits: float
    settled_bits_per_km: float
    line_m: tuple[tuple[float, float], ...]


def is_on_a_road(place: Believed) -> bool:
    """Whether a place has a road reference by which it can be ranked."""
    return _PLACE.fullmatch(place.road) is not None


def roads_to_drive(
    places: Iterable[Believed], *, p_seen: float = 0.998, p_false: float = 0.001
) -> tuple[RoadToDrive, ...]:
    """Rank roads by the bits that a drive is expected to settle for each kilometre, most first.

    Parameters
    ----------
    places : iterable of Believed
        Those without a road reference are on no road, and left out.
    p_seen : float
        Chance that the drive sees a sign that stands there and is not hidden.
    p_false : float
        Chance that it marks a sign where none stands.
    """
    found: dict[tuple[str, str], list[tuple[int, Believed]]] = {}
    for place in places:
        told = _PLACE.fullmatch(place.road)
        if told is not None:
            kommune = place.kommune.partition(",")[0]
            found.setdefault((told["road"], kommune), []).append((int(told["first"]), place))
    roads = [_road(name, kommune, on_it, p_seen, p_false) for (name, kommune), on_it in found.items()]
    return tuple(sorted(roads, key=lambda one: (-one.settled_bits_per_km, one.road, one.kommune)))


def _road(
    name: str, kommune: str, on_it: list[tuple[int, Believed]], p_seen: float, p_false: float
) -> RoadToDrive:
    ordered = sorted(on_it, key=lambda one: (one[0], one[1].place_id))
    places = [place for _, place in ordered]
    km = max((ordered[-1][0] - ordered[0][0]) / 1000, LEAST_KM)
    stands, visible = (np.array([getattr(one, key) for one in places]) for key in ("p_stands", "p_visible"))
    settled = float(settled_bits(visible, stands, p_seen, p_false).sum())
    line = [(one.east_m, one.north_m) for one in places]
    if len(line) == 1:
        ((east, north),) = line
        line = [(east - _STROKE_M, north), (east + _STROKE_M, north)]
    return RoadToDrive(
        road=name,
        kommune=kommune,
        km=round(km, 3),
        n_places=len(places),
        n_unsure=sum(one.state in _TO_LOOK_AT for one in places),
        n_not_passed=sum(one.state == State.NOT_PASSED for one in places),
        unsure_bits=round(sum(one.unsure_bits for one in places), 4),
        settled_bits=round(settled, 4),
        settled_bits_per_km=round(settled / km, 4),
        line_m=tuple(line),
    )
