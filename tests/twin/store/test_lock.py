"""The lock of a sync: one process at a time, and the second is told who holds it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from twin.errors import FileError, RefusedError
from twin.store.lock import exclusive

HOLDER = """
import sys
from pathlib import Path
from twin.store.lock import exclusive

with exclusive(Path(sys.argv[1]), "sync of twin.db"):
    sys.stdout.write("held\\n")
    sys.stdout.flush()
    sys.stdin.read()
"""


def hold(path: Path) -> subprocess.Popen[str]:
    """Another process that holds the lock until its input ends."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_lock_tells_the_second_process_who_holds_it(tmp_path: Path) -> None:
    """The refusal names what is at work, its process and since when; afterwards the lock is free."""
    path = tmp_path / "twin.db.sync-lock"
    with hold(path) as process:
        with pytest.raises(RefusedError) as refused, exclusive(path, "sync of twin.db"):
            pytest.fail("the lock was given twice")
        assert re.fullmatch(
            rf"A sync of twin\.db \(process {process.pid} on \S+, since \d{{4}}-\d\d-\d\dT[\d:]+Z\) "
            r"is at work: wait until it has ended, then run this again\.",
            str(refused.value),
        )
        process.communicate("")
    with exclusive(path, "sync of twin.db"):
        assert str(os.getpid()) in path.read_text()
    assert path.read_text() == ""


def test_lock_ends_with_a_killed_process(tmp_path: Path) -> None:
    """What a killed process wrote into the file does not hold anybody up."""
    path = tmp_path / "twin.db.sync-lock"
    with hold(path) as process:
        process.kill()
        process.communicate()
    assert "sync of twin.db" in path.read_text()
    with exclusive(path, "sync of twin.db"):
        assert str(os.getpid()) in path.read_text()


def test_lock_is_free_after_an_error(tmp_path: Path) -> None:
    """An error inside the block frees the lock too, and the lock of one file is not that of another."""
    path = tmp_path / "a.sync-lock"
    with pytest.raises(KeyError), exclusive(path, "sync of a"):
        raise KeyError
    with (
        exclusive(path, "sync of a"),
        exclusive(tmp_path / "b.sync-lock", "sync of b"),
        pytest.raises(RefusedError, match="A sync of a "),
        exclusive(path, "sync of a"),
    ):
        pytest.fail("the lock was given twice")


def test_lock_file_that_cannot_be_made_names_the_cure(tmp_path: Path) -> None:
    """A folder in which nothing can be written is refused with one sentence."""
    with (
        pytest.raises(FileError, match=r"lock file .* cannot be written \(.*\): give this user the right"),
        exclusive(tmp_path / "absent" / "a.sync-lock", "sync of a"),
    ):
        pytest.fail("there is no such folder")


def test_lock_file_of_another_user_names_the_owner(tmp_path: Path) -> None:
    """A lock file that is there and cannot be written (here a folder) is named with whose it is."""
    path = tmp_path / "a.sync-lock"
    path.mkdir()
    whose = rf"lock file .*a\.sync-lock cannot be written \(.*\): it belongs to {path.owner()}; run this as"
    with pytest.raises(FileError, match=whose), exclusive(path, "sync of a"):
        pytest.fail("a folder is no lock file")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
def test_lock_file_on_a_full_disk_is_named(tmp_path: Path) -> None:
    """Where it opens and takes no byte, the sentence says which file and what helps."""
    path = tmp_path / "a.sync-lock"
    limited = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)){HOLDER}"
    done = subprocess.run(
        [sys.executable, "-c", limited, path], capture_output=True, text=True, check=False, input=""
    )
    assert f"FileError: The lock file {path} cannot be written (File too large): free space" in done.stderr
    assert done.stdout == ""
