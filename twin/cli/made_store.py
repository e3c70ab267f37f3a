"""A store that a command makes, and takes away again where the command fails before it has kept anything."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from twin.store.address import StoreAddress

if TYPE_CHECKING:
    from twin.store.store import Store

_BESIDE = ("", "-wal", "-shm", ".sync-lock")
"""What a new store consists of, as ends of its name."""


@contextmanager
def made_store(address: StoreAddress) -> Iterator[Store]:
    """Open a store, making it; one that is new and holds nothing when the block fails is taken away again.

    A backfill that was interrupted after its first page is something: the next sync goes on there. The tables
    of a database stay: others may have begun to use them.
    """
    from twin.store.store import Store

    path = address.file
    existed = path is None or os.path.lexists(path)
    holds_nothing = False
    try:
        with Store.open(address) as opened:
            try:
                yield opened
            except BaseException:
                holds_nothing = not existed and _holds_nothing(opened)
                raise
    finally:
        if holds_nothing and path is not None:
            for end in _BESIDE:
                path.with_name(f"{path.name}{end}").unlink(missing_ok=True)


def _holds_nothing(store: Store) -> bool:
    from twin.mirror.mirror_tables import StoreMirror

    begun = StoreMirror(store).backfill()
    return store.revision() == 0 and (begun is None or not begun.cursors)
