"""On which road a sign stands: by NVDB's own word on its object, else by the nearest road of the network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import sqlalchemy as sa

from twin.mirror.raw import raw_text
from twin.mirror.vegnett.network import FACT, load_vegnett
from twin.store import schema
from twin.store.sql import each_number
from twin.store.store import Snapshot, Store

NEAR_KOMMUNE_M = 2000.0
NEAR_M = 30.0
"""A sign further from every road for cars has no road reference from the network."""


@dataclass(frozen=True, slots=True)
class Road:
    """Where a sign stands, for people.

    Attributes
    ----------
    reference : str
        Vegsystemreferanse, short: ``EV6 S58D1 m1234``; "" where it is not known.
    street : str
        Name of the street, which NVDB gives with objects read by Les V4; "" where it is not known.
    kommuner : tuple of int
        Of NVDB's object; of a sign that NVDB does not have those of the nearest one within `NEAR_KOMMUNE_M`.
    """

    reference: str = ""
    street: str = ""
    kommuner: tuple[int, ...] = ()

    def __str__(self) -> str:
        """``FV6680 S1D1 m120, Elgeseter gate``."""
        return ", ".join(part for part in (self.reference, self.street) if part)


class Placed(Protocol):
    """A finding: :class:`twin.store.records.Finding`, or what is known of it briefly."""

    @property
    def change_id(self) -> str:
        """Its id."""
        ...

    @property
    def nvdb_type(self) -> int:
        """95 or 96."""
        ...

    @property
    def nvdb_id(self) -> int | None:
        """Of NVDB's object; None where NVDB has none."""
        ...

    @property
    def east_m(self) -> float:
        """EPSG:25833."""
        ...

    @property
    def north_m(self) -> float:
        """EPSG:25833."""
        ...


def roads_of(store: Store, findings: Sequence[Placed], *, streets: bool = True) -> dict[str, Road]:
    """Say on which road each finding's sign stands.

    Parameters
    ----------
    store : Store
    findings : sequence of Placed
    streets : bool
        Whether streets are asked for, which are read from whole objects: slow for all signs of an area.

    Returns
    -------
    dict of change_id → Road
        Every finding is in it. The reference is that of NVDB's object where it has one, else that of the
        nearest road for cars within `NEAR_M` of the finding, if the store has the road network.
    """
    with store.snapshot() as view:
        known = {
            nvdb_type: _of_objects(view, nvdb_type, _ids(findings, nvdb_type), streets=streets)
            for nvdb_type in schema.MIRROR
        }
    roads = {one.change_id: known[one.nvdb_type].get(one.nvdb_id or 0, Road()) for one in findings}
    lost = [one for one in findings if not roads[one.change_id].reference]
    if lost and store.fact(FACT) is not None:
        for finding, reference in zip(lost, _of_network(store, lost), strict=True):
            roads[finding.change_id] = replace(roads[finding.change_id], reference=reference)
    nowhere = [one for one in findings if not roads[one.change_id].kommuner]
    for finding, kommuner in zip(nowhere, _kommuner_near(store, nowhere), strict=True):
        roads[finding.change_id] = replace(roads[finding.change_id], kommuner=kommuner)
    return roads


def _kommuner_near(store: Store, findings: Sequence[Placed]) -> list[tuple[int, ...]]:
    """Kommuner of the mirror's Skiltpunkt that stands nearest; none where none is near."""
    if not findings:
        return []
    from scipy.spatial import cKDTree

    at = np.array([(one.east_m, one.north_m) for one in findings])
    (west, south), (east, north) = at.min(axis=0) - NEAR_KOMMUNE_M, at.max(axis=0) + NEAR_KOMMUNE_M
    point = schema.skiltpunkt.c
    rows = store.rows(
        sa.select(point.east_m, point.north_m, point.kommuner)
        .where(
            point.east_m.between(float(west), float(east)), point.north_m.between(float(south), float(north))
        )
        .order_by(point.nvdb_id)
    )
    if not rows:
        return [()] * len(findings)
    tree = cKDTree([(row["east_m"], row["north_m"]) for row in rows])
    # One that is too far has the number of no row.
    _, nearest = tree.query(at, distance_upper_bound=NEAR_KOMMUNE_M)
    return [tuple(rows[k]["kommuner"]) if k < len(rows) else () for k in np.asarray(nearest).tolist()]


def _ids(findings: Iterable[Placed], nvdb_type: int) -> list[int]:
    return [one.nvdb_id for one in findings if one.nvdb_type == nvdb_type and one.nvdb_id is not None]


def _of_objects(view: Snapshot, nvdb_type: int, ids: Sequence[int], *, streets: bool) -> Mapping[int, Road]:
    table = schema.MIRROR[nvdb_type].visible.c
    wanted = each_number(ids)
    columns = [table.nvdb_id, table.road_reference, table.kommuner, *([table.raw] if streets else [])]
    return {
        row["nvdb_id"]: Road(
            row["road_reference"] or "", _street(row["raw"]) if streets else "", tuple(row["kommuner"])
        )
        for row in view.rows(sa.select(*columns).where(table.nvdb_id.in_(wanted)))
    }


def _street(stored: bytes) -> str:
    """The first street of ``lokasjon.adresser``; Uberiket's form of an object has none."""
    location = json.loads(raw_text(stored)).get("lokasjon") or {}
    streets = location.get("adresser") or [{}]
    return str(streets[0].get("navn") or "") if isinstance(streets[0], Mapping) else ""


def _of_network(store: Store, findings: Sequence[Placed]) -> list[str]:
    from nvdb.vegnett import BILVEG, stedfester

    places = stedfester(load_vegnett(store), type_veg=BILVEG).stedfest(
        [one.east_m for one in findings], [one.north_m for one in findings], max_distance_m=NEAR_M
    )
    return [str(reference) for reference in places.kortform]
