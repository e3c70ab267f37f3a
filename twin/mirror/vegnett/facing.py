"""Which way the mirrored plates face: by Ansiktsside and the metering direction of the road beside them."""

from __future__ import annotations

import datetime as dt
from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from nvdb.datakatalog import ANSIKTSSIDE, Datakatalog, katalog_from_document, snapshot
from nvdb.vegnett import (
    BILVEG,
    ON_THE_LINE_M,
    Polylinjer,
    Stedfester,
    Vegnett,
    facing_azimuth,
    stedfester,
    true_azimuth,
)
from twin.mirror.names import KATALOG_FACT
from twin.mirror.vegnett.network import ROWS_AT_ONCE, load_vegnett
from twin.store import schema
from twin.store.sql import each_number
from twin.store.store import Row, Store

_COLUMNS = ("nvdb_id", "ansiktsside", "own_geometry", "east_m", "north_m", "stedfesting")


@dataclass(frozen=True, slots=True)
class _Stedfestet:
    """Where on the road network NVDB itself places a plate; `side` as NVDB writes it, None if not said."""

    veglenkesekvensid: int
    posisjon: float
    side: str | None


@dataclass(frozen=True, slots=True)
class _Places:
    """The road beside n plates. NaN and empty where it is not known."""

    metering_grid_deg: FloatArray
    east: FloatArray
    north: FloatArray
    side: NDArray[np.object_]


def facing(
    store: Store,
    *,
    on_date: dt.date | None = None,
    max_distance_m: float = 50.0,
    plates: Collection[int] | None = None,
    network: Vegnett | None = None,
) -> dict[int, tuple[float, float]]:
    """Work out for each mirrored plate the compass direction that its face looks towards.

    The road beside a plate is the link that NVDB's own stedfesting names; where the store's network does not
    have it, the nearest road for cars within `max_distance_m` of the plate. Plates along the road
    (2837, 2838) also need the side they stand on: that of the stedfesting, else of the plate's own geometry.

    Parameters
    ----------
    store : Store
        With signs and a road network.
    on_date : date, optional
        Day on which links have to be valid; today if left out.
    max_distance_m : float
        See above.
    plates : collection of int, optional
        Ids of those that are wanted; all by default.
    network : Vegnett, optional
        The store's, where it was loaded already.

    Returns
    -------
    dict
        nvdb_id → azimuths clockwise from *true* north, degrees in [0, 360): of the face, and of the other
        face of a two-sided plate, NaN for every other. Both NaN where Ansiktsside, the road or its metering
        is not known. Good to some tens of degrees: see :func:`nvdb.vegnett.facing_azimuth`.

    Raises
    ------
    StoreError
        The store holds no road network.
    """
    roads = _Roads(load_vegnett(store) if network is None else network, on_date, max_distance_m)
    enums = _enum_ids(store)
    azimuths: dict[int, tuple[float, float]] = {}
    asked = sa.select(*(schema.skiltplate.c[name] for name in _COLUMNS))
    if plates is not None:
        asked = asked.where(schema.skiltplate.c.nvdb_id.in_(each_number(sorted(plates))))
    with store.snapshot() as view:
        for rows in view.chunks(asked, ROWS_AT_ONCE):
            places = roads.beside(rows)
            enum = [enums.get(_folded(plate["ansiktsside"]), 0) for plate in rows]
            metering = true_azimuth(places.metering_grid_deg, places.east, places.north)
            faces = facing_azimuth(enum, metering, places.side.astype(np.str_))
            ids = (plate["nvdb_id"] for plate in rows)
            azimuths.update(
                (i, (first, second)) for i, (first, second) in zip(ids, faces.tolist(), strict=True)
            )
    return azimuths


class _Roads:
    """The links that plates may stand beside, by veglenkesekvens and by place."""

    def __init__(self, nett: Vegnett, on_date: dt.date | None, max_distance_m: float) -> None:
        self._nett = nett
        self._max_distance_m = max_distance_m
        # A link without metering says nothing; objects hang on the level of vegtrasé.
        rows = np.flatnonzero(nett.valid(on_date) & ~nett.detaljert & (nett.retning != 0))
        self._rows: list[int] = rows.tolist()
        self._begins = list(
            zip(nett.veglenkesekvensid[rows].tolist(), nett.startposisjon[rows].tolist(), strict=True)
        )
        self._nearest: Stedfester = stedfester(nett, on_date=on_date, type_veg=BILVEG)

    def beside(self, plates: Sequence[Row]) -> _Places:
        """Say of each plate which road it stands beside."""
        east, north = (
            np.array([plate[name] for plate in plates], dtype=np.float64) for name in ("east_m", "north_m")
        )
        # What is no sign's own position is a point on the centre line, and on neither side of it.
        own = np.array([plate["own_geometry"] for plate in plates], dtype=np.bool_)
        near = self._nearest.stedfest(east, north, max_distance_m=self._max_distance_m)
        places = _Places(
            near.metering_azimuth_grid_deg, near.east, near.north, np.where(own, near.sideposisjon, "")
        )
        named = [_named(plate["stedfesting"]) for plate in plates]
        rows = np.array([-1 if place is None else self._row(place) for place in named], dtype=np.int64)
        placed = np.flatnonzero(rows >= 0)
        if len(placed):
            stedfestet = [place for place, row in zip(named, rows, strict=True) if place and row >= 0]
            at = np.where(own, east, np.nan)[placed], np.where(own, north, np.nan)[placed]
            self._put_stedfestet(places, placed, rows[placed], stedfestet, at)
        return places

    def _row(self, place: _Stedfestet) -> int:
        """Row of the link that a position lies on, -1 if the network does not have it."""
        wanted = (place.veglenkesekvensid, place.posisjon)
        number = bisect_right(self._begins, wanted) - 1
        if number < 0 or self._begins[number][0] != place.veglenkesekvensid:
            return -1
        row = self._rows[number]
        return row if place.posisjon <= self._nett.sluttposisjon[row] else -1

    def _put_stedfestet(
        self,
        places: _Places,
        placed: IntArray,
        rows: IntArray,
        stedfestet: Sequence[_Stedfestet],
        at: tuple[FloatArray, FloatArray],
    ) -> None:
        """Put the road of NVDB's own stedfesting in the place of the nearest one."""
        import shapely

        lines, retning = self._nett.geometri[rows], self._nett.retning[rows]
        start, slutt = self._nett.startposisjon[rows], self._nett.sluttposisjon[rows]
        along = np.array([place.posisjon for place in stedfestet]) - start
        fraction = np.divide(along, slutt - start, out=np.zeros_like(along), where=slutt > start)
        # In plan, where NVDB's positions are linear in 3-D: the direction is the same but beside a vertex.
        feet = shapely.get_coordinates(shapely.line_interpolate_point(lines, fraction, normalized=True))
        east, north = np.ascontiguousarray(feet.T)
        polylinjer, each = Polylinjer(lines), np.arange(len(lines))
        azimuth = polylinjer.feet(each, east, north).azimuth_deg
        places.metering_grid_deg[placed] = np.where(retning > 0, azimuth, azimuth + 180.0) % 360.0
        places.east[placed], places.north[placed] = east, north
        is_placed = np.isfinite(at[0]) & np.isfinite(at[1])
        own = polylinjer.feet(each, np.where(is_placed, at[0], east), np.where(is_placed, at[1], north))
        right = np.where(own.distance_m <= self._max_distance_m, own.right_m * retning, 0.0)
        geometric = np.select([right > ON_THE_LINE_M, right < -ON_THE_LINE_M], ["H", "V"], "")
        places.side[placed] = [
            side if place.side is None else place.side if place.side in {"H", "V"} else ""
            for place, side in zip(stedfestet, geometric.tolist(), strict=True)
        ]


def _named(stedfesting: Sequence[Mapping[str, Any]]) -> _Stedfestet | None:
    """The first point among the places that NVDB names."""
    for place in stedfesting:
        sekvens, posisjon = place.get("veglenkesekvensid"), place.get("relativ_posisjon")
        if sekvens is not None and posisjon is not None:
            return _Stedfestet(int(sekvens), float(posisjon), place.get("sideposisjon"))
    return None


def _enum_ids(store: Store) -> dict[str, int]:
    """Texts of Ansiktsside, folded → enum ids: of the shipped datakatalog and of the one last fetched."""
    fact = store.fact(KATALOG_FACT)
    katalogs: list[Datakatalog] = [snapshot(), *([katalog_from_document(fact)] if fact else [])]
    return {
        _folded(str(text)): enum_id
        for katalog in katalogs
        if ANSIKTSSIDE in katalog.egenskapstyper
        for enum_id, text in katalog.egenskapstyper[ANSIKTSSIDE].verdier.items()
    }


def _folded(text: str | None) -> str:
    return " ".join((text or "").casefold().split())
