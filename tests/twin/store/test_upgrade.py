"""A store of an older version, opened by this one."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest
import sqlalchemy as sa
from store_rows import row

from twin.errors import StoreError
from twin.store import schema
from twin.store.annotation_sets import all_annotation_sets
from twin.store.store import Store

SINCE_9 = ("annotation_set", *(table.name for table in schema.KEPT.values()))


SINCE_10 = ("known_mark",)
SINCE_12 = ("session", "request")
_VIEW_BEFORE_12 = (
    "CREATE VIEW decision AS SELECT * FROM decision_log AS e "
    "WHERE e.id = (SELECT max(n.id) FROM decision_log AS n WHERE n.change_id = e.change_id)"
)
SINCE_11 = ("crop", "crop_gap", "crop_log")
SINCE_15 = ("kept_part",)
SINCE_16 = ("fleet_job",)
_WITHOUT_INDEXES_OF_15 = (
    "DROP INDEX ix_skiltpunkt_east_m; DROP INDEX ix_skiltplate_east_m; DROP INDEX ix_skiltplate_point_id"
)


def older(path: Path, version: int = 4) -> Path:
    """Make a store as version 4 to 15 wrote it, with one decision."""
    Store.open(path).close()
    with sqlite3.connect(path) as raw:
        _older_log(raw, version)
        _older_schema(raw, version)
        for table in ("sighting", "sighting_kept") if version < 11 else ():
            for column in ("width_px", "height_px", *(["is_measured"] if version < 10 else [])):
                raw.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        gone = ((16, SINCE_16), (15, SINCE_15), (11, SINCE_11), (10, SINCE_10), (9, SINCE_9))
        for table in (table for since, tables in gone if version < since for table in tables):
            raw.execute(f"DROP TABLE {table}")
        if version < 8:
            raw.execute("DROP TABLE sent")
        if version < 7:
            raw.execute("ALTER TABLE drive_method DROP COLUMN misfits")
            raw.execute("ALTER TABLE drive_method DROP COLUMN absence_gap")
        if version < 6:
            raw.execute("ALTER TABLE estimate DROP COLUMN text")
            raw.execute("ALTER TABLE change DROP COLUMN cameras")
        if version < 5:
            raw.execute("ALTER TABLE estimate DROP COLUMN nvdb_type")
        raw.execute("UPDATE meta SET value = ? WHERE key = 'schema_version'", (str(version),))
        values = (1, "c1", "decided", "accept", "seen", "someone", "2026-06-10T08:00:00Z", "{}")
        columns = 'batch, change_id, kind, decision, reason, "by", at, evidence'
        if version >= 12:
            columns, values = f"{columns}, session", (*values, "")
        raw.execute(f"INSERT INTO decision_log ({columns}) VALUES ({', '.join('?' * len(values))})", values)
    raw.close()
    return path


def _older_schema(raw: sqlite3.Connection, version: int) -> None:
    if version < 15:
        raw.executescript(_WITHOUT_INDEXES_OF_15)
    if version < 14:
        raw.execute("ALTER TABLE crop_gap DROP COLUMN why")


def _older_log(raw: sqlite3.Connection, version: int) -> None:
    if version < 13:
        raw.execute("ALTER TABLE decision_log DROP COLUMN cause")
    if version < 12:
        raw.execute("DROP VIEW decision")
        for column in SINCE_12:
            raw.execute(f"DROP INDEX ix_decision_log_{column}")
            raw.execute(f"ALTER TABLE decision_log DROP COLUMN {column}")
        raw.execute(_VIEW_BEFORE_12)


@pytest.mark.parametrize("version", [4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15])
def test_older_store_is_upgraded_with_its_decisions(tmp_path: Path, version: int) -> None:
    """The new columns are there, empty, and nothing that a user decided is lost."""
    path = older(tmp_path / "twin.db", version)
    with Store.open(path) as store:
        assert store.rows(sa.select(schema.estimate.c.nvdb_type, schema.estimate.c.text)) == []
        assert store.rows(sa.select(schema.change.c.cameras)) == []
        assert store.rows(sa.select(schema.sent)) == []
        assert [one["decision"] for one in store.rows(sa.select(schema.decision))] == ["accept"]
    with Store.open(path, create=False) as again:
        versions = again.rows(sa.select(schema.meta.c.value).where(schema.meta.c.key == "schema_version"))
    assert versions == [{"value": str(schema.VERSION)}]


@pytest.mark.parametrize(
    "table",
    [
        *("estimate", "change", "drive_method", "sent", "sighting", "decision_log"),
        *SINCE_9,
        *SINCE_10,
        *SINCE_11,
        *SINCE_15,
        *SINCE_16,
        *("skiltpunkt", "skiltplate"),
    ],
)
def test_upgraded_store_has_the_tables_of_a_new_one(tmp_path: Path, table: str) -> None:
    """Column by column, in the same order."""
    tables = []
    for path in (older(tmp_path / "old.db"), tmp_path / "new.db"):
        Store.open(path).close()
        with sqlite3.connect(path) as raw:
            columns = raw.execute('SELECT name, type, "notnull" FROM pragma_table_info(?)', (table,))
            indexes = raw.execute("SELECT count(*) FROM pragma_index_list(?)", (table,))
            tables.append((columns.fetchall(), indexes.fetchall()))
        raw.close()
    assert tables[0] == tables[1]


@pytest.mark.parametrize(
    ("corrections", "misfits", "gap"),
    [
        (
            {"misfits": ["C2 is turned", "C3 is turned"], "absence_gap": "half was lost"},
            ["C2 is turned", "C3 is turned"],
            "half was lost",
        ),
        ({}, [], ""),
    ],
)
def test_what_speaks_against_a_drive_moves_out_of_its_corrections(
    tmp_path: Path, corrections: dict[str, object], misfits: list[str], gap: str
) -> None:
    """A drive that did not fit itself before the upgrade does not fit itself after it."""
    path = older(tmp_path / "twin.db", 6)
    noise = {"pixel_noise_factor": 1.5}
    with sqlite3.connect(path) as raw:
        values = ("d1", "adjusted", 2, json.dumps({**noise, **corrections}))
        raw.execute("INSERT INTO drive_method VALUES (?, ?, ?, ?)", values)
    raw.close()
    with Store.open(path) as store:
        (told,) = store.rows(sa.select(schema.drive_method))
    assert (told["corrections"], told["misfits"], told["absence_gap"]) == (noise, misfits, gap)


def test_drives_of_an_older_store_are_annotation_sets_that_count(tmp_path: Path) -> None:
    """Set 1 of each drive; which annotations it was made of is not known."""
    path = older(tmp_path / "twin.db", 8)
    with sqlite3.connect(path) as raw:
        for drive in (row(schema.drive, drive_id=d, n_annotations=n) for d, n in (("a", 7), ("b", 0))):
            marks = ", ".join("?" * len(drive))
            values = [json.dumps(value) if value == [] else value for value in drive.values()]
            raw.execute(f"INSERT INTO drive VALUES ({marks})", values)
    raw.close()
    with Store.open(path) as store:
        sets = [named.annotation_set for named in all_annotation_sets(store)]
    assert [(one.drive_id, one.number, one.n_annotations) for one in sets] == [("a", 1, 7), ("b", 1, 0)]
    assert all(one.is_current and one.annotations_sha256 is None for one in sets)


def test_sightings_of_a_store_of_version_9_were_all_measured(tmp_path: Path) -> None:
    """Those that count and those that are kept beside them, with all that was known of them."""
    path = older(tmp_path / "twin.db", 9)
    since = {"is_measured", "width_px", "height_px"}
    of_one = {c.name: 0 for c in schema.sighting.columns if c.name not in since}
    with sqlite3.connect(path) as raw:
        for table, one in (("sighting", of_one), ("sighting_kept", {**of_one, "annotation_set": 1})):
            raw.execute(f"INSERT INTO {table} VALUES ({', '.join('?' * len(one))})", list(one.values()))
    raw.close()
    with Store.open(path) as store:
        for table, more in (
            (schema.sighting, {}),
            (schema.KEPT[schema.sighting], {"annotation_set": 1}),
        ):
            (read,) = store.rows(sa.select(*(sa.cast(c, sa.Integer).label(c.name) for c in table.columns)))
            assert read == of_one | {"is_measured": 1, "width_px": None, "height_px": None} | more


def test_poles_of_an_older_store_are_known_again(store: Path) -> None:
    """By their clicks: what a match of today kept is there again, and the like of other methods."""
    asked = sa.select(schema.known_mark).order_by(schema.known_mark.c.drive_id, schema.known_mark.c.clicks)
    with Store.open(store) as opened:
        kept = {(row["clicks"], row["pole"], row["skiltnummer"]) for row in opened.rows(asked)}
    with Store.open(older(store, 9)) as opened:
        known = {(row["clicks"], row["pole"], row["skiltnummer"]) for row in opened.rows(asked)}
    assert len(kept) == 15
    assert kept <= known


def test_store_that_cannot_be_upgraded_is_refused_untouched(tmp_path: Path) -> None:
    """Version 3 has no way to this one: the sentence says what to do."""
    path = older(tmp_path / "twin.db", 3)
    before = path.read_bytes()
    with pytest.raises(StoreError, match=r"older twin .*into a new --store"):
        Store.open(path)
    assert path.read_bytes() == before


def test_upgrade_that_fails_leaves_the_store_as_it_was(tmp_path: Path) -> None:
    """The column is there already, which no store of version 4 has: nothing is changed."""
    path = older(tmp_path / "twin.db")
    with sqlite3.connect(path) as raw:
        raw.execute("ALTER TABLE estimate ADD COLUMN nvdb_type INTEGER")
    raw.close()
    with pytest.raises(StoreError, match="duplicate column"):
        Store.open(path)
    with sqlite3.connect(path) as raw:
        assert raw.execute("SELECT value FROM meta WHERE key = 'schema_version'").fetchone() == ("4",)
    raw.close()
