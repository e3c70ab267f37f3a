"""The sync of a mirror: real sources, real servers, a real store; what readers see is a whole mirror."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest
from mirror_bench import COUNTRY, Bench, broken, history, is_page, nine, rows, visible

from nvdb.area import Area
from nvdb.errors import AreaError
from nvdb.mirror import SyncProgress, sync
from nvdb.mirror.follow import MAX_LISTED
from nvdb.replay import RequestInfo
from twin.mirror.mirror_tables import StoreMirror
from twin.store import schema


def test_sync_backfills_first_and_follows_then(bench: Bench) -> None:
    """The first run fetches everything, and one without changes asks for the feed alone."""
    first = bench.sync()
    assert (first.mode, nine(first), first.received) == ("backfill", (4, 9), 13)
    assert first.applied.created == {95: 4, 96: 9}
    assert first.expected == {95: 4, 96: 9}
    assert (first.n_problems, first.source, first.area) == (0, bench.kind, "the whole country")
    n_before = len(bench.server.requests)
    second = bench.sync()
    assert (second.mode, nine(second), second.received) == ("changes", (4, 9), 0)
    asked = bench.server.requests[n_before:]
    assert len(asked) <= 2
    assert not any(is_page(info) for info in asked)
    assert visible(bench.store) == bench.clean()


def test_sync_brings_created_changed_removed_and_recreated_objects(bench: Bench, plate: Any) -> None:
    """Each kind of change arrives, and the mirror equals one that is made anew."""
    bench.world.remove(503)
    bench.sync()
    bench.world.create(96, plate(600))
    bench.world.update(501, egenskaper=plate(501)["egenskaper"][:3])
    bench.world.remove(502)
    bench.world.recreate(503)
    bench.world.update(2)
    report = bench.sync()
    assert report.mode == "changes"
    assert (report.applied.created, report.applied.deleted) == ({95: 0, 96: 2}, {95: 0, 96: 1})
    assert report.applied.changed == {95: 1, 96: 1}
    assert visible(bench.store) == bench.clean()
    assert {501, 503, 600} <= {number for _, number in visible(bench.store)}
    assert (96, 502) not in visible(bench.store)
    assert bench.sync().received == 0


def test_sync_has_a_change_between_two_pages(bench: Bench, plate: Any) -> None:
    """What is created, changed, removed and made again, behind the cursor and before it, is in the mirror."""
    bench.world.remove(501)

    def interfere(info: RequestInfo) -> None:
        if is_page(info) and info.path.endswith("96") and "start" in info.query:
            bench.world.on_request = None
            bench.world.create(96, plate(400))
            bench.world.recreate(501)
            for changed in (502, 509):
                bench.world.update(changed, egenskaper=plate(changed)["egenskaper"][:3])
            for removed in (503, 508, 1):
                bench.world.remove(removed)

    bench.world.on_request = interfere
    report = bench.sync()
    assert (report.mode, nine(report)) == ("backfill", (3, 8))
    assert visible(bench.store) == bench.clean()


def test_sync_shows_readers_the_old_mirror_until_the_new_one_is_whole(bench: Bench, plate: Any) -> None:
    """At every request of a backfill, also those that follow the last page, readers see the old mirror."""
    bench.sync()
    old = visible(bench.store)
    for number in (501, 2):
        bench.world.update(number)
    seen: list[bool] = []

    def look(info: RequestInfo) -> None:
        seen.append(visible(bench.store) == old)
        if is_page(info) and "start" in info.query and len(bench.world.events) == 2:
            bench.world.create(96, plate(400))

    bench.world.on_request = look
    bench.sync(fresh=True)
    assert all(seen)
    assert len(seen) > 10
    assert visible(bench.store) == bench.clean() != old


def test_sync_keeps_when_an_unchanged_object_was_fetched(bench: Bench, plate: Any) -> None:
    """Only what differs gets a new synced_at, whether by changes or by a fresh backfill."""
    bench.sync()
    first = bench.clock.time - timedelta(minutes=1)
    bench.clock.time += timedelta(days=2)
    bench.world.update(501, egenskaper=plate(501)["egenskaper"][:3])
    bench.world.segment(502)
    day = bench.clock.text()
    for fresh in (False, True):
        bench.sync(fresh=fresh)
        fetched = {row["nvdb_id"]: row["synced_at"] for row in rows(bench.store, schema.skiltplate)}
        assert fetched.pop(501) == day
        assert set(fetched.values()) == {f"{first:%Y-%m-%dT%H:%M:%SZ}"}


@pytest.mark.parametrize("fresh", [False, True])
def test_sync_keeps_replaced_states_in_the_history(bench: Bench, plate: Any, fresh: bool) -> None:
    """A changed and a removed object leave their last state, and when we learnt that it was over."""
    bench.sync()
    before = visible(bench.store)
    bench.clock.time += timedelta(days=2)
    bench.world.update(501, egenskaper=plate(501)["egenskaper"][:3])
    bench.world.remove(502)
    bench.world.create(96, plate(600))
    until = bench.clock.text()
    bench.sync(fresh=fresh)
    kept = {row["nvdb_id"]: row for row in history(bench.store)}
    assert sorted(kept) == [501, 502]
    for number, row in kept.items():
        assert row.pop("seen_until") == until
        assert row.pop("synced_at") < until
        assert row == before[96, number]


def test_sync_keeps_the_older_of_two_states_that_end_in_one_second(bench: Bench, plate: Any) -> None:
    """Two syncs within a second leave the state that was visible before the first of them."""
    bench.sync()
    before = visible(bench.store)[96, 501]
    for parts in (3, 2):
        bench.world.update(501, egenskaper=plate(501)["egenskaper"][:parts])
        sync(bench.source(), StoreMirror(bench.store), COUNTRY, clock=bench.clock)
    (row,) = history(bench.store)
    assert row["raw"] == before["raw"]
    assert visible(bench.store) == bench.clean()


def test_sync_keeps_an_unreadable_object_as_it_was_and_asks_again(bench: Bench, plate: Any) -> None:
    """An object in a broken form stays in its old state, is named, and arrives once it can be read."""
    bench.sync()
    old = visible(bench.store)[96, 505]
    bench.world.update(505, egenskaper=plate(505)["egenskaper"][:3])
    bench.world.drift = broken
    for fresh in (False, False, True):
        report = bench.sync(fresh=fresh)
        assert any("505" in problem for problem in report.problems)
        assert visible(bench.store)[96, 505] == old
        bench.clock.time += timedelta(days=2)
    bench.world.drift = None
    assert bench.sync().mode == "changes"
    assert visible(bench.store) == bench.clean()
    assert visible(bench.store)[96, 505] != old
    n_before = len(bench.server.requests)
    bench.sync()
    assert not any("ider" in info.query for info in bench.server.requests[n_before:])


def test_sync_asks_again_for_an_object_whose_end_has_come(bench: Bench) -> None:
    """No event tells that a day has come: the end date in the mirror does, and once."""
    bench.sync()
    metadata = {"type": {"id": 96}, "versjon": 2, "startdato": "2020-05-01", "sluttdato": "2026-06-20"}
    bench.world.update(501, metadata=metadata)
    bench.sync()
    bench.clock.time += timedelta(days=10)
    bench.sync()
    assert visible(bench.store)[96, 501]["end_date"] == "2026-06-20"
    bench.clock.time += timedelta(days=9)
    bench.world.close(501, "2026-06-20")  # as Les V4 shows it from that day on
    bench.world.events.pop()
    assert nine(bench.sync()) == (4, 8)
    assert visible(bench.store) == bench.clean()
    assert [row["nvdb_id"] for row in history(bench.store) if row["end_date"]] == [501]


def test_sync_tells_its_progress(bench: Bench) -> None:
    """Progress comes before the first page and after each one, with the API's own total."""
    told: list[SyncProgress] = []
    bench.sync(page_size=5, progress=told.append)
    assert told == [
        *(SyncProgress("Skiltpunkt", n, 4) for n in (0, 4)),
        *(SyncProgress("Skiltplate", n, 9) for n in (0, 5, 9)),
    ]


def test_sync_lists_a_limited_number_of_problems_and_counts_all(bench: Bench, plate: Any) -> None:
    """A million odd objects do not make a million sentences."""
    for number in range(1000, 1000 + MAX_LISTED + 20):
        bench.world.create(96, plate(number, geometri={"wkt": "POINT EMPTY", "egengeometri": True}))
        bench.world.update(number, egenskaper=plate(number)["egenskaper"][1:4])
    report = bench.sync(page_size=1000)
    assert report.n_problems >= MAX_LISTED + 20
    assert len(report.problems) == MAX_LISTED


def test_sync_refuses_an_area_before_it_asks(bench: Bench) -> None:
    """Uberiket has no kommuner; Les V4 sends them along with count and pages alike."""
    n_before = len(bench.server.requests)
    if bench.kind == "uberiket":
        with pytest.raises(AreaError):
            bench.sync(area=Area(kommuner=(5001,)))
        assert len(bench.server.requests) == n_before
        return
    assert nine(bench.sync(area=Area(kommuner=(5001,)))) == (4, 9)
    asked = [info for info in bench.server.requests if "endringer" not in info.path]
    assert {info.query.get("kommune") for info in asked} == {"5001"}
