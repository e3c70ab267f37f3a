"""A store that was synced, and a world that has changed since."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from mirror_bench import visible_at
from mirror_scene import PLATES, Scene, new_world

from nvdb.replay import ReplayServer


@pytest.fixture(scope="session", params=["les-v4", "uberiket"])
def synced(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Both sources in turn: a store that mirrors a world, before anything happens."""
    made = Scene(request.param, new_world(), tmp_path_factory.mktemp("synced") / "twin.db")
    with ReplayServer(made.world, faults=made.fault_now) as made.server:
        made.sync()
        made.old = visible_at(made.path)
        yield made


@pytest.fixture
def scene(synced: Scene, tmp_path: Path, no_waiting: None) -> Scene:
    """Three plates changed, one removed and one made again since the store was synced."""
    world = new_world()
    synced.server.routes.source = world
    made = Scene(synced.source, world, Path(shutil.copy(synced.path, tmp_path)), synced.old)
    made.server, synced.then = synced.server, made
    world.touch(PLATES[3:6])
    world.remove(PLATES[9])
    world.recreate(PLATES[20])
    return made
