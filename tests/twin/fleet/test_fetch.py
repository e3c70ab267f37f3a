"""Drives in shared and object storage: fetched whole, told what is lacking, and gone afterwards."""

from __future__ import annotations

import functools
import hashlib
import http.server
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest

from twin.errors import ConfigError, FetchError, StorageError
from twin.fleet.fetch import SUMS, Source, drives_at
from twin.fleet.work_folders import work_folder

FILES = {"drive.toml": b"name = 'a'\n", "labels/1.txt": b"0 0.5 0.5 0.1 0.1\n", "gnss.nmea": b"$GPGGA" * 99}


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Attempts follow each other at once; work folders are this test's."""
    monkeypatch.setattr("tenacity.nap.time.sleep", lambda _s: None)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


@pytest.fixture
def memory() -> Iterator[Any]:
    """Object storage in this process, with a drive and its sums."""
    system = fsspec.filesystem("memory")
    put(system, FILES)
    yield system
    system.store.clear()


def sums(files: dict[str, bytes]) -> bytes:
    """Write the sums as ``sha256sum`` does."""
    return "".join(f"{hashlib.sha256(c).hexdigest()}  ./{name}\n" for name, c in files.items()).encode()


def put(system: Any, files: dict[str, bytes]) -> None:
    """Put files and sums of all into a drive of the storage."""
    system.pipe({f"/drives/a/{name}": content for name, content in {**files, SUMS: sums(FILES)}.items()})


def read(folder: Path) -> dict[str, bytes]:
    """Read a folder's files."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_drive_is_fetched_whole_and_gone_afterwards(memory: Any, tmp_path: Path) -> None:
    """Every file that the sums name, in a folder called as the drive; nothing of it stays."""
    del memory
    source = Source("memory://drives/a")
    with source.fetched() as folder:
        assert (folder.name, read(folder)) == ("a", FILES)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"gnss.nmea": FILES["gnss.nmea"][:-7]}, r"gnss\.nmea is cut off or damaged"),
        ({"labels/1.txt": b"1 0.5 0.5 0.1 0.1\n"}, r"labels/1\.txt is cut off or damaged"),
        ({"labels/1.txt": None}, r"labels/1\.txt is lacking"),
        ({SUMS: b"nonsense\n"}, "none of sha256sum's"),
        ({SUMS: b"0" * 64 + b"  ../../etc/passwd\n"}, "outside the drive"),
    ],
)
def test_what_is_not_whole_is_named(
    memory: Any, tmp_path: Path, files: dict[str, bytes | None], said: str
) -> None:
    """One sentence with the file's name, and nothing is left on the disk."""
    memory.pipe({f"/drives/a/{name}": content for name, content in files.items() if content is not None})
    for name in (name for name, content in files.items() if content is None):
        memory.rm(f"/drives/a/{name}")
    with pytest.raises(FetchError, match=said), Source("memory://drives/a").fetched():
        pytest.fail("it was given")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


def test_fingerprint_changes_with_the_files_and_with_nothing_else(memory: Any) -> None:
    """By the sums, or by what the storage says of each file."""
    before = Source("memory://drives/a").fingerprint()
    put(memory, FILES)
    assert Source("memory://drives/a").fingerprint() == before
    memory.pipe(f"/drives/a/{SUMS}", sums({**FILES, "gnss.nmea": b""}))
    assert Source("memory://drives/a").fingerprint() != before
    memory.rm(f"/drives/a/{SUMS}")
    unsummed = Source("memory://drives/a").fingerprint()
    time.sleep(0.001)
    memory.pipe("/drives/a/gnss.nmea", b"others")
    assert Source("memory://drives/a").fingerprint() != unsummed


def test_pattern_stands_for_folders(memory: Any, tmp_path: Path) -> None:
    """``*`` finds the drives below, in storage as on this machine; a pattern that fits nothing is told."""
    memory.pipe("/drives/b/x", b"")
    memory.pipe("/drives/notes.txt", b"")
    assert drives_at("memory://drives/*") == ["memory:///drives/a", "memory:///drives/b"]
    (tmp_path / "trips" / "c").mkdir(parents=True)
    assert drives_at(f"{tmp_path}/trips/*") == [f"{tmp_path}/trips/c"]
    with pytest.raises(FetchError, match="No folder fits"):
        drives_at("memory://elsewhere/*")


@pytest.mark.parametrize(
    ("address", "error", "said"),
    [
        ("memory://drives/nothing", FetchError, "There is no drive at"),
        ("nowhere://drives/a", ConfigError, "Protocol not known"),
        ("s3://drives/a", ConfigError, "Install s3fs"),
        ("https://me:secret@host/a", ConfigError, "password"),
        ("http://127.0.0.1:1/a", StorageError, "cannot be read now"),
    ],
)
def test_wrong_address_is_told(address: str, error: type[Exception], said: str) -> None:
    """Nothing there, no such storage, no library, a password in it, no server: each has its sentence."""
    with pytest.raises(error, match=said) as told:
        Source(address)
    assert "secret" not in str(told.value)


class _Quiet(http.server.SimpleHTTPRequestHandler):
    """A web server's folder; one file ends before it is whole."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def copyfile(self, source: Any, outputfile: Any) -> None:
        """Send a file, but of one only the half."""
        outputfile.write(source.read() if "gnss" not in self.path else source.read()[:100])


def test_web_server_that_breaks_off_is_told(tmp_path: Path) -> None:
    """Over HTTP the sums list the files; a transfer that ends early fails after three attempts."""
    for name, content in {**FILES, SUMS: sums(FILES)}.items():
        (tmp_path / "web" / "a" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "web" / "a" / name).write_bytes(content)
    handler = functools.partial(_Quiet, directory=str(tmp_path / "web"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/a"
        with pytest.raises(StorageError, match="cannot be read now"), Source(address).fetched():
            pytest.fail("it was given")
        with Source(address, leave_out=["gnss*"]).fetched() as folder:
            assert read(folder) == {k: v for k, v in FILES.items() if k != "gnss.nmea"}
        server.shutdown()


def test_folder_of_a_killed_process_goes_with_the_next(tmp_path: Path) -> None:
    """A folder whose lock nobody holds is removed; one in use stays."""
    with work_folder() as used:
        left = used.with_name("left")
        left.mkdir()
        (left / "video.h264").write_bytes(b"1")
        lock = left.with_suffix(".lock")
        lock.touch()
        for path in (lock, used.with_suffix(".lock")):
            os.utime(path, (0, 0))
        with work_folder():
            assert not left.exists()
            assert not lock.exists()
            assert used.exists()
