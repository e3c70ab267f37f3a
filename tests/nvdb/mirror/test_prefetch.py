"""One page ahead: the same items in the same order, and never more than one of them unasked for."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator

import pytest

from nvdb.mirror.prefetch import one_ahead, rare_cycle_search


def counting(n: int, made: list[int], error: Exception | None = None) -> Iterator[int]:
    """Numbers up to `n`, each noted when it is made, and an error after the last."""
    for number in range(n):
        made.append(number)
        yield number
    if error is not None:
        raise error


@pytest.mark.parametrize("n", [0, 1, 2, 50])
def test_one_ahead_yields_the_same_items(n: int) -> None:
    """Nothing is lost, doubled or put in another order."""
    assert list(one_ahead(counting(n, []))) == list(range(n))


def test_one_ahead_is_one_ahead() -> None:
    """While an item is used the next one is made, and no other."""
    made: list[int] = []
    for number in one_ahead(counting(20, made)):
        _wait_for_threads()
        assert made == list(range(min(number + 2, 20)))


def test_one_ahead_raises_in_turn() -> None:
    """An error comes after the items before it, as itself, and ends the thread that met it."""
    error = ValueError("the third page")
    items = one_ahead(counting(2, [], error))
    assert [next(items), next(items)] == [0, 1]
    with pytest.raises(ValueError, match="the third page") as caught:
        next(items)
    assert caught.value is error
    _wait_for_threads()


def test_one_ahead_left_early_ends_its_thread() -> None:
    """A consumer that fails leaves one item unused and no thread behind."""
    made: list[int] = []
    items = one_ahead(counting(9, made))
    next(items)
    items.close()  # type: ignore[attr-defined]
    _wait_for_threads()
    assert made == [0, 1]


class Ring:
    """A cycle that only the collector frees."""

    freed = 0

    def __init__(self) -> None:
        self.ring = self

    def __del__(self) -> None:
        Ring.freed += 1


@pytest.mark.parametrize("enabled", [True, False])
def test_rare_cycle_search_leaves_the_collector_as_it_was(enabled: bool) -> None:
    """Off inside, where cycles are freed now and then, and afterwards what it was."""
    was, before = gc.isenabled(), Ring.freed
    (gc.enable if enabled else gc.disable)()
    try:
        with rare_cycle_search() as page_done:
            assert not gc.isenabled()
            for _ in range(40):
                Ring()
                page_done()
        assert gc.isenabled() is enabled
        assert Ring.freed - before >= 30
    finally:
        (gc.enable if was else gc.disable)()


def _wait_for_threads() -> None:
    for thread in threading.enumerate():
        if thread.name == "one-ahead":
            thread.join(10)
            assert not thread.is_alive()
