"""What a mirror must survive on this side of the API: locks, rights, full disks and Ctrl-C."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from mirror_bench import visible_at
from mirror_scene import Scene
from nvdb_country import GeneratedWorld

from nvdb.area import Area
from nvdb.replay import Fault, ReplayServer, RequestInfo
from twin.cli.exit_codes import exit_code
from twin.errors import RefusedError, StoreError
from twin.mirror.sync import sync_nvdb
from twin.store.store import Store


def test_two_syncs_at_once(scene: Scene) -> None:
    """The second says who holds the lock and asks nothing; its exit code is 5."""
    refused: list[Exception] = []

    def second(info: RequestInfo) -> None:
        scene.world.on_request = None
        try:
            with Store.open(scene.path) as store:
                sync_nvdb(store, Area(), api_url=scene.server.url, source=scene.source)
        except RefusedError as error:
            refused.append(error)

    scene.world.on_request = second
    scene.sync(fresh=True)
    (error,) = refused
    assert exit_code(error) == 5
    assert f"A sync of twin.db (process {os.getpid()} on " in str(error)
    assert visible_at(scene.path) == scene.new()


@pytest.mark.skipif(not hasattr(os, "seteuid"), reason="folders are not made read-only by chmod here")
def test_read_only_folder(scene: Scene) -> None:
    """A user who may read and not write is told so, and nothing changes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = Path(shutil.copy(scene.path, folder / "twin.db"))
        path.chmod(0o444)
        folder.chmod(0o555)
        user, scene.path = os.geteuid(), path
        if user == 0:
            os.seteuid(65534)
        try:
            error = scene.attempt(fresh=True)
        finally:
            os.seteuid(user)
        assert isinstance(error, StoreError | RefusedError)
        assert "give this user the right" in str(error)
        folder.chmod(0o755)
        path.chmod(0o644)
        scene.stays_old()
        scene.gets_new()


def test_disk_full(scene: Scene) -> None:
    """Wherever the space runs out, while pages are kept or when they are published, the old mirror stays."""
    n_failed, spare_pages = 0, 0

    def limit(connection: Any, _record: Any) -> None:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count={pages + spare_pages}")

    failed: Exception | None = StoreError()
    while failed is not None:
        failed = None
        with Store.open(scene.path) as store:
            sa.event.listen(store._backend.engine, "connect", limit)
            store._backend.engine.dispose()  # connections that are open already have no limit
            try:
                sync_nvdb(store, Area(), api_url=scene.server.url, source=scene.source, fresh=True)
            except StoreError as error:
                failed = error
        if failed is not None:
            assert "free some space; nothing was changed" in str(failed)
            scene.stays_old()
            n_failed, spare_pages = n_failed + 1, spare_pages + 1
    assert n_failed >= 2
    assert visible_at(scene.path) == scene.new() != scene.old


FULL = """
import resource, sys
from twin.cli import run

resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
sys.exit(run(sys.argv[2:]))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit on the size of files here")
def test_disk_full_under_the_command(scene: Scene) -> None:
    """A file that may grow no more ends the command with exit code 4 and one sentence."""
    command = ["sync-nvdb", "--all", "--fresh", "--source", scene.source, "--api-url", scene.server.url]
    limit = str(scene.path.stat().st_size // 4)
    done = subprocess.run(
        [sys.executable, "-c", FULL, limit, *command, "--store", str(scene.path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert "nothing was changed" in done.stderr
    scene.stays_old()
    scene.gets_new()


def test_interrupted_sync_does_not_wait_for_the_page_on_its_way(tmp_path: Path) -> None:
    """Ctrl-C ends a sync with code 130 although a page comes in drops; the next run goes on from there."""
    world = GeneratedWorld(40, 80)
    world.page_limit = 10
    slow, ended = threading.Event(), threading.Event()

    def page_in_drops(info: RequestInfo) -> Fault | None:
        if "/vegobjekter/96" not in info.path or "start" not in info.query or ended.is_set():
            return None
        slow.set()
        return Fault("drip", pause_s=1.0)  # the whole page would take hours; no wait for a byte is long

    with ReplayServer(world, faults=page_in_drops) as server:
        command = ["sync-nvdb", "--all", "--api-url", server.url, "--store", str(tmp_path / "a.db")]
        with subprocess.Popen(
            [sys.executable, "-m", "twin", *command], stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                assert slow.wait(200)
                process.send_signal(signal.SIGINT)
                _, told = process.communicate(timeout=200)  # below the client's deadline of 300 s
            finally:
                process.kill()
        assert process.returncode == 130
        assert told.count("Interrupted:") == 1
        ended.set()
        with Store.open(tmp_path / "a.db") as store:
            result = sync_nvdb(store, Area(), api_url=server.url)
        assert (result.mode, result.skiltplate) == ("resumed", 80)
