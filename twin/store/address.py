"""Where a store is: a file of SQLite, or a database of PostgreSQL."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from twin.errors import ConfigError

if TYPE_CHECKING:
    import sqlalchemy as sa

_SCHEME = re.compile(r"(?:postgres|postgresql)(?:\+\w+)?://", re.IGNORECASE)
_OURS = ("postgres", "postgresql", "postgresql+psycopg")
_PICTURES = "pictures"
FORM = "postgresql://USER@HOST/DATABASE"


@dataclass(frozen=True, slots=True, repr=False)
class StoreAddress:
    """What ``--store`` names.

    Parameters
    ----------
    text : str
        The path of a SQLite file, or ``postgresql://USER@HOST/DATABASE``, with ``?pictures=FOLDER`` where
        crops of pictures are kept. It may hold a password, and is never shown: ``str()`` leaves that out.
    """

    text: str

    @classmethod
    def of(cls, given: StoreAddress | Path | str) -> StoreAddress:
        """Take what a caller names a store by."""
        return given if isinstance(given, StoreAddress) else cls(str(given))

    @property
    def file(self) -> Path | None:
        """The SQLite file; None of a database."""
        return None if _SCHEME.match(self.text) else Path(self.text)

    @property
    def pictures(self) -> Path | None:
        """The folder for crops of pictures that a database's address names."""
        named = self.url().query.get(_PICTURES)
        return Path(named if isinstance(named, str) else named[-1]) if named else None

    def url(self) -> sa.URL:
        """Return the address of a database.

        Raises
        ------
        ConfigError
            It cannot be read, or names a driver that twin does not use.
        """
        import sqlalchemy as sa

        try:
            url = sa.make_url(self.text)
        except (sa.exc.ArgumentError, ValueError):
            # Not `from` the error, which may show the password.
            raise ConfigError(f"The store {self} is no address: write {FORM}.") from None
        if url.drivername.lower() not in _OURS:
            raise ConfigError(
                f"The store {self} names the driver {url.drivername}, and twin uses psycopg: write {FORM}."
            )
        return url.set(drivername="postgresql+psycopg")

    def connected(self) -> sa.URL:
        """Return the address as the database's driver takes it."""
        return self.url().difference_update_query([_PICTURES])

    def __str__(self) -> str:
        """Return it for people: without a password, and without what stands behind the database's name."""
        if self.file is not None:
            return self.text
        parts = urlsplit(self.text)
        user, at, host = parts.netloc.rpartition("@")
        return f"postgresql://{user.partition(':')[0]}{at}{host}{parts.path}"

    __repr__ = __str__
