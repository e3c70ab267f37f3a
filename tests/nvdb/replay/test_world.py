"""The replayed world: what it answers as Uberiket and the feeds do, and how it can be made to misbehave."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from nvdb.client import NvdbClient
from nvdb.errors import HttpStatusError, ReplaySourceError
from nvdb.replay import Fault, ReplayWorld

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)
UBERIKET = "/uberiket/api/v1"


@pytest.fixture
def world(plate: Callable[..., Any], point: Callable[..., Any]) -> ReplayWorld:
    """Points 1 and 2, plates 501 to 505."""
    return ReplayWorld(
        {95: [point(1), point(2)], 96: [plate(number) for number in range(501, 506)]}, clock=lambda: NOW
    )


def get(client: NvdbClient, path: str, **params: Any) -> Any:
    """One answer."""
    return client.get_json(path, params)


def test_world_leaves_out_neste_on_uberikets_last_page(api: Any, world: ReplayWorld) -> None:
    """Uberiket's pages end without ``neste``, also where the last page is full."""
    client, _ = api.serve(world)
    first = get(client, f"{UBERIKET}/vegobjekter/96", antall=3, inkluder="alle")
    assert [raw["id"] for raw in first["vegobjekter"]] == [501, 502, 503]
    assert first["metadata"]["returnert"] == first["metadata"]["sidestorrelse"] == 3
    assert first["metadata"]["neste"]["start"] == "503-2"
    last = get(client, f"{UBERIKET}/vegobjekter/96", antall=2, start="503-2")
    assert [raw["id"] for raw in last["vegobjekter"]] == [504, 505]
    assert set(last["metadata"]) == {"returnert", "sidestorrelse"}
    assert set(last["vegobjekter"][0]) == {"id", "versjon", "typeId", "sistEndret"}


def test_world_shows_an_object_in_uberikets_form(api: Any, world: ReplayWorld) -> None:
    """Enum ids without text, ASCII keys, the geometry with its srid, children under the list's id."""
    client, _ = api.serve(world)
    (plate,) = get(client, f"{UBERIKET}/vegobjekter/96", ider=501, inkluder="alle")["vegobjekter"]
    assert plate["egenskaper"]["5530"] == {"type": "EnumEgenskap", "verdi": 8874}
    assert plate["egenskaper"]["4795"]["verdi"] == {
        "wkt": "POINT Z (270000.0 7040501.0 42.5)",
        "srid": 5973,
        "kvalitet": {"datafangstmetode": "sat", "noyaktighet": 12, "maksimaltAvvik": -1},
    }
    assert plate["stedfesting"]["punkter"][0]["kjorefelt"] == ["1"]
    (point,) = get(client, f"{UBERIKET}/vegobjekter/95", ider=1, inkluder="barn")["vegobjekter"]
    assert point["barn"] == {"220004": [501, 502]}


def test_world_keeps_every_version_for_uberiket_and_the_open_one_for_v4(api: Any, world: ReplayWorld) -> None:
    """A new version ends the old one where it begins; ``dato`` picks the one valid on a day."""
    world.new_version(501, "2026-01-01")
    client, _ = api.serve(world)
    path = f"{UBERIKET}/vegobjekter/96"
    spans = [
        (raw["versjon"], raw["gyldighetsperiode"])
        for raw in get(client, path, ider=501, inkluder="alle")["vegobjekter"]
    ]
    assert spans == [
        (2, {"startdato": "2020-05-01", "sluttdato": "2026-01-01"}),
        (3, {"startdato": "2026-01-01"}),
    ]
    old = get(client, path, ider=501, dato="2025-12-31")["vegobjekter"]
    assert [raw["versjon"] for raw in old] == [2]
    shown = get(client, "/vegobjekter/96", ider=501, inkluder="metadata")["objekter"]
    assert [raw["metadata"]["versjon"] for raw in shown] == [3]


def test_world_numbers_events_and_both_feeds_agree(api: Any, world: ReplayWorld) -> None:
    """Uberiket counts events from 1; V4 sorts the same changes into lists, by time, with a token to go on."""
    world.update(501)
    world.remove(502)
    world.recreate(502)
    client, _ = api.serve(world)
    events = get(client, f"{UBERIKET}/hendelser/vegobjekter", typeIder="95,96")["hendelser"]
    assert [(event["hendelseId"], event["hendelseType"], event["vegobjektId"]) for event in events] == [
        (1, "VegobjektVersjonEndret", 501),
        (2, "VegobjektVersjonFjernet", 502),
        (3, "VegobjektVersjonOpprettet", 502),
    ]
    assert get(client, f"{UBERIKET}/hendelser/vegobjekter/96/siste") == events[-1]
    assert get(client, f"{UBERIKET}/hendelser/vegobjekter/96", start=2)["hendelser"] == events[2:]
    page = get(client, "/vegobjekter/endringer", typeIder="96", antall=2)
    assert [item["id"] for item in page["vegobjektVersjonerEndret"]] == [501]
    assert [item["id"] for item in page["vegobjektVersjonerFjernet"]] == [502]
    token = page["metadata"]["neste"]["start"]
    assert token == "2026-06-01T12:00:00.000001Z,502,2"
    rest = get(client, "/vegobjekter/96/endringer", start=token)
    assert [item["id"] for item in rest["vegobjektVersjonerOpprettet"]] == [502]
    end = get(client, "/vegobjekter/96/endringer", start=rest["metadata"]["neste"]["start"])
    assert end["metadata"]["neste"]["start"] == rest["metadata"]["neste"]["start"]
    assert end["metadata"]["returnert"] == 0


def test_world_forgets_v4_changes_after_thirty_days(api: Any, plate: Callable[..., Any]) -> None:
    """V4's feed leaves out older changes without a word; Uberiket keeps them."""
    time = [NOW]
    world = ReplayWorld({96: [plate(501)]}, clock=lambda: time[0])
    world.update(501)
    time[0] += timedelta(days=31)
    client, _ = api.serve(world)
    assert get(client, "/vegobjekter/96/endringer")["metadata"]["returnert"] == 0
    assert get(client, f"{UBERIKET}/hendelser/vegobjekter/96")["metadata"]["returnert"] == 1


@pytest.mark.parametrize(
    ("path", "params", "status"),
    [
        (f"{UBERIKET}/vegobjekter/96", {"antall": 1001}, 400),
        (f"{UBERIKET}/vegobjekter/96", {"start": "503:2"}, 400),
        (f"{UBERIKET}/vegobjekter/96", {"inkluder": "lokasjon"}, 400),
        (f"{UBERIKET}/vegobjekter/96", {"ider": "1", "polygon": "0 0, 1 1, 0 1, 0 0"}, 400),
        (f"{UBERIKET}/vegobjekter/105", {}, 404),
        (f"{UBERIKET}/hendelser/vegobjekter/95/siste", {}, 404),
        ("/vegobjekter/endringer", {}, 400),
        ("/vegobjekter/96/endringer", {"start": "yesterday"}, 400),
        ("/datakatalog/api/v1/vegobjekttyper/105", {}, 404),
    ],
)
def test_world_answers_a_bad_question_with_its_status(
    api: Any, world: ReplayWorld, path: str, params: dict[str, Any], status: int
) -> None:
    """What the APIs refuse is refused here."""
    client, _ = api.serve(world)
    with pytest.raises(HttpStatusError) as caught:
        client.get_json(path, params)
    assert caught.value.status == status


def test_world_can_change_the_order_of_its_pages(api: Any, world: ReplayWorld) -> None:
    """Another order gives the same objects on other pages, and each seed its own order every time."""

    def order(seed: int | None) -> list[int]:
        world.order_seed = seed
        client, _ = api.serve(world)
        found, start = [], "0:0"
        for _ in range(3):
            page = get(client, "/vegobjekter/96", antall=2, **({"start": start} if found else {}))
            found += [raw["id"] for raw in page["objekter"]]
            start = page["metadata"]["neste"]["start"]
        return found

    assert order(None) == [501, 502, 503, 504, 505]
    assert sorted(order(1)) == [501, 502, 503, 504, 505]
    assert order(1) == order(1) != order(2)


def test_world_can_repeat_a_page_under_the_right_cursor(api: Any, world: ReplayWorld) -> None:
    """The fault ``repeat_page`` shows the first page's objects again, and its cursor goes on as it should."""
    client, _ = api.serve(world, [None, Fault("repeat_page")])
    first = get(client, "/vegobjekter/96", antall=2)
    again = get(client, "/vegobjekter/96", antall=2, start=first["metadata"]["neste"]["start"])
    assert again["objekter"] == first["objekter"]
    assert again["metadata"]["neste"]["start"] == "504:2"


def test_world_refuses_changes_of_what_is_not_there(world: ReplayWorld, plate: Callable[..., Any]) -> None:
    """A test that changes the wrong object hears of it."""
    with pytest.raises(ReplaySourceError, match="no vegobjekt 999"):
        world.update(999)
    with pytest.raises(ReplaySourceError, match="501 is there already"):
        world.create(96, plate(501))
    with pytest.raises(ReplaySourceError, match="501 was not removed"):
        world.recreate(501)
    assert world.events == []
