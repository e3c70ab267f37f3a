"""The road network in the store: whole or not at all, the same as was fetched; and which way plates face."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import SchemaError
from nvdb.mirror import MassDeletionError, ShortBackfillError
from nvdb.replay import ReplayServer
from nvdb.replay_world import ReplayWorld
from nvdb.vegnett import Vegnett
from twin import schema
from twin.errors import RefusedError, StoreError
from twin.lock import exclusive
from twin.store import Store
from twin.sync import sync_nvdb
from twin.vegnett import facing, load_vegnett, sync_vegnett

Raw = dict[str, Any]
AREA = Area(kommuner=(5001,))
EVERYTHING = Area()
MERIDIAN_E = 500_000.0
"""Easting of UTM33's central meridian, where grid north is true north."""


def _segment(sekvens: int, coordinates: str, retning: str = "MED", **changes: Any) -> Raw:
    """A link in V4's form, 0 to 1 of its veglenkesekvens, on a road for cars."""
    return {
        "veglenkesekvensid": sekvens,
        "veglenkenummer": 1,
        "segmentnummer": 1,
        "referanse": f"{sekvens}-1-1",
        "metadata": {"startdato": "2015-03-01"},
        "startposisjon": 0,
        "sluttposisjon": 1,
        "type": "HOVED",
        "detaljnivå": "Vegtrase og kjørebane",
        "topologinivå": "Vegtrase",
        "typeVeg_sosi": "enkelBilveg",
        "geometri": {"wkt": f"LINESTRING Z({coordinates})", "srid": 5973},
        "kommune": 5001,
        "vegsystemreferanse": {
            "vegsystem": {"vegkategori": "F", "fase": "V", "nummer": 6690},
            "strekning": {
                "strekning": 1,
                "delstrekning": 1,
                "trafikantgruppe": "K",
                "retning": retning,
                "fra_meter": 100.0,
                "til_meter": 598.5,
            },
            "kortform": "FV6690 S1D1 m100-599",
        },
        **changes,
    }


def _many(n: int) -> list[Raw]:
    """Links with and without heights, references, ends and segment numbers."""
    links = []
    for number in range(n):
        east, north, height = (
            270_000 + 100 * number,
            7_040_000,
            -999999 if number % 3 == 0 else number + 0.125,
        )
        link = _segment(1000 + number, f"{east} {north} {height}, {east + 50.123} {north + 70} {height}")
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


def _plate(
    number: int,
    enum: tuple[int, str] | None,
    at: tuple[float, float],
    *,
    place: tuple[int, float, str | None] | None = None,
    own: bool = True,
) -> Raw:
    """A Skiltplate in V4's form; `place` is its stedfesting: sekvens, position and side."""
    wkt = f"POINT Z ({at[0]} {at[1]} 10)"
    egenskaper: list[Raw] = [
        {"id": 5530, "navn": "Skiltnummer", "egenskapstype": "Tekstenum", "verdi": "202", "enum_id": 7642}
    ]
    if own:
        egenskaper.append({"id": 4795, "navn": "Geometri, punkt", "egenskapstype": "Geometri", "verdi": wkt})
    if enum is not None:
        side = {"id": 1894, "navn": "Ansiktsside, rettet mot", "egenskapstype": "Tekstenum"}
        egenskaper.append({**side, "verdi": enum[1], "enum_id": enum[0]})
    lokasjon: Raw = {"kommuner": [5001]}
    if place is not None:
        punkt = {"type": "Punkt", "veglenkesekvensid": place[0], "relativPosisjon": place[1]}
        lokasjon["stedfestinger"] = [punkt if place[2] is None else {**punkt, "sideposisjon": place[2]}]
    return {
        "id": number,
        "metadata": {"type": {"id": 96, "navn": "Skiltplate"}, "versjon": 1, "startdato": "2020-05-01"},
        "egenskaper": egenskaper,
        "lokasjon": lokasjon,
        "geometri": {"wkt": wkt, "srid": 5973, "egengeometri": own},
    }


MED = (2714, "Trafikk i metreringsretning")
MOT = (2717, "Trafikk mot metreringsretning")
TOWARDS = (2837, "Parallelt mot veg")
AWAY = (2838, "Parallelt fra veg")
BOTH = (3698, "Tosidig")


@pytest.fixture
def empty(tmp_path: Path) -> Iterator[Store]:
    """A new store."""
    with Store.open(tmp_path / "twin.db") as store:
        yield store


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


def test_network_of_the_store_places_points_as_the_fetched_one_does(empty: Store, net: Net) -> None:
    """Stedfesting on the loaded network gives the same positions, sides and meters."""
    sync_vegnett(empty, AREA, client=net.client)
    rng = np.random.default_rng(5)
    east, north = rng.uniform(270_000, 274_000, 200), rng.uniform(7_039_990, 7_040_080, 200)
    got = load_vegnett(empty).stedfest(east, north)
    want = Vegnett.from_les_v4(net.world.vegnett or ()).stedfest(east, north)
    assert got.found.any()
    np.testing.assert_array_equal(got.relativ_posisjon, want.relativ_posisjon)
    np.testing.assert_array_equal(got.meter, want.meter)
    assert got.kortform.tolist() == want.kortform.tolist()


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
    clock = "twin.vegnett.fetch.utc_now"
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


def test_network_is_fetched_by_one_process_at_a_time(empty: Store, net: Net) -> None:
    """A second fetch is refused and says who is at work."""
    lock = empty.path.with_name(empty.path.name + ".vegnett-lock")
    with exclusive(lock, "sync of the road network of twin.db"), pytest.raises(RefusedError, match="process"):
        sync_vegnett(empty, AREA, client=net.client)


# -- which way plates face ---------------------------------------------------------------------------------


@pytest.fixture
def faces(empty: Store) -> Callable[..., dict[int, tuple[float, float]]]:
    """Sync plates and links into a store, as one of the APIs shows them, and ask which way they face."""

    def work(plates: list[Raw], links: list[Raw], source: str = "les-v4") -> dict[int, tuple[float, float]]:
        with (
            ReplayServer(ReplayWorld({96: plates}, vegnett=links)) as server,
            NvdbClient(server.url, sleep=lambda _s: None) as client,
        ):
            sync_nvdb(empty, EVERYTHING, api_url=server.url, source=source)
            sync_vegnett(empty, EVERYTHING, client=client)
        return facing(empty)

    return work


NORTHWARD = f"{MERIDIAN_E} 7000000 1, {MERIDIAN_E} 7001000 1"


@pytest.mark.parametrize("source", ["les-v4", "uberiket"])
@pytest.mark.parametrize(("retning", "turned"), [("MED", 0.0), ("MOT", 180.0)])
def test_facing_follows_ansiktsside_and_metering(
    faces: Callable[..., Any], source: str, retning: str, turned: float
) -> None:
    """On a road due north, worked out by hand: against the metering, along it, towards and away from it."""
    at = (MERIDIAN_E + 5.0, 7_000_500.0)
    sides = {MED: (180, None), MOT: (0, None), BOTH: (180, 0), TOWARDS: (270, None), AWAY: (90, None)}
    # The plate stands east of the road: right of a metering to the north, left of one to the south.
    side = "H" if retning == "MED" else "V"
    plates = [_plate(k, enum, at, place=(77, 0.5, side)) for k, enum in enumerate([*sides, None], start=1)]
    found = faces(plates, [_segment(77, NORTHWARD, retning)], source)
    assert set(found) == {1, 2, 3, 4, 5, 6}
    for k, (enum, (first, second)) in enumerate(sides.items(), start=1):
        # Turning the metering turns what refers to it; the road stays on the same side of the plate.
        turn = 0.0 if enum in (TOWARDS, AWAY) else turned
        assert found[k][0] == pytest.approx((first + turn) % 360, abs=1e-6)
        assert math.isnan(found[k][1]) == (second is None)
        if second is not None:
            assert found[k][1] == pytest.approx((second + turn) % 360, abs=1e-6)
    assert all(math.isnan(azimuth) for azimuth in found[6])


def test_facing_is_from_true_north(faces: Callable[..., Any]) -> None:
    """Near Trondheim a grid-northward road runs some 4° west of north, as the geodesic along it says."""
    east, north = 270_000.0, 7_040_000.0
    link = _segment(77, f"{east} {north} 1, {east} {north + 1000} 1")
    found = faces([_plate(1, MOT, (east + 4, north + 500), place=(77, 0.5, "H"))], [link])
    to_degrees = pyproj.Transformer.from_crs(25833, 4258, always_xy=True)
    ends = [to_degrees.transform(east, north + along) for along in (499.0, 501.0)]
    azimuth, _, _ = pyproj.Geod(ellps="GRS80").inv(*ends[0], *ends[1])
    # Convergence changes by less than a millionth of a degree over the metre between chord and point.
    assert found[1][0] == pytest.approx(azimuth % 360, abs=1e-5)
    assert 355.5 < found[1][0] < 356.5


def test_facing_believes_the_stedfesting_before_the_nearest_road(faces: Callable[..., Any]) -> None:
    """A plate that NVDB hangs on a road 20 m away does not follow the crossing road beside it."""
    east, north = MERIDIAN_E, 7_000_500.0
    crossing = _segment(78, f"{east - 500} {north} 1, {east + 500} {north} 1")
    plates = [
        _plate(1, MED, (east + 20, north + 1), place=(77, 0.5, "H")),
        _plate(2, MED, (east + 20, north + 1), place=(999, 0.5, "H")),
        _plate(3, MED, (east + 20, north + 1)),
    ]
    found = faces(plates, [_segment(77, NORTHWARD), crossing])
    assert found[1][0] == pytest.approx(180.0, abs=1e-3)
    # Unknown to the network, or without stedfesting: the road beside it runs east and is read from there.
    assert found[2][0] == pytest.approx(270.0, abs=1e-2)
    assert found[3][0] == pytest.approx(270.0, abs=1e-2)


def test_facing_finds_the_piece_of_a_sekvens_that_a_position_lies_on(faces: Callable[..., Any]) -> None:
    """Of two pieces at a right angle the one counts that holds the position; outside both none does."""
    corner = f"{MERIDIAN_E} 7000500 1"
    pieces = [
        _segment(77, f"{MERIDIAN_E} 7000000 1, {corner}", sluttposisjon=0.4),
        _segment(
            77,
            f"{corner}, {MERIDIAN_E + 300} 7000500 1",
            startposisjon=0.4,
            sluttposisjon=0.9,
            segmentnummer=2,
            referanse="77-1-2",
        ),
    ]
    far = (MERIDIAN_E + 5000, 7_000_000.0)  # no road near: only the stedfesting can tell
    plates = [
        _plate(k, MOT, far, place=(77, position, None))
        for k, position in enumerate((0.1, 0.6, 0.95), start=1)
    ]
    found = faces(plates, pieces)
    assert found[1][0] == pytest.approx(0.0, abs=1e-3)
    assert found[2][0] == pytest.approx(90.0, abs=1e-2)
    assert math.isnan(found[3][0])


@pytest.mark.parametrize("retning", ["MED", "MOT"])
def test_facing_takes_the_side_from_own_geometry_where_nvdb_does_not_say(
    faces: Callable[..., Any], retning: str
) -> None:
    """A plate along the road and west of it looks east to the road; one on the centre line on no side."""
    west, derived = (MERIDIAN_E - 6.0, 7_000_500.0), (MERIDIAN_E - 0.004, 7_000_500.0)
    plates = [
        _plate(1, TOWARDS, west, place=(77, 0.5, None)),
        _plate(2, TOWARDS, west),
        _plate(3, TOWARDS, west, place=(77, 0.5, "M")),
        _plate(4, TOWARDS, derived, place=(77, 0.5, None), own=False),
        _plate(5, TOWARDS, derived, own=False),
        _plate(6, MED, derived, own=False),
    ]
    found = faces(plates, [_segment(77, NORTHWARD, retning)])
    assert found[1][0] == pytest.approx(90.0, abs=1e-3)
    assert found[2][0] == pytest.approx(90.0, abs=1e-3)
    assert all(math.isnan(found[number][0]) for number in (3, 4, 5))
    # The direction of the road is known also where the side is not.
    assert found[6][0] == pytest.approx(180.0 if retning == "MED" else 0.0, abs=1e-3)


def test_facing_does_not_depend_on_which_way_links_are_drawn(empty: Store) -> None:
    """Turning links round (geometry, positions, MED and MOT) changes no face by more than a microdegree."""
    rng = np.random.default_rng(11)
    links, turned, plates = [], [], []
    for k in range(30):
        x = 480_000 + 1000.0 * k + np.cumsum(rng.uniform(-80, 80, 4))
        y = 7_000_000.0 + np.cumsum(rng.uniform(-80, 80, 4))
        points = [f"{a:.3f} {b:.3f} 5" for a, b in zip(x, y, strict=True)]
        links.append(_segment(100 + k, ", ".join(points)))
        turned.append(_segment(100 + k, ", ".join(points[::-1]), "MOT"))
        at = (round(float(x.mean()), 2), round(float(y.mean()), 2))
        enum = [MED, MOT, TOWARDS, AWAY, BOTH][k % 5]
        # Positions that are multiples of 1/8 turn round without rounding.
        plates.append((k, enum, at, int(rng.integers(1, 8)) / 8))
    results = []
    for drawn, flip in ((links, False), (turned, True)):
        there = [
            _plate(k + 1, enum, at, place=(100 + k, 1 - p if flip else p, "H")) for k, enum, at, p in plates
        ]
        with (
            ReplayServer(ReplayWorld({96: there}, vegnett=drawn)) as server,
            NvdbClient(server.url, sleep=lambda _s: None) as client,
        ):
            sync_nvdb(empty, EVERYTHING, api_url=server.url, fresh=True)
            sync_vegnett(empty, EVERYTHING, client=client)
        results.append(np.array([faces for _, faces in sorted(facing(empty).items())]))
    assert np.isfinite(results[0][:, 0]).all()
    difference = (results[0] - results[1] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(difference[np.isfinite(difference)], 0.0, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(results[0]), np.isnan(results[1]))


def test_facing_needs_a_road_network(empty: Store) -> None:
    """Without one the cure is named."""
    with pytest.raises(StoreError, match="no road network: run `twin sync-nvdb` with --vegnett"):
        facing(empty)
