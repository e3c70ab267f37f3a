"""The only door to a drive folder's files: safe names, a size cap, and the drive's id."""

from __future__ import annotations

import hashlib
import unicodedata
from pathlib import Path, PurePosixPath, PureWindowsPath

from twin.errors import DriveError

MAX_FILE_BYTES = 500_000_000
"""Largest file that is read: a day of NMEA at 10 Hz or a million annotations stay far below it."""


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

    def has(self, name: str) -> bool:
        """Whether `name`, relative to the folder, is a file in it."""
        return self._path(name).is_file()

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
        key = unicodedata.normalize("NFC", PurePosixPath(name).as_posix())
        self._digests[key] = hashlib.sha256(content).digest()
        if track:
            self._tracks.add(self._digests[key])
        return content

    def drive_id(self) -> str:
        """First 12 hex digits of the SHA-256 over the content of the track files read so far.

        The car's track is what makes a drive: one that is annotated anew, calibrated anew, renamed, moved or
        laid out in another way stays the same drive.
        """
        return hashlib.sha256(b"".join(sorted(self._tracks))).hexdigest()[:12]

    def content_sha256(self) -> str:
        """SHA-256 over name and content of every file read so far, as hex digits.

        Names are relative, in Unicode NFC and sorted: neither the folder's place and name nor the file
        system's way with accents changes it.
        """
        whole = hashlib.sha256()
        for name in sorted(self._digests):
            whole.update(name.encode() + b"\0" + self._digests[name])
        return whole.hexdigest()

    def _path(self, name: str) -> Path:
        """The file's path, refused where it leads out of the folder (``..``, absolute, a link outwards)."""
        if not name or "\0" in name:
            raise DriveError(f"{name!r} is no file name: name a file inside the drive folder.")
        outside = Path(name).is_absolute() or PureWindowsPath(name).is_absolute()
        path = self.root / name
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

    def _unreadable(self, name: str, error: OSError) -> DriveError:
        return DriveError(f"{name} cannot be read ({error.strerror}): check its permissions.")
