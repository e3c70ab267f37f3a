"""Any order of commands: no operation is carried out twice, no decision lost, no stale finding exported.

``TWIN_HISTORIES=1000`` makes a longer run of it (``make soak``).
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from sending_country import base_store
from sending_history import run_history, story

HISTORIES = int(os.environ.get("TWIN_HISTORIES", "8"))
PARTS = 4


@pytest.fixture(scope="module")
def base(matched_road: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with four new signs and three findings about known ones."""
    return base_store(matched_road, tmp_path_factory.mktemp("base") / "twin.db")


@pytest.mark.parametrize("part", range(PARTS))
def test_no_order_of_commands_sends_twice(base: Path, tmp_path: Path, part: int) -> None:
    """Random histories, each against what the model says may be."""
    for seed in range(part, HISTORIES, PARTS):
        folder = tmp_path / str(seed)
        folder.mkdir()
        steps, wrong = run_history(base, folder, seed)
        assert not wrong, story(seed, steps, wrong)
        shutil.rmtree(folder)
