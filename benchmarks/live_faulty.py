"""Faults of a car's sensors, clocks, sinks and wires, done to drives: for `live_faults.py` and for tests."""

from __future__ import annotations

import gc
import json
import random
import socket
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from heapq import heappop, heappush
from operator import xor
from pathlib import Path
from threading import Event, Thread
from typing import NamedTuple

from geoloc.live.samples import Fix
from twin.live import Arrival, Detection, Frame, LiveEngine, LiveRun, RunSettings, played
from twin.live.keep import Keeper
from twin.live.notices import Notice
from twin.live.ports import Said

Arrivals = Iterable[Arrival]
_SECOND_NS = 1_000_000_000


class Span(NamedTuple):
    """When a fault is, by the stamps of arrivals."""

    begin_ns: int
    end_ns: int

    def __contains__(self, at_ns: object) -> bool:
        return isinstance(at_ns, int) and self.begin_ns <= at_ns < self.end_ns


def without_fixes(arrivals: Arrivals, when: Span) -> Iterator[Arrival]:
    """No fix arrives."""
    return (one for one in arrivals if not (isinstance(one.what, Fix) and one.at_ns in when))


def without_camera(arrivals: Arrivals, when: Span, camera: str = "") -> Iterator[Arrival]:
    """One camera, or all, delivers nothing."""
    for one in arrivals:
        is_gone = isinstance(one.what, Frame) and camera in ("", one.what.camera) and one.at_ns in when
        if not is_gone:
            yield one


def gnss_stepped(arrivals: Arrivals, when: Span, by_s: float) -> Iterator[Arrival]:
    """The receiver's clock steps at the beginning, and stays so."""
    by_ns = round(by_s * _SECOND_NS)
    for one in arrivals:
        if isinstance(one.what, Fix) and one.what.epoch_ns >= when.begin_ns:
            yield one._replace(what=one.what._replace(epoch_ns=one.what.epoch_ns + by_ns))
        else:
            yield one


def host_stepped(arrivals: Arrivals, when: Span, by_s: float) -> Iterator[Arrival]:
    """The clock of the computer steps at the beginning, which stamps arrivals and frames, and stays so."""
    by_ns = round(by_s * _SECOND_NS)
    for one in arrivals:
        if one.at_ns < when.begin_ns:
            yield one
        elif isinstance(one.what, Fix):
            yield one._replace(at_ns=one.at_ns + by_ns)
        else:
            what = one.what._replace(epoch_ns=one.what.epoch_ns + by_ns)
            yield Arrival(one.at_ns + by_ns, what)


def delayed(arrivals: Arrivals, delay_ns: Callable[[Arrival], int]) -> Iterator[Arrival]:
    """Some arrive later, and all in the order in which they then do."""
    waiting: list[tuple[int, int, Arrival]] = []
    for number, one in enumerate(arrivals):
        while waiting and waiting[0][0] <= one.at_ns:
            yield heappop(waiting)[2]
        late_ns = delay_ns(one)
        if late_ns:
            at_ns = one.at_ns + late_ns
            heappush(waiting, (at_ns, number, one._replace(at_ns=at_ns)))
        else:
            yield one
    while waiting:
        yield heappop(waiting)[2]


def late_fixes(arrivals: Arrivals, when: Span) -> Iterator[Arrival]:
    """The link to the receiver hangs for three seconds, again and again, and then delivers all at once."""
    period_ns = 3 * _SECOND_NS

    def delay_ns(one: Arrival) -> int:
        if not isinstance(one.what, Fix) or one.at_ns not in when:
            return 0
        return period_ns - (one.at_ns - when.begin_ns) % period_ns

    return delayed(arrivals, delay_ns)


def out_of_order(arrivals: Arrivals, when: Span) -> Iterator[Arrival]:
    """Fixes take between none and two seconds."""
    draw = random.Random(7)

    def delay_ns(one: Arrival) -> int:
        is_fix = isinstance(one.what, Fix) and one.at_ns in when
        return round(draw.uniform(0.0, 2.0) * _SECOND_NS) if is_fix else 0

    return delayed(arrivals, delay_ns)


def spoilt(arrivals: Arrivals, when: Span) -> Iterator[Arrival]:
    """Frames of a camera that the car does not have, detections without a pixel, fixes without a place."""
    nan = float("nan")
    strange = Detection((nan, nan), "foot", "nowhere")
    for number, one in enumerate(arrivals):
        what = one.what
        if one.at_ns in when and isinstance(what, Frame) and number % 5 == 0:
            yield one._replace(what=what._replace(detections=(*what.detections, strange)))
            yield one._replace(what=Frame("no such camera", number, what.epoch_ns, what.detections))
        else:
            yield one
        if one.at_ns in when and isinstance(what, Fix) and number % 5 == 0:
            yield one._replace(what=what._replace(latitude_deg=nan))


@dataclass
class Feed:
    """A source that gives what it is made of, until it is closed."""

    every: Arrivals
    name: str = "drive"
    closed: Event = field(default_factory=Event)

    def arrivals(self) -> Iterator[Arrival]:
        """Yield what arrives."""
        for one in self.every:
            if self.closed.is_set():
                return
            yield one

    def close(self) -> None:
        """End it."""
        self.closed.set()


@dataclass
class Heard:
    """A sink that keeps what is final, and takes nothing while it is stuck."""

    name: str = "sink"
    must_arrive: bool = True
    final: list[Said] = field(default_factory=list)
    flows: Event = field(default_factory=Event)

    def write(self, said: Said) -> None:
        """Take a line."""
        self.flows.wait()
        if said.lasts:
            self.final.append(said)

    def close(self) -> None:
        """Nothing waits."""


class Outcome(NamedTuple):
    """What came of one drive."""

    run: LiveRun
    heard: Heard
    notices: list[Notice]
    kept: dict[str, str]
    """What stands in the file: state by id."""
    queue: int
    grown_mb: float
    seconds: float


def drive_with(
    engine: LiveEngine,
    arrivals: Arrivals,
    folder: Path,
    *,
    settings: RunSettings | None = None,
    stuck_s: tuple[float, float] | None = None,
) -> Outcome:
    """Run a drive to its end.

    Parameters
    ----------
    engine : LiveEngine
    arrivals : iterable of Arrival
    folder : Path
        For the file of what is final.
    settings : RunSettings, optional
    stuck_s : (float, float), optional
        Between these seconds the sink takes nothing.
    """
    heard, notices = Heard(), list[Notice]()
    heard.flows.set()
    keep = folder / "live.gpkg"
    run = LiveRun(
        engine,
        [Feed(arrivals)],
        [heard],
        keeper=Keeper(keep, "fault"),
        tell=notices.append,
        settings=settings,
    )
    gc.collect()
    before_mb, most_mb, queue, began_s = resident_mb(), 0.0, 0, time.monotonic()
    run.start()
    while not run.wait(0.1):
        since_s = time.monotonic() - began_s
        if stuck_s is not None:
            (heard.flows.clear if stuck_s[0] <= since_s < stuck_s[1] else heard.flows.set)()
        most_mb, queue = max(most_mb, resident_mb()), max(queue, run.last.queue)
    seconds = time.monotonic() - began_s
    return Outcome(run, heard, notices, kept_in(keep), queue, most_mb - before_mb, seconds)


def kept_in(path: Path) -> dict[str, str]:
    """State of each object in a file of what is final, which has to be whole."""
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        return dict(database.execute("SELECT id, state FROM estimates ORDER BY fid"))


def resident_mb() -> float:
    """What the process has in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


class Wires:
    """The sensors of a car: fixes as NMEA of two receivers and detections as JSON lines, each on a port.

    Parameters
    ----------
    every : iterable of Arrival
        Is sent as if it happened now, in real time.
    """

    def __init__(self, every: Arrivals, antennas: Sequence[str]) -> None:
        self._every = every
        self._servers = {name: socket.create_server(("127.0.0.1", 0)) for name in (*antennas, "frames")}
        self._clients: dict[str, socket.socket] = {}
        self.spoils, self.ended = Event(), Event()
        Thread(target=self._send_all, daemon=True).start()

    def options(self) -> list[str]:
        """Where `twin live` finds them."""
        place = {name: f"tcp://127.0.0.1:{one.getsockname()[1]}" for name, one in self._servers.items()}
        frames = place.pop("frames")
        fixes = [part for name, url in place.items() for part in ("--gnss", f"{url}?antenna={name}")]
        return [*fixes, "--detections", frames]

    def close(self) -> None:
        """Hang up."""
        self.ended.set()
        for one in (*self._clients.values(), *self._servers.values()):
            one.close()

    def _send_all(self) -> None:
        draw = random.Random(3)
        with suppress(OSError):
            for name, server in self._servers.items():
                self._clients[name] = server.accept()[0]
            shift_ns = None
            for one in played(self._every, 1.0):
                if self.ended.is_set():
                    return
                shift_ns = time.time_ns() - one.at_ns if shift_ns is None else shift_ns
                name, line = _line(one.what, shift_ns)
                if self.spoils.is_set():
                    line = (
                        draw.randbytes(draw.randrange(400)) + b"\n" + line + b'{"camera": 7}\n$GNGGA,,*00\n'
                    )
                self._clients[name].sendall(line)


def _line(what: object, shift_ns: int) -> tuple[str, bytes]:
    if isinstance(what, Frame):
        found = [
            {"foot": [one.pixel_px[0] + 0.5, one.pixel_px[1] + 0.5], "object": one.object, "label": one.label}
            for one in what.detections
        ]
        stamp = what.epoch_ns + shift_ns
        line = {"camera": what.camera, "frame": what.number, "stamp_ns": stamp, "detections": found}
        return "frames", json.dumps(line).encode() + b"\n"
    assert isinstance(what, Fix)
    when = datetime.fromtimestamp((what.epoch_ns + shift_ns) / 1e9, tz=UTC)
    words = [
        f"GNGGA,{when:%H%M%S}.{when.microsecond // 1000:03d}",
        f"{int(what.latitude_deg):02d}{what.latitude_deg % 1.0 * 60.0:011.8f},N",
        f"{int(what.longitude_deg):03d}{what.longitude_deg % 1.0 * 60.0:011.8f},E",
        f"{what.quality},12,0.6,{what.height_m - 40.0:.4f},M,40.0,M,1.0,0000",
    ]
    body = ",".join(words)
    check = reduce(xor, body.encode())
    return what.antenna, f"${body}*{check:02X}\r\n".encode()


def final_of(lines: Path) -> set[str]:
    """Objects that were said to be final, of whole lines."""
    text = lines.read_text()
    features = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
    return {one["id"] for one in features if one["properties"].get("state") in ("final", "lost")}
