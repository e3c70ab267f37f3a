"""The store: old state or new state, and a clear sentence for everything else."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
import sqlalchemy as sa
from checkout import ROOT
from findings import finding
from store_rows import located

from twin.errors import StoreError
from twin.ingest.save import save_drive
from twin.matching.save import save_changes
from twin.store import schema
from twin.store.kinds import Method
from twin.store.records import Estimate
from twin.store.sqlite_file import sqlite_errors
from twin.store.store import Store


def estimate(name: str, method: Method = Method.SINGLE_FRAME) -> Estimate:
    """Make an estimate of the drive."""
    place = {"east_m": 1.0, "north_m": 2.0, "height_m": 3.0, "range_min_m": 4.0}
    return Estimate(
        drive_id="d",
        object=name,
        codes=(),
        covariance_m2=(0.01, 0.0, 0.01),
        cameras=("C1",),
        n_sightings=1,
        estimate_id=f"d:{name}:{method}",
        method=method,
        **place,
    )


def test_store_is_in_wal_mode(empty: Store) -> None:
    """A reader never waits for a writer: the file is in WAL mode."""
    with sqlite3.connect(empty.path) as raw:
        assert raw.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    raw.close()


def test_store_missing_is_said_with_its_cure(tmp_path: Path) -> None:
    """A command that only reads names the missing file and what to run."""
    with pytest.raises(StoreError, match=r"no\.db: run `twin sync-nvdb`"):
        Store.open(tmp_path / "no.db", create=False)
    assert not (tmp_path / "no.db").exists()


def test_store_of_a_newer_version_is_refused_untouched(tmp_path: Path) -> None:
    """What a newer twin wrote is not guessed at, and not a byte of it changes."""
    path = tmp_path / "twin.db"
    with Store.open(path) as opened, opened.transaction() as connection:
        connection.execute(sa.update(schema.meta).values(value=str(schema.VERSION + 1)))
    before = path.read_bytes()
    with pytest.raises(StoreError, match="newer twin"):
        Store.open(path)
    assert path.read_bytes() == before


def test_store_that_is_no_store_is_refused(tmp_path: Path) -> None:
    """A text file, another database and a folder are each refused in one sentence."""
    text = tmp_path / "text.db"
    text.write_text("this is no database, and it is long enough to be read as one" * 20)
    with pytest.raises(StoreError, match="not a twin store"):
        Store.open(text)
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as raw:
        raw.execute("CREATE TABLE something (a)")
    raw.close()
    with pytest.raises(StoreError, match="not a twin store"):
        Store.open(other)
    with pytest.raises(StoreError, match="could not be used"):
        Store.open(tmp_path)


def test_store_in_a_missing_folder_is_said(tmp_path: Path) -> None:
    """A store is not made in a folder that is not there."""
    with pytest.raises(StoreError, match="folder of the store"):
        Store.open(tmp_path / "nowhere" / "twin.db")


def test_transaction_rolls_back_on_any_exception(either: Store) -> None:
    """An exception in the middle leaves the old state."""
    save_changes(either, [finding("a")], {}, {"method": "m"})

    def fail_halfway() -> None:
        with either.transaction() as connection:
            connection.execute(sa.delete(schema.change))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_halfway()
    assert either.count(schema.change) == 1


def test_revision_counts_drives_but_not_matches(either: Store) -> None:
    """A match belongs to the revision it was made from: a drive that comes later makes it stale.

    The same drive with the same results does not.
    """
    save_drive(either, located(estimates=[estimate("1")]))
    save_changes(either, [finding("a")], {}, {"method": "m"})
    last = either.fact("last_match")
    assert last is not None
    assert last["revision"] == either.revision()
    save_drive(either, located(estimates=[estimate("1")]))
    assert last["revision"] == either.revision()
    save_drive(either, located(estimates=[estimate("1"), estimate("2")]))
    assert last["revision"] != either.revision()


def test_snapshot_sees_one_state(either: Store) -> None:
    """What is written while a snapshot is open is not in it."""
    save_changes(either, [finding("a")], {}, {"method": "m"})
    with either.snapshot() as view:
        before = view.rows(sa.select(schema.change.c.change_id))
        save_changes(either, [finding("b")], {}, {"method": "m"})
        assert view.rows(sa.select(schema.change.c.change_id)) == before == [{"change_id": "a"}]


def test_save_drive_twice_doubles_nothing(either: Store) -> None:
    """The same drive by the same method replaces itself; another method stands beside it."""
    save_drive(either, located(estimates=[estimate("1"), estimate("2")]))
    save_drive(either, located(estimates=[estimate("1")]))
    save_drive(either, located("paper", [estimate("1", Method.PAPER)]))
    assert either.count(schema.drive) == 1
    assert either.count(schema.estimate) == 2
    assert either.methods() == ["paper", "single-frame"]


def test_save_drive_of_changed_files_forgets_other_methods(either: Store) -> None:
    """A drive that was annotated anew does not keep estimates from its old annotations."""
    save_drive(either, located("paper", [estimate("1", Method.PAPER)], content_sha256="1"))
    save_drive(either, located(estimates=[estimate("1")], content_sha256="2"))
    assert either.methods() == ["single-frame"]


def test_store_locked_by_another_process_is_said(empty: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second writer is told that another one is at work."""
    monkeypatch.setattr("twin.store.sqlite_file._BUSY_TIMEOUT_S", 0.05)
    with Store.open(empty.path) as second:
        raw = sqlite3.connect(empty.path, isolation_level=None)
        raw.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match="another process is writing"):
            save_changes(second, [finding("a")], {}, {"method": "m"})
        raw.execute("ROLLBACK")
        raw.close()
    assert empty.count(schema.change) == 0


@pytest.mark.parametrize(
    ("code", "cure"),
    [
        (sqlite3.SQLITE_BUSY_SNAPSHOT, "another process is writing"),
        (sqlite3.SQLITE_READONLY_DIRECTORY, r"twin\.db cannot be written: give this user the right"),
        (sqlite3.SQLITE_IOERR_WRITE, "free some space"),
        (sqlite3.SQLITE_CORRUPT_INDEX, "not a twin store"),
        (sqlite3.SQLITE_MISMATCH, "nothing was changed"),
    ],
)
def test_cure_follows_from_the_code_of_sqlite_whatever_it_says(tmp_path: Path, code: int, cure: str) -> None:
    """Another SQLite may word its messages otherwise: no cure hangs on them."""
    cause = sqlite3.OperationalError("the sky is locked, full and readonly")
    cause.sqlite_errorcode = code
    with pytest.raises(StoreError, match=cure), sqlite_errors(tmp_path / "twin.db"):
        raise sa.exc.OperationalError("SELECT 1", None, cause)


_WRITER = """
import sys
sys.path.insert(0, sys.argv[2])
from twin.matching.save import save_changes
from twin.store.store import Store
from findings import finding
store = Store.open(sys.argv[1])
print("ready", flush=True)
n = 0
while True:
    n += 1
    save_changes(store, [finding(f"{n}-{i}") for i in range(200)], {}, {"method": str(n)})
"""


@pytest.mark.parametrize("written", [3, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 7))])
def test_store_survives_sigkill_in_the_middle_of_writing(address: str, written: int) -> None:
    """A writer killed at any instant leaves 200 findings of one and the same match, never a mixture."""
    Store.open(address).close()
    with subprocess.Popen(
        [sys.executable, "-c", _WRITER, address, str(ROOT / "tests")], stdout=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            with Store.open(address) as watcher:
                # Wait for states, not for time; then kill wherever the writer happens to be.
                while int((watcher.fact("last_match") or {"method": 0})["method"]) < written:
                    assert process.poll() is None, "the writer ended by itself"
        finally:
            process.kill()
    with Store.open(address) as store:
        last = store.fact("last_match")
        assert last is not None
        ids = [row["change_id"] for row in store.rows(sa.select(schema.change.c.change_id))]
    assert len(ids) == 200
    assert {i.split("-")[0] for i in ids} == {last["method"]}
