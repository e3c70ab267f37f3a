"""Where a sync changes signs: every place whose signs are otherwise is named, and few others."""

from __future__ import annotations

import math
import random

import sqlalchemy as sa
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.replay import ReplayServer
from twin.matching.config import MatchConfig
from twin.matching.sites import Site, sites_from_mirror
from twin.mirror.sync import sync_nvdb
from twin.store import schema
from twin.store.store import Store
from twin.store.touched import FACT, Place, touched_since


def sites(store: Store) -> set[Site]:
    """All signs, as matching sees them."""
    points, plates = (store.rows(sa.select(t)) for t in (schema.skiltpunkt, schema.skiltplate))
    return set(sites_from_mirror(points, plates, MatchConfig()))


def place(site: Site) -> Place:
    """Its whole metres."""
    return math.floor(site.east_m), math.floor(site.north_m)


def test_a_sync_names_every_place_whose_signs_change(empty: Store) -> None:
    """Objects that change, move, go, come back, or lose their pole, by following and by a new backfill."""
    world, rng = GeneratedWorld(30, 60, seed=5), random.Random(3)
    points, plates = world.ids(95, 30), world.ids(96, 60)
    with ReplayServer(world) as server:
        sync_nvdb(empty, Area(), api_url=server.url)
        assert touched_since(empty.fact(FACT), 0, empty.revision()) is None
        gone: list[int] = []
        for number in range(8):
            before, revision = sites(empty), empty.revision()
            there = [one for one in (*points, *plates) if one not in gone]
            moved = f"POINT Z ({270000 + 500 * number} 7040000 5)"
            geometry = {"wkt": moved, "srid": 5973, "egengeometri": rng.random() < 0.7}
            world.update(rng.choice(there), geometri=geometry)
            world.update(rng.choice(plates), relasjoner={})
            world.touch(rng.sample(there, 2))
            if number % 2:
                gone.append(rng.choice(there))
                world.remove(gone[-1])
            elif gone:
                world.recreate(gone.pop())
            sync_nvdb(empty, Area(), api_url=server.url, fresh=number in {3, 6})
            told = touched_since(empty.fact(FACT), revision, empty.revision())
            assert told is not None
            assert {place(site) for site in before ^ sites(empty)} <= told.places
            assert len(told.places) < 40
