"""What can go wrong in the twin itself.

::

    TwinError
    ├── DriveError          a recorded drive that cannot be read (what, where, cure)
    ├── StoreError          the store is missing, locked, or written by a newer version
    ├── ConfigError         a setting that cannot be
    │   └── MissingExtraError   … without an extra of the package; a DriveError as well
    ├── FileError           a file or folder that a command names, and that is not there or not readable
    │   └── FetchError          a drive in shared storage that is not there, or not whole
    ├── StorageError        shared storage that does not answer
    ├── LayoutError         a ``layout.toml`` for ``calibrate extrinsics`` that cannot be read
    ├── TruthError          a truth file for ``evaluate`` that cannot be read
    ├── TerrainError        a ground raster that cannot be read or used
    └── RefusedError        doing it would lose or overwrite something
        └── ExportRefusedError  … in an export folder

Exit codes live in :mod:`twin.cli.exit_codes` alone.
"""

from __future__ import annotations

import errno
import shlex
import subprocess
import sys

_RIGHTS = "give this user the right to it, or name another"
_SPACE = "free space on the disk, or name another place"
CURES = {
    errno.EACCES: _RIGHTS,
    errno.EPERM: _RIGHTS,
    errno.EROFS: _RIGHTS,
    errno.ENOSPC: _SPACE,
    errno.EDQUOT: _SPACE,
    errno.EFBIG: _SPACE,
    errno.EIO: "the disk fails; name another place",
    errno.EMFILE: "allow this process more open files (ulimit -n)",
}
"""Error number of the system → what helps."""


def to_type(*words: object) -> str:
    """Write a command as people type it in this system's shell, with quotes where they are needed."""
    texts = [str(word) for word in words]
    return subprocess.list2cmdline(texts) if sys.platform == "win32" else shlex.join(texts)


class TwinError(Exception):
    """Base of every error that ``twin`` raises."""


class DriveError(TwinError):
    """A drive folder that cannot be read; the message names the file and the cure."""


class StoreError(TwinError):
    """A store that cannot be opened or written."""


class ConfigError(TwinError):
    """A setting that is out of its range."""


class FileError(TwinError):
    """A file or folder that is not there or not readable; the message names it and the cure."""


class FetchError(FileError):
    """A drive in shared or object storage that is not there or not whole; the message names the file."""


class StorageError(TwinError):
    """Shared or object storage that does not answer as it should: the same may work later."""


class MissingExtraError(DriveError, ConfigError):
    """What was asked for needs a library that comes with an extra of the package, which is not installed.

    Nothing is wrong with the drive, but whoever goes on without an unreadable file goes on here too.
    """

    def __init__(self, what: str, library: str, extra: str) -> None:
        super().__init__(
            f'{what} needs {library}, which is not installed: pip install "nvdb-twin[{extra}]" '
            "(pipx, uv: twin help install)."
        )


class LayoutError(TwinError):
    """A ``layout.toml`` that cannot be read; the message names the file and the key."""


class TruthError(TwinError):
    """A truth file that cannot be read."""


class TerrainError(TwinError):
    """A ground raster that cannot be read or used; the message names the file and the cure."""


class RefusedError(TwinError):
    """Something that twin refuses to do because it would lose or overwrite something."""


class ExportRefusedError(RefusedError):
    """An export that cannot be written without losing something; the old files are untouched."""
