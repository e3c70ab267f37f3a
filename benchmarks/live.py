"""The live engine against its bars: time a frame, memory, positions against the batch adjustment, replay.

Usage: OMP_NUM_THREADS=1 python benchmarks/live.py [PART ...] [--seeds 10] [--rows NAME] [--minutes 60]
       [--histogram FILE]

Parts: `positions` (urban and highway drives, through the engine and through the batch adjustment of the
same recording; on the simulator's roads, and with every error drawn as it is stated, where an ellipse should
hold 95 %), `latency` (three cameras at 30 frames a second with six signs in view in each), `memory` (a long
drive), `replay` (the sample as fast as it goes, against the same in real time). Times are of the processor,
on one core: the whole work since the frame before counts for a frame, that of fixes too.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from heapq import merge
from pathlib import Path
from typing import NamedTuple

import numpy as np
from accuracy import (
    AS_STATED_SEED,
    CASES,
    CHI2_95,
    SEEDS_A_CASE,
    USUAL,
    Case,
    Recorded,
    adjusted_of,
    offsets,
    recorded,
    show,
    with_clock,
)
from rich.progress import track
from spread_draws import evenly

from geoloc.arrays import FloatArray, IntArray
from geoloc.live.samples import Fix
from geoloc.locate.accuracy import nees
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.records import Kind
from geoloc.simulation.scenarios import PoleSpec
from geoloc.simulation.simulate import SimulatedDrive, SimulatedSightings, scenario, simulate_drive
from geoloc.trajectory.poses import GnssFixes
from twin.cli.output import console
from twin.drives.read import read_drive
from twin.live import Arrival, Detection, Estimate, Frame, LiveCar, LiveEngine, State, arrivals_of, car_of
from twin.live.features import line_of
from twin.live.replay import played
from twin.samples.demo import sample_folder

POSITIONS = ("urban, 25 km/h", "highway, 60 km/h", "highway, 80 km/h")
MEDIAN_RATIO, FINAL_SHARE, FIRST_SHARE = 1.5, (0.92, 0.98), (0.90, 0.99)
P50_MS, P99_MS, TIMES_REAL = 5.0, 33.0, 10.0
SIGNS_IN_VIEW = 6
GROWTH_MB = 5.0
"""A drive's second half may add so much to what its first took: the allocator's grain, not a leak."""


class Unfitted(NamedTuple):
    """A simulated drive without a trajectory: what `arrivals` takes of one."""

    drive: SimulatedDrive
    sightings: SimulatedSightings
    epoch_ns: IntArray
    antennas: int
    stated: ErrorBudget = USUAL


class Driven(NamedTuple):
    """Squared errors over variances, and errors in metres, of one way to locate the poles of a drive."""

    error_m: FloatArray
    square: FloatArray


def fixes_of(one: GnssFixes) -> Iterator[Arrival]:
    """Fixes of an antenna as they arrive."""
    columns = (one.epoch_ns, one.latitude_deg, one.longitude_deg, one.height_m, one.quality)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for at_ns, row in zip(np.maximum.accumulate(one.host_ns).tolist(), rows, strict=True):
        yield Arrival(at_ns, Fix(one.antenna, *row))


def frames_of(recording: Recorded | Unfitted, camera: str, most: int | None = None) -> Iterator[Arrival]:
    """Frames of one camera, those without a pole too."""
    drive, seen = recording.drive, recording.drive.sightings
    names, of_frame = drive.objects.object.tolist(), dict[int, list[Detection]]()
    mine = np.flatnonzero(np.isin(seen.camera, np.unique(recording.sightings.camera)))
    assert mine.size == recording.epoch_ns.size
    stamps = drive.frame_host_ns[camera] + clock_ns(recording)
    for row in mine[seen.camera[mine] == camera].tolist():
        pixel = tuple(seen.pixel_px[row].tolist())
        name = names[seen.object_index[row]]
        of_frame.setdefault(int(seen.frame[row]), []).append(Detection(pixel, Kind.FOOT, name))
    for number, stamp in enumerate(stamps.tolist()):
        yield Arrival(stamp, Frame(camera, number, stamp, tuple(of_frame.get(number, ())[:most])))


def clock_ns(recording: Recorded | Unfitted) -> int:
    """What `with_clock` added to the stamps."""
    drive, seen = recording.drive, recording.drive.sightings
    keep = np.flatnonzero(np.isin(seen.camera, np.unique(recording.sightings.camera)))[:1]
    if not keep.size:
        return 0
    row = int(keep[0])
    return int(recording.epoch_ns[0] - drive.frame_host_ns[str(seen.camera[row])][seen.frame[row]])


def arrivals(recording: Recorded | Unfitted, most: int | None = None) -> Iterator[Arrival]:
    """All that a simulated drive recorded, in the order in which it arrived."""
    cameras = np.unique(recording.sightings.camera).tolist()
    streams = [fixes_of(one) for one in recording.drive.gnss[: recording.antennas]]
    streams += [frames_of(recording, camera, most) for camera in cameras]
    return merge(*streams, key=lambda one: one.at_ns)


def car(recording: Recorded | Unfitted) -> LiveCar:
    """The car as its calibration has it."""
    names = tuple(one.antenna for one in recording.drive.gnss[: recording.antennas])
    return LiveCar(recording.drive.rig, names, recording.stated)


def driven(recording: Recorded) -> tuple[list[Estimate], list[Estimate]]:
    """First and final estimates of a drive by the engine."""
    engine, every = LiveEngine(car(recording)), list[Estimate]()
    for one in arrivals(recording):
        every += engine.feed(one)
    every += engine.finish()
    first, final = ([one for one in every if one.state is state] for state in (State.FIRST, State.FINAL))
    return first, final


def errors(recording: Recorded | Unfitted, estimates: Sequence[Estimate]) -> Driven:
    """Hold estimates against the truth."""
    names = recording.drive.objects.object.tolist()
    index = np.array([names.index(one.object) for one in estimates], dtype=np.int64)
    place = np.array([(one.latitude_deg, one.longitude_deg) for one in estimates]).reshape(-1, 2)
    off = offsets(recording.drive, index, *place.T)[index]
    covariance = np.array([one.covariance_m2 for one in estimates]).reshape(-1, 2, 2)
    return Driven(np.hypot(*off.T), nees(off, covariance))


def batch(recording: Recorded) -> Driven:
    """The same of the batch adjustment."""
    found = adjusted_of(recording, recording.sightings, budget=recording.stated)
    known = found.reason == ""
    off = offsets(recording.drive, found.object, found.latitude_deg, found.longitude_deg)[found.object][known]
    return Driven(np.hypot(*off.T), nees(off, found.covariance_m2[known]))


def name_of(case: Case, *, stated: bool) -> str:
    """What a row is called."""
    return f"{case.label}{', as stated' if stated else ''}"


def run_case(case: Case, seeds: int, *, stated: bool) -> tuple[list[object], bool]:
    """One row of the table, and whether it is within the bars."""
    parts: dict[str, list[Driven]] = {"batch": [], "live": [], "first": []}
    clocks = evenly(seeds)
    begin = (AS_STATED_SEED if stated else 0) + SEEDS_A_CASE * CASES.index(case)
    for i in track(range(seeds), description=case.label, console=console(stderr=True), transient=True):
        recording = recorded(case, case.speeds_kmh[0], begin + i, stated=stated)
        if stated:
            recording = with_clock(recording, clocks[i])
        first, final = driven(recording)
        parts["batch"].append(batch(recording))
        parts["live"].append(errors(recording, final))
        parts["first"].append(errors(recording, first))
    whole = {
        name: Driven(*(np.concatenate(column) for column in zip(*found, strict=True)))
        for name, found in parts.items()
    }
    median = {name: float(np.median(one.error_m)) for name, one in whole.items()}
    share = {name: float(np.mean(one.square <= CHI2_95)) for name, one in whole.items()}
    ratio = median["live"] / median["batch"]
    met = ratio <= MEDIAN_RATIO
    if stated:
        met &= FINAL_SHARE[0] <= share["live"] <= FINAL_SHARE[1]
        met &= FIRST_SHARE[0] <= share["first"] <= FIRST_SHARE[1]
    sizes = [f"{np.median(one.error_m):.3f} / {np.percentile(one.error_m, 95):.3f}" for one in whole.values()]
    row: list[object] = [
        name_of(case, stated=stated),
        f"{whole['live'].error_m.size} of {whole['batch'].error_m.size}",
        *sizes,
        f"{ratio:.2f}",
        *(f"{share[name]:.1%}" for name in ("batch", "live", "first")),
        "yes" if met else "NO",
    ]
    print(*row, sep=" | ", file=sys.stderr)
    return row, met


def positions(seeds: int, only: str, *, markdown: bool) -> bool:
    """Live against batch."""
    cases = [(case, stated) for stated in (True, False) for case in CASES if case.label in POSITIONS]
    rows = [
        run_case(case, seeds, stated=stated) for case, stated in cases if only in name_of(case, stated=stated)
    ]
    header = ["drive", "poles", "batch m", "live m", "first frame m", "live / batch"]
    header += ["in batch ellipse", "in live", "in first", "within bars"]
    show("Errors in the plane (median / 95 %)", header, [row for row, _ in rows], markdown=markdown)
    return all(met for _, met in rows)


def busy(minutes: float, poles_every_m: float, speed_kmh: float = 40.0) -> Unfitted:
    """Drive an urban road with poles on both sides, each frame of three cameras annotated."""
    world = scenario("urban", speed_kmh, 1, minutes)
    length_m = 60.0 * minutes * speed_kmh / 3.6
    stations = np.arange(35.0, length_m - 5.0, poles_every_m)
    poles = tuple(
        PoleSpec(f"P{i:05d}", "362.50", float(x), (-1.0) ** i * 5.0) for i, x in enumerate(stations)
    )
    drive = simulate_drive(replace(world, poles=poles, annotate_every=1), 1)
    seen = drive.sightings
    stamps = np.empty(seen.frame.size, dtype=np.int64)
    for camera in np.unique(seen.camera):
        rows = seen.camera == camera
        stamps[rows] = drive.frame_host_ns[str(camera)][seen.frame[rows]]
    return Unfitted(drive, seen, stamps, 2)


def timed(recording: Recorded | Unfitted, most: int | None = None) -> tuple[FloatArray, FloatArray]:
    """Milliseconds of processor time of each frame, and how many signs it shows."""
    engine, spent_ms, shown = LiveEngine(car(recording)), [], []
    for one in list(arrivals(recording, most)):
        began = time.process_time_ns()
        engine.feed(one)
        spent = (time.process_time_ns() - began) / 1e6
        if isinstance(one.what, Frame):
            spent_ms.append(spent)
            shown.append(len(one.what.detections))
        elif spent_ms:
            spent_ms[-1] += spent
    return np.array(spent_ms), np.array(shown)


def latency(histogram: Path | None) -> bool:
    """Three cameras, 30 frames a second, six signs in each frame."""
    spent_ms, shown = timed(busy(1.0, 5.0), SIGNS_IN_VIEW)
    known = np.arange(spent_ms.size) > 450
    spent_ms, shown = spent_ms[known], shown[known]
    p50, p99 = np.percentile(spent_ms, [50, 99])
    met = bool(p50 <= P50_MS and p99 <= P99_MS)
    print(
        f"latency: {spent_ms.size} frames with {shown.mean():.1f} signs each:"
        f" p50 {p50:.2f} ms, p90 {np.percentile(spent_ms, 90):.2f}, p99 {p99:.1f},"
        f" longest {spent_ms.max():.0f}; {spent_ms.sum() / (spent_ms.size / 90.0) / 10.0:.0f} % of a core"
        f" (bars {P50_MS:g} and {P99_MS:g}) {'yes' if met else 'NO'}"
    )
    edges = np.array([0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 33.0, 50.0, np.inf])
    counts = np.histogram(spent_ms, edges)[0]
    for low, high, count in zip(edges, edges[1:], counts, strict=False):
        print(f"  {low:5g} to {high:5g} ms {count:6d} {count / counts.sum():7.2%}")
    if histogram is not None:
        _drawn(spent_ms, histogram)
    return met


def _drawn(spent_ms: FloatArray, path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 3.2), layout="constrained")
    axes.hist(spent_ms, np.geomspace(0.005, 200.0, 60).tolist(), color="#33658a")
    axes.set(xscale="log", yscale="log", xlabel="processor time a frame, ms", ylabel="frames")
    for x, what in ((np.median(spent_ms), "p50"), (np.percentile(spent_ms, 99), "p99"), (33.3, "next frame")):
        axes.axvline(x, color="#c0392b", linewidth=1.0)
        axes.annotate(what, (x, 0.97), xycoords=("data", "axes fraction"), rotation=90, va="top", ha="right")
    figure.savefig(path)


def resident_mb() -> float:
    """What the process has in memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def memory(minutes: float) -> bool:
    """A long drive with as many poles as streets have."""
    recording = busy(minutes, 23.0)
    engine, marks = LiveEngine(car(recording)), list[float]()
    first_ns = None
    began = time.process_time()
    for one in arrivals(recording):
        engine.feed(one)
        first_ns = one.at_ns if first_ns is None else first_ns
        if one.at_ns - first_ns >= (len(marks) + 1) * 6e9 * minutes:
            marks.append(resident_mb())
            print(f"memory: {len(marks)}0 % of the drive, {marks[-1]:.0f} MB", file=sys.stderr, flush=True)
    grown = marks[-1] - marks[len(marks) // 2]
    print(
        f"memory: {minutes:g} minutes, {engine.sightings} sightings: {marks[0]:.0f} MB after a tenth,"
        f" {marks[len(marks) // 2]:.0f} half-way, {marks[-1]:.0f} at the end: {grown:+.1f} MB in the second"
        f" half; {60.0 * minutes / (time.process_time() - began):.0f} x real time"
        f" (bar {GROWTH_MB:g} MB) {'yes' if grown <= GROWTH_MB else 'NO'}"
    )
    return grown <= GROWTH_MB


def replay(*, real_time: bool) -> bool:
    """The sample as fast as it goes, and in real time."""
    drive = read_drive(sample_folder() / "trip_trondheim")
    lines: list[list[str]] = []
    spent_s = 0.0
    for speed in (None, 1.0 if real_time else 50.0):
        engine, found = LiveEngine(car_of(drive)), list[str]()
        began, last_ns, first_ns = time.process_time(), 0, 0
        for one in played(arrivals_of(drive), speed):
            found += [line_of(estimate) for estimate in engine.feed(one)]
            first_ns, last_ns = first_ns or one.at_ns, one.at_ns
        found += [line_of(estimate) for estimate in engine.finish()]
        lines.append(found)
        spent_s = spent_s or time.process_time() - began
    lasted_s = (last_ns - first_ns) / 1e9
    times = lasted_s / spent_s
    same = lines[0] == lines[1]
    met = same and times >= TIMES_REAL
    print(
        f"replay: {lasted_s:.0f} s of the sample in {spent_s:.1f} s, {times:.1f} x real time"
        f" (bar {TIMES_REAL:g}); {len(lines[0])} estimates, {'the same' if same else 'OTHERS'} when played"
        f" {'in real time' if real_time else '50 x'} {'yes' if met else 'NO'}"
    )
    return met


def main() -> None:
    """Run the parts that were asked for; 1 if one misses its bars."""
    parts = ("positions", "latency", "memory", "replay")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", nargs="*", help=f"of {', '.join(parts)} (default: all)")
    parser.add_argument("--seeds", type=int, default=10, help="drives a row (default 10)")
    parser.add_argument("--rows", default="", help="positions: only rows that have this in their name")
    parser.add_argument("--minutes", type=float, default=60.0, help="length of the long drive (default 60)")
    parser.add_argument("--histogram", type=Path, help="draw the latencies into this file")
    parser.add_argument("--markdown", action="store_true", help="print the table for docs/live.md")
    parser.add_argument("--real-time", action="store_true", help="play the sample at its own speed: 50 s")
    options = parser.parse_args()
    asked = options.part or parts
    met = []
    if "latency" in asked:
        met.append(latency(options.histogram))
    if "replay" in asked:
        met.append(replay(real_time=options.real_time))
    if "positions" in asked:
        met.append(positions(options.seeds, options.rows, markdown=options.markdown))
    if "memory" in asked:
        met.append(memory(options.minutes))
    raise SystemExit(0 if all(met) else 1)


if __name__ == "__main__":
    main()
