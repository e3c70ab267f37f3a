"""The sample, a store that holds it matched, and the command line as a function."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from nvdb.client import NvdbClient
from nvdb.replay import ReplayServer
from twin.cli import run
from twin.demo import sample_folder
from twin.match import METHODS


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


@dataclass(frozen=True)
class Answer:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON document."""
        return json.loads(self.out)


@pytest.fixture
def twin(capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Run the command line in this process."""

    def call(*arguments: object) -> Answer:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Answer(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def matched_store(sample: Path, nvdb_url: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with the sample synced, ingested by every method and matched; copy it before writing."""
    path = tmp_path_factory.mktemp("matched") / "twin.db"
    store = ["--store", str(path), "--json"]
    assert run(["sync-nvdb", "--kommune", "5001", "--api-url", nvdb_url, *store]) == 0
    for method in METHODS:
        assert run(["ingest-drive", str(sample / "trip_trondheim"), "--method", method, *store]) == 0
    assert run(["match", *store]) == 0
    return path


@pytest.fixture
def store(matched_store: Path, tmp_path: Path) -> Path:
    """A copy of the matched store for one test."""
    return Path(shutil.copy(matched_store, tmp_path / "twin.db"))
