"""What is kept between matches: after any history the findings are those of a match of everything.

``TWIN_HISTORIES=1000`` makes a longer run of it (``make soak``).
"""

from __future__ import annotations

import json
import os
import random
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from one_road import with_road
from postgres_server import Server

from geoloc.earth.geodesy import geographic_from_utm33, utm33_from_geographic
from twin.decisions import decide, undo
from twin.errors import TwinError
from twin.matching import match
from twin.matching.config import MatchConfig
from twin.matching.kept import Kept
from twin.mirror.touched import places_of
from twin.mirror.vegnett.touched import places_beside_changes
from twin.store import schema
from twin.store.annotation_sets import AnnotationSet, annotation_sets, put, use_annotation_set
from twin.store.copying import copy_store
from twin.store.kinds import Decision
from twin.store.poses import blob_from_poses, poses_from_blob
from twin.store.sql import swap
from twin.store.store import Row, Store

HISTORIES = max(1, int(os.environ.get("TWIN_HISTORIES", "8")) // 4)
STEPS = 7
METHOD = "adjusted"
DAY_NS = 86_400_000_000_000
OF_DRIVES = (schema.drive, schema.drive_method, schema.estimate, schema.sighting)
SETTINGS = (
    MatchConfig(),
    MatchConfig(view_range_m=12.0),
    MatchConfig(map_aided=True, measured_m=2.0),
    MatchConfig(min_views=12),
)


@dataclass
class History:
    """A store, and what happens to it."""

    store: Store
    draw: random.Random
    config: MatchConfig = SETTINGS[0]
    drives: int = 1

    def ingest(self, east_m: float | None = None) -> None:
        """A drive comes: as the first one, on another day, over a part of the road, a bit elsewhere."""
        name, later_ns = f"drive{self.drives}", self.draw.randint(1, 400) * DAY_NS
        self.drives += 1
        first, moved_m = self._first(), [self.draw.gauss(0, 0.2) for _ in range(2)]
        moved_m[0] += self.draw.choice([0.0, FAR_M]) if east_m is None else east_m
        made: dict[sa.Table, list[Row]] = {}
        objects = self.store.rows(sa.select(schema.estimate.c.object).distinct())
        unseen = {row["object"] for row in objects if self.draw.random() < 0.15}
        for table in OF_DRIVES:
            rows = self.store.rows(sa.select(table).where(table.c.drive_id == first))
            made[table] = [
                self._later(row, name, later_ns, moved_m) for row in rows if row.get("object") not in unseen
            ]
        with self.store.transaction() as connection:
            for table, rows in made.items():
                connection.execute(sa.insert(table), rows)
            self.store.touch(connection, [name])

    def _first(self) -> str:
        rows = self.store.rows(sa.select(schema.drive.c.drive_id).order_by(schema.drive.c.started_ns))
        return str(rows[0]["drive_id"])

    def _later(self, row: Row, name: str, later_ns: int, moved_m: list[float]) -> Row:
        own = {key: value.replace(row["drive_id"], name) for key, value in row.items() if key in _IDS}
        own |= {key: value + later_ns for key, value in row.items() if key.endswith("_ns")}
        if "poses" in row:
            poses = poses_from_blob(row["poses"])
            half = self.draw.choice([slice(None), slice(None, len(poses.epoch_ns) // 2)])
            kept = {key: getattr(poses, key)[half] for key in poses.__slots__}
            kept["epoch_ns"] = kept["epoch_ns"] + later_ns
            east, north = utm33_from_geographic(kept["latitude_deg"], kept["longitude_deg"])
            kept["latitude_deg"], kept["longitude_deg"] = geographic_from_utm33(east + moved_m[0], north)
            own["poses"] = blob_from_poses(type(poses)(**kept))
            own["annotations_complete"] = self.draw.random() < 0.8
        if "cov_ee_m2" in row and row["east_m"] is not None:
            own |= {key: row[key] + by for key, by in zip(("east_m", "north_m"), moved_m, strict=True)}
        return {**row, **own}

    def ingest_again(self) -> None:
        """A drive is read anew: some of its signs stand a bit elsewhere, and one was left out."""
        rows = self.store.rows(sa.select(schema.drive.c.drive_id).order_by(schema.drive.c.drive_id))
        (row,) = self.draw.sample(rows, 1)
        t = schema.estimate
        mine = t.c.drive_id == row["drive_id"]
        objects = self.store.rows(sa.select(t.c.object).where(mine).order_by(t.c.object))
        with self.store.transaction() as connection:
            for one in self.draw.sample(objects, min(3, len(objects))):
                by_m = self.draw.gauss(0, 1.0)
                this = mine & (t.c.object == one["object"])
                connection.execute(sa.update(t).where(this).values(north_m=t.c.north_m + by_m))
            if len(objects) > 3:
                left_out = mine & (t.c.object == self.draw.choice(objects)["object"])
                connection.execute(sa.delete(t).where(left_out))
            self.store.touch(connection, [row["drive_id"]])

    def use_other_annotations(self) -> None:
        """Somebody makes another set of a drive's annotations the current one, or takes that back."""
        rows = self.store.rows(sa.select(schema.drive.c.drive_id).order_by(schema.drive.c.drive_id))
        drive_id = self.draw.choice(rows)["drive_id"]
        with self.store.transaction() as connection:
            sets = annotation_sets(connection, drive_id)
            if len(sets) < 2:
                sets = [AnnotationSet(drive_id, k, None, None, "", True, k == 1, 1, 1, 1) for k in (1, 2)]
                self._keep_another(connection, drive_id)
                for one in sets:
                    put(connection, one)
        use_annotation_set(self.store, drive_id, next(one.number for one in sets if not one.is_current))

    def _keep_another(self, connection: sa.Connection, drive_id: str) -> None:
        """Other annotations of the same drive: signs a bit elsewhere, and not all of them."""
        view, moved_m = self.store.view(connection), self.draw.gauss(0, 0.2)
        for table, kept in schema.KEPT.items():
            rows = view.rows(sa.select(table).where(table.c.drive_id == drive_id))
            if table is schema.estimate:
                rows = self.draw.sample(rows, len(rows) // 2)
                rows = [{**row, "north_m": row["north_m"] + moved_m} for row in rows]
            connection.execute(sa.insert(kept), [{**row, "annotation_set": 2} for row in rows])

    def lose(self) -> None:
        """All that is known of a drive goes."""
        if len(self.store.rows(sa.select(schema.drive.c.drive_id))) > 1:
            gone = self._first()
            with self.store.transaction() as connection:
                for table in (*OF_DRIVES, *schema.KEPT.values(), schema.annotation_set):
                    connection.execute(sa.delete(table).where(table.c.drive_id == gone))
                self.store.touch(connection, [gone])

    def sync(self) -> None:
        """NVDB has moved signs, lost one, changed a code, got a new one, or forgot who carries a plate."""
        rows = self.store.rows(sa.select(schema.skiltpunkt.c.nvdb_id).order_by(schema.skiltpunkt.c.nvdb_id))
        for row in self.draw.sample(rows, self.draw.randint(1, 3)):
            with self.store.transaction() as connection:
                new = self.draw.randrange(10**12)
                plates = frozenset(self._plates(row["nvdb_id"]))
                ids = {95: frozenset({row["nvdb_id"], new}), 96: plates | {new + 1}}
                before = places_of(connection, ids)
                self._change(connection, row["nvdb_id"], new)
                self.store.touch(connection, places=before | places_of(connection, ids))

    def turn_the_road(self) -> None:
        """A new road network comes, if the store has one: its road is metered the other way."""
        now, old, new = f"2026-07-{self.draw.randint(1, 28):02}", schema.veglenke, schema.veglenke_aside
        with self.store.transaction() as connection:
            view = self.store.view(connection)
            if not (rows := view.rows(sa.select(old))):
                return
            connection.execute(sa.insert(new), [{**row, "retning": -row["retning"]} for row in rows])
            places = places_beside_changes(connection, "2026-06-01", now)
            swap(connection, old, new)
            self.store.put_fact(connection, "vegnett", {"rejected": [], "fetched_at": now})
            self.store.touch(connection, places=places)

    def _plates(self, point_id: int) -> list[int]:
        plate = schema.skiltplate.c
        rows = self.store.rows(sa.select(plate.nvdb_id).where(plate.point_id == point_id))
        return [row["nvdb_id"] for row in rows]

    def _change(self, connection: sa.Connection, point_id: int, new: int) -> None:
        point, plate = schema.skiltpunkt, schema.skiltplate
        this, carried = point.c.nvdb_id == point_id, plate.c.point_id == point_id
        by_m = self.draw.choice([self.draw.uniform(-3, 3), self.draw.uniform(-30, 30), 900.0])
        match self.draw.randrange(5):
            case 0:
                for table, which in ((point, this), (plate, carried)):
                    connection.execute(sa.update(table).where(which).values(east_m=table.c.east_m + by_m))
            case 1:
                self.lose_sign(connection, point_id)
            case 2:
                code = self.draw.choice(["362.50", "110"])
                connection.execute(sa.update(plate).where(carried).values(skiltnummer=code))
            case 3:
                view = self.store.view(connection)
                of_new = {"nvdb_id": new, "plate_ids": [new + 1]}
                (row,) = view.rows(sa.select(point).where(this))
                east_m = None if row["east_m"] is None else row["east_m"] + by_m
                connection.execute(sa.insert(point), [{**row, **of_new, "east_m": east_m}])
                for row in view.rows(sa.select(plate).where(carried).limit(1)):
                    of_new = {"nvdb_id": new + 1, "point_id": self.draw.choice([new, None])}
                    connection.execute(sa.insert(plate), [{**row, **of_new}])
            case _:
                connection.execute(sa.update(plate).where(carried).values(point_id=None))

    def lose_sign(self, connection: sa.Connection, point_id: int) -> None:
        """NVDB has closed a sign."""
        point, plate = schema.skiltpunkt, schema.skiltplate
        connection.execute(sa.delete(plate).where(plate.c.point_id == point_id))
        connection.execute(sa.delete(point).where(point.c.nvdb_id == point_id))

    def change_a_setting(self) -> None:
        """Another range of view, help of the map, another number of views."""
        self.config = self.draw.choice(SETTINGS)

    def decide(self) -> None:
        """Somebody decides about a finding."""
        rows = self.store.rows(sa.select(schema.change.c.change_id).order_by(schema.change.c.change_id))
        decide(self.store, [self.draw.choice(rows)["change_id"]], Decision.DISMISS, by="a")

    def undo(self) -> None:
        """Somebody takes the last decision back, if there is one."""
        try:
            undo(self.store, by="a")
        except TwinError:
            return


FAR_M, MORE = 3000.0, 10_000_000_000
_IDS = ("drive_id", "estimate_id", "name")


def with_another_place(path: Path) -> None:
    """Let NVDB have the same signs once more, far to the east."""
    with Store.open(path) as store, store.transaction() as connection:
        for table, parent in ((schema.skiltpunkt, None), (schema.skiltplate, "point_id")):
            rows = [dict(row) for row in store.view(connection).rows(sa.select(table))]
            for row in rows:
                row["nvdb_id"] += MORE
                row["east_m"] = None if row["east_m"] is None else row["east_m"] + FAR_M
                if parent is None:
                    row["plate_ids"] = [one + MORE for one in row["plate_ids"]]
                elif row[parent] is not None:
                    row[parent] += MORE
            connection.execute(sa.insert(table), rows)
        # In a country one sign more or less leaves each code as common as it was.
        plates = [dict(row) for row in store.view(connection).rows(sa.select(schema.skiltplate))]
        nowhere = {"east_m": None, "north_m": None, "point_id": None}
        elsewhere = [
            {**row, **nowhere, "nvdb_id": row["nvdb_id"] + k * 100 * MORE}
            for row in plates
            for k in range(1, 20)
        ]
        connection.execute(sa.insert(schema.skiltplate), elsewhere)
        store.touch(connection)


def findings(store: Store) -> str:
    """All that a match says, to the last bit."""
    tables = [
        sa.select(schema.change).order_by(schema.change.c.change_id),
        sa.select(schema.pole_key).order_by(schema.pole_key.c.member),
        sa.select(schema.known_mark).order_by(schema.known_mark.c.id),
        sa.select(schema.decision.c.change_id, schema.decision.c.decision),
    ]
    return json.dumps([store.rows(asked) for asked in tables], sort_keys=True)


@pytest.mark.parametrize("seed", range(HISTORIES))
def test_a_match_is_that_of_everything_after_any_history(
    matched_store: Path, tmp_path: Path, seed: int
) -> None:
    """Drives that come and go, syncs, decisions and other settings: the same findings, bit for bit."""
    path, other = tmp_path / "twin.db", tmp_path / "other.db"
    shutil.copy(matched_store, path)
    with_another_place(path)
    history = History(Store(path), random.Random(seed))
    if seed % 2:
        with_road(history.store, fetched_at="2026-06-01")
    can = (
        history.ingest,
        history.ingest_again,
        history.use_other_annotations,
        history.lose,
        history.sync,
        history.turn_the_road,
        history.change_a_setting,
        history.decide,
    )
    for number in range(STEPS):
        step = history.ingest if number < 2 else history.draw.choice((*can, history.undo))
        step()
        history.store.close()  # which brings SQLite's log into the file
        shutil.copy(path, other)
        report = match(history.store, method=METHOD, config=history.config)
        with Store.open(other) as fresh:
            with fresh.transaction() as connection:
                connection.execute(sa.delete(schema.kept_part))
            assert match(fresh, method=METHOD, config=history.config) == report, step.__name__
            assert findings(history.store) == findings(fresh), step.__name__
            assert history.store.count(schema.kept_part) == fresh.count(schema.kept_part)
    assert match(history.store, method=METHOD, config=history.config, anew=True).kept_agree is True


def test_what_was_touched_is_matched_alike_on_postgresql(
    matched_store: Path, tmp_path: Path, postgres: Server
) -> None:
    """A drive, a sync and a new road network, from one and the same store: the same findings, bit for bit."""
    path = tmp_path / "twin.db"
    shutil.copy(matched_store, path)
    with_another_place(path)
    history = History(Store(path), random.Random(4))
    with_road(history.store, fetched_at="2026-06-01")
    history.ingest()
    match(history.store, method=METHOD)
    history.ingest(FAR_M)
    history.sync()
    history.turn_the_road()
    history.store.close()
    address, said = postgres.new(), list[str]()
    copy_store(path, address)
    with Store(address) as other:
        report = match(other, method=METHOD, progress=said.append)
        assert said[0].startswith("reading what was touched")
        assert match(history.store, method=METHOD) == report
        assert findings(history.store) == findings(other)
        assert match(other, method=METHOD, anew=True).kept_agree is True


def test_what_nothing_touched_is_not_looked_at(matched_store: Path, tmp_path: Path) -> None:
    """A falsified finding stays so while drives and syncs come elsewhere; `--all` finds it."""
    path = tmp_path / "twin.db"
    shutil.copy(matched_store, path)
    with_another_place(path)
    history = History(Store(path), random.Random(1))
    match(history.store, method=METHOD)
    ids = [row["change_id"] for row in history.store.rows(sa.select(schema.change.c.change_id))]
    with history.store.transaction() as connection:
        connection.execute(sa.update(schema.change).values(confidence=0.5))
    asked = sa.select(schema.change.c.confidence).where(schema.change.c.change_id.in_(ids))
    history.ingest(FAR_M)
    match(history.store, method=METHOD)
    assert history.store.count(schema.change) > len(ids)
    assert {row["confidence"] for row in history.store.rows(asked)} == {0.5}
    number = schema.change.c.nvdb_id
    far = (
        sa.select(number)
        .where(number > MORE, number < 9 * MORE, schema.change.c.nvdb_type == 95)
        .order_by(number)
    )
    sign = history.store.rows(far)[0]["nvdb_id"]
    with history.store.transaction() as connection:
        before = places_of(connection, {95: frozenset({sign}), 96: frozenset()})
        history.lose_sign(connection, sign)
        history.store.touch(connection, places=before)
    match(history.store, method=METHOD)
    assert sign not in {row["nvdb_id"] for row in history.store.rows(far)}
    assert {row["confidence"] for row in history.store.rows(asked)} == {0.5}
    assert match(history.store, method=METHOD, anew=True).kept_agree is False
    assert 0.5 not in {row["confidence"] for row in history.store.rows(asked)}


def test_all_finds_a_kept_part_that_is_wrong(opened: Store) -> None:
    """A match believes what was kept, only `--all` does not; and it puts it right."""
    match(opened, method=METHOD)
    right = findings(opened)
    with opened.transaction() as connection:
        kept = Kept(opened.view(connection))
        for kind, key in connection.execute(sa.select(schema.kept_part.c.kind, schema.kept_part.c.key)):
            if kind == "views":
                part = dict(kept.get(kind, key) or {})
                zero = np.zeros_like(part["views"])
                kept.put(kind, key, {**part, "views": zero, "fronts": zero})
        kept.save(connection, rest_goes=False)
        opened.touch(connection)
    match(opened, method=METHOD)
    assert findings(opened) != right
    assert match(opened, method=METHOD, anew=True).kept_agree is False
    assert findings(opened) == right
    match(opened, method=METHOD)
    assert findings(opened) == right
