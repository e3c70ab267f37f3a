"""One page ahead: the next page is fetched and read while the present one is being stored.

A backfill's time is the API's, the parser's and the store's in turn; with the next page already on its way
the first of them costs nothing. Never is more than one page ahead, so that requests still come one after
the other and memory stays that of two pages.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Generic, TypeVar

T = TypeVar("T")

_LISTEN_S: Final = 0.2
"""How often a wait listens for Ctrl-C, on systems where a wait does not end by it."""
_COLLECT_AFTER: Final = 10
"""Pages after which cycles are looked for among what these pages left behind."""


def one_ahead(items: Iterator[T]) -> Iterator[T]:
    """Yield the items of an iterator while the next one is made in a thread of its own.

    What the iterator raises is raised here, in its turn: after the items before it have been yielded. A
    consumer that stops early leaves at most one item unused; the thread that makes it ends with it, and
    keeps no program from ending.

    Parameters
    ----------
    items : iterator
        It, and what it works with, is used by one thread at a time; the caller must not use it meanwhile.
    """
    coming = _Coming(items)
    while (made := coming.wait()) is not None:
        coming = _Coming(items)
        yield made[0]


class _Coming(Generic[T]):
    """The next item of an iterator, in the making."""

    def __init__(self, items: Iterator[T]) -> None:
        self._items = items
        self._made: tuple[T] | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._make, name="one-ahead", daemon=True)
        self._thread.start()

    def wait(self) -> tuple[T] | None:
        """Give the item; None at the end. Raises what the iterator raised."""
        while self._thread.is_alive():
            self._thread.join(_LISTEN_S)
        if self._error is not None:
            raise self._error
        return self._made

    def _make(self) -> None:
        try:
            self._made = (next(self._items),)
        except StopIteration:
            pass
        except BaseException as error:  # raised by whoever waits for the item
            self._error = error


@contextmanager
def rare_cycle_search() -> Iterator[Callable[[], None]]:
    """Keep Python's search for cycles from going over all that a program holds, page after page.

    Yields
    ------
    page_done : callable
        To be called after each page: looks for cycles now and then, among what came since the last time.
    """
    enabled, n_pages = gc.isenabled(), 0

    def page_done() -> None:
        nonlocal n_pages
        n_pages += 1
        if n_pages % _COLLECT_AFTER == 0:
            gc.collect(1)

    gc.disable()
    try:
        yield page_done
    finally:
        if enabled:
            gc.enable()
