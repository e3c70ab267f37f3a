"""One page ahead: the same items in the same order, and never more than one of them unasked for."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from nvdb.mirror.prefetch import one_ahead


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
        expected = list(range(min(number + 2, 20)))
        end = time.monotonic() + 60
        while len(made) < len(expected) and time.monotonic() < end:
            time.sleep(0.001)
        assert made == expected


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


def _wait_for_threads() -> None:
    for thread in threading.enumerate():
        if thread.name.startswith("one-ahead"):
            thread.join(10)
            assert not thread.is_alive()
