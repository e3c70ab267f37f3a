"""What fails in a car, one fault after the other: the run goes on, says so, and loses nothing that was final.

Usage: python benchmarks/live_faults.py [CASE ...] [--seconds 60] [--speed 1]

Each case drives for so long with one fault in the middle third, in real time, through the loop of `twin live`
as sensors drive it: nothing waits. Of each it is asked that nothing fails, that the queue and the memory stay
bounded, that the fault is said in one sentence, and that all that was final stands in the file. SIGTERM,
SIGKILL and garbage are done to `twin live` as a process of its own.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from live_faulty import (
    Arrivals,
    Outcome,
    Span,
    Wires,
    drive_with,
    final_of,
    gnss_stepped,
    host_stepped,
    kept_in,
    late_fixes,
    out_of_order,
    spoilt,
    without_camera,
    without_fixes,
)

from twin.live import Arrival, Estimate, LiveEngine, RunSettings, State, played
from twin.live.notices import NoticeKind

MOST_MB = 60.0
"""A run may grow by so much: the engine's window, the queues and the allocator's grain."""
WITHIN_S = 5.0
CHI2_95 = 5.991
_SECOND_NS = 1_000_000_000


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
