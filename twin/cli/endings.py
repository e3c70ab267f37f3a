"""Ctrl-C and SIGTERM for work that goes on until it is told to end: the first ends it in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ended_in_order() -> Iterator[threading.Event]:
    """Give an event that the first Ctrl-C or SIGTERM sets; the second ends everything at once, as elsewhere.

    A signal that whoever started twin wants ignored stays so.
    """
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    before = {one: handler for one, handler in before.items() if handler is not signal.SIG_IGN}

    def restore() -> None:
        for one, handler in before.items():
            signal.signal(one, handler)

    def ask(_signal: int, _frame: object) -> None:
        restore()
        asked.set()

    for one in before:
        signal.signal(one, ask)
    try:
        yield asked
    finally:
        restore()
