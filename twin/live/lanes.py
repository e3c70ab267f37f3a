"""A bounded queue between threads that loses what matters least, and counts it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from threading import Condition
from typing import Generic, TypeVar

from twin.live.ports import Said

T = TypeVar("T")
_LASTING, _REPLACED = 0, 1


class Lanes(Generic[T]):
    """Several lanes of one bounded queue, the one that matters most first.

    When it is full the oldest of the last lane that holds anything is left out, unless whoever puts is made
    to wait. Any number of threads may put and get.

    Parameters
    ----------
    lanes : int
        How many.
    most : int
        What all lanes hold together at most.
    overtakes : bool
        Whether what matters more is handed on first; else everything in the order in which it came.

    Attributes
    ----------
    lost : list of int
        How many of each lane were left out so far.
    """

    def __init__(self, lanes: int, most: int, *, overtakes: bool = False) -> None:
        self.lost = [0] * lanes
        self._most, self._overtakes = most, overtakes
        self._lanes: list[deque[tuple[int, T]]] = [deque() for _ in range(lanes)]
        self._changed = Condition()
        self._count = self._held = 0
        self._closed = self._hurries = False

    def __len__(self) -> int:
        return self._held

    @property
    def is_closed(self) -> bool:
        """Whether nothing more is taken."""
        return self._closed

    def put(self, one: T, lane: int, *, waits: bool = False) -> bool:
        """Take one; return whether it was taken, which it is not after `close`.

        Parameters
        ----------
        one : T
        lane : int
            0 matters most.
        waits : bool
            Wait for room rather than leave anything out.
        """
        with self._changed:
            while waits and self._held >= self._most and not (self._closed or self._hurries):
                self._changed.wait()
            if self._closed:
                return False
            self._count += 1
            self._lanes[lane].append((self._count, one))
            self._held += 1
            if self._held > self._most:
                self._leave_out()
            self._changed.notify_all()
            return True

    def get(self, timeout_s: float | None = None) -> T | None:
        """Hand on the next; None after `timeout_s`, or where nothing is left after `close`."""
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._held and not self._closed:
                left_s = None if until_s is None else until_s - time.monotonic()
                if left_s is not None and left_s <= 0.0:
                    return None
                self._changed.wait(left_s)
            filled = [lane for lane in self._lanes if lane]
            if not filled:
                return None
            _, one = (filled[0] if self._overtakes else min(filled, key=_first)).popleft()
            self._held -= 1
            self._changed.notify_all()
            return one

    def hurry(self) -> None:
        """Let nobody wait for room any more."""
        with self._changed:
            self._hurries = True
            self._changed.notify_all()

    def close(self, *, forget: bool = False) -> None:
        """Take nothing more; `get` hands on what is held, or nothing where that is to be forgotten."""
        with self._changed:
            self._closed = True
            if forget:
                self._held = 0
                for lane in self._lanes:
                    lane.clear()
            self._changed.notify_all()

    def drop(self, is_stale: Callable[[T], bool], lane: int) -> None:
        """Leave out of a lane what is stale, without counting it as lost."""
        with self._changed:
            kept = deque(one for one in self._lanes[lane] if not is_stale(one[1]))
            self._held -= len(self._lanes[lane]) - len(kept)
            self._lanes[lane] = kept
            self._changed.notify_all()

    def drained(self) -> Iterator[T]:
        """Hand on what is held now, in the order of `get`, without waiting."""
        while (one := self.get(0.0)) is not None:
            yield one

    def _leave_out(self) -> None:
        number = max(i for i, lane in enumerate(self._lanes) if lane)
        self._lanes[number].popleft()
        self.lost[number] += 1
        self._held -= 1


class Unsaid(Lanes[Said]):
    """Lines that wait for whoever takes them: those that last matter most, and replace what they supersede.

    Parameters
    ----------
    most : int
    overtakes : bool
    """

    def __init__(self, most: int, *, overtakes: bool) -> None:
        super().__init__(2, most, overtakes=overtakes)

    def say(self, said: Said, *, waits: bool = False) -> None:
        """Take a line; what it replaces and still waits need not go, unless all are waited for."""
        if said.lasts and not waits:
            kind = type(said)
            self.drop(lambda old: old.id == said.id and type(old) is kind, _REPLACED)
        self.put(said, _LASTING if said.lasts else _REPLACED, waits=waits)


def _first(lane: deque[tuple[int, T]]) -> int:
    return lane[0][0]
