"""A store in which findings are accepted, its export, and a user of the local API Skriv."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from skriv_of_store import SECRET, USER

from twin.cli import run
from twin.cli.submit import PASSWORD

VERDICTS = [part for name in ("new", "missing", "moved", "wrong_type") for part in ("--verdict", name)]


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes servers."""
    with ExitStack() as made:
        yield made


def _decided(folder: Path, matched_road: Path, *verdicts: str) -> Path:
    """Make a folder with a store in which findings of these verdicts are accepted, and its export."""
    store = ["--store", str(shutil.copy(matched_road, folder / "twin.db"))]
    assert run(["decide", "accept", *verdicts, "--by", "kari", *store]) == 0
    assert run(["export", str(folder / "out"), *store]) == 0
    return folder


def _copied(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A copy of a decided store and its export for one test, whose commands take that store."""
    store, out = tmp_path / "twin.db", tmp_path / "out"
    shutil.copy(folder / "twin.db", store)
    shutil.copytree(folder / "out", out)
    monkeypatch.setenv("TWIN_STORE", str(store))
    return store, out


@pytest.fixture(scope="session")
def all_accepted(matched_road: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Everything is accepted and exported; copy it before anything is done with it."""
    return _decided(tmp_path_factory.mktemp("accepted"), matched_road, *VERDICTS)


@pytest.fixture(scope="session")
def one_accepted(matched_road: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The one new sign is accepted, and that exported; copy it before anything is done with it."""
    return _decided(tmp_path_factory.mktemp("new_sign"), matched_road, "--verdict", "new")


@pytest.fixture
def accepted(all_accepted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The store of every command here, in which everything is accepted, and its export."""
    return _copied(all_accepted, tmp_path, monkeypatch)


@pytest.fixture
def new_sign(one_accepted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The store of every command here, in which the one new sign is accepted, and its export.

    NVDB guards all but that.
    """
    return _copied(one_accepted, tmp_path, monkeypatch)


@pytest.fixture
def user(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody whom the local server knows."""
    monkeypatch.setenv("TWIN_SKRIV_USER", USER)
    monkeypatch.setenv(PASSWORD, SECRET)
