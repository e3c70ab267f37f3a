"""Where drives are located: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, Protocol, TypeVar

from twin.errors import ConfigError, MissingExtraError, StorageError, TwinError

P = ParamSpec("P")
T = TypeVar("T")


class LostProcessError(TwinError):
    """The process that did the work was killed."""


class Executor(Protocol):
    """Runs functions elsewhere: what a fleet needs of an engine, and no more.

    A function and what it takes and gives go through a pickle. A future's exception means that the work was
    lost, not that it failed: the function tells of failures in what it returns.
    """

    reaches_store: bool
    """Whether what it runs can open the store: it is on this machine."""

    @property
    def slots(self) -> int:
        """How many functions it can run at once, now.

        Raises
        ------
        StorageError
            The engine itself is gone.
        """

    def submit(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a function."""

    def close(self) -> None:
        """End it, and what it still runs."""


class LocalProcesses:
    """A process for each piece of work, so many at once; one that is killed takes no other along.

    Parameters
    ----------
    n : int
        A process has one thread: as many as there are cores keep them all busy.
    """

    reaches_store = True

    def __init__(self, n: int) -> None:
        self._n = n
        self._threads = ThreadPoolExecutor(n)
        self._running: set[BaseProcess] = set()
        self._lock = threading.Lock()
        self._is_closed = False
        # The server of forks imports NumPy once, and its children work side by side: a thread each.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        methods = multiprocessing.get_all_start_methods()
        self._context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        self._context.set_forkserver_preload(["twin.fleet.locating", "twin.fleet.matching"])

    @property
    def slots(self) -> int:
        """How many processes it runs at once."""
        return self._n

    def submit(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a function in a process of its own."""
        return self._threads.submit(self._apart, work, args, kwargs)

    def close(self) -> None:
        """Kill what still runs."""
        with self._lock:
            self._is_closed = True
            for process in self._running:
                process.kill()
        self._threads.shutdown(cancel_futures=True)

    def _apart(self, work: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        receiver, sender = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_answer, args=(sender, work, args, kwargs), daemon=True)
        with receiver:
            with self._lock, sender:
                if self._is_closed:
                    raise LostProcessError("The fleet has ended.")
                process.start()
                self._running.add(process)
            try:
                answer: T = receiver.recv()
            except EOFError:
                process.join()
                raise LostProcessError(
                    f"The process that ran it was killed ({_how(process.exitcode)})."
                ) from None
            finally:
                process.join()
                with self._lock:
                    self._running.discard(process)
        return answer


def _answer(
    sender: Connection, work: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]
) -> None:
    """Do the work in this process, and send what it gives."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the first one says so
    with suppress(BrokenPipeError), sender:
        sender.send(work(*args, **kwargs))


def _how(exitcode: int | None) -> str:
    if exitcode == -signal.SIGKILL:
        return "SIGKILL, as the system does where memory runs out"
    if exitcode is not None and exitcode < 0:
        return signal.Signals(-exitcode).name
    return f"exit code {exitcode}"


class DaskCluster:
    """A Dask scheduler with its workers: for reprocessing in bulk.

    Start the workers with ``--nthreads 1``: locating is Python and keeps a core busy. They have to have the
    same twin.

    Parameters
    ----------
    address : str
        ``tcp://host:8786``.

    Raises
    ------
    MissingExtraError, ConfigError, StorageError
        Dask is not installed; the address is none; nothing answers there.
    """

    reaches_store = False

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise MissingExtraError("--scheduler", "dask.distributed", "fleet") from error
        self._address = address
        # What goes wrong is told below, in a sentence; it would add a traceback.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=20.0, set_as_default=False)
        except ValueError as error:
            raise ConfigError(f"{address} is no scheduler's address: write tcp://HOST:8786.") from error
        except OSError as error:
            raise self._gone() from error
        # Each call is work of its own; workers that are killed are told of after the third.
        self._pool = self._client.get_executor(pure=False)

    @property
    def slots(self) -> int:
        """Threads of all workers, and one more each, so that none waits for the next drive."""
        if self._client.status != "running":
            raise self._gone()
        return 2 * sum(map(int, self._client.nthreads().values()))

    def submit(self, work: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a function on a worker."""
        future: Future[T] = self._pool.submit(work, *args, **kwargs)
        return future

    def close(self) -> None:
        """Leave the cluster, which stays."""
        with suppress(Exception):  # a scheduler that is gone cannot be left in order
            self._pool.shutdown(wait=False, cancel_futures=True)
        with suppress(Exception):
            self._client.close(timeout=5.0)

    def _gone(self) -> StorageError:
        return StorageError(
            f"The scheduler {self._address} does not answer: start it (dask scheduler), then run this again;"
            " what was done is kept."
        )
