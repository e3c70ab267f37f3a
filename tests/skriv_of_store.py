"""A local API Skriv that holds what a store's mirror holds."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from nvdb.datakatalog import snapshot
from nvdb.replay.skriv import ReplayObject, SkrivReplayServer, SkrivWorld
from twin.changesets.nvdb_side import earlier_from_raw
from twin.decisions import decide
from twin.mirror.raw import raw_object
from twin.store import schema
from twin.store.store import Store

USER, SECRET = "olanor", "hemmelig-4c1d"  # of the local server


def world_of(store: Path) -> SkrivWorld:
    """An API Skriv that holds what the mirror holds."""
    objects = []
    with Store.open(store) as opened:
        for kind, tables in schema.MIRROR.items():
            for row in opened.rows(sa.select(tables.visible.c.raw)):
                state = earlier_from_raw(raw_object(row), kind, snapshot())
                objects.append(
                    ReplayObject(
                        type_id=kind,
                        nvdb_id=state.nvdb_id,
                        versjon=state.versjon,
                        startdato=state.startdato,
                        egenskaper={e.type_id: e for e in state.egenskaper},
                        stedfesting=state.stedfesting,
                        barn=[child for ids in (state.dotre or {}).values() for child in ids],
                    )
                )
    # API Skriv tells whole milliseconds.
    return SkrivWorld(objects, now=lambda: datetime.now(UTC).replace(microsecond=0))


def skriv(stack: ExitStack, store: Path, **options: Any) -> SkrivReplayServer:
    """A local API Skriv with the mirror's objects."""
    options = {"on_the_way": (), **options}
    return stack.enter_context(SkrivReplayServer(world_of(store), users={USER: SECRET}, **options))


def posts(server: SkrivReplayServer) -> int:
    """How many sets were registered."""
    return server.requests.count(("POST", "/rest/v3/endringssett"))


def new_signs(server: SkrivReplayServer, store: Path) -> int:
    """How many Skiltpunkter were registered and are there: the sample has one that NVDB does not know."""
    with Store.open(store) as opened:
        mirrored = {row["nvdb_id"] for row in opened.rows(sa.select(schema.skiltpunkt.c.nvdb_id))}
    points = {number for number, item in server.world.objects.items() if item.type_id == 95}
    return len(points - mirrored)


def decisions(store: Path, **wanted: str) -> None:
    """Decide about all findings of a verdict, whatever was decided before."""
    with Store.open(store) as opened:
        for row in opened.rows(sa.select(schema.change.c.change_id, schema.change.c.verdict)):
            if row["verdict"] in wanted:
                decide(opened, [row["change_id"]], wanted[row["verdict"]], by="kari")
