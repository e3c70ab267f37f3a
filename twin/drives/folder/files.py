"""The only door to a drive folder's files: safe names, a size cap, and the drive's id."""

from __future__ import annotations

import hashlib
import os
import unicodedata
from collections.abc import Collection
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import BinaryIO

from twin.errors import DriveError

MAX_FILE_BYTES = 500_000_000
"""Largest file that is read: a day of NMEA at 10 Hz or a million annotations stay far below it."""

MAX_RECORDING_BYTES = 200_000_000_000
"""Largest recording of all sensors that is read piece by piece: a day with pictures stays below it."""


class DriveFolder:
    """A folder whose files are read once, never from outside it, and remembered for the drive's id.

    Parameters
    ----------
    root : Path
        The folder. It must exist.

    Raises
    ------
    DriveError
        If `root` is not a folder, or cannot be listed.
    """

    def __init__(self, root: Path) -> None:
        if not root.exists():
            raise DriveError(f"{root} does not exist: give the folder that holds the drive.")
        if not root.is_dir():
            raise DriveError(f"{root} is a file: give the folder that holds the drive.")
        self.root = root
        self._digests: dict[str, bytes] = {}
        self._tracks: set[bytes] = set()
        try:
            self._names = tuple(sorted(entry.name for entry in root.iterdir() if entry.is_file()))
        except OSError as error:
            raise DriveError(f"{root} cannot be listed ({error.strerror}): check its permissions.") from error

    def names(self, *suffixes: str) -> list[str]:
        """Names of the files directly in the folder, sorted; only those with one of `suffixes` if given."""
        if not suffixes:
            return list(self._names)
        return [name for name in self._names if name.lower().endswith(suffixes)]

    def folders(self, inside: str = "") -> list[str]:
        """Names of the folders directly in the folder, or in one in it, which then stands before them.

        They are sorted; hidden, linked and locked ones are left out.
        """
        place = self._path(inside) if inside else self.root
        return sorted(
            f"{inside}/{entry.name}" if inside else entry.name
            for entry in place.iterdir()
            if entry.is_dir()
            and not entry.is_symlink()
            and not entry.name.startswith(".")
            and os.access(entry, os.R_OK | os.X_OK)
        )

    def has(self, name: str) -> bool:
        """Whether `name`, relative to the folder, is a file in it."""
        return self._path(name).is_file()

    def is_folder(self, name: str) -> bool:
        """Whether `name`, relative to the drive folder, is a folder in it."""
        return self._path(name).is_dir()

    def names_in(self, name: str, *suffixes: str) -> list[str]:
        """Names of the files directly in a folder of the drive folder, sorted, with that folder before them.

        Raises
        ------
        DriveError
            If it is absent, lies outside the drive folder, or cannot be listed.
        """
        path = self._path(name)
        if not path.is_dir():
            raise DriveError(
                f"{name} is not a folder in the drive folder {self.root}: add it, or correct its name."
            )
        try:
            files = sorted(entry.name for entry in path.iterdir() if entry.is_file())
        except OSError as error:
            raise self._unreadable(name, error) from error
        prefix = PurePosixPath(name.replace("\\", "/"))
        return [str(prefix / file) for file in files if not suffixes or file.lower().endswith(suffixes)]

    def open(self, name: str) -> BinaryIO:
        """Open a file of any size for reading piece by piece; a look does not enter the drive's id.

        Raises
        ------
        DriveError
            As :meth:`peek`, but for the size.
        """
        path = self._path(name)
        if not path.is_file():
            raise DriveError(f"{name} is not in the drive folder {self.root}: add it, or correct its name.")
        try:
            return path.open("rb")
        except OSError as error:
            raise self._unreadable(name, error) from error

    def found(self, name: str | None) -> str | None:
        """The file that a recorder called `name`, or None.

        Recorders write names as they saw them, sometimes with a folder of their own machine before them:
        where the whole name is not in the folder, its last part is tried.
        """
        if not name:
            return None
        last = PureWindowsPath(name).name
        if last and last in self._names:
            return last
        relative = PurePosixPath(name)
        inside = not relative.is_absolute() and ".." not in relative.parts
        return name if inside and self.has(name) else None

    def head(self, name: str, n_bytes: int = 65_536) -> bytes:
        """First bytes of a file, to see what it is; a look does not enter the drive's id."""
        try:
            with self._path(name).open("rb") as file:
                return file.read(n_bytes)
        except OSError as error:
            raise self._unreadable(name, error) from error

    def peek(self, name: str) -> bytes:
        """Whole content of a file without entering it in the drive's id.

        Raises
        ------
        DriveError
            If the file is absent, too large, unreadable, or outside the folder.
        """
        path = self._path(name)
        if not path.is_file():
            raise DriveError(f"{name} is not in the drive folder {self.root}: add it, or correct its name.")
        try:
            size = path.stat().st_size
            if size > MAX_FILE_BYTES:
                raise DriveError(
                    f"{name} is {size / 1e6:.0f} MB, more than the {MAX_FILE_BYTES / 1e6:.0f} MB that a drive"
                    " file may have: split it, or check that it is the right file."
                )
            return path.read_bytes()
        except OSError as error:
            raise self._unreadable(name, error) from error

    def content(self, name: str, *, track: bool = False) -> bytes:
        """Whole content of a file; the file becomes part of what the drive was read from.

        Parameters
        ----------
        name : str
        track : bool
            Whether it says where the car was (GNSS, poses): that is what makes it this drive and no other.

        Raises
        ------
        DriveError
            As :meth:`peek`.
        """
        content = self.peek(name)
        self._enter(name, hashlib.sha256(content).digest(), track=track)
        return content

    def entered(self) -> frozenset[str]:
        """Names of the files that the drive was read from so far."""
        return frozenset(self._digests)

    def enter(self, name: str, content: bytes) -> None:
        """Remember a file from outside the folder that the drive was read with."""
        self._enter(name, hashlib.sha256(content).digest(), track=False)

    def recording(self, name: str, *, track: bool = True) -> Path:
        """Path of a recording that its reader opens itself, piece by piece.

        It becomes part of what the drive was read from, and says where the car was (see :meth:`content`)
        unless `track` is false.

        Raises
        ------
        DriveError
            As :meth:`peek`; a recording may have `MAX_RECORDING_BYTES`.
        """
        self.open(name).close()  # absent, or outside the folder
        path = self._path(name)
        try:
            size = path.stat().st_size
            if size > MAX_RECORDING_BYTES:
                raise DriveError(
                    f"{name} is {size / 1e9:.0f} GB, more than the {MAX_RECORDING_BYTES / 1e9:.0f} GB that a"
                    " recording may have: cut out the topics that twin reads (GNSS, IMU)."
                )
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").digest()
        except OSError as error:
            raise self._unreadable(name, error) from error
        self._enter(name, digest, track=track)
        return path

    def beginning(self, name: str, n_bytes: int) -> bytes:
        """First bytes of a file that say where the car was, entered as such (see :meth:`content`)."""
        head = self.head(name, n_bytes)
        self._enter(name, hashlib.sha256(head).digest(), track=True)
        return head

    def drive_id(self) -> str:
        """First 12 hex digits of the SHA-256 over the content of the track files read so far.

        The car's track is what makes a drive: one that is annotated anew, calibrated anew, renamed, moved or
        laid out in another way stays the same drive.
        """
        return hashlib.sha256(b"".join(sorted(self._tracks))).hexdigest()[:12]

    def content_sha256(self, names: Collection[str] | None = None) -> str:
        """SHA-256 over name and content of every file read so far, or of some of them, as hex digits.

        Names are relative, in Unicode NFC and sorted: neither the folder's place and name nor the file
        system's way with accents changes it.
        """
        whole = hashlib.sha256()
        for name in sorted(self._digests if names is None else names):
            whole.update(name.encode() + b"\0" + self._digests[name])
        return whole.hexdigest()

    def _enter(self, name: str, digest: bytes, *, track: bool) -> None:
        """Remember a file that the drive was read from."""
        self._digests[unicodedata.normalize("NFC", PurePosixPath(name).as_posix())] = digest
        if track:
            self._tracks.add(digest)

    def _path(self, name: str) -> Path:
        """The file's path, refused where it leads out of the folder (``..``, absolute, a link outwards)."""
        if not _is_name(name):
            raise DriveError(
                f"{name[:80]!r} is no file name that twin can keep (not UTF-8, too long, or none): rename the"
                " file, or name a file inside the drive folder."
            )
        outside = Path(name).is_absolute() or PureWindowsPath(name).is_absolute()
        path = self.root / self._as_on_disk(name)
        try:
            outside = outside or not path.resolve().is_relative_to(self.root.resolve())
        except (OSError, RuntimeError) as error:  # a link that leads to itself
            raise DriveError(f"{name} cannot be followed to a file ({error}): replace the link.") from error
        if outside:
            raise DriveError(
                f"{name} lies outside the drive folder {self.root}, which is refused: copy the file into the"
                " folder and name it relative to the folder."
            )
        return path

    def _as_on_disk(self, name: str) -> str:
        """The same name with accents as the folder has them: composed or not, people cannot see which."""
        if name in self._names or name.isascii():
            return name
        same = unicodedata.normalize("NFC", name)
        return next((one for one in self._names if unicodedata.normalize("NFC", one) == same), name)

    def _unreadable(self, name: str, error: OSError) -> DriveError:
        return DriveError(f"{name} cannot be read ({error.strerror}): check its permissions.")


def _is_name(name: str) -> bool:
    """Whether file systems take a name: theirs have at most 255 bytes a part, and no NUL."""
    try:
        parts = [len(part.encode()) for part in name.replace("\\", "/").split("/")]
    except UnicodeEncodeError:
        return False
    return bool(name) and "\0" not in name and max(parts) <= 255 and sum(parts) <= 2000
