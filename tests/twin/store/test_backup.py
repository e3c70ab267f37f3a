"""A store copied and put back: whole with its pictures, or not at all."""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from command_line import Twin

from twin.store.store import Store

WRITER = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1])
database.execute("PRAGMA wal_autocheckpoint=0")
database.execute("INSERT OR REPLACE INTO meta VALUES ('later', 'yes')")
database.commit()
os._exit(0)
"""
"""A process that ends as if killed: what it wrote stands in the log beside the store."""


def facts(path: Path) -> set[str]:
    """Keys of what a whole store knows of itself."""
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        return {key for (key,) in database.execute("SELECT key FROM meta")}


def add_picture(store: Path, content: bytes) -> Path:
    """Keep a crop of this content, row and file; return its file."""
    sha256 = hashlib.sha256(content).hexdigest()
    with closing(sqlite3.connect(store)) as database:
        columns = database.execute("PRAGMA table_info(crop)").fetchall()
        told = {"sha256": sha256, "change_id": sha256}
        values = [
            told.get(name, "x" if "CHAR" in kind or kind == "TEXT" else 1) for _, name, kind, *_ in columns
        ]
        marks = ", ".join("?" * len(values))
        database.execute(f"INSERT INTO crop VALUES ({marks})", values)
        database.commit()
    path = store.with_name(f"{store.name}.evidence") / sha256[:2] / f"{sha256}.webp"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A store of a folder of its own."""
    path = tmp_path / "at_work" / "twin.db"
    path.parent.mkdir()
    Store.open(path).close()
    return path


def killed_writer(store: Path) -> None:
    """Leave a change in the store's log."""
    subprocess.run([sys.executable, "-c", WRITER, store], check=True)
    assert store.with_name("twin.db-wal").stat().st_size


def test_restore_takes_a_leftover_log_away_from_the_new_store(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """The log of the old store is not replayed into the new one; what it held is kept with the old one."""
    copy = tmp_path / "copy.db"
    assert twin("backup", copy, "--store", mine).code == 0
    killed_writer(mine)
    answer = twin("restore", copy, "--store", mine)
    assert (answer.code, "twin.db.before-restore" in answer.err) == (0, True)
    assert "later" not in facts(mine)
    assert "later" in facts(mine.with_name("twin.db.before-restore"))
    assert not mine.with_name("twin.db-wal").exists()


def test_restore_where_only_the_log_is_left(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """A log without its store is no part of the next one."""
    copy = tmp_path / "copy.db"
    twin("backup", copy, "--store", mine)
    killed_writer(mine)
    mine.unlink()
    assert twin("restore", copy, "--store", mine).code == 0
    assert "later" not in facts(mine)


def test_backup_has_what_stands_in_the_log(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """The last changes too, which a plain copy of the file would miss."""
    killed_writer(mine)
    twin("backup", tmp_path / "copy.db", "--store", mine)
    assert "later" in facts(tmp_path / "copy.db")


def test_pictures_come_along_and_go(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """A second night has the pictures of that night in the same folder; a restore sets those of now aside."""
    first, copy = add_picture(mine, b"first"), tmp_path / "copy.db"
    assert "pictures (1)" in twin("backup", copy, "--store", mine).err
    second = add_picture(mine, b"second")
    with closing(sqlite3.connect(mine)) as database:
        database.execute("DELETE FROM crop WHERE sha256 = ?", [first.stem])
        database.commit()
    twin("backup", copy, "--store", mine)
    assert [path.read_bytes() for path in tmp_path.glob("copy.db.evidence/**/*.webp")] == [b"second"]
    second.unlink()
    assert "without a file: 1" in twin("backup", tmp_path / "b", "--store", mine).err
    assert twin("restore", copy, "--store", mine).code == 0
    assert second.read_bytes() == b"second"
    assert not first.exists()
    assert (mine.with_name("twin.db.before-restore.evidence") / first.parent.name / first.name).exists()


def test_backup_without_a_whole_store_leaves_the_former_copy(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """A store that is gone or damaged does not wipe the last good copy."""
    copy = tmp_path / "copy.db"
    twin("backup", copy, "--store", mine)
    before = copy.read_bytes()
    with closing(sqlite3.connect(mine)) as database:
        database.execute("PRAGMA journal_mode=DELETE")
    mine.write_bytes(mine.read_bytes()[:4096] + b"\x5a" * 40960)
    assert (twin("backup", copy, "--store", mine).code, copy.read_bytes()) == (4, before)
    mine.unlink()
    assert (twin("backup", copy, "--store", mine).code, copy.read_bytes()) == (4, before)
    assert twin("backup", tmp_path / "not mounted" / "c.db", "--store", copy).code == 4
    (tmp_path / "notes.txt").write_text("mine")
    assert twin("backup", tmp_path / "notes.txt", "--store", copy).code == 5
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_refused_restore_changes_nothing(twin: Twin, mine: Path, tmp_path: Path) -> None:
    """Not while somebody has the store open, nor over what an earlier restore has set aside."""
    copy = tmp_path / "copy.db"
    twin("backup", copy, "--store", mine)
    with Store(mine) as opened:
        opened.revision()
        answer = twin("restore", copy, "--store", mine)
        assert (answer.code, "has the store" in answer.err) == (5, True)
    assert twin("restore", copy, "--store", mine).code == 0
    killed_writer(mine)
    answer = twin("restore", copy, "--store", mine)
    assert (answer.code, "earlier restore" in answer.err) == (5, True)
    assert "later" in facts(mine)
    assert twin("restore", tmp_path / "none.db", "--store", mine).code == 4


def test_restore_that_fails_between_renames_puts_the_old_store_back(
    twin: Twin, mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last rename fails: store, log and pictures are as they were."""
    picture, copy = add_picture(mine, b"kept"), tmp_path / "copy.db"
    twin("backup", copy, "--store", mine)
    killed_writer(mine)
    rename = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.parent.name == "twin.db.restoring" and target == mine:
            raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    assert twin("restore", copy, "--store", mine).code == 4
    assert ("later" in facts(mine), picture.read_bytes()) == (True, b"kept")
    assert sorted(path.name for path in mine.parent.glob("*before*")) == []
