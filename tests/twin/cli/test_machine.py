"""The edges of the machine: streams that are closed, full or left, disks without room, rights, memory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import Answer, Twin

from twin.errors import StoreError
from twin.store import schema
from twin.store.store import Store

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the shell's redirections and limits")

needs_dev_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
EXPORT = ("export", "OUT", "--store", "STORE")
EXPORT_JSON = (*EXPORT, "--json")
STATUS = ("status", "--store", "STORE")
LOST = "Standard output cannot be written (No space left on device)"


def in_shell(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command of twin in bash, where the script has it as ``"$@"``; a hang fails."""
    command = ["bash", "-c", script, "bash", sys.executable, "-m", "twin", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    ("script", "command", "code", "told"),
    [
        ('"$@" >&-', ("--help",), 0, ""),
        ('"$@" >&- 2>&- <&-', EXPORT, 0, ""),
        ('"$@" 2>&-', ("nonsense",), 2, ""),
        pytest.param('"$@" > /dev/full', ("--version",), 6, LOST, marks=needs_dev_full),
        pytest.param('"$@" > /dev/full', STATUS, 6, LOST, marks=needs_dev_full),
        pytest.param('"$@" > /dev/full', EXPORT_JSON, 6, LOST, marks=needs_dev_full),
        pytest.param('"$@" 2> /dev/full', EXPORT, 0, "", marks=[needs_dev_full, pytest.mark.slow]),
        ('"$@" | true; exit ${PIPESTATUS[0]}', ("--help",), 141, ""),
        ('"$@" | true; exit ${PIPESTATUS[0]}', STATUS, 141, ""),
        pytest.param(
            '"$@" 2>&1 >/dev/null | true; exit ${PIPESTATUS[0]}', EXPORT, 0, "", marks=pytest.mark.slow
        ),
    ],
)
def test_streams_that_fail(
    script: str, command: tuple[str, ...], code: int, told: str, store: Path, tmp_path: Path
) -> None:
    """No traceback, whatever the streams are; what the command writes elsewhere is written."""
    out = tmp_path / "out"
    done = in_shell(script, *({"STORE": store, "OUT": out}.get(word, word) for word in command))
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert told in done.stderr
    if told:
        assert done.stderr.count(told) == done.stderr.count("\n") == 1
    assert (out / "twin_utm33.gpkg").exists() == (command[0] == "export")


def test_a_closed_output_is_not_the_store(store: Path) -> None:
    """The number of a closed output is not given to the store's file, which would be printed into."""
    assert in_shell('"$@" >&-', "match", "--store", store).returncode == 0
    with Store.open(store, create=False) as opened:
        assert opened.matched()["method"] == "adjusted"


@contextmanager
def unprivileged() -> Iterator[None]:
    """Be a user without the superuser's rights."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


@pytest.fixture
def guarded(store: Path) -> Iterator[Path]:
    """A store that may be read and not written, in a folder alike."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = Path(shutil.copy(store, folder / "twin.db"))
        path.chmod(0o444)
        folder.chmod(0o555)
        yield path
        folder.chmod(0o755)


def said(answer: Answer, store: Path) -> list[str]:
    """What a command printed, but for where the store is and how old its mirror."""
    return [line.replace(str(store), "") for line in answer.out.splitlines() if "age_hours" not in line]


@pytest.mark.parametrize(
    "command",
    [
        *("status", "drives", "findings", "show P01", "show 45ca74", "explain 45ca74", "evaluate TRUTH"),
        *("match", "ingest-drive TRIP"),
    ],
)
def test_a_store_that_may_only_be_read(
    twin: Twin, sample: Path, store: Path, guarded: Path, command: str
) -> None:
    """Commands that read give what they give of any store; those that write say why they cannot."""
    words = command.replace("TRUTH", str(sample / "truth.csv")).replace(
        "TRIP", str(sample / "trip_trondheim")
    )
    with unprivileged():
        answer = twin(*words.split(), "--store", guarded, "--json")
    assert [path.name for path in guarded.parent.iterdir()] == ["twin.db"]
    if command.startswith(("match", "ingest-drive")):
        assert answer.code == 4
        assert "give this user the right to read and write" in answer.err
    else:
        assert answer.code == 0, answer.err
        assert said(answer, guarded) == said(twin(*words.split(), "--store", store, "--json"), store)


def test_settings_of_another_user_are_none_of_this_ones(
    twin: Twin, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Started with another user's home, as by `su` or a service, twin has no settings there and works."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "twin").mkdir()
        (Path(name) / "twin" / "twin.toml").write_text('lang = "nb"', encoding="utf-8")
        assert twin("config").code == 0  # loads what the other user may not be able to read
        monkeypatch.setenv("XDG_CONFIG_HOME", name)
        Path(name).chmod(0o000)
        with unprivileged():
            codes = [twin("config").code, twin("config", "--json").code]
        Path(name).chmod(0o755)
    assert codes == [0, 0]


def test_what_others_are_writing_is_read_too(twin: Twin, store: Path) -> None:
    """Of a store that another user writes to, the newest state is read, not the file without its log."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(shutil.copy(store, Path(name) / "twin.db"))
        with Store.open(path) as opened:
            with opened.transaction() as connection:
                connection.exec_driver_sql("DELETE FROM estimate WHERE method = 'paper'")
            path.chmod(0o444)
            Path(name).chmod(0o555)
            with unprivileged():
                found = twin("status", "--store", path, "--json").json["estimates"]
            Path(name).chmod(0o755)
    assert found == {"adjusted": 15, "single-frame": 15}


def test_a_log_that_may_not_be_read_is_named(twin: Twin, store: Path) -> None:
    """A writer was killed, and its log's index is gone: nothing older is shown as if it were all."""
    with tempfile.TemporaryDirectory() as name:
        path, log = Path(name) / "twin.db", Path(name) / "twin.db-wal"
        with Store.open(store) as opened:
            with opened.transaction() as connection:
                connection.exec_driver_sql("DELETE FROM estimate WHERE method = 'paper'")
            for copy in (path, log):
                shutil.copy(store.with_name(copy.name), copy)
                copy.chmod(0o444)
        Path(name).chmod(0o555)
        with unprivileged():
            answer = twin("status", "--store", path)
        Path(name).chmod(0o755)
    assert answer.code == 4
    assert "let its owner run `twin status` once" in answer.err


def test_a_store_written_while_it_is_read_says_so(guarded: Path) -> None:
    """Where SQLite's locks cannot be had, a change under the reader is noticed."""
    with unprivileged():
        opened = Store.open(guarded, create=False)
    with opened:
        assert opened.count(schema.estimate) == 45
        os.utime(guarded, ns=(1, 1))
        with pytest.raises(StoreError, match="was written while it was read"):
            opened.count(schema.estimate)


@pytest.mark.parametrize("command", ["status", "match", "ingest-drive TRIP", "sync-nvdb", "drives"])
@pytest.mark.parametrize("rights", ["file", "folder"])
def test_a_store_that_may_not_be_read(
    twin: Twin, store: Path, sample: Path, command: str, rights: str
) -> None:
    """Another user's store is bad data with its cure, not a wrong option."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(shutil.copy(store, Path(name) / "twin.db"))
        path.chmod(0o000 if rights == "file" else 0o644)
        Path(name).chmod(0o000 if rights == "folder" else 0o755)
        words = command.replace("TRIP", str(sample / "trip_trondheim")).split()
        missing = Path(name).parent / "nowhere" / "twin.db"
        assert twin(*words, "--store", missing).code in {2, 4}  # loads what others may not be able to read
        with unprivileged():
            answer = twin(*words, "--store", path)
        Path(name).chmod(0o755)
    assert answer.code == 4
    assert answer.err.count("\n") == 1
    assert "give this user the right to read and write" in answer.err


@pytest.mark.parametrize(
    ("command", "code", "told"),
    [
        ("status", 0, ""),
        ("match", 4, "free some space; nothing was changed"),
        ("evaluate TRUTH --plots OUT", 5, "free space on the disk"),
    ],
)
def test_a_full_disk(command: str, code: int, told: str, sample: Path, store: Path, tmp_path: Path) -> None:
    """Where no file may grow, commands that read do; the others say it in one sentence."""
    words = command.replace("TRUTH", str(sample / "truth.csv")).replace("OUT", str(tmp_path / "out")).split()
    done = in_shell('ulimit -f 0; "$@"', *words, "--store", store)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert told in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux holds a process to its address space")
@pytest.mark.parametrize("megabytes", [60, 300])
def test_too_little_memory(megabytes: int, sample: Path, tmp_path: Path) -> None:
    """A small address space is told at once: OpenBLAS would try for minutes to get its memory."""
    command = ("ingest-drive", sample / "trip_trondheim", "--store", tmp_path / "twin.db")
    done = in_shell(f'ulimit -v {1024 * megabytes}; "$@"', *command)
    assert done.returncode == 6, done.stderr
    assert "twin: There is too little memory" in done.stderr
    assert not (tmp_path / "twin.db").exists()
