"""The road network in the store: whole or not at all, the same as was fetched."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import shapely
from vegnett_links import segment

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import SchemaError
from nvdb.mirror import MassDeletionError, ShortBackfillError
from nvdb.replay import ReplayServer, ReplayWorld
from nvdb.vegnett import Vegnett
from twin.errors import RefusedError, StoreError
from twin.mirror.vegnett import load_vegnett, sync_vegnett
from twin.store import schema
from twin.store.lock import exclusive
from twin.store.store import Store

Raw = dict[str, Any]
AREA = Area(kommuner=(5001,))
EVERYTHING = Area()


def _many(n: int) -> list[Raw]:
    """Links with and without heights, references, ends and segment numbers."""
    links = []
    for number in range(n):
        east, north, height = (
            270_000 + 100 * number,
            7_040_000,
            -999999 if number % 3 == 0 else number + 0.125,
        )
        link = segment(1000 + number, f"{east} {north} {height}, {east + 50.123} {north + 70} {height}")
        if number % 4 == 1:
            link |= {"vegsystemreferanse": {}, "detaljnivå": "Kjørefelt", "topologinivå": "Kjørefelt"}
        if number % 5 == 2:
            link |= {
                "metadata": {"startdato": "1950-01-01", "sluttdato": "2018-06-30"},
                "type": "KONNEKTERING",
            }
        if number % 7 == 3:
            link |= {
                "startposisjon": 0.123456781,
                "sluttposisjon": 0.98765432,
                "typeVeg_sosi": "gangOgSykkelveg",
            }
        links.append(link)
    return links


class Net:
    """A world with a road network, its server and a client of it that never waits."""

    def __init__(self, world: ReplayWorld, server: ReplayServer, client: NvdbClient) -> None:
        self.world, self.server, self.client = world, server, client

    def asked(self) -> list[str | None]:
        """The cursors of all pages that were asked for since the last call, without the count."""
        found = [
            info.query.get("start") for info in self.server.requests if "inkluderAntall" not in info.query
        ]
        self.server.requests.clear()
        return found


@pytest.fixture
def net() -> Iterator[Net]:
    """Forty links in pages of at most eight."""
    world = ReplayWorld(vegnett=_many(40))
    world.page_limit = 8
    with ReplayServer(world) as server, NvdbClient(server.url, sleep=lambda _s: None) as client:
        yield Net(world, server, client)


class _KilledError(Exception):
    """Stands for whatever ends a process between two pages."""


def _killed_after(n_links: int) -> Callable[[str, int, int | None], None]:
    def progress(_what: str, done: int, _expected: int | None) -> None:
        if done >= n_links:
            raise _KilledError

    return progress


def _columns(nett: Vegnett) -> dict[str, list[Any]]:
    """All columns, comparable; lines as WKB and NaN as text."""
    found = {
        name: getattr(nett, name).tolist() for name in [column.name for column in schema.veglenke.columns]
    }
    found["geometri"] = [shapely.to_wkb(line) for line in nett.geometri]
    return {
        name: ["nan" if isinstance(v, float) and math.isnan(v) else v for v in column]
        for name, column in found.items()
    }


def test_network_comes_out_of_the_store_as_it_was_fetched(empty: Store, net: Net) -> None:
    """Every column of every link survives: heights, unknown heights, ends, links without a reference."""
    seen: list[tuple[str, int, int | None]] = []
    n = sync_vegnett(empty, AREA, client=net.client, progress=lambda *step: seen.append(step))
    assert n == 40
    assert seen == [("veglenker", done, 40) for done in (8, 16, 24, 32, 40)]
    want = Vegnett.from_les_v4(net.world.vegnett or ())
    got = load_vegnett(empty)
    assert _columns(got) == _columns(want)
    for name in [column.name for column in schema.veglenke.columns]:
        assert getattr(got, name).dtype == getattr(want, name).dtype
    fact = empty.fact("vegnett")
    assert fact is not None
    assert (fact["area"], fact["count"], fact["n_rejected"]) == (AREA.text(), 40, 0)


def test_network_stays_unseen_until_its_last_page(empty: Store, net: Net) -> None:
    """A fetch that is cut off shows nothing of itself: first no network, later the old one."""
    with pytest.raises(_KilledError):
        sync_vegnett(empty, AREA, client=net.client, progress=_killed_after(16))
    assert empty.count(schema.veglenke) == 0
    with pytest.raises(StoreError, match="--vegnett"):
        load_vegnett(empty)
    sync_vegnett(empty, AREA, client=net.client)
    old = _columns(load_vegnett(empty))
    net.world.vegnett = _many(60)
    with pytest.raises(_KilledError):
        sync_vegnett(empty, AREA, client=net.client, progress=_killed_after(56))
    assert _columns(load_vegnett(empty)) == old


@pytest.mark.parametrize("n_kept", [8, 16, 24, 32, 40])
def test_network_goes_on_where_it_was_cut_off(empty: Store, net: Net, n_kept: int) -> None:
    """After a cut only the rest is asked for, and the network equals one fetched in one go."""
    with pytest.raises(_KilledError):
        sync_vegnett(empty, AREA, client=net.client, progress=_killed_after(n_kept))
    net.asked()
    assert sync_vegnett(empty, AREA, client=net.client) == 40
    asked = net.asked()
    assert asked[0] == f"{1000 + n_kept - 1}-1-1"
    assert len(asked) == (40 - n_kept) // 8 + 1
    assert _columns(load_vegnett(empty)) == _columns(Vegnett.from_les_v4(net.world.vegnett or ()))
    assert empty.count(schema.veglenke_aside) == 0


def test_network_fetch_begins_anew_after_a_day_or_for_another_area(
    empty: Store, net: Net, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What changed between the pages of two days nobody tells, and another area is another network."""
    clock = "twin.mirror.vegnett.fetch.utc_now"
    for again, area, first in (
        ("2026-05-02T07:59:59Z", AREA, "1015-1-1"),
        ("2026-05-02T08:00:00Z", AREA, None),
        ("2026-05-01T08:00:01Z", EVERYTHING, None),
    ):
        monkeypatch.setattr(clock, lambda: "2026-05-01T08:00:00Z")
        with pytest.raises(_KilledError):
            sync_vegnett(empty, AREA, client=net.client, progress=_killed_after(16))
        net.asked()
        monkeypatch.setattr(clock, lambda again=again: again)
        assert sync_vegnett(empty, area, client=net.client) == 40
        assert net.asked()[0] == first


def test_network_that_is_shorter_than_its_count_is_refused(empty: Store, net: Net) -> None:
    """Where the API counts 40 links and sends 10, nothing is published and nothing is kept to resume."""
    whole = net.world.vegnett or ()
    net.world.on_request = lambda info: setattr(
        net.world, "vegnett", whole if "inkluderAntall" in info.query else whole[:10]
    )
    with pytest.raises(ShortBackfillError, match="counts 40 veglenker and sent 10"):
        sync_vegnett(empty, AREA, client=net.client)
    assert (empty.fact("vegnett"), empty.fact("vegnett_fetch")) == (None, None)
    assert empty.count(schema.veglenke_aside) == 0
    net.world.on_request = None
    net.world.vegnett = whole
    assert sync_vegnett(empty, AREA, client=net.client) == 40


def test_network_names_the_links_that_cannot_be_read(empty: Store, net: Net) -> None:
    """One unreadable link of forty is left out and named; three of forty are too many."""
    links = _many(40)
    links[7]["geometri"] = {"wkt": "POINT(1 2)", "srid": 5973}
    net.world.vegnett = links
    assert sync_vegnett(empty, AREA, client=net.client) == 39
    (sentence,) = load_vegnett(empty).rejected
    assert "1007-1-1" in sentence
    for number in (8, 9):
        links[number]["startposisjon"] = "midt på"
    with pytest.raises(SchemaError, match=r"3 of 40 veglenker .* cannot be read") as caught:
        sync_vegnett(empty, AREA, client=net.client)
    assert "1007-1-1" in str(caught.value)
    assert len(load_vegnett(empty)) == 39


def test_network_that_loses_many_links_needs_a_confirmation(empty: Store, net: Net) -> None:
    """Going from 40 links to 10 is refused and forgotten; confirmed, the same is published."""
    sync_vegnett(empty, AREA, client=net.client)
    net.world.vegnett = _many(10)
    with pytest.raises(MassDeletionError, match="30 of 40 veglenker"):
        sync_vegnett(empty, AREA, client=net.client)
    assert len(load_vegnett(empty)) == 40
    assert (empty.fact("vegnett_fetch"), empty.count(schema.veglenke_aside)) == (None, 0)
    assert sync_vegnett(empty, AREA, client=net.client, confirm_deletions=True) == 10
    assert len(load_vegnett(empty)) == 10


def test_network_of_another_area_replaces_the_old_one_unasked(empty: Store, net: Net) -> None:
    """A smaller area has fewer links, which is no loss."""
    sync_vegnett(empty, EVERYTHING, client=net.client)
    box = Area(bbox=(270_000.0, 7_039_000.0, 270_320.0, 7_041_000.0))
    assert sync_vegnett(empty, box, client=net.client) == 4
    assert load_vegnett(empty).veglenkesekvensid.tolist() == [1000, 1001, 1002, 1003]


def test_network_that_did_not_change_leaves_findings_fresh(empty: Store, net: Net) -> None:
    """The store's revision moves when a link differs, and only then."""
    sync_vegnett(empty, AREA, client=net.client)
    before = empty.revision()
    sync_vegnett(empty, AREA, client=net.client)
    assert empty.revision() == before
    links = _many(40)
    links[3]["metadata"] = {"startdato": "2015-03-01", "sluttdato": "2026-01-01"}
    net.world.vegnett = links
    sync_vegnett(empty, AREA, client=net.client)
    assert empty.revision() == before + 1


@pytest.mark.file
def test_network_is_fetched_by_one_process_at_a_time(empty: Store, net: Net) -> None:
    """A second fetch is refused and says who is at work."""
    lock = empty.path.with_name(empty.path.name + ".vegnett-lock")
    with exclusive(lock, "sync of the road network of twin.db"), pytest.raises(RefusedError, match="process"):
        sync_vegnett(empty, AREA, client=net.client)
