"""What holds for both sources of a mirror: everything arrives, and no fault goes by in silence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from msgspec import structs
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.errors import PagingError, RequestError, SchemaError
from nvdb.mirror import LesV4Source, Source, UberiketSource
from nvdb.mirror.source import batches
from nvdb.objects import Skiltpunkt
from nvdb.replay import Fault, ReplayWorld, RequestInfo

COUNTRY = Area()
START = datetime(2026, 6, 1, 12, tzinfo=UTC)
KINDS: dict[str, Any] = {"les-v4": LesV4Source, "uberiket": UberiketSource}


class Clock:
    """A clock that only moves when it is told to; world and source share it."""

    def __init__(self) -> None:
        self.time = START

    def __call__(self) -> datetime:
        """Now."""
        return self.time


class Setup:
    """A world, and a source of the kind in test that reads it through a replay server."""

    def __init__(self, kind: str, api: Any, clock: Clock) -> None:
        self.kind, self.clock = kind, clock
        self._api = api

    def source(self, world: ReplayWorld, faults: Any = None, page_size: int = 1000) -> Source:
        """Serve the world and make the source."""
        client, self.server = self._api.serve(world, faults)
        made: Source = KINDS[self.kind](client, page_size=page_size, clock=self.clock)
        return made


@pytest.fixture(params=sorted(KINDS))
def setup(request: pytest.FixtureRequest, api: Any) -> Setup:
    """Both sources in turn."""
    return Setup(request.param, api, Clock())


@pytest.fixture
def world(setup: Setup, plate: Callable[..., Any], point: Callable[..., Any]) -> ReplayWorld:
    """A world of 9 plates and 4 points."""
    return ReplayWorld(
        {95: [point(number) for number in range(1, 5)], 96: [plate(number) for number in range(501, 510)]},
        clock=setup.clock,
    )


def ids_of(source: Source, type_id: int = 96, start: str | None = None) -> list[int]:
    """Ids of a backfill, in order of arrival."""
    return [skilt.nvdb_id for page in source.pages(type_id, COUNTRY, start) for skilt in page.objects]


def changed(source: Source, since: str) -> tuple[dict[int, set[int]], str]:
    """All ids that changed since a position, and the new position."""
    found: dict[int, set[int]] = {95: set(), 96: set()}
    for page in source.changes((95, 96), since):
        for type_id, ids in page.changed.items():
            found[type_id] |= ids
        since = page.next_position
    return found, since


def test_source_pages_give_every_object_once(setup: Setup, world: ReplayWorld) -> None:
    """Whatever the page size, a backfill gives each object once, in order, and counts what it received."""
    for size in (1, 2, 4, 9, 10):
        source = setup.source(world, page_size=size)
        assert ids_of(source) == list(range(501, 510))
        assert sum(page.received for page in source.pages(96, COUNTRY)) == source.count(96, COUNTRY) == 9


def test_source_goes_on_from_every_cursor(setup: Setup, world: ReplayWorld) -> None:
    """Whichever page was the last to be kept, also the very last, its cursor gives exactly the rest."""
    source = setup.source(world, page_size=2)
    seen: list[int] = []
    for page in source.pages(96, COUNTRY):
        seen += [skilt.nvdb_id for skilt in page.objects]
        assert seen + ids_of(source, start=page.next_cursor) == list(range(501, 510))


def test_source_head_is_before_every_later_change(setup: Setup, world: ReplayWorld) -> None:
    """A change in the very instant after the position was noted is told, also if it is the first ever."""
    source = setup.source(world)
    empty_head = source.head()
    world.update(501)
    assert changed(source, empty_head)[0][96] == {501}
    later_head = source.head()
    world.update(502)
    assert 502 in changed(source, later_head)[0][96]


def test_source_follows_a_feed_of_many_pages(setup: Setup) -> None:
    """2500 events come in pages of 1000, and the position of each page gives exactly what follows it."""
    world = GeneratedWorld(10, 2500, clock=setup.clock)
    source = setup.source(world)
    head = source.head()
    ids = world.ids(96, 2500)
    world.touch(ids)
    pages = list(source.changes((95, 96), head))
    assert [page.n_events for page in pages] == [1000, 1000, 500]
    assert set().union(*(page.changed[96] for page in pages)) == set(ids)
    assert changed(source, pages[1].next_position)[0][96] == set(ids[2000:])


def test_source_fetches_in_batches_of_a_hundred(setup: Setup) -> None:
    """250 ids are three questions; ids that come twice are asked for once."""
    world = GeneratedWorld(50, 300, clock=setup.clock)
    source = setup.source(world)
    ids = world.ids(96, 250)
    result = source.fetch(96, [*ids, *ids[:20], 1], COUNTRY)
    assert [skilt.nvdb_id for skilt in result.objects] == ids
    assert result.missing == {1}
    asked = [
        len(info.query["ider"].split(",")) for info in setup.server.requests if "start" not in info.query
    ]
    assert asked == [100, 100, 51]
    assert list(batches([])) == []


def test_source_stops_at_a_page_that_leads_back(setup: Setup, world: ReplayWorld) -> None:
    """A cursor that has been used before is an error and not an end, in pages and in the feed."""
    source = setup.source(world, [None, Fault("repeat_cursor")], page_size=2)
    with pytest.raises(PagingError, match=r"leads back .*start the sync again"):
        ids_of(source)
    world.touch([501, 502])
    looping = setup.source(world, lambda info: Fault("repeat_cursor"))
    with pytest.raises(PagingError, match="leads back"):
        changed(looping, "2026-06-01T00:00:00Z" if setup.kind == "les-v4" else "0")


def test_source_goes_on_after_an_empty_page_that_leads_on(setup: Setup, world: ReplayWorld) -> None:
    """An empty page is the end only if it does not lead on: none of the nine plates is lost."""
    empty = Fault("empty_page")
    source = setup.source(world, [empty, None, None, empty, None, empty], page_size=2)
    assert ids_of(source) == list(range(501, 510))


def test_source_stops_at_a_page_that_comes_again(setup: Setup) -> None:
    """A page with the objects or events of an earlier one, under a good cursor, hides those it replaced."""
    world = GeneratedWorld(10, 2500, clock=setup.clock)
    with pytest.raises(PagingError, match="start the sync again"):
        ids_of(setup.source(world, [None, Fault("repeat_page")], page_size=5))
    position = "2026-06-01T00:00:00Z" if setup.kind == "les-v4" else "0"
    world.touch(world.ids(96, 2100))

    def repeat(info: RequestInfo) -> Fault | None:
        return Fault("repeat_page") if info.number == 1 else None

    source = setup.source(world, repeat)
    pages = source.changes((95, 96), position)
    next(pages)
    # Uberiket's start is needed by its first page too: without it the first 1000 events come again.
    with pytest.raises(PagingError, match="start the sync again"):
        list(pages)


def test_source_names_an_object_that_cannot_be_read_and_keeps_the_rest(
    setup: Setup, world: ReplayWorld
) -> None:
    """A field of the wrong type costs one object: named, counted, and not taken for deleted."""

    def drift(made: dict[str, Any], api: str) -> dict[str, Any]:
        broken = {"lokasjon": "nowhere"} if api == "les-v4" else {"stedfesting": "nowhere"}
        return made | (broken if made["id"] == 505 else {"nytt_felt": [1]})

    world.drift = drift
    source = setup.source(world)
    (page,) = source.pages(96, COUNTRY)
    assert page.received == 9
    assert 505 not in {skilt.nvdb_id for skilt in page.objects}
    assert len(page.problems) == 1
    assert "505" in page.problems[0]
    result = source.fetch(96, [504, 505, 506, 999], COUNTRY)
    assert (result.unreadable, result.missing) == ({505}, {999})


def test_source_stops_when_nothing_can_be_read(setup: Setup, world: ReplayWorld) -> None:
    """A page of which no object can be read means that the API has changed."""
    world.drift = lambda made, api: made | {"egenskaper": 7}
    with pytest.raises(SchemaError, match=r"No object of a page of type 96.*update this program"):
        ids_of(setup.source(world))


def test_source_counts_ids_that_the_datakatalog_does_not_know(
    setup: Setup, world: ReplayWorld, plate: Callable[..., Any]
) -> None:
    """A property that no datakatalog names is kept and counted, and the object is not refused."""
    extra = {"id": 99999, "navn": "Nytt", "egenskapstype": "Tekst", "verdi": "x"}
    world.update(501, egenskaper=[*plate(501)["egenskaper"], extra])
    (page,) = setup.source(world).pages(96, COUNTRY)
    assert page.unknown == {(99999, None): 1}
    assert len(page.objects) == 9


def test_source_refuses_types_and_positions_of_something_else(setup: Setup, world: ReplayWorld) -> None:
    """Other types, page sizes beyond the API's and positions of the other source are refused."""
    source = setup.source(world)
    with pytest.raises(RequestError, match="95 and 96"):
        list(source.changes((105,), source.head()))
    with pytest.raises(RequestError, match="fresh backfill"):
        list(source.changes((96,), "412;7" if setup.kind == "uberiket" else "12345678"[:3]))
    with pytest.raises(RequestError, match="1 to 1000"):
        setup.source(world, page_size=1001)


def test_sources_give_the_same_sign(api: Any) -> None:
    """The same generated objects through both APIs are equal but for the fields that Uberiket documents."""
    world = GeneratedWorld(200, 450, seed=3)
    client, _ = api.serve(world)
    for type_id in (95, 96):
        les, bare = (
            [skilt for page in kind(client).pages(type_id, COUNTRY) for skilt in page.objects]
            for kind in (LesV4Source, UberiketSource)
        )
        assert len(les) == len(bare) == (200 if type_id == 95 else 450)
        assert {skilt.own_geometry for skilt in les} == {True, False}
        for rich, poor in zip(les, bare, strict=True):
            expected = replace(
                rich,
                kommuner=(),
                road_reference=None,
                position=rich.position if rich.own_geometry else None,
                stedfesting=tuple(structs.replace(place, kortform=None) for place in rich.stedfesting),
                **({} if isinstance(rich, Skiltpunkt) else {"point_id": None}),
            )
            assert poor == expected
