"""Replacing files: what is old or new when a rename fails, and exports that begin while another one ends."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from twin.errors import ExportRefusedError
from twin.store.atomic_files import STAGING, replace_file, replacing

NAMES = ("a", "b", "c")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder that holds the old files."""
    for name in NAMES:
        (tmp_path / name).write_text(f"old {name}")
    return tmp_path


def _write(staging: Path) -> None:
    for name in NAMES:
        (staging / name).write_text(f"new {name}")


def _texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def _replace(folder: Path) -> None:
    with replacing(folder, NAMES) as staging:
        _write(staging)


def _no_links(monkeypatch: pytest.MonkeyPatch) -> None:
    def link(*_: object) -> None:
        raise PermissionError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", link)


def _fail_replace(monkeypatch: pytest.MonkeyPatch, *numbers: int) -> None:
    """Let the calls of os.replace with these numbers, counted from 1, fail."""
    real, calls = os.replace, [0]

    def replace(source: Path, target: Path) -> None:
        calls[0] += 1
        if calls[0] in numbers:
            raise PermissionError(errno.EACCES, "the file is in use")
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)


def test_replacing_without_hard_links_keeps_the_new_file_when_a_later_rename_fails(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a way back the file already replaced stays new and whole, and the message says which it is."""
    _no_links(monkeypatch)
    _fail_replace(monkeypatch, 2)
    with pytest.raises(
        ExportRefusedError, match=r"cannot replace .*b: the file is in use; .* a is already new, b and c as"
    ):
        _replace(folder)
    assert _texts(folder) == {"a": "new a", "b": "old b", "c": "old c"}


def test_replacing_says_which_files_stay_new_when_one_cannot_be_taken_back(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third rename fails, and so does taking back the first: only that one is new, and it is named."""
    _fail_replace(monkeypatch, 3, 4)
    with pytest.raises(ExportRefusedError, match=r"a is already new, b and c as before"):
        _replace(folder)
    assert _texts(folder) == {"a": "new a", "b": "old b", "c": "old c"}


def test_replacing_in_a_new_folder_keeps_what_arrived(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is no old file to go back to, whole new ones stay and are named."""
    _fail_replace(monkeypatch, 3)
    with pytest.raises(ExportRefusedError, match=r"a and b are already new, c as before"):
        _replace(tmp_path)
    assert _texts(tmp_path) == {"a": "new a", "b": "new b"}


def test_replacing_takes_back_every_file_where_it_can(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With hard links a failing third rename leaves all as it was, and the system's own error comes out."""
    _fail_replace(monkeypatch, 3)
    with pytest.raises(PermissionError, match="the file is in use"):
        _replace(folder)
    assert _texts(folder) == {name: f"old {name}" for name in NAMES}


@pytest.mark.skipif(os.name == "nt", reason="Windows has no flush of folders")
def test_replacing_where_folders_cannot_be_flushed_succeeds(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file system that cannot flush a folder, as some on a network, does not make a success a failure."""
    real = os.open

    def no_folders(path: Any, flags: int, *rest: Any, **more: Any) -> int:
        if Path(path) == folder:
            raise OSError(errno.EINVAL, "not on this file system")
        return real(path, flags, *rest, **more)

    monkeypatch.setattr(os, "open", no_folders)
    _replace(folder)
    assert _texts(folder) == {name: f"new {name}" for name in NAMES}


def _once_around(
    monkeypatch: pytest.MonkeyPatch, method: str, name: str, when: str, happens: Callable[[], None]
) -> None:
    """Let something happen before or after the first call of a method of Path on a file of this name."""
    real, done = getattr(Path, method), [False]

    def call(path: Path, *rest: Any, **more: Any) -> Any:
        now = path.name == name and not done[0]
        done[0] = done[0] or now
        if now and when == "before":
            happens()
        result = real(path, *rest, **more)
        if now and when == "after":
            happens()
        return result

    monkeypatch.setattr(Path, method, call)


@pytest.mark.parametrize("when", ["before", "after"])
def test_export_that_begins_while_another_ends_has_a_lock_that_holds(
    folder: Path, monkeypatch: pytest.MonkeyPatch, when: str
) -> None:
    """Where the other removes folder and lock at any moment of locking, the newcomer makes them again."""
    first = ExitStack()
    _write(first.enter_context(replacing(folder, NAMES)))
    _once_around(monkeypatch, "open", "lock", when, first.close)
    with replacing(folder, NAMES) as staging:
        assert {path.name for path in staging.iterdir()} == {"lock"}
        with pytest.raises(ExportRefusedError, match="another export is writing"), replacing(folder, NAMES):
            pass
        for name in NAMES:
            (staging / name).write_text(f"newer {name}")
    assert _texts(folder) == {name: f"newer {name}" for name in NAMES}


def test_export_that_locked_a_removed_file_does_not_believe_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One export ends and another begins between a newcomer's opening and locking: it is refused."""
    first, second = ExitStack(), ExitStack()
    _write(first.enter_context(replacing(folder, NAMES)))

    def change_hands() -> None:
        first.close()
        _write(second.enter_context(replacing(folder, NAMES)))

    _once_around(monkeypatch, "open", "lock", "after", change_hands)
    with pytest.raises(ExportRefusedError, match="another export is writing"):
        _replace(folder)
    second.close()
    assert _texts(folder) == {name: f"new {name}" for name in NAMES}


@pytest.mark.parametrize(
    ("method", "name", "when"),
    [("unlink", "lock", "after"), ("rmdir", STAGING, "before"), ("rmdir", STAGING, "after")],
)
def test_export_that_ends_leaves_a_newcomer_its_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch, method: str, name: str, when: str
) -> None:
    """An export that begins while another removes lock and folder writes its files undisturbed."""
    with ExitStack() as newcomer:
        begun: list[Path] = []
        _once_around(
            monkeypatch,
            method,
            name,
            when,
            lambda: begun.append(newcomer.enter_context(replacing(folder, NAMES))),
        )
        _replace(folder)
        assert len(begun) == 1
        with pytest.raises(ExportRefusedError, match="another export is writing"):
            _replace(folder)
        for file in NAMES:
            assert (folder / file).read_text() == f"new {file}"
            (begun[0] / file).write_text(f"newer {file}")
    assert _texts(folder) == {file: f"newer {file}" for file in NAMES}


@pytest.mark.skipif(os.name == "nt", reason="Windows gives the lock free before it is removed")
def test_export_that_still_cleans_up_keeps_a_newcomer_out(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The staging folder is emptied, and the lock removed, while the lock is held."""
    refused: list[set[str]] = []

    def begin() -> None:
        with pytest.raises(ExportRefusedError, match="another export is writing"):
            _replace(folder)
        refused.append({path.name for path in (folder / STAGING).iterdir()})

    _once_around(monkeypatch, "unlink", "lock", "before", begin)
    _replace(folder)
    assert refused == [{"lock"}]
    assert _texts(folder) == {name: f"new {name}" for name in NAMES}


def test_export_that_always_loses_its_folder_gives_up(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where every lock vanishes at once the export is refused after some attempts."""
    real = Path.open

    def vanishing(path: Path, *rest: Any) -> Any:
        file = real(path, *rest)
        path.unlink()
        return file

    monkeypatch.setattr(Path, "open", vanishing)
    with pytest.raises(ExportRefusedError, match="other exports keep writing"):
        _replace(folder)
    monkeypatch.undo()
    assert all((folder / name).read_text() == f"old {name}" for name in NAMES)


def test_pipe_is_written_into_and_stays(tmp_path: Path) -> None:
    """What is no regular file is not replaced by one."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        replace_file(pipe, b"a,b\n")
        assert os.read(reader, 100) == b"a,b\n"
    finally:
        os.close(reader)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
