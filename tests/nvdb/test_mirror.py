"""The sync of a mirror: real sources, real servers, a real store; what readers see is a whole mirror."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from nvdb.area import Area
from nvdb.errors import AreaError, HttpStatusError
from nvdb.les_v4 import LesV4Source
from nvdb.mirror import (
    MAX_LISTED,
    MassDeletionError,
    ShortBackfillError,
    SyncProgress,
    SyncReport,
    sync,
)
from nvdb.replay import Fault, RequestInfo
from nvdb.replay_world import ReplayWorld
from nvdb.sources import Source
from nvdb.uberiket import UberiketSource
from twin import mirror_store, schema
from twin.mirror_store import StoreMirror, raw_object
from twin.store import Store

COUNTRY = Area()
KINDS: dict[str, Any] = {"les-v4": LesV4Source, "uberiket": UberiketSource}
PLATES = range(501, 510)
Visible = dict[tuple[int, int], dict[str, Any]]


class Clock:
    """A clock that only moves when it is told to."""

    def __init__(self) -> None:
        self.time = datetime(2026, 6, 1, 12, tzinfo=UTC)

    def __call__(self) -> datetime:
        """Now."""
        return self.time

    def text(self) -> str:
        """Now, as the store writes it."""
        return f"{self.time:%Y-%m-%dT%H:%M:%SZ}"


class Bench:
    """A world behind a replay server, and a store that mirrors it through the source in test."""

    def __init__(self, kind: str, api: Any, world: ReplayWorld, clock: Clock, folder: Path) -> None:
        self.kind, self.world, self.clock = kind, world, clock
        self._api, self._folder = api, folder
        self.faults: Callable[[RequestInfo], Fault | None] = lambda info: None
        _, self.server = api.serve(world, self._fault)
        self.store = self.new_store("twin.db")

    def _fault(self, info: RequestInfo) -> Fault | None:
        return self.faults(info)

    def new_store(self, name: str) -> Store:
        """An empty store."""
        store: Store = self._api.keep(Store.open(self._folder / name))
        return store

    def source(self, kind: str = "", page_size: int = 2) -> Source:
        """A source that reads the world."""
        client = self._api.client(self.server.url, attempts=2)
        made: Source = KINDS[kind or self.kind](client, page_size=page_size, clock=self.clock)
        return made

    def sync(self, *, kind: str = "", area: Area = COUNTRY, page_size: int = 2, **options: Any) -> SyncReport:
        """Sync the store in test; a minute later it is over."""
        mirror = StoreMirror(self.store)
        report = sync(self.source(kind, page_size), mirror, area, clock=self.clock, **options)
        self.clock.time += timedelta(minutes=1)
        return report

    def clean(self, kind: str = "", area: Area = COUNTRY) -> Visible:
        """What a first sync into an empty store gives now."""
        hook, self.world.on_request = self.world.on_request, None
        with self.new_store(f"clean-{len(self.server.requests)}.db") as store:
            sync(self.source(kind, 1000), StoreMirror(store), area, clock=self.clock)
            found = visible(store)
        self.world.on_request = hook
        return found

    def position(self) -> str | None:
        """Where the visible mirror stands in the feed."""
        following = StoreMirror(self.store).following()
        return following.position if following else None

    def feed_is_too_old(self) -> None:
        """Make the feed end after the mirror's position."""
        self.clock.time += timedelta(days=40)
        if self.kind == "uberiket":
            start = self.position()
            self.faults = lambda info: (
                Fault("status", status=410)
                if info.path.endswith("/hendelser/vegobjekter") and info.query["start"] == start
                else None
            )


@pytest.fixture(params=sorted(KINDS))
def bench(
    request: pytest.FixtureRequest,
    api: Any,
    plate: Any,
    point: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Bench]:
    """Both sources in turn; 4 points and 9 plates."""
    clock = Clock()
    monkeypatch.setattr(mirror_store, "utc_now", clock.text)
    objects = {95: [point(number) for number in range(1, 5)], 96: [plate(number) for number in PLATES]}
    with ExitStack() as stack:
        api.keep = stack.enter_context
        yield Bench(request.param, api, ReplayWorld(objects, clock=clock), clock, tmp_path)


def rows(store: Store, table: sa.Table) -> list[dict[str, Any]]:
    """All rows of a table; the raw object decoded."""
    found = [dict(row) for row in store.rows(sa.select(table))]
    return [row | {"raw": raw_object(row)} for row in found]


def visible(store: Store) -> Visible:
    """The visible mirror, all but when it was fetched."""
    return {
        (kind, row["nvdb_id"]): {name: value for name, value in row.items() if name != "synced_at"}
        for kind, tables in schema.MIRROR.items()
        for row in rows(store, tables.visible)
    }


def history(store: Store) -> list[dict[str, Any]]:
    """States that were replaced, of both types."""
    return [row for tables in schema.MIRROR.values() for row in rows(store, tables.history)]


def is_page(info: RequestInfo) -> bool:
    """Whether a request asks for objects and not by id."""
    return info.path.endswith(("/vegobjekter/95", "/vegobjekter/96")) and "ider" not in info.query


def nine(report: SyncReport) -> tuple[int, int]:
    """Points and plates in the mirror."""
    return report.applied.total[95], report.applied.total[96]


def broken(made: dict[str, Any], api: str) -> dict[str, Any]:
    """Drift: plate 505 has a part of the wrong type."""
    part = {"lokasjon": "nowhere"} if api == "les-v4" else {"stedfesting": "nowhere"}
    return made | (part if made["id"] == 505 else {})


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


def test_sync_has_a_change_between_two_pages(bench: Bench, plate: Any) -> None:
    """Objects created, changed and removed behind the cursor and before it are right in the first mirror."""

    def interfere(info: RequestInfo) -> None:
        if is_page(info) and info.path.endswith("96") and "start" in info.query and not bench.world.events:
            bench.world.create(96, plate(400))
            bench.world.update(501, egenskaper=plate(501)["egenskaper"][:3])
            bench.world.remove(502)
            bench.world.remove(508)
            bench.world.remove(1)

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


def test_sync_makes_a_fresh_backfill_when_the_feed_is_too_short(bench: Bench) -> None:
    """A mirror that was left alone for too long is fetched anew, and finds what was removed unheard."""
    bench.sync()
    bench.world.remove(505)
    bench.feed_is_too_old()
    report = bench.sync()
    assert (report.mode, nine(report)) == ("backfill", (4, 8))
    bench.faults = lambda info: None
    assert visible(bench.store) == bench.clean()
    assert bench.sync().mode == "changes"


@pytest.mark.parametrize("fresh", [False, True])
def test_sync_refuses_to_delete_much_unless_confirmed(bench: Bench, fresh: bool) -> None:
    """A feed or a backfill that would take most plates away changes nothing; confirmed, it passes."""
    bench.sync()
    old, position = visible(bench.store), bench.position()
    for number in PLATES[:5]:
        bench.world.remove(number)
    with pytest.raises(MassDeletionError, match=r"delete 5 of 9 Skiltplate .* confirm the deletions"):
        bench.sync(fresh=fresh)
    assert visible(bench.store) == old
    assert bench.position() == position
    bench.sync(fresh=fresh, confirm_deletions=True)
    assert visible(bench.store) == bench.clean() != old


def test_sync_refuses_by_share_in_a_mirror_of_many(bench: Bench, plate: Any) -> None:
    """In a mirror of 500, 25 deletions are 5 % and pass, and 26 do not."""
    for number in range(1000, 1491):
        bench.world.create(96, plate(number))
    bench.sync(page_size=1000)
    for number in range(1000, 1026):
        bench.world.remove(number)
    with pytest.raises(MassDeletionError, match=r"26 of 500 Skiltplate .* 5%"):
        bench.sync()
    bench.world.recreate(1000)
    assert bench.sync().applied.deleted[96] == 25


def test_sync_recovers_when_a_refused_backfill_was_a_fault_of_the_api(bench: Bench) -> None:
    """A backfill that was refused is not taken up again: what the API says by then is what counts."""
    bench.sync()
    old = visible(bench.store)
    hidden = set(PLATES[:5])
    for number in hidden:
        bench.world.remove(number)
    with pytest.raises(MassDeletionError):
        bench.sync(fresh=True)
    for number in hidden:
        bench.world.recreate(number)
    report = bench.sync(fresh=True)
    assert (report.mode, nine(report)) == ("backfill", (4, 9))
    assert visible(bench.store) == bench.clean()
    assert visible(bench.store).keys() == old.keys()


def test_sync_refuses_a_backfill_that_lacks_what_the_api_counts(bench: Bench) -> None:
    """Nine plates of twenty that statistikk counts are no mirror; the next run begins anew."""
    bench.faults = lambda info: (
        Fault("status", status=200, body=b'{"antall": 20}') if info.path.endswith("96/statistikk") else None
    )
    with pytest.raises(ShortBackfillError, match="counts 20 Skiltplate and sent 9"):
        bench.sync()
    assert visible(bench.store) == {}
    assert bench.position() is None
    bench.faults = lambda info: None
    assert bench.sync().mode == "backfill"


def test_sync_tells_of_a_small_difference_to_the_count(bench: Bench, plate: Any) -> None:
    """Fewer objects than the API counts by less than 5 % are a problem in the report, and more are too."""
    for number in range(1000, 1050):
        bench.world.create(96, plate(number))
    for count in (60, 58):
        body = json.dumps({"antall": count}).encode()
        bench.faults = lambda info, body=body: (  # type: ignore[misc]
            Fault("status", status=200, body=body) if info.path.endswith("96/statistikk") else None
        )
        report = bench.sync(fresh=True, page_size=1000)
        assert report.problems == (
            f"The API counts {count} Skiltplate and sent 59: if they should agree, fetch everything anew.",
        )


@pytest.mark.parametrize(
    "answer", [Fault("status", status=404), Fault("status", 200, body=b'{"antall": "x"}')]
)
def test_sync_does_without_the_count(bench: Bench, answer: Fault) -> None:
    """A statistikk that is not there leaves the total unknown, and nothing else."""
    bench.faults = lambda info: answer if info.path.endswith("statistikk") else None
    report = bench.sync()
    assert (report.expected, nine(report), report.problems) == ({95: None, 96: None}, (4, 9), ())


def test_sync_makes_a_new_mirror_of_another_source(bench: Bench) -> None:
    """Positions of one API mean nothing to the other: the mirror is filled anew, beside the old one."""
    other = next(kind for kind in KINDS if kind != bench.kind)
    bench.sync()
    old = visible(bench.store)
    seen: list[bool] = []
    bench.world.on_request = lambda info: seen.append(visible(bench.store) == old)
    report = bench.sync(kind=other)
    assert (report.mode, report.source, all(seen)) == ("backfill", other, True)
    assert visible(bench.store) == bench.clean(other) != old
    assert bench.sync(kind=other).mode == "changes"


def test_sync_makes_a_new_mirror_of_another_area(bench: Bench) -> None:
    """However much of the old mirror goes: another area was asked for."""
    box = Area(bbox=(269_990.0, 7_040_501.5, 270_010.0, 7_040_503.5))
    bench.sync()
    report = bench.sync(area=box)
    assert (report.mode, nine(report)) == ("backfill", (0, 2))
    bench.world.update(505)  # outside
    bench.world.remove(502)
    report = bench.sync(area=box)
    assert (report.mode, nine(report)) == ("changes", (0, 1))
    assert visible(bench.store) == bench.clean(area=box)


def test_sync_resumes_and_asks_only_for_the_rest(bench: Bench, plate: Any) -> None:
    """Wherever a backfill breaks off, the next run goes on from there, also over changes in between."""
    bench.sync()
    n_pages = sum(is_page(info) for info in bench.server.requests)
    for broken_at in (1, 2, 5):
        bench.store = bench.new_store(f"broken-{broken_at}.db")
        n_before = len(bench.server.requests)

        def break_off(
            info: RequestInfo, n_before: int = n_before, broken_at: int = broken_at
        ) -> Fault | None:
            n_asked = sum(is_page(old) for old in bench.server.requests[n_before:])
            return Fault("status", status=403) if is_page(info) and n_asked > broken_at else None

        bench.faults = break_off
        with pytest.raises(HttpStatusError):
            bench.sync()
        assert visible(bench.store) == {}
        bench.faults = lambda info: None
        bench.world.update(501 + broken_at % 9, egenskaper=plate(501)["egenskaper"][:3])
        n_before = len(bench.server.requests)
        assert bench.sync().mode == "resumed"
        n_asked = sum(is_page(info) for info in bench.server.requests[n_before:])
        # A type that was read to its end is asked for what follows its last object.
        assert n_asked <= n_pages - broken_at + 1
        assert visible(bench.store) == bench.clean()


@pytest.mark.parametrize("why", ["area", "source", "feed"])
def test_sync_begins_anew_what_it_cannot_resume(bench: Bench, why: str) -> None:
    """A backfill of another area or source, or one whose feed has ended, is not gone on with."""
    bench.faults = lambda info: Fault("status", status=403) if info.path.endswith("/96") else None
    with pytest.raises(HttpStatusError):
        bench.sync()
    begun = StoreMirror(bench.store).backfill()
    assert begun is not None
    bench.faults = lambda info: None
    other = next(kind for kind in KINDS if kind != bench.kind)
    kind, area = (other if why == "source" else ""), COUNTRY
    if why == "area":
        area = Area(bbox=(269_000.0, 7_040_000.0, 271_000.0, 7_042_000.0))
    elif why == "feed":
        bench.clock.time += timedelta(days=40)
        gone = Fault("status", status=410)
        position = begun.position
        if bench.kind == "uberiket":
            bench.faults = lambda info: gone if info.query.get("start") == position == "0" else None
            bench.world.update(501)  # so that the new position is another
    report = bench.sync(kind=kind, area=area)
    assert (report.mode, nine(report)) == ("backfill", (4, 9))
    bench.faults = lambda info: None
    assert visible(bench.store) == bench.clean(kind, area)


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


@pytest.mark.parametrize(
    "kind", ["status", "truncate", "cut", "html_200", "garbage", "damaged_gzip", "disconnect"]
)
def test_sync_gives_the_same_mirror_through_every_passing_fault(bench: Bench, kind: Any) -> None:
    """With every second request failing, the mirror equals one made without faults."""
    bench.faults = lambda info: Fault(kind) if info.number % 2 == 0 else None
    assert bench.sync().mode == "backfill"
    bench.faults = lambda info: None
    assert visible(bench.store) == bench.clean()
