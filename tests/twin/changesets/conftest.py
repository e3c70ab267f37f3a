"""A store in which findings are accepted, its export, and a user of the local API Skriv."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from command_line import Twin
from skriv_of_store import SECRET, USER

from twin.cli.submit import PASSWORD

VERDICTS = [part for name in ("new", "missing", "moved", "wrong_type") for part in ("--verdict", name)]


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    """Closes servers."""
    with ExitStack() as made:
        yield made


@pytest.fixture
def accepted(
    twin: Twin, matched_road: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Path, Path]:
    """The store of every command here, in which everything is accepted, and its export."""
    store, out = Path(shutil.copy(matched_road, tmp_path / "twin.db")), tmp_path / "out"
    monkeypatch.setenv("TWIN_STORE", str(store))
    assert twin("decide", "accept", *VERDICTS, "--by", "kari").code == 0
    assert twin("export", out).code == 0
    return store, out


@pytest.fixture
def new_sign(twin: Twin, matched_road: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The store of every command here, in which the one new sign is accepted: NVDB guards all but that."""
    store = Path(shutil.copy(matched_road, tmp_path / "twin.db"))
    monkeypatch.setenv("TWIN_STORE", str(store))
    assert twin("decide", "accept", "--verdict", "new", "--by", "kari").code == 0
    return store


@pytest.fixture
def user(monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody whom the local server knows."""
    monkeypatch.setenv("TWIN_SKRIV_USER", USER)
    monkeypatch.setenv(PASSWORD, SECRET)
