"""The mirror in a store: what `twin sync-nvdb` leaves behind, refuses and shows to readers."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Twin
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.mirror import Backfill, FetchResult, Following, MassDeletionError, SourcePage
from nvdb.objects import skilt_from_les_v4
from nvdb.replay import ReplayServer
from twin.mirror.mirror_tables import StoreMirror
from twin.mirror.raw import raw_object
from twin.mirror.sync import sync_nvdb
from twin.store import schema
from twin.store.store import Store

SOURCES = ("les-v4", "uberiket")


@pytest.fixture
def world() -> GeneratedWorld:
    """30 points with 60 plates, in pages of 20."""
    made = GeneratedWorld(30, 60, seed=5)
    made.page_limit = 20
    return made


@pytest.fixture
def url(world: GeneratedWorld) -> Iterator[str]:
    """Where the world is served."""
    with ReplayServer(world) as server:
        yield server.url


def ids(store: Store, table: sa.Table) -> list[int]:
    """Ids in a table, in order."""
    return [row["nvdb_id"] for row in store.rows(sa.select(table.c.nvdb_id).order_by(table.c.nvdb_id))]


def page(world: GeneratedWorld, wanted: list[int], cursor: str = "1:1", **more: Any) -> SourcePage:
    """A page of plates."""
    records = [world.one(96, number) for number in wanted]
    plates = tuple(skilt_from_les_v4(record.raw, 96) for record in records if record is not None)
    return SourcePage(96, plates, (), cursor, len(plates), **more)


def test_mirror_store_keeps_every_field_of_a_sign(world: GeneratedWorld, empty: Store) -> None:
    """A row holds what the typed view holds, and the object as it came can be had again."""
    mirror = StoreMirror(empty)
    mirror.begin_backfill(Backfill("les-v4", "the whole country", "7"))
    wanted = world.ids(96, 60)
    made = page(world, wanted)
    mirror.save_page(made)
    mirror.publish(Following("les-v4", "the whole country", "7"))
    rows = {row["nvdb_id"]: row for row in empty.rows(sa.select(schema.skiltplate))}
    assert sorted(rows) == wanted
    for plate in made.objects:
        row = rows[plate.nvdb_id]
        assert raw_object(row) == plate.raw
        position = (row["east_m"], row["north_m"], row["height_m"])
        where = plate.position
        assert position == ((where.east_m, where.north_m, where.height_m) if where else (None, None, None))
        for name in ("version", "start_date", "own_geometry", "accuracy_cm", "capture_method", "text"):
            assert row[name] == getattr(plate, name)
        assert (row["skiltnummer"], row["kommuner"]) == (plate.skiltnummer, list(plate.kommuner))  # type: ignore[union-attr]


def test_mirror_store_keeps_the_last_of_an_object_that_comes_twice(
    world: GeneratedWorld, empty: Store
) -> None:
    """A backfill that shows an object on two pages has it once, in its later state."""
    mirror = StoreMirror(empty)
    mirror.begin_backfill(Backfill("les-v4", "the whole country", "7"))
    first, second = world.ids(96, 2)
    mirror.save_page(page(world, [first, second]))
    world.update(first, egenskaper=[])
    mirror.save_page(page(world, [first], "2:1"))
    assert mirror.count_aside(96) == 2
    assert ids(empty, schema.skiltplate) == []
    mirror.publish(Following("les-v4", "the whole country", "7"))
    (row,) = empty.rows(sa.select(schema.skiltplate).where(schema.skiltplate.c.nvdb_id == first))
    assert row["skiltnummer"] is None


def test_mirror_store_remembers_a_backfill_and_its_unreadable_objects(
    world: GeneratedWorld, empty: Store
) -> None:
    """Cursors and unreadable ids outlive the process; an object that is read later is forgotten."""
    mirror = StoreMirror(empty)
    begun = Backfill("les-v4", "the whole country", "7")
    mirror.begin_backfill(begun)
    assert StoreMirror(empty).backfill() == begun
    first, second, third = world.ids(96, 3)
    mirror.save_page(page(world, [first], "1:1", unreadable=frozenset({second, third})))
    mirror.save_page(page(world, [second], "2:1"))
    expected = Backfill("les-v4", "the whole country", "7", {96: "2:1"}, {96: frozenset({third})})
    assert StoreMirror(empty).backfill() == expected
    mirror.begin_changes()
    assert (mirror.backfill(), mirror.count_aside(96)) == (None, 0)


def test_mirror_store_takes_no_page_before_a_backfill(world: GeneratedWorld, empty: Store) -> None:
    """A page without a backfill has no cursor to go with: a fault of the caller."""
    with pytest.raises(RuntimeError, match="begin_backfill"):
        StoreMirror(empty).save_page(page(world, world.ids(96, 1)))


def test_mirror_store_fills_gaps_from_the_visible_mirror(world: GeneratedWorld, empty: Store) -> None:
    """keep_visible copies states that are not aside, drop_aside takes out what is gone, and only there."""
    mirror = StoreMirror(empty)
    wanted = world.ids(96, 4)
    for position in ("7", "8"):
        mirror.begin_backfill(Backfill("les-v4", "the whole country", position))
        mirror.save_page(page(world, wanted if position == "7" else wanted[:2]))
        if position == "7":
            mirror.publish(Following("les-v4", "the whole country", position))
    mirror.drop_aside({96: frozenset({wanted[0], 1})})
    mirror.keep_visible({96: frozenset({wanted[1], wanted[2], 1})})
    assert ids(empty, schema.MIRROR[96].aside) == wanted[1:3]
    assert ids(empty, schema.skiltplate) == wanted
    applied = mirror.publish(Following("les-v4", "the whole country", "8"))
    assert (applied.deleted[96], applied.changed[96], applied.total[96]) == (2, 0, 2)


def test_mirror_store_counts_ids_in_many_chunks(world: GeneratedWorld, empty: Store) -> None:
    """Thousands of ids do not meet the limit of SQLite's parameters."""
    mirror = StoreMirror(empty)
    mirror.begin_changes()
    wanted = world.ids(96, 60)
    mirror.save_changes(FetchResult(page(world, wanted).objects, frozenset()))
    mirror.apply(Following("les-v4", "x", "1"), {})
    assert mirror.count(96, range(wanted[0], wanted[-1] + 1)) == 60
    applied = mirror.apply(Following("les-v4", "x", "2"), {96: frozenset(range(wanted[0], wanted[59]))})
    assert (applied.deleted[96], applied.total[96]) == (59, 1)


def test_mirror_store_raises_the_revision_only_when_something_changed(
    world: GeneratedWorld, url: str, empty: Store
) -> None:
    """Findings stay valid through a sync that brings nothing."""
    revisions = []
    for change in (None, None, world.ids(96, 1)):
        world.touch(change or [])
        sync_nvdb(empty, Area(), api_url=url)
        revisions.append(empty.revision())
    assert revisions[0] == revisions[1] < revisions[2]


@pytest.mark.parametrize("source", SOURCES)
def test_mirror_readers_in_one_snapshot_see_one_mirror(
    world: GeneratedWorld, url: str, empty: Store, source: str
) -> None:
    """A reader that began before the swap goes on in the old mirror; a new one sees the new."""
    sync_nvdb(empty, Area(), api_url=url, source=source)
    old = ids(empty, schema.skiltplate)
    with empty.snapshot() as reader:
        statement = sa.select(schema.skiltplate.c.nvdb_id).order_by(schema.skiltplate.c.nvdb_id)
        assert [row["nvdb_id"] for row in reader.rows(statement)] == old
        world.remove(old[7])
        with Store.open(empty.path) as writer:
            result = sync_nvdb(writer, Area(), api_url=url, source=source, fresh=True)
        assert (result.mode, result.deleted, result.skiltplate) == ("backfill", 1, 59)
        assert [row["nvdb_id"] for row in reader.rows(statement)] == old
    assert ids(empty, schema.skiltplate) == [number for number in old if number != old[7]]


def test_sync_command_refuses_mass_deletion(
    world: GeneratedWorld, url: str, tmp_path: Path, twin: Twin
) -> None:
    """Exit code 5 with the cure in the message; --confirm-deletions lets the deletions pass."""
    command = ["sync-nvdb", "--api-url", url, "--store", tmp_path / "a.db"]
    assert twin(*command, "--all").code == 0
    for number in world.ids(96, 40):
        world.remove(number)
    refused = twin(*command, "--all")
    assert refused.code == 5
    assert "would delete 40 of 60 Skiltplate" in refused.err
    assert "confirm the deletions (--confirm-deletions)." in refused.err
    assert twin(*command, "--all", "--confirm-deletions").code == 0
    with Store.open(tmp_path / "a.db") as store:
        assert ids(store, schema.skiltplate) == world.ids(96, 60, 40)


@pytest.mark.parametrize("source", SOURCES)
def test_kept_counts_are_those_of_the_objects(
    world: GeneratedWorld, url: str, empty: Store, source: str
) -> None:
    """After backfills and rounds of changes, removals and creations the kept counts are the true ones."""
    rng = random.Random(source)
    mirror = StoreMirror(empty)
    for n in range(6):
        plates = [number for number in world.ids(96, 60) if world.one(96, number) is not None]
        gone = sorted(set(world.ids(96, 60)) - set(plates))
        if n:
            world.touch([*rng.sample(plates, 5), *rng.sample(world.ids(95, 30), 3)])
            geometry = {"wkt": "POINT Z (270000 7040000 5)", "srid": 5973, "egengeometri": False}
            world.update(rng.choice(plates), geometri=geometry, egenskaper=[])
            world.remove(rng.choice(plates))
            if gone:
                world.recreate(gone[0])
        result = sync_nvdb(empty, Area(), api_url=url, source=source, fresh=n == 3)
        assert mirror.counts() == mirror.recounted()
        rows = [row for t in (schema.skiltpunkt, schema.skiltplate) for row in empty.rows(sa.select(t))]
        assert result.skiltpunkt + result.skiltplate == len(rows)
        assert result.without_own_geometry == sum(not row["own_geometry"] for row in rows)
        own = Counter(row["capture_method"] for row in rows if row["own_geometry"])
        assert result.by_capture_method == {kind or "not stated": n for kind, n in own.items()}


def test_mirror_of_an_older_store_is_counted_once(world: GeneratedWorld, url: str, empty: Store) -> None:
    """A store without kept counts is counted when it is next synced: its guard against deletions holds."""
    sync_nvdb(empty, Area(), api_url=url)
    with empty.transaction() as connection:
        empty.drop_fact(connection, "mirror_counts")
    for number in world.ids(96, 40):
        world.remove(number)
    with pytest.raises(MassDeletionError, match="40 of 60"):
        sync_nvdb(empty, Area(), api_url=url)
    assert sync_nvdb(empty, Area(), api_url=url, confirm_deletions=True).skiltplate == 20


def test_following_changes_reads_no_visible_table_from_end_to_end(
    world: GeneratedWorld, url: str, empty: Store
) -> None:
    """By SQLite's own plans a round of changes costs what changed, and one without news nothing."""
    sync_nvdb(empty, Area(), api_url=url)
    world.touch(world.ids(96, 7))
    world.remove(world.ids(96, 8)[7])
    asked: list[tuple[str, Any]] = []

    def note(_c: Any, _cursor: Any, text: str, values: Any, _context: Any, many: bool) -> None:
        if not many and text.startswith(("SELECT", "INSERT", "UPDATE", "DELETE")):
            asked.append((text, values))

    sa.event.listen(sa.Engine, "before_cursor_execute", note)
    try:
        for _ in range(2):
            sync_nvdb(empty, Area(), api_url=url)
    finally:
        sa.event.remove(sa.Engine, "before_cursor_execute", note)
    assert any("skiltplate_history" in text for text, _ in asked)
    with empty.transaction() as connection:
        for text, values in asked:
            plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {text}", values)
            steps = [row[3] for row in plan]
            assert not {"SCAN skiltpunkt", "SCAN skiltplate"} & set(steps), text
            assert not any(step.startswith(("SCAN skiltpunkt U", "SCAN skiltplate U")) for step in steps), (
                text
            )
