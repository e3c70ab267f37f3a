"""NVDB for histories of sending: a side that is written to, and a side that is read and may lag behind."""

from __future__ import annotations

import copy
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from nvdb.area import Area
from nvdb.datakatalog import snapshot
from nvdb.objects import point_from_wkt
from nvdb.replay import ReplayServer, ReplayWorld
from nvdb.replay.skriv import ReplayObject, SkrivReplayServer
from twin.matching import match
from twin.mirror.raw import raw_object
from twin.mirror.sync import sync_nvdb
from twin.store import schema
from twin.store.store import Store

AREA = Area(kommuner=(5001,))
UNKNOWN = (1042500108, 1042500109, 1042500114)
"""Poles of the sample that are taken out of NVDB, so that there are several new signs."""


def without_poles(store: Path) -> list[dict[str, Any]]:
    """What the mirror holds, as received, but for `UNKNOWN` and their plates."""
    with Store.open(store) as opened:
        rows = [
            raw_object(row)
            for tables in schema.MIRROR.values()
            for row in opened.rows(sa.select(tables.visible.c.raw))
        ]
    gone = {
        plate
        for raw in rows
        if raw["id"] in UNKNOWN
        for relation in raw["relasjoner"]["barn"]
        for plate in relation["vegobjekter"]
    }
    return [raw for raw in rows if raw["id"] not in gone | set(UNKNOWN)]


def world_to_read(raws: list[dict[str, Any]]) -> ReplayWorld:
    """NVDB's reading side with these objects."""
    return ReplayWorld({kind: [r for r in raws if r["metadata"]["type"]["id"] == kind] for kind in (95, 96)})


def as_les_v4(item: ReplayObject, parent: int | None, template: dict[str, Any]) -> dict[str, Any]:
    """Write an object of the local API Skriv as API Les would show it; the rest is the template's."""
    raw = copy.deepcopy(template)
    raw["id"] = item.nvdb_id
    raw["metadata"] |= {"versjon": item.versjon, "startdato": item.startdato.isoformat()}
    raw["metadata"]["sist_modifisert"] = item.sist_modifisert.isoformat().replace("+00:00", "Z")
    values = []
    for number, egenskap in item.egenskaper.items():
        known = next(
            (one for one in template["egenskaper"] if one["id"] == number), {"id": number, "navn": ""}
        )
        if egenskap.geometri is not None:
            quality = egenskap.geometri.kvalitet
            kvalitet = {
                "datafangstmetode": "fot",
                "nøyaktighet": quality and quality.noyaktighet_cm,
                "synbarhet": 0,
            }
            wkt = egenskap.geometri.wkt
            values.append({**known, "verdi": wkt, "kvalitet": kvalitet, "egenskapstype": "Geometri"})
            raw["geometri"] = {"wkt": wkt, "srid": 5973, "egengeometri": True}
        elif egenskap.enum:
            text = katalog_text(number, egenskap.enum[0])
            values.append({**known, "verdi": text, "enum_id": egenskap.enum[0], "egenskapstype": "Tekstenum"})
        elif egenskap.verdi:
            values.append({**known, "verdi": egenskap.verdi[0], "egenskapstype": "Tekst"})
    raw["egenskaper"] = values
    if item.stedfesting is not None:
        for place, punkt in zip(raw["lokasjon"]["stedfestinger"], item.stedfesting.punkter, strict=False):
            place |= {"veglenkesekvensid": punkt.veglenkesekvens_id, "relativPosisjon": punkt.posisjon}
            place |= {"retning": punkt.retning, "sideposisjon": punkt.sideposisjon}
    if "barn" in raw["relasjoner"]:
        raw["relasjoner"]["barn"][0]["vegobjekter"] = list(item.barn)
    else:
        raw["relasjoner"]["foreldre"][0]["vegobjekter"] = [] if parent is None else [parent]
    return raw


def katalog_text(number: int, enum: int) -> str:
    """What the datakatalog calls a value."""
    return str(snapshot().egenskapstyper[number].verdier.get(enum, enum))


@dataclass
class Country:
    """NVDB: a side that is written to and a side that is read, which may lag behind."""

    skriv: SkrivReplayServer
    les: ReplayServer
    les_world: ReplayWorld
    templates: dict[int, dict[str, Any]]
    shown: dict[int, tuple[Any, ...]] = field(default_factory=dict)

    def catch_up(self) -> None:
        """Let the reading side show what was written."""
        world, objects = self.les_world, self.skriv.world.objects
        parents = {child: item.nvdb_id for item in objects.values() for child in item.barn}
        for number in [number for number in self.shown if number not in objects]:
            if world.find(number) is not None:
                world.remove(number)
            del self.shown[number]
        for item in list(objects.values()):
            state = (item.versjon, item.sist_modifisert, item.sluttdato, tuple(item.barn))
            if self.shown.get(item.nvdb_id) == state:
                continue
            raw = as_les_v4(item, parents.get(item.nvdb_id), self.templates[item.type_id])
            there = world.find(item.nvdb_id)
            if item.sluttdato is not None:
                if there is not None:
                    world.close(item.nvdb_id, item.sluttdato.isoformat())
            elif there is None:
                world.create(item.type_id, raw)
            else:
                world.update(item.nvdb_id, **{key: raw[key] for key in raw if key != "id"})
            self.shown[item.nvdb_id] = state

    def poles(self) -> list[tuple[float, float]]:
        """Where the Skiltpunkter stand that are there now."""
        found = []
        for item in self.skriv.world.objects.values():
            geometri = next((e.geometri for e in item.egenskaper.values() if e.geometri is not None), None)
            if item.type_id == 95 and item.sluttdato is None and geometri is not None:
                found.append(point_from_wkt(geometri.wkt)[:2])
        return found


def base_store(matched_road: Path, path: Path) -> Path:
    """A store whose mirror lacks some poles, matched: several new signs."""
    shutil.copy(matched_road, path)
    raws = without_poles(path)
    world = world_to_read(raws)
    with ReplayServer(world) as server, Store.open(path) as store:
        sync_nvdb(
            store,
            AREA,
            api_url=server.url,
            replace=True,
            fresh=True,
            confirm_deletions=True,
        )
        match(store)
    return path
