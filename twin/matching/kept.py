"""What earlier matches worked out, kept in the store.

A part is found by its kind and key. Where the key is a digest of all its input it is never out of date; of
others :mod:`twin.matching.left` says when they hold.
"""

from __future__ import annotations

import hashlib
import json
import math
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
_Name = tuple[str, str]


class NotSure(Exception):  # noqa: N818  # never leaves the package
    """What was touched may reach further than what was read: everything has to be matched."""


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
    view : Snapshot, optional
        Of the store with what earlier matches left; nothing by default: then all is worked out anew.
    """

    def __init__(self, view: Snapshot | None = None) -> None:
        self._view = view
        self._before: dict[_Name, bytes | None] = {}
        self._now: dict[_Name, bytes] = {}
        self._gone: set[_Name] = set()

    def get(self, kind: str, key: str) -> Arrays | None:
        """Return what was kept, and keep it; None where it has to be worked out."""
        name = kind, key
        packed = self._now.get(name) or self._read(name)
        if packed is None:
            return None
        self._now[name] = packed
        return arrays_of(packed)

    def put(self, kind: str, key: str, arrays: Arrays) -> None:
        """Keep what was worked out."""
        self._now[kind, key] = packed_arrays(arrays)
        self._gone.discard((kind, key))

    def drop(self, kind: str, key: str) -> None:
        """Forget a part."""
        self._now.pop((kind, key), None)
        self._gone.add((kind, key))

    def used(self) -> dict[_Name, bytes]:
        """Return what this match used or put, packed, by kind and key."""
        return dict(self._now)

    def take(self, parts: Mapping[_Name, bytes]) -> None:
        """Keep what another process worked out of the same store (:meth:`used`)."""
        self._now |= parts
        self._gone -= parts.keys()

    def _read(self, name: _Name) -> bytes | None:
        if name not in self._before:
            t, (kind, key) = schema.kept_part.c, name
            asked = sa.select(t.arrays).where(t.kind == kind, t.key == key)
            rows = [] if self._view is None else self._view.rows(asked)
            self._before[name] = rows[0]["arrays"] if rows else None
        return self._before[name]

    def save(self, connection: sa.Connection, *, rest_goes: bool) -> None:
        """Leave what this match used to the next one, inside the caller's transaction.

        Parameters
        ----------
        rest_goes : bool
            Whether what nobody asked for is forgotten: it was a match of everything.
        """
        t = schema.kept_part
        gone = set(self._gone)
        if rest_goes:
            every = connection.execute(sa.select(t.c.kind, t.c.key))
            gone |= {(kind, key) for kind, key in every} - self._now.keys()
        fresh = [name for name, packed in self._now.items() if self._before.get(name) != packed]
        left = [{"of_kind": kind, "of_key": key} for kind, key in sorted(gone | set(fresh))]
        if left:
            same = (t.c.kind == sa.bindparam("of_kind")) & (t.c.key == sa.bindparam("of_key"))
            connection.execute(sa.delete(t).where(same), left)
        if fresh:
            rows = [{"kind": kind, "key": key, "arrays": self._now[kind, key]} for kind, key in fresh]
            connection.execute(taking_place(connection, t), rows)


def packed_arrays(arrays: Arrays) -> bytes:
    """One line of JSON that says what follows, and the arrays: a fleet's parts are many, npz is slow."""
    some = {name: np.asarray(array) for name, array in arrays.items()}
    line = json.dumps([[name, array.dtype.str, array.shape] for name, array in some.items()])
    return b"".join([line.encode(), b"\n", *(array.tobytes() for array in some.values())])


def arrays_of(packed: bytes) -> dict[str, NDArray[Any]]:
    """Return what :func:`packed_arrays` packed."""
    line, _, rest = packed.partition(b"\n")
    found, at = {}, 0
    for name, kind, shape in json.loads(line):
        count = math.prod(shape)
        one = np.frombuffer(rest, dtype=kind, count=count, offset=at) if count else np.zeros(0, dtype=kind)
        found[name] = one.reshape(shape)
        at += one.nbytes
    return found
