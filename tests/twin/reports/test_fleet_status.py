"""``twin status`` of a fleet: what came in, what waits, what nobody has decided; and for Prometheus."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest
import sqlalchemy as sa
from command_line import Twin
from findings import finding
from prometheus_client.parser import text_string_to_metric_families
from store_rows import row

from twin.decisions.record import decide
from twin.fleet.queue import MOST_FAILED, Queue
from twin.matching.save import save_changes
from twin.reports.prometheus import prometheus_text
from twin.reports.store_status import status
from twin.store import schema
from twin.store.kinds import Decision, Fault, JobKind, Verdict
from twin.store.store import Store


def add_drive(store: Store, number: int, read_at: str | None, *, is_current: bool = True) -> None:
    """Add a drive of 1 km that began `number` days after 1970, and an annotation set of it."""
    drive_id = f"d{number}"
    values = {"drive_id": drive_id, "started_ns": number * 86_400 * 10**9, "length_m": 1000.0}
    of_set = {"drive_id": drive_id, "number": 1, "read_at": read_at, "is_current": is_current}
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.drive), [row(schema.drive, **values)])
        connection.execute(sa.insert(schema.annotation_set), [row(schema.annotation_set, **of_set)])


def test_days_are_the_last_seven_on_which_drives_were_read(either: Store) -> None:
    """Of nine such days; drives read before days were kept, and sets that do not count, are on none."""
    for day in range(1, 10):
        add_drive(either, day, f"2026-06-{day:02}T23:59:59Z")
    add_drive(either, 10, "2026-06-09T00:00:00Z")
    add_drive(either, 11, None)
    add_drive(either, 12, "2026-06-09T00:00:00Z", is_current=False)
    days = status(either).days
    assert [(one.day[-2:], one.n, one.length_m) for one in days[:2]] == [("09", 2, 2000.0), ("08", 1, 1000.0)]
    assert [one.day[-2:] for one in days] == [f"{day:02}" for day in range(9, 2, -1)]


def test_queue_is_counted_by_state_with_reasons_and_its_oldest(either: Store) -> None:
    """One parked, one that failed once and waits, one running, one done; the match is no drive."""
    queue = Queue(either, "w")
    queue.add(JobKind.INGEST, ["a"], {})
    for _ in range(MOST_FAILED):
        job = queue.claim()
        assert job is not None
        queue.fail(job, Fault.STORAGE, "away", 1.0)
    queue.add(JobKind.INGEST, ["b", "c", "d"], {})
    queue.add(JobKind.MATCH, [""], {})
    with either.transaction() as connection:
        old = {"added_at": "2026-01-01T00:00:00Z"}
        connection.execute(sa.update(schema.fleet_job).where(schema.fleet_job.c.address != "c").values(**old))
    done, failed = queue.claim(), queue.claim()
    assert done is not None
    assert failed is not None
    with either.transaction() as connection:
        queue.finish(connection, done, "d1", "f", 1.0)
    queue.fail(failed, Fault.DRIVE, "bad", 1.0)
    queue.claim()
    found = status(either).queue
    assert found.jobs == {"waiting": 1, "running": 1, "done": 1, "parked": 1}
    assert (found.failing, found.parked, found.oldest) == (1, {"storage": 1}, "2026-01-01T00:00:00Z")
    queue.retry()
    again = status(either).queue
    assert (again.jobs["parked"], again.parked) == (0, {})


def test_oldest_undecided_is_the_open_finding_of_the_earliest_drive(either: Store) -> None:
    """Neither a decided one, nor one that asks nobody."""
    for number in (1, 2, 3):
        add_drive(either, number, None)
    found = [
        finding("quiet", verdict=Verdict.UNCHANGED, drive_ids=("d1",)),
        finding("decided", drive_ids=("d1", "d2")),
        finding("waits", drive_ids=("d3", "d2")),
        finding("later", drive_ids=("d3",)),
    ]
    save_changes(either, found, {}, {"method": "m", "at": "2026-06-10T08:00:00Z"})
    decide(either, ["decided"], Decision.DISMISS, by="ann")
    oldest = status(either).oldest_open
    assert oldest is not None
    assert (oldest.change_id, oldest.since) == ("waits", "1970-01-03T00:00:00Z")


def test_prometheus_reads_every_number_of_the_status(twin: Twin, store: Path, tmp_path: Path) -> None:
    """Its own parser finds the numbers that --json gives, also of a store named with quotes."""
    strange = tmp_path / 'a "b" \\c'
    strange.mkdir()
    store = store.rename(strange / "twin.db")
    with Store.open(store) as opened:
        Queue(opened).add(JobKind.INGEST, ["x", "y"], {})
        text = prometheus_text(status(opened))
    said = twin("status", "--store", store, "--json").json
    families = list(text_string_to_metric_families(text))
    assert all(family.documentation and family.type == "gauge" for family in families)
    samples = [sample for family in families for sample in family.samples]
    assert {sample.labels.pop("store") for sample in samples} == {str(store)}
    values = {(one.name.removeprefix("twin_"), *one.labels.values()): one.value for one in samples}
    assert len(values) == len(samples)
    for name, counts in (
        ("estimates", said["estimates"]),
        ("findings", said["verdicts"]),
        ("decisions", said["decisions"]),
        ("queue_drives", said["queue"]["jobs"]),
    ):
        assert {key[1]: value for key, value in values.items() if key[0] == name} == counts
    for name, at in (
        ("mirror_synced", said["mirror"]["synced_at"]),
        ("last_match", said["last_match"]["at"]),
        ("oldest_open_finding", said["oldest_open"]["since"]),
        ("queue_oldest", said["queue"]["oldest"]),
    ):
        assert values[f"{name}_timestamp_seconds",] == dt.datetime.fromisoformat(at).timestamp()
    assert twin("status", "--store", store, "--prometheus").out == text
    assert twin("status", "--store", store, "--prometheus", "--json").code == 2


@pytest.mark.parametrize("lang", ["en", "nb"])
def test_table_names_the_queue_only_where_there_was_one(twin: Twin, store: Path, lang: str) -> None:
    """Who has one car sees which drive came in, and nothing of a fleet."""
    word = {"en": "0 running", "nb": "0 under arbeid"}[lang]
    today = dt.datetime.now(dt.UTC).date().isoformat()
    first = twin("status", "--store", store, "--lang", lang).out
    assert f"{today[:8]}" in first
    assert word not in first
    with Store.open(store) as opened:
        Queue(opened).add(JobKind.INGEST, ["x"], {})
    assert word in twin("status", "--store", store, "--lang", lang).out
