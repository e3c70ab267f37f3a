"""The door to a drive folder's files."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from twin.drives.folder import files as folder_module
from twin.drives.folder.files import DriveFolder
from twin.errors import DriveError


def test_content_sha256_is_the_hash_of_names_and_contents(tmp_path: Path, maker: Any) -> None:
    """It can be computed by hand: SHA-256 over sorted names, each with the SHA-256 of its content."""
    folder = DriveFolder(maker.write(tmp_path, {"b.txt": "two", "a.txt": "one", "unread.txt": "x"}))
    folder.content("b.txt")
    folder.content("a.txt")
    folder.peek("unread.txt")
    whole = b"a.txt\0" + hashlib.sha256(b"one").digest() + b"b.txt\0" + hashlib.sha256(b"two").digest()
    assert folder.content_sha256() == hashlib.sha256(whole).hexdigest()


def test_drive_id_is_the_hash_of_the_track_alone(tmp_path: Path, maker: Any) -> None:
    """The GNSS files decide, whatever their names and whatever else is read."""
    folder = DriveFolder(maker.write(tmp_path / "a", {"gnss": "one", "notes.xml": "x"}))
    other = DriveFolder(maker.write(tmp_path / "b", {"gnss.nmea": "one", "notes.xml": "y"}))
    for drive, name in ((folder, "gnss"), (other, "gnss.nmea")):
        drive.content(name, track=True)
        drive.content("notes.xml")
    digest = hashlib.sha256(b"one").digest()
    assert folder.drive_id() == other.drive_id() == hashlib.sha256(digest).hexdigest()[:12]
    assert folder.content_sha256() != other.content_sha256()


@pytest.mark.parametrize("name", ["../secret.txt", "/etc/hostname", "sub/../../secret.txt", "C:\\secret.txt"])
def test_file_outside_the_folder_is_refused(tmp_path: Path, maker: Any, name: str) -> None:
    """Neither a relative nor an absolute name leads out."""
    maker.write(tmp_path, {"secret.txt": "s", "drive/a": "1", "drive/sub/b": "2"})
    with pytest.raises(DriveError, match="outside the drive folder"):
        DriveFolder(tmp_path / "drive").content(name)


def test_file_inside_a_subfolder_is_read(tmp_path: Path, maker: Any) -> None:
    """A name with folders in it is fine as long as it stays inside."""
    folder = DriveFolder(maker.write(tmp_path, {"sub/b": "2"}))
    assert folder.content("sub/b") == b"2"
    assert folder.content("sub/../sub/b") == b"2"


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights on Windows")
def test_link_out_of_the_folder_is_refused(tmp_path: Path, maker: Any) -> None:
    """A link to a file elsewhere is not followed, nor one to itself."""
    maker.write(tmp_path, {"secret.txt": "s", "drive/a": "1"})
    (tmp_path / "drive" / "link").symlink_to(tmp_path / "secret.txt")
    (tmp_path / "drive" / "loop").symlink_to(tmp_path / "drive" / "loop")
    folder = DriveFolder(tmp_path / "drive")
    with pytest.raises(DriveError, match="link lies outside"):
        folder.content("link")
    with pytest.raises(DriveError, match="loop"):
        folder.content("loop")


def test_file_that_is_absent_or_too_large_is_refused_by_name(
    tmp_path: Path, maker: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both errors name the file."""
    monkeypatch.setattr(folder_module, "MAX_FILE_BYTES", 10)
    folder = DriveFolder(maker.write(tmp_path, {"big.xml": "x" * 11}))
    with pytest.raises(DriveError, match=r"big\.xml is .* MB, more than"):
        folder.content("big.xml")
    with pytest.raises(DriveError, match=r"gone\.xml is not in the drive folder"):
        folder.content("gone.xml")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may read anything")
def test_file_without_permission_is_refused_by_name(tmp_path: Path, maker: Any) -> None:
    """The error says to check permissions."""
    folder = DriveFolder(maker.write(tmp_path, {"a": "1"}))
    (tmp_path / "a").chmod(0)
    with pytest.raises(DriveError, match=r"a cannot be read .* permissions"):
        folder.content("a")


def test_folder_that_is_absent_or_a_file_is_refused(tmp_path: Path, maker: Any) -> None:
    """The error says to give the folder that holds the drive."""
    maker.write(tmp_path, {"file": "1"})
    for name in ("file", "nowhere"):
        with pytest.raises(DriveError, match="give the folder that holds the drive"):
            DriveFolder(tmp_path / name)


def test_recorded_name_with_a_foreign_folder_finds_the_file(tmp_path: Path, maker: Any) -> None:
    """Recorders write absolute names of their own machine: the last part is looked for."""
    folder = DriveFolder(maker.write(tmp_path, {"gnss.bin": "1", "sub/t": "2"}))
    assert folder.found("/data/trip087/gnss.bin") == "gnss.bin"
    assert folder.found("D:\\trips\\gnss.bin") == "gnss.bin"
    assert folder.found("sub/t") == "sub/t"
    assert folder.found("../gnss2.bin") is None
    assert folder.found("other.bin") is None
    assert folder.found(None) is None
