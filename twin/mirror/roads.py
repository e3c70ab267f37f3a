"""On which road a sign stands: by NVDB's own word on its object, else by the nearest road of the network."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from twin.mirror.raw import raw_text
from twin.mirror.vegnett.network import FACT, load_vegnett
from twin.store import schema
from twin.store.records import Finding
from twin.store.store import Snapshot, Store

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
    """

    reference: str = ""
    street: str = ""

    def __str__(self) -> str:
        """``FV6680 S1D1 m120, Elgeseter gate``."""
        return ", ".join(part for part in (self.reference, self.street) if part)


def roads_of(store: Store, findings: Sequence[Finding]) -> dict[str, Road]:
    """Say on which road each finding's sign stands.

    Parameters
    ----------
    store : Store
    findings : sequence of Finding

    Returns
    -------
    dict of change_id → Road
        Every finding is in it. The reference is that of NVDB's object where it has one, else that of the
        nearest road for cars within `NEAR_M` of the finding, if the store has the road network.
    """
    with store.snapshot() as view:
        known = {
            nvdb_type: _of_objects(view, nvdb_type, _ids(findings, nvdb_type)) for nvdb_type in schema.MIRROR
        }
    roads = {one.change_id: known[one.nvdb_type].get(one.nvdb_id or 0, Road()) for one in findings}
    lost = [one for one in findings if not roads[one.change_id].reference]
    if lost and store.fact(FACT) is not None:
        for finding, reference in zip(lost, _of_network(store, lost), strict=True):
            roads[finding.change_id] = Road(reference, roads[finding.change_id].street)
    return roads


def _ids(findings: Iterable[Finding], nvdb_type: int) -> list[int]:
    return [one.nvdb_id for one in findings if one.nvdb_type == nvdb_type and one.nvdb_id is not None]


def _of_objects(view: Snapshot, nvdb_type: int, ids: Sequence[int]) -> Mapping[int, Road]:
    table = schema.MIRROR[nvdb_type].visible.c
    # Any number of ids as one parameter.
    wanted = sa.select(sa.func.json_each(json.dumps(ids)).table_valued("value").c.value)
    rows = view.rows(
        sa.select(table.nvdb_id, table.road_reference, table.raw).where(table.nvdb_id.in_(wanted))
    )
    return {row["nvdb_id"]: Road(row["road_reference"] or "", _street(row["raw"])) for row in rows}


def _street(stored: bytes) -> str:
    """The first street of ``lokasjon.adresser``; Uberiket's form of an object has none."""
    location = json.loads(raw_text(stored)).get("lokasjon") or {}
    streets = location.get("adresser") or [{}]
    return str(streets[0].get("navn") or "") if isinstance(streets[0], Mapping) else ""


def _of_network(store: Store, findings: Sequence[Finding]) -> list[str]:
    from nvdb.vegnett import BILVEG, stedfester

    places = stedfester(load_vegnett(store), type_veg=BILVEG).stedfest(
        [one.east_m for one in findings], [one.north_m for one in findings], max_distance_m=NEAR_M
    )
    return [str(reference) for reference in places.kortform]
