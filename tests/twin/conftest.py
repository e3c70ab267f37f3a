"""The sample, a store that holds it matched, and the command line as a function."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Answer, Twin
from postgres_server import Server, running
from stores_in_postgres import ASKED, instead_of_files
from vegnett_links import segment

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.objects import point_from_wkt
from nvdb.replay import ReplayServer, ReplayWorld
from twin.cli import run
from twin.mirror.raw import raw_object
from twin.mirror.vegnett import sync_vegnett
from twin.samples.demo import sample_folder
from twin.store import schema
from twin.store.schema import METHODS
from twin.store.store import Store


@pytest.fixture(scope="session")
def sample() -> Path:
    """The shipped sample."""
    return sample_folder()


@pytest.fixture(scope="session")
def nvdb_url(sample: Path) -> Iterator[str]:
    """An NVDB on loopback that holds the sample's signs."""
    with ReplayServer(sample / "nvdb") as server:
        yield server.url


@pytest.fixture
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Retries follow each other at once."""
    monkeypatch.setitem(NvdbClient.__init__.__kwdefaults__, "sleep", lambda _s: None)


@pytest.fixture
def twin(capsys: pytest.CaptureFixture[str]) -> Twin:
    """Run the command line in this process."""

    def call(*arguments: object) -> Answer:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Answer(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def synced_store(nvdb_url: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the sample's NVDB and no drive; copy it before writing."""
    path = tmp_path_factory.mktemp("synced") / "twin.db"
    options = ["--kommune", "5001", "--api-url", nvdb_url, "--store", str(path), "--json"]
    assert run(["sync-nvdb", *options]) == 0
    return path


@pytest.fixture
def synced(synced_store: Path, tmp_path: Path) -> Path:
    """A copy of the store without drives for one test."""
    return Path(shutil.copy(synced_store, tmp_path / "synced.db"))


@pytest.fixture(scope="session")
def matched_store(sample: Path, synced_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the sample synced, ingested by every method and matched; copy it before writing."""
    path = Path(shutil.copy(synced_store, tmp_path_factory.mktemp("matched") / "twin.db"))
    store = ["--store", str(path), "--json"]
    for method in METHODS:
        assert run(["ingest-drive", str(sample / "trip_trondheim"), "--method", method, *store]) == 0
    assert run(["match", *store]) == 0
    return path


@pytest.fixture
def store(matched_store: Path, tmp_path: Path) -> Path:
    """A copy of the matched store for one test."""
    return Path(shutil.copy(matched_store, tmp_path / "twin.db"))


@pytest.fixture
def opened(store: Path) -> Iterator[Store]:
    """The matched store of one test, opened: every object by every method."""
    with Store.open(store) as one:
        yield one


@pytest.fixture
def trip(sample: Path, tmp_path: Path) -> Path:
    """A copy of the sample's drive for one test."""
    return Path(shutil.copytree(sample / "trip_trondheim", tmp_path / "trip"))


@pytest.fixture(scope="session")
def matched_road(matched_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The matched store with the sample's main road: a line through the places that its signs are hung on."""
    path = Path(shutil.copy(matched_store, tmp_path_factory.mktemp("road") / "twin.db"))
    with Store.open(path) as opened:
        raws = [raw_object(row) for row in opened.rows(sa.select(schema.skiltpunkt.c.raw))]
        link = _main_road(raws)
        with ReplayServer(ReplayWorld(vegnett=[link])) as server, NvdbClient(server.url) as client:
            assert sync_vegnett(opened, Area(kommuner=(5001,)), client=client) == 1
    assert run(["match", "--store", str(path), "--json"]) == 0
    return path


def _main_road(raws: list[dict[str, Any]]) -> dict[str, Any]:
    """One link of the veglenkesekvens that most signs are on, in V4's form."""
    places = {
        raw["lokasjon"]["stedfestinger"][0]["relativPosisjon"]: point_from_wkt(
            raw["lokasjon"]["geometri"]["wkt"]
        )
        for raw in raws
        if raw["lokasjon"]["stedfestinger"][0]["veglenkesekvensid"] == 3041771
    }
    line = ", ".join(f"{places[at][0]} {places[at][1]} -999999" for at in sorted(places))
    first, last = min(places), max(places)
    road = segment(3041771, line, startposisjon=first, sluttposisjon=last)
    road["vegsystemreferanse"]["strekning"] |= {"fra_meter": 1000 * first, "til_meter": 1000 * last}
    return road


@pytest.fixture
def empty(tmp_path: Path) -> Iterator[Store]:
    """A new store."""
    with Store.open(tmp_path / "twin.db") as store:
        yield store


@pytest.fixture(scope="session")
def postgres() -> Iterator[Server]:
    """A server of PostgreSQL with PostGIS, for as long as the tests run."""
    with ExitStack() as held:
        try:
            server = held.enter_context(running())
        except FileNotFoundError as absent:
            pytest.skip(str(absent))
        yield server


@pytest.fixture(scope="session", autouse=ASKED)
def stores_in_postgres(postgres: Server) -> Iterator[None]:
    """Every store is a database, where that is asked for."""
    with instead_of_files(postgres):
        yield


@pytest.fixture(params=["postgresql"] if ASKED else ["sqlite", "postgresql"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where a store of one test is, or will be: in a file, and in a database."""
    if request.param == "sqlite":
        return str(tmp_path / "twin.db")
    server: Server = request.getfixturevalue("postgres")
    return server.new()


@pytest.fixture
def either(address: str) -> Iterator[Store]:
    """A new store, in a file and in a database."""
    with Store.open(address) as store:
        yield store
