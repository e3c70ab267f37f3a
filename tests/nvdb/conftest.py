"""Generated objects in V4's form, a client that never really waits, a mirror under test, and an API Skriv."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from mirror_bench import KINDS, PLATES, Bench, Clock
from skriv_desk import Desk

from nvdb.client import NvdbClient
from nvdb.replay import ReplayServer, ReplayWorld
from twin.mirror import mirror_tables as mirror_store

Raw = dict[str, Any]


def _plate(object_id: int, **changes: Any) -> Raw:
    """A Skiltplate with everything that ``inkluder=alle`` brings; 1 m further north for each id."""
    east, north = 270_000.0, 7_040_000.0 + object_id % 1000
    raw: Raw = {
        "id": object_id,
        "metadata": {
            "type": {"id": 96, "navn": "Skiltplate"},
            "versjon": 2,
            "startdato": "2020-05-01",
            "sist_modifisert": "2024-03-02T10:11:12Z",
        },
        "egenskaper": [
            {
                "id": 5530,
                "navn": "Skiltnummer",
                "egenskapstype": "Tekstenum",
                "verdi": "362.50 - Fartsgrense, 50 km/t",
                "enum_id": 8874,
            },
            {
                "id": 1894,
                "navn": "Ansiktsside, rettet mot",
                "egenskapstype": "Tekstenum",
                "verdi": "Trafikk i metreringsretning",
                "enum_id": 2714,
            },
            {"id": 5128, "navn": "Plasseringskode", "egenskapstype": "Heltall", "verdi": 10},
            {"id": 1910, "navn": "Tekst", "egenskapstype": "Tekst", "verdi": "50"},
            {
                "id": 4795,
                "navn": "Geometri, punkt",
                "egenskapstype": "Geometri",
                "verdi": f"POINT Z ({east} {north} 42.5)",
                "kvalitet": {"datafangstmetode": "sat", "nøyaktighet": 12, "maksimaltAvvik": -1},
            },
        ],
        "relasjoner": {
            "foreldre": [
                {
                    "id": 220004,
                    "type": {"id": 95, "navn": "Skiltpunkt"},
                    "relasjonstype": "vegobjektIder",
                    "vegobjekter": [object_id - 500],
                }
            ]
        },
        "lokasjon": {
            "kommuner": [5001],
            "fylker": [50],
            "vegsystemreferanser": [{"kortform": "EV6 S46D1 m1200"}, {"kortform": "FV1 S1D1 m0"}],
            "stedfestinger": [
                {
                    "type": "Punkt",
                    "veglenkesekvensid": 2510771,
                    "relativPosisjon": 0.25,
                    "retning": "MED",
                    "kjørefelt": ["1"],
                    "sideposisjon": "H",
                    "kortform": "0.25@2510771",
                }
            ],
        },
        "geometri": {"wkt": f"POINT Z ({east} {north} 42.5)", "srid": 5973, "egengeometri": True},
    }
    return raw | changes


def _point(object_id: int, **changes: Any) -> Raw:
    """A Skiltpunkt with two plates."""
    raw = _plate(object_id)
    raw["metadata"] = raw["metadata"] | {"type": {"id": 95, "navn": "Skiltpunkt"}, "versjon": 1}
    wkt = raw["geometri"]["wkt"]
    raw["egenskaper"] = [
        {"id": 4794, "navn": "Geometri, punkt", "egenskapstype": "Geometri", "verdi": wkt},
        {
            "id": 1876,
            "navn": "Oppsettingsutstyr",
            "egenskapstype": "Tekstenum",
            "verdi": 'Stolpe 60,3 mm (2")',
            "enum_id": 2866,
        },
    ]
    raw["relasjoner"] = {
        "barn": [
            {
                "listeid": 220004,
                "id": 200004,
                "type": {"id": 96, "navn": "Skiltplate"},
                "relasjonstype": "vegobjektIder",
                "vegobjekter": [object_id + 500, object_id + 501],
            }
        ]
    }
    return raw | changes


@pytest.fixture
def plate() -> Callable[..., Raw]:
    """``plate(id, **changes)`` makes a Skiltplate in V4's form."""
    return _plate


@pytest.fixture
def point() -> Callable[..., Raw]:
    """``point(id, **changes)`` makes a Skiltpunkt in V4's form."""
    return _point


class Api:
    """A replay server and a client of it; `waits` holds what the client would have slept."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self.waits: list[float] = []

    def serve(self, source: Any, faults: Any = None, **client: Any) -> tuple[NvdbClient, ReplayServer]:
        """Start both; the fixture closes them."""
        server = self._stack.enter_context(ReplayServer(source, faults=faults))
        return self.client(server.url, **client), server

    def client(self, url: str, **options: Any) -> NvdbClient:
        """A client that notes its waits instead of waiting."""
        settings: dict[str, Any] = {"timeout_s": 5.0, "sleep": self.waits.append, **options}
        return self._stack.enter_context(NvdbClient(url, **settings))


@pytest.fixture
def api() -> Iterator[Api]:
    """Replay servers and clients for one test."""
    with ExitStack() as stack:
        yield Api(stack)


@pytest.fixture
def source(plate: Callable[..., Raw]) -> dict[int, list[Raw]]:
    """Three plates, for a replay server."""
    return {96: [plate(number) for number in (901, 902, 903)]}


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


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes servers and clients."""
    with ExitStack() as made:
        yield made


@pytest.fixture
def desk(stack: ExitStack) -> Desk:
    """A world of one Skiltpunkt (50, version 2) with one plate (51), and its user."""
    return Desk(stack)
