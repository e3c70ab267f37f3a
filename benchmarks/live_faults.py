"""What fails in a car, one fault after the other: the run goes on, says so, and loses nothing that was final.

Usage: python benchmarks/live_faults.py [CASE ...] [--seconds 60] [--speed 1]

Each case drives for so long with one fault in the middle third, in real time, through the loop of `twin live`
as sensors drive it: nothing waits. Of each it is asked that nothing fails, that the queue and the memory stay
bounded, that the fault is said in one sentence, and that all that was final stands in the file. SIGTERM,
SIGKILL and garbage are done to `twin live` as a process of its own.
"""

from __future__ import annotations

import argparse
import gc
import json
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
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

import numpy as np

from geoloc.live.samples import Fix
from twin.live import Arrival, Detection, Estimate, Frame, LiveEngine, LiveRun, RunSettings, State, played
from twin.live.keep import Keeper
from twin.live.notices import Notice, NoticeKind
from twin.live.ports import Said

Arrivals = Iterable[Arrival]
MOST_MB = 60.0
"""A run may grow by so much: the engine's window, the queues and the allocator's grain."""
WITHIN_S = 5.0
CHI2_95 = 5.991
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


class Case(NamedTuple):
    """A fault, and what is to be said of it."""

    fault: Callable[[Arrivals, Span], Iterator[Arrival]] | None
    said: frozenset[NoticeKind]
    sticks: bool = False


def _case(fault: Callable[[Arrivals, Span], Iterator[Arrival]] | None, *said: NoticeKind) -> Case:
    return Case(fault, frozenset(said))


CASES = {
    "nothing": _case(None),
    "lost GNSS": _case(
        without_fixes,
        NoticeKind.GNSS_LOST,
        NoticeKind.POSITION_LOST,
        NoticeKind.GNSS_BACK,
        NoticeKind.POSITION_BACK,
    ),
    "lost cameras": _case(without_camera, NoticeKind.CAMERA_LOST, NoticeKind.CAMERA_BACK),
    "GNSS clock +18 s": _case(lambda some, when: gnss_stepped(some, when, 18.0), NoticeKind.CLOCK_STEPPED),
    "GNSS clock -18 s": _case(lambda some, when: gnss_stepped(some, when, -18.0), NoticeKind.CLOCK_STEPPED),
    "host clock +1 h": _case(lambda some, when: host_stepped(some, when, 3600.0), NoticeKind.CLOCK_STEPPED),
    "host clock -1 h": _case(lambda some, when: host_stepped(some, when, -3600.0), NoticeKind.CLOCK_STEPPED),
    "late fixes": _case(late_fixes),
    "fixes out of order": _case(out_of_order),
    "spoilt frames": _case(spoilt, NoticeKind.REFUSED),
    "blocking sink": Case(None, frozenset({NoticeKind.SINK_BLOCKED, NoticeKind.SINK_BACK}), sticks=True),
}
_ALWAYS = {NoticeKind.FRAMES_DROPPED, NoticeKind.GNSS_LOST, NoticeKind.GNSS_BACK}
"""What may be said in any case: a machine that is busy with other work drops frames."""


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


def faults_of(outcome: Outcome, case: Case, settings: RunSettings) -> list[str]:
    """What is not as it should be."""
    said = {one.kind for one in outcome.notices}
    final = {one.id: one.state.value for one in outcome.heard.final if isinstance(one, Estimate)}
    last = outcome.run.last
    found = {
        f"not said: {', '.join(sorted(case.said - said))}": bool(case.said - said),
        f"said as well: {', '.join(sorted(said - case.said - _ALWAYS))}": bool(said - case.said - _ALWAYS),
        "not all that was final is in the file": outcome.kept != final,
        "some that was final did not reach the sink": sum(one.lost for one in last.sinks) > 0
        and not case.sticks,
        "the queue grew": outcome.queue > settings.queue,
        "memory grew": outcome.grown_mb > MOST_MB,
        f"twin failed at {last.faults} arrivals": last.faults > 0,
        "nothing was located": not any(state == State.FINAL.value for state in final.values()),
    }
    return [what for what, is_so in found.items() if is_so]


def resident_mb() -> float:
    """What the process has in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def run_case(name: str, seconds: float, speed: float) -> tuple[list[object], bool]:
    """One row of the table, and whether all is as it should be."""
    from live import arrivals, busy, car, errors

    case, settings = CASES[name], RunSettings()
    recording = busy(seconds / 60.0, 23.0)
    every = list(arrivals(recording))
    begin_ns = every[0].at_ns
    third_ns = (every[-1].at_ns - begin_ns) // 3
    when = Span(begin_ns + third_ns, begin_ns + 2 * third_ns)
    paced = played(every, speed)
    faulty = paced if case.fault is None else case.fault(paced, when)
    third_s = third_ns / _SECOND_NS / speed
    with tempfile.TemporaryDirectory() as folder:
        stuck_s = (third_s, 2.0 * third_s) if case.sticks else None
        outcome = drive_with(
            LiveEngine(car(recording)), faulty, Path(folder), settings=settings, stuck_s=stuck_s
        )
    wrong = faults_of(outcome, case, settings)
    final = [
        one
        for one in outcome.heard.final
        if isinstance(one, Estimate) and one.state is State.FINAL and one.object is not None
    ]
    off = errors(recording, final)
    row = [
        name,
        " ".join(dict.fromkeys(one.kind.value for one in outcome.notices)) or "–",
        len(final),
        f"{np.median(off.error_m):.3f} / {np.percentile(off.error_m, 95):.3f}",
        f"{np.mean(off.square <= CHI2_95):.0%}",
        outcome.queue,
        outcome.run.last.frames_dropped,
        f"{outcome.grown_mb:+.0f}",
        "yes" if not wrong else "NO: " + "; ".join(wrong),
    ]
    print(*row, sep=" | ", file=sys.stderr)
    return row, not wrong


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


def on_wires(name: str, seconds: float) -> tuple[list[object], bool]:
    """`twin live` as a process of its own on real sockets: garbage on each, then SIGTERM; or SIGKILL."""
    from twin.drives.read import read_drive
    from twin.live import arrivals_of, car_of
    from twin.samples.demo import sample_folder

    trip = sample_folder() / "trip_trondheim"
    drive = read_drive(trip)
    seconds = min(seconds, 44.0)
    number = signal.SIGKILL if name == "SIGKILL" else signal.SIGTERM
    with tempfile.TemporaryDirectory() as folder:
        keep, out = Path(folder) / "live.gpkg", Path(folder) / "live.geojsonl"
        wires = Wires(arrivals_of(drive), car_of(drive).antennas)
        options = ["--car", str(trip), "--record", f"{folder}/record", "--keep", str(keep), *wires.options()]
        with out.open("w") as lines:
            command = [sys.executable, "-m", "twin", "live", *options]
            process = subprocess.Popen(command, stdout=lines, stderr=subprocess.PIPE, text=True)
            try:
                time.sleep(seconds / 3.0)
                if name == "garbage":
                    wires.spoils.set()
                time.sleep(seconds / 3.0)
                wires.spoils.clear()
                time.sleep(seconds / 3.0 if name == "garbage" else 0.0)
                process.send_signal(number)
                began_s = time.monotonic()
                _, told = process.communicate(timeout=60.0)
                took_s = time.monotonic() - began_s
            finally:
                process.kill()
                wires.close()
        said, kept = final_of(out), kept_in(keep)
    missing = said - set(kept)
    is_kill = number == signal.SIGKILL
    # What was said to be final in the second before a kill may not be in the file yet.
    found = {
        f"exit code {process.returncode}": not is_kill and process.returncode != 0,
        f"it took {took_s:.1f} s": took_s > WITHIN_S,
        f"missing in the file: {', '.join(sorted(missing))}": len(missing) > (2 if is_kill else 0),
        "nothing was final": not kept,
        "garbage was not told of": name == "garbage" and "cannot be read" not in told,
        f"a traceback: {told[-200:]}": "Traceback" in told,
    }
    wrong = [what for what, is_so in found.items() if is_so]
    if wrong:
        print(told, file=sys.stderr)
    how = f"exit code {process.returncode} after {took_s:.1f} s"
    row = [name, how, len(kept), "", "", "", "", "", "yes" if not wrong else "NO: " + "; ".join(wrong)]
    print(*row, sep=" | ", file=sys.stderr)
    return row, not wrong


def final_of(lines: Path) -> set[str]:
    """Objects that were said to be final, of whole lines."""
    text = lines.read_text()
    features = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
    return {one["id"] for one in features if one["properties"].get("state") in ("final", "lost")}


def main() -> None:
    """Run the cases that were asked for; 1 if one is not as it should be."""
    from accuracy import show

    names = (*CASES, "garbage", "SIGTERM", "SIGKILL")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", nargs="*", help=f"of {', '.join(names)} (default: all)")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of each drive (default 60)")
    parser.add_argument("--speed", type=float, default=1.0, help="times as fast (default 1)")
    parser.add_argument("--markdown", action="store_true", help="print the table for docs/live.md")
    options = parser.parse_args()
    rows, fine = [], True
    for name in options.case or names:
        row, is_fine = (
            run_case(name, options.seconds, options.speed)
            if name in CASES
            else on_wires(name, options.seconds)
        )
        rows.append(row)
        fine &= is_fine
    header = [
        "fault",
        "said",
        "final",
        "error m",
        "in ellipse",
        "queue",
        "frames dropped",
        "MB",
        "as it should",
    ]
    show("Faults in the middle third of a drive", header, rows, markdown=options.markdown)
    sys.exit(not fine)


if __name__ == "__main__":
    main()
