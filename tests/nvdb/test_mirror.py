"""The sync: what reaches the store, in which order, and what happens when it goes wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from nvdb.area import Area
from nvdb.errors import HttpStatusError, RequestError, SchemaError
from nvdb.mirror import MAX_LISTED, SyncProgress, SyncReport, sync
from nvdb.replay import Fault, RequestInfo
from nvdb.skilt import Skiltplate, Skiltpunkt, skilt_from_les_v4


class MemoryStore:
    """A MirrorStore that keeps what it gets, and its calls."""

    def __init__(self, cursors: dict[int, str] | None = None, fail_at: str = "") -> None:
        self.calls: list[str] = []
        self.kept: dict[int, Skiltpunkt | Skiltplate] = {}
        self.cursors: list[tuple[int, str | None]] = []
        self._new: dict[int, Skiltpunkt | Skiltplate] = {}
        self._start = cursors or {}
        self._fail_at = fail_at

    def _call(self, name: str) -> None:
        self.calls.append(name)
        if name == self._fail_at:
            raise KeyboardInterrupt

    def begin(self, area: Area, source: str) -> None:
        """Check the source and forget an earlier sync."""
        assert source.startswith("http://127.0.0.1")
        self._new = {}
        self._call("begin")

    def cursor(self, type_id: int) -> str | None:
        """Where an earlier sync stopped."""
        self._call("cursor")
        return self._start.get(type_id)

    def save_page(self, type_id: int, objects: Sequence[Skiltpunkt | Skiltplate], cursor: str | None) -> None:
        """Keep a page aside."""
        self.cursors.append((type_id, cursor))
        self._new.update((item.nvdb_id, item) for item in objects)
        self._call("save_page")

    def finish(self, report: SyncReport) -> None:
        """Make it visible."""
        self._call("finish")
        self.kept = self._new

    def abort(self) -> None:
        """Forget it."""
        self.calls.append("abort")
        self._new = {}


@pytest.fixture
def source(plate: Any, point: Any) -> dict[int, list[dict[str, Any]]]:
    """Three points with a plate each, one of them without own geometry and one in another kommune."""
    plates = [plate(number) for number in (701, 702, 703)]
    plates[1]["geometri"]["egengeometri"] = False
    plates[1]["egenskaper"].pop()
    plates[2]["lokasjon"]["kommuner"] = [301]
    plates[2]["egenskaper"][0] |= {"verdi": "U999 - Annet", "enum_id": 9358}
    return {95: [point(number) for number in (201, 202, 203)], 96: plates}


def test_sync_hands_the_store_every_object_as_it_is(api: Any, source: Any) -> None:
    """What the store keeps equals what is parsed from the source, and the report counts it."""
    client, _ = api.serve(source)
    store = MemoryStore()
    report = sync(client, store, Area(), page_size=2)
    expected = [skilt_from_les_v4(raw, kind) for kind in (95, 96) for raw in source[kind]]
    assert list(store.kept.values()) == expected
    assert store.calls == ["begin", *(["cursor", "save_page", "save_page"] * 2), "finish"]
    assert store.cursors == [(95, "202:1"), (95, "203:1"), (96, "702:2"), (96, "703:2")]
    points, plates = report.types
    assert (points.expected, points.received, points.saved) == (3, 3, 3)
    assert (plates.without_own_geometry, plates.without_position, plates.retired) == (1, 0, 1)
    assert (plates.n_problems, plates.problems) == (0, ())
    assert report.started_at <= report.finished_at


def test_sync_asks_for_everything_of_its_area(api: Any, source: Any) -> None:
    """Pages are asked for with inkluder=alle in UTM33, and the area goes into count and pages alike."""
    client, server = api.serve(source)
    store = MemoryStore()
    report = sync(client, store, Area(kommuner=(301,)), types=(96,))
    assert list(store.kept) == [703]
    assert report.types[0].expected == 1
    count, first, _ = server.requests
    assert (count.path, count.query) == ("/vegobjekter/96/statistikk", {"kommune": "301"})
    assert first.query == {"inkluder": "alle", "srid": "5973", "kommune": "301", "antall": "1000"}
    sync(client, store, Area(bbox=(269_999.0, 7_040_700.5, 270_001.0, 7_040_702.5)), types=(96,))
    assert list(store.kept) == [701, 702]


def test_sync_tells_its_progress(api: Any, source: Any) -> None:
    """Progress comes before the first page and after each one, with the API's own total."""
    client, _ = api.serve(source)
    told: list[SyncProgress] = []
    sync(client, MemoryStore(), Area(), types=(96,), page_size=2, progress=told.append)
    assert told == [SyncProgress(96, 0, 3), SyncProgress(96, 2, 3), SyncProgress(96, 3, 3)]


@pytest.mark.parametrize("status", [404, 403])
def test_sync_does_without_the_count(api: Any, source: Any, status: int) -> None:
    """A statistikk that is not there leaves the total unknown, and nothing else."""

    def no_count(request: RequestInfo) -> Fault | None:
        return Fault("status", status=status) if request.path.endswith("statistikk") else None

    client, _ = api.serve(source, no_count)
    report = sync(client, MemoryStore(), Area(), types=(96,))
    assert (report.types[0].expected, report.types[0].received) == (None, 3)
    client, _ = api.serve(source, [Fault("status", status=200, body=b'{"antall": "mange"}')])
    assert sync(client, MemoryStore(), Area(), types=(96,)).types[0].expected is None


def test_sync_tells_when_the_count_and_the_pages_disagree(api: Any, source: Any) -> None:
    """Fewer objects than the API counts is a problem in the report."""
    client, _ = api.serve(source, [Fault("status", status=200, body=b'{"antall": 5}')])
    report = sync(client, MemoryStore(), Area(), types=(96,))
    assert report.types[0].problems == (
        "The API counts 5 objects of type 96 and sent 3: sync again if they should agree.",
    )


def test_sync_goes_on_from_the_stores_cursor(api: Any, source: Any) -> None:
    """A store that has a cursor gets the pages after it only."""
    client, _ = api.serve(source)
    store = MemoryStore(cursors={96: "702:2"})
    report = sync(client, store, Area(), types=(96,))
    assert list(store.kept) == [703]
    assert report.types[0].problems == ()


def test_sync_leaves_out_and_names_an_object_that_cannot_be_read(api: Any, source: Any) -> None:
    """One broken object of a page is counted and named; the others are kept."""
    source[96][1]["metadata"]["versjon"] = "to"
    source[96][2]["geometri"]["wkt"] = source[96][2]["egenskaper"][-1]["verdi"] = "POINT EMPTY"
    client, _ = api.serve(source)
    store = MemoryStore()
    (report,) = sync(client, store, Area(), types=(96,)).types
    assert list(store.kept) == [701, 703]
    assert (report.received, report.saved, report.without_position, report.n_problems) == (3, 2, 1, 3)
    assert (
        report.problems[0] == "In vegobjekt 702 the field metadata.versjon is 'to' instead of a whole number."
    )
    assert report.problems[1] == "Vegobjekt 703 (type 96): egenskap 4795 is empty."


def test_sync_lists_a_limited_number_of_problems_and_counts_all(api: Any, plate: Any) -> None:
    """A million odd objects do not make a million sentences."""
    plates = [plate(number) for number in range(1, MAX_LISTED + 21)]
    for raw in plates:
        raw["metadata"]["startdato"] = "i fjor"
    client, _ = api.serve({96: plates})
    (report,) = sync(client, MemoryStore(), Area(), types=(96,)).types
    assert (report.n_problems, len(report.problems)) == (MAX_LISTED + 20, MAX_LISTED)


def test_sync_stops_when_no_object_can_be_read(api: Any, source: Any) -> None:
    """A page of which nothing can be read means a changed API: the mirror stays as it was."""
    for raw in source[96]:
        raw["metadata"]["versjon"] = "to"
    client, _ = api.serve(source)
    store = MemoryStore()
    with pytest.raises(SchemaError, match="No object of a page of type 96 can be read"):
        sync(client, store, Area())
    assert (store.calls[-1], store.kept) == ("abort", {})


def test_sync_aborts_once_when_the_api_fails_half_way(api: Any, source: Any) -> None:
    """An error between two pages leaves nothing behind, and is raised as it is."""
    client, server = api.serve(source, [None, None, Fault("status", status=403)])
    store = MemoryStore()
    with pytest.raises(HttpStatusError):
        sync(client, store, Area(), page_size=2)
    assert store.calls == ["begin", "cursor", "save_page", "abort"]
    assert store.kept == {}
    assert len(server.requests) == 3


@pytest.mark.parametrize("moment", ["cursor", "save_page", "finish"])
def test_sync_aborts_on_ctrl_c_too(api: Any, source: Any, moment: str) -> None:
    """KeyboardInterrupt at any call after begin is followed by exactly one abort."""
    client, _ = api.serve(source)
    store = MemoryStore(fail_at=moment)
    with pytest.raises(KeyboardInterrupt):
        sync(client, store, Area())
    assert store.calls[-2:] == [moment, "abort"]
    assert store.calls.count("abort") == 1
    assert store.kept == {}


@pytest.mark.parametrize("options", [{"types": ()}, {"types": (105,)}, {"page_size": 0}, {"page_size": 1001}])
def test_sync_refuses_what_it_cannot_do_before_it_begins(api: Any, source: Any, options: Any) -> None:
    """Other types and impossible page sizes are refused, and the store is not touched."""
    client, server = api.serve(source)
    store = MemoryStore()
    with pytest.raises(RequestError):
        sync(client, store, Area(), **options)
    assert store.calls == []
    assert server.requests == []


@pytest.mark.parametrize(
    "kind", ["status", "truncate", "cut", "html_200", "garbage", "damaged_gzip", "disconnect"]
)
def test_sync_gives_the_same_result_through_every_passing_fault(api: Any, source: Any, kind: Any) -> None:
    """With every second request failing, the store ends with the same objects as without faults."""

    def every_second(request: RequestInfo) -> Fault | None:
        return Fault(kind) if request.number % 2 == 0 else None

    client, _ = api.serve(source, every_second)
    store = MemoryStore()
    sync(client, store, Area(), page_size=1)
    assert list(store.kept) == [201, 202, 203, 701, 702, 703]
