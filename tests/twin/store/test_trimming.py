"""``twin store trim``: what is old goes, and no finding notices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Twin
from store_rows import row

from twin.errors import ConfigError, RefusedError
from twin.store import schema
from twin.store.kinds import JobKind, JobState
from twin.store.store import Store, utc_now
from twin.store.trimming import trim_store

OLD = "2020-01-01T00:00:00Z"
POINT = schema.MIRROR[95].history
SIGHTING = schema.KEPT[schema.sighting]


def fill(store: Store) -> None:
    """Add of everything that may go what is old, and beside it what must stay."""
    now = utc_now()
    sets = [("d", 1, OLD, False), ("d", 2, now, True), ("d", 3, now, False), ("e", 1, OLD, True)]
    sets.append(("f", 1, None, False))
    jobs: list[dict[str, Any]] = [
        {"address": "old", "state": JobState.DONE, "ended_at": OLD},
        {"address": "new", "state": JobState.DONE, "ended_at": now},
        {"address": "waits", "state": JobState.WAITING, "ended_at": OLD},
        {"address": "parked", "state": JobState.PARKED, "ended_at": OLD},
        {"address": "", "state": JobState.DONE, "ended_at": OLD, "kind": JobKind.MATCH},
    ]
    named = ("drive_id", "number", "read_at", "is_current")
    rows: dict[sa.Table, list[dict[str, Any]]] = {
        schema.annotation_set: [dict(zip(named, one, strict=True)) for one in sets],
        SIGHTING: [{"drive_id": "d", "number": 1, "annotation_set": k, "object": "x" * 999} for k in (1, 3)],
        POINT: [{"nvdb_id": k, "seen_until": at} for k, at in ((1, OLD), (2, OLD), (1, now))],
        schema.sent: [
            {"id": 1, "objects": [{"type_id": 95, "nvdb_id": 2}, {"type_id": 96, "nvdb_id": None}]}
        ],
        schema.fleet_job: [
            {"job_id": k, "digest": str(k), "kind": JobKind.INGEST, **one} for k, one in enumerate(jobs, 1)
        ],
    }
    with store.transaction() as connection:
        for table, some in rows.items():
            connection.execute(sa.insert(table), [row(table, **values) for values in some])
        store.put_fact(connection, "mirror", {"area": "a", "since": "2019-01-01T00:00:00Z"})


def everything(store: Store) -> dict[str, list[Any]]:
    """Every row of a store."""
    return {table.name: store.rows(sa.select(table)) for table in schema.metadata.sorted_tables}


def test_only_what_is_old_and_rests_on_nothing_goes(either: Store) -> None:
    """Old sets that are not current, past states of what was not sent, drives that are done."""
    fill(either)
    before = everything(either)
    would = trim_store(either, 30, dry_run=True)
    with pytest.raises(RefusedError, match="2 annotation sets"):
        trim_store(either, 30)
    assert everything(either) == before
    done = trim_store(either, 30, yes=True)
    assert dict(done.parts) == dict(would.parts)
    assert {name: part.rows for name, part in done.parts.items()} == {
        "annotation_set": 2,
        "sighting_kept": 1,
        "skiltpunkt_history": 1,
        "fleet_job": 1,
    }
    assert 1000 <= done.parts["sighting_kept"].n_bytes <= 1500
    assert done.kept_room is None
    after = everything(either)
    assert {(one["drive_id"], one["number"]) for one in after["annotation_set"]} == {
        ("d", 2),
        ("d", 3),
        ("e", 1),
    }
    assert [one["annotation_set"] for one in after["sighting_kept"]] == [3]
    assert [(one["nvdb_id"], one["seen_until"] == OLD) for one in after["skiltpunkt_history"]] in (
        [(2, True), (1, False)],
        [(1, False), (2, True)],
    )
    assert {one["address"] for one in after["fleet_job"]} == {"new", "waits", "parked", ""}
    # Of days before that the mirror says that it was not watching.
    assert either.fact("mirror") == {"area": "a", "since": done.before}
    changed = {*done.parts, "meta"}
    assert {name: rows for name, rows in after.items() if name not in changed} == {
        name: rows for name, rows in before.items() if name not in changed
    }
    assert not trim_store(either, 30).parts


def test_file_is_smaller_afterwards(empty: Store) -> None:
    """SQLite's file gives back what went, also to the system."""
    with empty.transaction() as connection:
        rows = [row(POINT, nvdb_id=k, seen_until=OLD, raw=bytes(10_000)) for k in range(300)]
        connection.execute(sa.insert(POINT), rows)
    done = trim_store(empty, 1)
    assert done.parts[POINT.name].n_bytes > 3_000_000
    assert empty.path.stat().st_size < 1_000_000


def test_sync_at_work_and_no_age_are_refused(either: Store) -> None:
    """A sync would write the beginning of its mirror over ours."""
    with either.alone("sync", "sync"), pytest.raises(RefusedError):
        trim_store(either, 30)
    for days in (0, 10**6):
        with pytest.raises(ConfigError, match="days"):
            trim_store(either, days)


def test_findings_evidence_and_positions_are_the_same_before_and_after(
    twin: Twin, store: Path, trip: Path
) -> None:
    """On the sample, of whose drive an older annotation set goes; also after a match of everything."""
    xml = next(trip.rglob("*.xml"))
    twin("decide", "accept", "--verdict", "moved", "--store", store)
    xml.write_bytes(xml.read_bytes().replace(b"</annotations>", b"<!-- again --></annotations>"))
    twin("ingest-drive", trip, "--store", store)
    with Store.open(store) as opened, opened.transaction() as connection:
        number = connection.execute(sa.select(sa.func.count()).select_from(schema.annotation_set)).scalar()
        of = sa.update(schema.annotation_set).where(~schema.annotation_set.c.is_current)
        connection.execute(of.values(read_at=OLD))
        connection.execute(sa.insert(POINT), [row(POINT, nvdb_id=77, seen_until=OLD)])
    assert number == 2
    twin("match", "--store", store)

    def told() -> list[Any]:
        found, shown = (
            twin(*one, "--store", store, "--json").json for one in (["findings"], ["show", "P01"])
        )
        del found["matched_at"]
        return [found, shown]

    before = told()
    assert twin("store", "trim", "--older-than", 30, "--store", store).code == 5
    assert "annotation_set" in twin("store", "trim", "--older-than", 30, "--dry-run", "--store", store).out
    gone = twin("store", "trim", "--older-than", 30, "--yes", "--store", store, "--json").json["parts"]
    names = {"drive_kept", "drive_method_kept", "estimate_kept", "sighting_kept"}
    assert gone.keys() == names | {"annotation_set", "skiltpunkt_history"}
    assert told() == before
    assert twin("match", "--all", "--store", store).code == 0
    assert told() == before
