"""One page ahead: the next page is fetched and read while the present one is being stored.

A backfill's time is the API's, the parser's and the store's in turn; with the next page already on its way
the first of them costs nothing. Never is more than one page ahead, so that requests still come one after
the other and memory stays that of two pages.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Final, TypeVar

T = TypeVar("T")

_LISTEN_S: Final = 0.2
"""How often a wait listens for Ctrl-C, on systems where a wait does not end by it."""


def one_ahead(items: Iterator[T]) -> Iterator[T]:
    """Yield the items of an iterator while the next one is made in a thread of its own.

    What the iterator raises is raised here, in its turn: after the items before it have been yielded. A
    consumer that stops early leaves at most one item unused; the thread that makes it ends with it.

    Parameters
    ----------
    items : iterator
        It, and what it works with, is used by one thread at a time; the caller must not use it meanwhile.
    """

    def taken() -> tuple[T] | None:
        """The next item; None at the end."""
        for item in items:
            return (item,)
        return None

    thread = ThreadPoolExecutor(1, "one-ahead")
    try:
        coming = thread.submit(taken)
        while (item := _result(coming)) is not None:
            coming = thread.submit(taken)
            yield item[0]
    finally:
        thread.shutdown(wait=False)


def _result(coming: Future[T]) -> T:
    while not wait([coming], _LISTEN_S).done:
        pass
    return coming.result()
