"""``twin live`` as a process: ended in order or killed, fed over sockets, and what it refuses."""

from __future__ import annotations

import fcntl
import json
import signal
import sqlite3
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import takewhile
from pathlib import Path
from typing import IO

import pytest
from command_line import Twin
from live_faulty import Wires, kept_in
from live_senders import until

from twin.drives.read import read_drive
from twin.live import arrivals_of, car_of
from twin.samples.demo import sample_folder

TRIP = sample_folder() / "trip_trondheim"


@contextmanager
def running(out: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Run ``twin live`` with standard output in a file."""
    with (
        out.open("w", encoding="utf-8") as lines,
        (out.parent / "err").open("w", encoding="utf-8") as errors,
    ):
        command = [sys.executable, "-m", "twin", "live", *options]
        process = subprocess.Popen(command, stdout=lines, stderr=errors, text=True)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def finals(out: Path) -> set[str]:
    """Objects said to be final, in whole lines."""
    text = out.read_text(encoding="utf-8")
    features = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
    return {one["id"] for one in features if one["properties"].get("state") in ("final", "lost")}


@pytest.mark.slow
def test_sigterm_ends_a_drive_in_order_and_a_kill_loses_nothing_that_was_written(tmp_path: Path) -> None:
    """First killed, then ended, with the same file: both runs stand in it, whole; exit code 0 for SIGTERM."""
    keep, first, second = tmp_path / "live.gpkg", tmp_path / "first", tmp_path / "second"
    options = ("--replay", str(TRIP), "--speed", "8", "--keep", str(keep))

    def written() -> set[str]:
        return set(kept_in(keep)) if keep.exists() else set()

    with running(first, *options) as process:
        until(lambda: keep.exists() and len(finals(first)) >= 2)
        known = finals(first)
        until(lambda: known <= written())
        process.kill()
        process.wait()
    assert known <= written() <= finals(first)
    with running(second, *options) as process:
        until(lambda: finals(second))
        process.send_signal(signal.SIGTERM)
        assert process.wait(15.0) == 0
    with closing(sqlite3.connect(keep)) as database:
        runs = database.execute("SELECT run, ended IS NOT NULL FROM runs").fetchall()
        of_second = {name for (name,) in database.execute("SELECT id FROM estimates WHERE run = 2")}
        assert known <= {name for (name,) in database.execute("SELECT id FROM estimates WHERE run = 1")}
    assert runs == [(1, 0), (2, 1)]
    assert of_second == finals(second)
    assert "objects located" in (tmp_path / "err").read_text(encoding="utf-8")


@pytest.mark.slow
def test_sigterm_ends_it_where_nobody_reads_standard_output() -> None:
    """A pipe that is full holds up a recorded drive, and not its end."""
    command = [sys.executable, "-m", "twin", "live", "--replay", str(TRIP), "--speed", "max"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            assert process.stdout is not None
            until(lambda: _waiting(process.stdout) >= _FULL)
            process.send_signal(signal.SIGTERM)
            assert process.wait(20.0) == 0
        finally:
            process.kill()


_FULL = 60_000
"""A pipe of Linux holds 65,536 bytes."""


def _waiting(pipe: IO[bytes]) -> int:
    """How many bytes a pipe holds."""
    answer = fcntl.ioctl(pipe.fileno(), termios.FIONREAD, b"\0" * 4)
    return int.from_bytes(answer, sys.byteorder)


@pytest.mark.slow
def test_a_car_on_sockets_is_located_whatever_else_is_sent(tmp_path: Path) -> None:
    """Fixes and detections with garbage between: it is told of, and what was open is final at the end."""
    drive = read_drive(TRIP)
    begin_ns = next(arrivals_of(drive)).at_ns
    some = takewhile(lambda one: one.at_ns < begin_ns + 30 * 10**9, arrivals_of(drive))
    out, record = tmp_path / "out", tmp_path / "record"
    wires = Wires(some, car_of(drive).antennas)
    wires.spoils.set()
    try:
        with running(out, "--car", str(TRIP), "--record", str(record), *wires.options()) as process:
            until(lambda: '"state": "refined"' in out.read_text(encoding="utf-8"))
            process.send_signal(signal.SIGTERM)
            assert process.wait(15.0) == 0
    finally:
        wires.close()
    kept = kept_in(record / "live.gpkg")
    assert set(kept) == finals(out)
    assert "final" in kept.values()
    told = (tmp_path / "err").read_text(encoding="utf-8")
    assert told.count("sends what cannot be read") >= 3
    assert "Traceback" not in told
    recorded = read_drive(record)
    assert {one.antenna for one in recorded.gnss} == set(car_of(drive).antennas)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ((), "twin live needs a drive"),
        (("--gnss", "tcp://127.0.0.1:1"), "twin live needs a drive"),
        (("--replay", "x", "--car", "y"), "leave out --gnss"),
        (("--replay", str(TRIP), "--detector", "nope.onnx"), "--record, --detector"),
        (("--replay", str(TRIP), "--to", "http://broker/topic"), "http:// is no address"),
        (("--replay", str(TRIP), "--to", "mqtt://broker/#"), "names no topic"),
        (("--replay", str(TRIP), "--serve", "nowhere"), "write HOST:PORT"),
        (("--replay", str(TRIP), "--speed", "0"), "--speed takes a number above 0"),
        (
            ("--gnss", "com3", "--detections", "x://y", "--serve", "x"),
            "(--gnss URL,|com3 is no|x:// is no|write HOST",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(twin: Twin, options: tuple[str, ...], sentence: str) -> None:
    """Exit code 2, and nothing is started; of several mistakes each is told."""
    answer = twin("live", *options)
    assert answer.code == 2
    assert [part for part in sentence.split("|") if part not in answer.err] == []


def test_a_run_that_cannot_begin_leaves_its_folder_to_the_next_one(twin: Twin, tmp_path: Path) -> None:
    """Where the store is missing, say: nothing was recorded yet."""
    record, store = tmp_path / "record", tmp_path / "none.db"
    options = ("--car", str(TRIP), "--gnss", "tcp://127.0.0.1:1?antenna=gnss50:vehicle", "--check")
    answer = twin("live", *options, "--store", str(store), "--record", str(record))
    assert answer.code == 4
    assert not list(record.iterdir())
