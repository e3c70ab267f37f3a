"""The change feed and the areas of API Les V4."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from nvdb.area import Area
from nvdb.errors import SchemaError
from nvdb.mirror import FeedTooOldError, LesV4Source
from nvdb.mirror.les_v4 import HEAD_OVERLAP
from nvdb.replay import Fault, ReplayWorld, RequestInfo
from nvdb.replay.pages import PLACES

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)


def make(api: Any, world: ReplayWorld, now: datetime = NOW, faults: Any = None) -> LesV4Source:
    """A source whose clock says `now`."""
    client, _ = api.serve(world, faults)
    return LesV4Source(client, clock=lambda: now)


@pytest.fixture
def world(plate: Callable[..., Any]) -> ReplayWorld:
    """Plates 501 to 503 at noon."""
    return ReplayWorld({96: [plate(number) for number in (501, 502, 503)]}, clock=lambda: NOW)


def test_feed_older_than_thirty_days_is_refused_with_the_cure(api: Any, world: ReplayWorld) -> None:
    """A position that the feed no longer reaches names its date and asks for a fresh backfill."""
    old = "2026-05-01T12:00:00Z,501,1"
    with pytest.raises(FeedTooOldError, match=r"2026-05-01 12:00 UTC.*30 days.*make a fresh backfill"):
        list(make(api, world).changes((96,), old))
    young = (NOW - timedelta(days=29)).isoformat()
    assert [page.n_events for page in make(api, world).changes((96,), young)] == [0]


def test_quiet_feed_does_not_let_the_position_grow_old(api: Any, world: ReplayWorld) -> None:
    """Without any event the position moves to a day before now, so that it can be followed for ever."""
    since = LesV4Source.head(make(api, world))
    for week in range(1, 9):
        source = make(api, world, NOW + timedelta(weeks=week))
        (page,) = source.changes((95, 96), since)
        assert page.changed == {}
        since = page.next_position
    assert datetime.fromisoformat(since) == NOW + timedelta(weeks=8) - HEAD_OVERLAP


def test_all_four_lists_of_the_feed_count(api: Any, world: ReplayWorld, plate: Callable[..., Any]) -> None:
    """Created, changed, removed and segmented versions are all told."""
    since = (NOW - timedelta(hours=1)).isoformat()
    world.create(96, plate(600))
    world.update(501)
    world.remove(502)
    world.segment(503)
    (page,) = make(api, world).changes((96,), since)
    assert page.changed == {96: {600, 501, 502, 503}}
    assert page.next_position == "2026-06-01T12:00:00.000003Z,503,2"


def test_page_that_merges_changes_loses_none(api: Any, world: ReplayWorld) -> None:
    """1500 changes of three objects are merged into few entries a page, and both pages are read."""
    world.touch([501, 502, 503] * 500)
    pages = list(make(api, world).changes((96,), (NOW - timedelta(hours=1)).isoformat()))
    assert [page.n_events for page in pages] == [3, 3]
    assert pages[-1].changed == {96: {501, 502, 503}}


def test_feed_without_its_lists_is_refused(api: Any, world: ReplayWorld) -> None:
    """A feed that lacks one of its lists has changed its form: silence would lose changes."""
    body = b'{"vegobjektVersjonerEndret":[],"metadata":{"returnert":0}}'
    source = make(api, world, faults=lambda info: Fault("status", 200, body=body))
    with pytest.raises(SchemaError, match="has no list vegobjektVersjonerFjernet"):
        list(source.changes((96,), NOW.isoformat()))


AREAS: dict[str, tuple[Area, dict[str, Any]]] = {
    "kommune": (Area(kommuner=(5001,)), {"kommuner": [5001], "fylker": [50]}),
    "fylke": (Area(fylker=(50, 15)), {"kommuner": [5001], "fylker": [50]}),
    "kontraktsomrade": (
        Area(kontraktsomrader=("9503 Midtre Hålogaland 2021-2026",)),
        {"kontraktsområder": [{"id": 17, "nummer": 9503, "navn": "9503 Midtre Hålogaland 2021-2026"}]},
    ),
    "kontraktsomrade by id": (
        Area(kontraktsomrader=("17",)),
        {"kontraktsområder": [{"id": 17, "nummer": 9503, "navn": "9503 Midtre Hålogaland 2021-2026"}]},
    ),
}
ELSEWHERE: dict[str, Any] = {"kommuner": [301], "fylker": [3]}


@pytest.mark.parametrize("name", AREAS)
def test_object_that_leaves_the_area_is_missing(api: Any, name: str, plate: Any) -> None:
    """Of each kind of area: a sign inside is paged, counted and fetched, one that moved out is missing."""
    area, inside = AREAS[name]
    plates = [plate(501, lokasjon=inside), plate(502, lokasjon=inside), plate(503, lokasjon=ELSEWHERE)]
    world = ReplayWorld({96: plates}, clock=lambda: NOW)
    source = make(api, world)
    (page,) = source.pages(96, area)
    assert [skilt.nvdb_id for skilt in page.objects] == [501, 502]
    assert source.count(96, area) == 2
    world.update(502, lokasjon=ELSEWHERE)
    result = source.fetch(96, [501, 502, 503], area)
    assert [skilt.nvdb_id for skilt in result.objects] == [501]
    assert result.missing == {502, 503}


@pytest.mark.parametrize("name", AREAS)
def test_filter_that_the_api_does_not_apply_is_found_out(api: Any, name: str, plate: Any) -> None:
    """Where a filter is passed over, an object's own ``lokasjon`` keeps what lies elsewhere out."""
    area, inside = AREAS[name]
    plates = [plate(501, lokasjon=inside), *(plate(number, lokasjon=ELSEWHERE) for number in (502, 503, 504))]
    world = ReplayWorld({96: plates}, clock=lambda: NOW)
    source = make(api, world, faults=lambda info: _unfiltered(world, info))
    (page,) = source.pages(96, area)
    assert [skilt.nvdb_id for skilt in page.objects] == [501]
    assert page.problems == tuple(
        f"Vegobjekt {number} came for {area.text()}, but says that it lies elsewhere: left out."
        for number in (502, 503, 504)
    )
    result = source.fetch(96, [501, 502], area)
    assert ([skilt.nvdb_id for skilt in result.objects], result.missing) == ([501], {502})
    world.remove(501)
    with pytest.raises(SchemaError, match="sent signs that all lie elsewhere"):
        list(source.pages(96, area))


def _unfiltered(world: ReplayWorld, info: RequestInfo) -> Fault:
    """The answer to the same question without its filters of area."""
    query = {name: text for name, text in info.query.items() if name not in PLACES}
    return Fault("status", 200, body=world.page_body(96, query, f"http://localhost{info.path}"))


def test_closed_object_is_missing(api: Any, world: ReplayWorld) -> None:
    """V4 shows only objects without an end date."""
    world.close(501, "2026-05-31")
    source = make(api, world)
    assert source.fetch(96, [501], Area()).missing == {501}
    assert source.count(96, Area()) == 2
