"""Road reference and kommune of findings: by the mirror's objects, the road network, or their neighbours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from nvdb.vegnett import stedfester
from twin.mirror.vegnett import load_vegnett
from twin.store import schema
from twin.store.store import Snapshot, Store

_NEAR_ROAD_M = 50.0
"""A sign farther from the centre line, or from the next sign, says nothing of the road."""
_NEAR_KOMMUNE_M = 2000.0
_DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, slots=True)
class Place:
    """Where on the roads a finding is.

    Attributes
    ----------
    reference : str
        ``EV6 S58D1 m1234``; of what stands beside no known road, only that of its neighbour; or "".
    kommuner : tuple of int
    """

    reference: str = ""
    kommuner: tuple[int, ...] = ()

    @property
    def road(self) -> str:
        """The road alone: ``EV6``."""
        return self.reference.partition(" ")[0]


def places_of(
    store: Store, view: Snapshot, nvdb_id: Sequence[int | None], east_m: FloatArray, north_m: FloatArray
) -> list[Place]:
    """Return the place of each finding, by its object or, for what NVDB does not have, by its position."""
    signs = _mirrored(view)
    known = {key: at for at, key in enumerate(signs["nvdb_id"])}
    of_object = [None if key is None else known.get(key) for key in nvdb_id]
    nearest, apart = _nearest(signs, east_m, north_m)
    roads = _on_network(store, east_m, north_m) if None in of_object else [""] * len(of_object)
    places = []
    for at, own in enumerate(of_object):
        near = own if own is not None else nearest[at]
        if near is None:
            places.append(Place(roads[at]))
            continue
        reference = signs["road_reference"][near] or ""
        if own is None:
            beside = reference.partition(" ")[0] if apart[at] <= _NEAR_ROAD_M else ""
            reference = roads[at] or beside
        is_near = own is not None or apart[at] <= _NEAR_KOMMUNE_M
        places.append(Place(reference, tuple(signs["kommuner"][near]) if is_near else ()))
    return places


def in_order(reference: str) -> list[tuple[int, str]]:
    """Key that sorts road references as people count: m200 before m1000."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in _DIGITS.split(reference)]


def _mirrored(view: Snapshot) -> dict[str, list[Any]]:
    together: dict[str, list[Any]] = {}
    for tables in schema.MIRROR.values():
        c = tables.visible.c
        found = view.columns(sa.select(c.nvdb_id, c.east_m, c.north_m, c.road_reference, c.kommuner))
        for name, values in found.items():
            together.setdefault(name, []).extend(values)
    return together


def _nearest(
    signs: dict[str, list[Any]], east_m: FloatArray, north_m: FloatArray
) -> tuple[list[int | None], FloatArray]:
    """Row of the mirrored object that stands nearest, and how far away; None where there is none."""
    import shapely  # not SciPy's tree: loading that would be a third of the page's start

    at = np.array([signs["east_m"], signs["north_m"]], dtype=np.float64).T
    placed = np.flatnonzero(np.isfinite(at).all(axis=1))
    if not placed.size:
        return [None] * len(east_m), np.full(len(east_m), np.inf)
    tree, asked = shapely.STRtree(np.asarray(shapely.points(at[placed]))), shapely.points(east_m, north_m)
    (_, row), apart = tree.query_nearest(asked, return_distance=True, all_matches=False)
    return placed[row].tolist(), np.asarray(apart)


def _on_network(store: Store, east_m: FloatArray, north_m: FloatArray) -> list[str]:
    """Road reference of the nearest link; "" where there is none, or the store has no network."""
    if store.fact("vegnett") is None:
        return [""] * len(east_m)
    found = stedfester(load_vegnett(store)).stedfest(east_m, north_m, max_distance_m=_NEAR_ROAD_M)
    return [str(kortform) for kortform in found.kortform]
