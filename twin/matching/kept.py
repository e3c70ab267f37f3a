"""What earlier matches worked out, kept in the store by everything that it rests on: it is never out of date.

A part's key is a digest of all its input. What has changed has another key, is not found, and is worked out;
what nobody asked for in a match is forgotten with it.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from twin import __version__
from twin.store import schema
from twin.store.sql import taking_place
from twin.store.store import Snapshot

Arrays = Mapping[str, NDArray[Any]]


def digest(*parts: bytes) -> str:
    """Return what tells one input from any other, of this version of twin: 128 bits."""
    found = hashlib.blake2b(f"{__version__} {np.__version__}".encode(), digest_size=16)
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))
        found.update(part)
    return found.hexdigest()


class Kept:
    """Parts of a match by kind and key.

    Parameters
    ----------
    before : mapping of (kind, key) to packed arrays, optional
        What earlier matches left; nothing by default: then all is worked out anew.
    """

    def __init__(self, before: Mapping[tuple[str, str], bytes] | None = None) -> None:
        self._before = dict(before or {})
        self._now: dict[tuple[str, str], bytes] = {}

    @classmethod
    def of_store(cls, view: Snapshot) -> Kept:
        """Read what the last match left."""
        t = schema.kept_part.c
        columns = view.columns(sa.select(t.kind, t.key, t.arrays))
        names = zip(columns["kind"], columns["key"], strict=True)
        return cls(dict(zip(names, columns["arrays"], strict=True)))

    def get(self, kind: str, key: str) -> Arrays | None:
        """Return what was kept, and keep it; None where it has to be worked out."""
        name = kind, key
        packed = self._now.get(name, self._before.get(name))
        if packed is None:
            return None
        self._now[name] = packed
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            return dict(arrays)

    def put(self, kind: str, key: str, arrays: Arrays) -> None:
        """Keep what was worked out."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        self._now[kind, key] = buffer.getvalue()

    def save(self, connection: sa.Connection) -> None:
        """Leave what this match used to the next one, inside the caller's transaction; the rest goes."""
        t = schema.kept_part
        gone = [{"of_kind": kind, "of_key": key} for kind, key in self._before.keys() - self._now.keys()]
        if gone:
            same = (t.c.kind == sa.bindparam("of_kind")) & (t.c.key == sa.bindparam("of_key"))
            connection.execute(sa.delete(t).where(same), gone)
        fresh = [
            {"kind": kind, "key": key, "arrays": packed}
            for (kind, key), packed in self._now.items()
            if self._before.get((kind, key)) != packed
        ]
        if fresh:
            connection.execute(taking_place(connection, t), fresh)
