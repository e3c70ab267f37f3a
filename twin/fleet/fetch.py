"""A drive in shared or object storage → a folder on this machine, whole or not at all, gone afterwards.

Addresses are those of fsspec: ``s3://bucket/trip``, ``az://container/trip``, ``https://host/trip``,
``file:///mnt/drives/trip``. What has no ``://`` is a folder of this machine and is read where it stands.

A file ``SHA256SUMS`` in the drive (as ``sha256sum`` writes it) says which files there are and what is in
them. Without it the storage's own list and sizes are held against what arrives.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from tenacity import Retrying, retry_if_exception_type, stop_after_attempt, wait_exponential

from twin import __version__
from twin.errors import ConfigError, FetchError, MissingExtraError, StorageError, TwinError
from twin.fleet.work_folders import work_folder

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

SUMS = "SHA256SUMS"
_SUM_LINE = re.compile(r"([0-9a-fA-F]{64}) [ *](?:\./)?(.+)")
_ATTEMPTS = 3
_SILENT_S = 60.0
"""A server that sends nothing for so long has gone."""
_STAMPS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "created")
"""By which kinds of storage say that a file was written anew."""


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """A file of a drive, as ``SHA256SUMS`` or the storage lists it; None for what that does not say."""

    name: str
    sha256: str | None = None
    n_bytes: int | None = None
    stamp: str = ""


def is_remote(address: str) -> bool:
    """Whether an address names storage rather than a folder of this machine."""
    return "://" in address


def drives_at(address: str) -> list[str]:
    """Return the drives that an address names: itself, or the folders that a ``*`` in it stands for.

    Raises
    ------
    ConfigError, FetchError, StorageError
        As :class:`Source`; no folder fits a pattern.
    """
    if "*" not in address:
        return [address.rstrip("/") if is_remote(address) else str(Path(address).absolute())]
    system, root = storage(address)
    with told(address):
        listed = system.glob(root.rstrip("/"), detail=True)
    folders = sorted(name.rstrip("/") for name, one in listed.items() if one["type"] == "directory")
    if not folders:
        raise FetchError(f"No folder fits {address}: check the pattern.")
    return [system.unstrip_protocol(name) if is_remote(address) else name for name in folders]


class Source:
    """A drive at an address, listed and not yet fetched.

    Parameters
    ----------
    address : str
    leave_out : sequence of str
        Patterns of files that are not fetched, such as ``*.h264``.

    Raises
    ------
    ConfigError
        There is no such kind of storage, or its library is not installed.
    FetchError
        Nothing is there, or ``SHA256SUMS`` cannot be used.
    StorageError
        The storage does not answer as it should.
    """

    def __init__(self, address: str, leave_out: Sequence[str] = ()) -> None:
        self.address = address
        self._system, self._root = storage(address)
        with told(address):
            files = self._listed()
        self.files = [one for one in files if not any(fnmatch(one.name, each) for each in leave_out)]
        if not self.files:
            raise FetchError(
                f"There is no drive at {address}, or its files cannot be listed: check the address, or put a"
                f" {SUMS} there (twin help fleet)."
            )

    def fingerprint(self) -> str:
        """Return what is the same as long as no file of the drive changes; "" where that is not told."""
        if not all(one.sha256 or one.stamp for one in self.files):
            return ""
        lines = sorted(f"{one.name}\0{one.sha256}\0{one.n_bytes}\0{one.stamp}" for one in self.files)
        return hashlib.sha256("\n".join([__version__, *lines]).encode()).hexdigest()

    @contextmanager
    def fetched(self) -> Iterator[Path]:
        """Give the drive's folder on this machine: itself, or a copy that is gone after the block.

        Raises
        ------
        FetchError
            A file is lacking, cut off or damaged.
        StorageError
            As above, also at the third attempt.
        """
        if not is_remote(self.address):
            yield Path(self.address)
            return
        with work_folder() as work:
            folder = work / (PurePosixPath(urlsplit(self.address).path).name or "drive")
            folder.mkdir()
            self._fetch(folder)
            yield folder

    def _listed(self) -> list[RemoteFile]:
        if is_remote(self.address):
            # Not asked whether it exists: over HTTP a server that is away would count as no.
            with suppress(FileNotFoundError):
                return _read_sums(self._system.cat_file(f"{self._root}/{SUMS}"), f"{self.address}/{SUMS}")
        start = len(self._root) + 1
        return [
            RemoteFile(name[start:], None, one.get("size"), _stamp(one))
            for name, one in self._system.find(self._root, detail=True).items()
            if len(name) > start and one["type"] == "file"
        ]

    def _fetch(self, folder: Path) -> None:
        """Fetch what is not there whole yet; a damaged file is fetched anew."""
        for attempt in Retrying(
            retry=retry_if_exception_type((StorageError, FetchError)),
            stop=stop_after_attempt(_ATTEMPTS),
            wait=wait_exponential(max=20.0),
            reraise=True,
        ):
            with attempt:
                wanted = [one for one in self.files if self._lack_of(one, folder / one.name)]
                for one in wanted:
                    (folder / one.name).parent.mkdir(parents=True, exist_ok=True)
                remote = [f"{self._root}/{one.name}" for one in wanted]
                with told(self.address):
                    self._system.get(remote, [str(folder / one.name) for one in wanted])
                for one in wanted:
                    if lack := self._lack_of(one, folder / one.name):
                        raise FetchError(
                            f"{self.address} is not whole: {one.name} {lack}; copy the drive there again."
                        )

    def _lack_of(self, one: RemoteFile, path: Path) -> str:
        """Say what a fetched file lacks; "" where it is whole."""
        if not path.is_file():
            return "is lacking"
        n_bytes = path.stat().st_size
        if one.n_bytes is not None and n_bytes != one.n_bytes:
            return f"is cut off ({n_bytes:,} of {one.n_bytes:,} bytes)"
        if one.sha256 is None:
            return ""
        with path.open("rb") as file:
            is_same = hashlib.file_digest(file, "sha256").hexdigest() == one.sha256
        return "" if is_same else f"is cut off or damaged (its SHA-256 is not that of {SUMS})"


def _read_sums(content: bytes, where: str) -> list[RemoteFile]:
    """Read what ``sha256sum`` wrote; names lead nowhere else."""
    files = []
    for line in content.decode("utf-8", "replace").splitlines():
        found = _SUM_LINE.fullmatch(line.rstrip())
        if line.strip() and found is None:
            raise FetchError(f"{where} has a line that is none of sha256sum's ({line:.60}): write it anew.")
        if found is None:
            continue
        name = PurePosixPath(found[2])
        if name.is_absolute() or ".." in name.parts or "\\" in found[2]:
            raise FetchError(f"{where} names {found[2]:.80}, which lies outside the drive: write it anew.")
        if str(name) != SUMS:
            files.append(RemoteFile(str(name), found[1].lower()))
    return files


def _stamp(listed: dict[str, Any]) -> str:
    return next((str(listed[key]) for key in _STAMPS if listed.get(key)), "")


def storage(address: str) -> tuple[AbstractFileSystem, str]:
    """Return the storage that an address belongs to, and the address inside it."""
    import fsspec.core

    parts = urlsplit(address) if is_remote(address) else None
    if parts is not None and parts.password:
        raise ConfigError(
            f"The address {parts.scheme}://…@{parts.hostname} has a password in it, which the store would"
            " keep: give it in the way that this storage's library takes (twin help fleet)."
        )
    # A process that lives for days is not to take an old list for the new one.
    options: dict[str, Any] = {"use_listings_cache": False}
    if parts is not None and parts.scheme in ("http", "https"):
        options["client_kwargs"] = {"timeout": _timeout()}
    try:
        system, root = fsspec.core.url_to_fs(address, **options)
    except ImportError as error:
        raise ConfigError(f"{address} cannot be read here. {error} with pip, beside twin.") from error
    except ValueError as error:
        raise ConfigError(f"{address}: {error}; twin help fleet has the kinds of storage.") from error
    return system, root.rstrip("/")


def _timeout() -> Any:
    try:
        import aiohttp
    except ImportError as error:
        raise MissingExtraError("https:// storage", "aiohttp", "fleet") from error
    return aiohttp.ClientTimeout(total=None, sock_connect=_SILENT_S, sock_read=_SILENT_S)


@contextmanager
def told(address: str) -> Iterator[None]:
    """Turn what a storage's library says into one sentence."""
    try:
        yield
    except TwinError:
        raise
    except FileNotFoundError as error:
        raise FetchError(f"{address} is not whole or not there: {error} is lacking.") from error
    except (PermissionError, NotADirectoryError) as error:
        raise FetchError(f"{address} cannot be read ({error}): check rights and address.") from error
    except Exception as error:  # each storage has errors of its own
        raise StorageError(
            f"{address} cannot be read now ({type(error).__name__}: {error}): try again when the storage"
            " answers."
        ) from error
