"""Positions of simulated drives against their truth: the paper's method, single frames, and the adjustment.

Usage: python benchmarks/accuracy.py [--seeds 20] [--markdown] [--as-stated [--rows NAME]]

Every row is one scenario, driven with many seeds of its own; all methods see the same recordings. A drive's
clock and mounting are drawn once and move all its signs, so that a row says less than its number of signs.
"Bound" is the Cramér-Rao bound: the median error that the best possible estimator has, which knows the size
of every error that the simulator draws; it is worked out at the true pixels. The last columns are the
adjustment's: NEES is the squared error over its variance, 1 where it is honest. Errors do not depend on the
machine; nothing here is a timing.

The yard of the rows that stand still is flatter than roads are. The last rows state that, as a person who has
measured a yard does (`twin ingest-drive --error`); the first rows take it for ground beside any road.

`--as-stated` asks another question: not whether covariances suit these roads and cars, but whether they are
right. Every error is then drawn as large as the budget and the priors say (`geoloc.simulation.as_stated`),
and NEES should be 1. Intervals (95 %) are of drawing the drives anew. Clocks, the heights of the antennas
against one another and mean crossfalls alone are not drawn but lie evenly (`spread_draws.py`).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from rich.progress import track
from spread_draws import evenly, taped

from geoloc.adjustment.adjust import adjust
from geoloc.adjustment.result import Adjusted
from geoloc.arrays import FloatArray, IntArray
from geoloc.association.associate import join_cameras
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.accuracy import nees
from geoloc.locate.combine import combine, ellipse
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.locate.single_frame import locate_paper, locate_single_frame
from geoloc.simulation.as_stated import CARRIER_PHASE, CODE, StatedFixes, as_stated
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.trajectory import GnssFixes, Trajectory, trajectory_from_gnss
from twin.cli.output import console, print_table

METHODS = ("paper", "single-frame", "adjusted")
AS_STATED_SEED = 50_000
HONEST = (0.75, 1.3)
"""Between these NEES / 2 and height NEES of a row should be."""
CHI2_95 = 5.991
"""95 % quantile of chi-square with two degrees of freedom."""
SEEDS_A_CASE = 1_000
"""Seeds of a case begin this far after those of the one before: no two rows share a clock or a mounting."""
WIDE = ("C3_tricam120",)
USUAL = ErrorBudget()
# A levelled yard: feet within a centimetre of its plane, which bends by 0.1° and falls by 0.3 % for the rain.
FLAT_YARD = replace(USUAL, ground_height_m=0.01, ground_slope_deg=0.1, ground_fall=0.003)
# Median of the length of a Gaussian error: exact for a circle (1.1774 σ), within 4 % for long ellipses.
_MEDIAN_OF_SIGMAS = 0.5887


@dataclass(frozen=True, slots=True)
class Case:
    """One row: what is driven, and the bars on the adjustment's median and 95th percentile, metres."""

    label: str
    scenario: str
    speeds_kmh: tuple[float | None, ...]
    bar_m: tuple[float, float | None]
    cameras: tuple[str, ...] | None = None
    antennas: int = 2
    object: int | None = None
    """Only this object counts."""
    drives: float = 1.0
    """Times the number of seeds."""
    minutes: float | None = None
    """Length of the drive; None for the scenario's own."""
    stated: ErrorBudget = USUAL
    """What is known of the errors beforehand."""
    fixes: StatedFixes = CARRIER_PHASE
    """As stated, of `run_as_stated` alone."""
    has_ids: bool = True
    """Whether all cameras number an object alike."""


CASES = (
    Case("standing still, 9.0 m", "still", (None,), (0.15, None), object=0, drives=2.5),
    Case("standing still, 11.8 m", "still", (None,), (0.20, None), object=1, drives=2.5),
    Case("standing still, 19.3 m", "still", (None,), (0.50, None), object=2, drives=2.5),
    Case("approach 15 to 6 m, 7-20 km/h", "approach", (7.0, 10.0, 15.0, 20.0), (0.10, 0.30), drives=6.0),
    Case("urban, 25 km/h", "urban", (25.0,), (0.10, 0.30)),
    Case("highway, 35 km/h", "highway", (35.0,), (0.12, 0.35)),
    Case("highway, 45 km/h", "highway", (45.0,), (0.12, 0.35)),
    Case("highway, 60 km/h", "highway", (60.0,), (0.12, 0.35)),
    Case("highway, 80 km/h", "highway", (80.0,), (0.15, 0.45)),
    Case("120° camera alone, urban", "urban", (25.0,), (0.20, 0.60), cameras=WIDE),
    Case("120° camera alone, highway 60", "highway", (60.0,), (0.20, 0.60), cameras=WIDE),
    Case("one antenna, urban", "urban", (25.0,), (0.25, 0.70), antennas=1),
    Case("one antenna, highway 60", "highway", (60.0,), (0.25, 0.70), antennas=1),
    Case("yard stated flat, 9.0 m", "still", (None,), (0.15, None), object=0, drives=2.5, stated=FLAT_YARD),
    Case("yard stated flat, 11.8 m", "still", (None,), (0.20, None), object=1, drives=2.5, stated=FLAT_YARD),
    Case("yard stated flat, 19.3 m", "still", (None,), (0.50, None), object=2, drives=2.5, stated=FLAT_YARD),
)

AS_STATED_CASES = (
    *CASES,
    Case("receiver of 2 m, urban", "urban", (25.0,), (0.0, None), antennas=1, drives=3.0, fixes=CODE),
    Case("receiver of 2 m, highway 60", "highway", (60.0,), (0.0, None), antennas=1, drives=3.0, fixes=CODE),
    Case("no ids, urban", "urban", (25.0,), (0.0, None), has_ids=False),
    Case("no ids, highway 60", "highway", (60.0,), (0.0, None), has_ids=False),
)
"""All poles of a drive share what a poor receiver is off: one drive is one draw of it."""


class Found(NamedTuple):
    """Positions of objects by one method: errors (g, 3) east, north and up, and their covariances.

    Single frames give no height: NaN.
    """

    offset_m: FloatArray
    covariance_m2: FloatArray
    """East and north, (g, 2, 2)."""
    sigma_height_m: FloatArray


class Recorded(NamedTuple):
    """A simulated drive as an estimator sees it."""

    drive: SimulatedDrive
    trajectory: Trajectory
    sightings: Sightings
    true_px: FloatArray
    object: IntArray
    epoch_ns: IntArray
    antennas: int
    stated: ErrorBudget = USUAL
    pole: IntArray | None = None
    """What each sighting shows, where `object` is what somebody found."""


def recorded(
    case: Case,
    speed_kmh: float | None,
    seed: int,
    *,
    stated: bool = False,
    leans: tuple[float, float] | None = None,
) -> Recorded:
    """Drive once; through a world whose errors are those stated, if so asked.

    Then `leans` are what the antennas' heights and the mean crossfall are off, in sigmas; None: drawn.
    """
    world = scenario(case.scenario, speed_kmh, seed, case.minutes)
    if stated:
        crossfall = None if leans is None else leans[1]
        world = as_stated(world, case.antennas, seed, case.stated, case.fixes, crossfall)
    drive = simulate_drive(world, seed)
    fixes = tuple(_of_quality(one, case.fixes) for one in drive.gnss[: case.antennas])
    arms = {one.antenna: drive.rig.antennas[one.antenna].rig_t_antenna_m for one in fixes}
    if leans is not None:
        arms = taped(arms, drive.drawn.lever_arm_m, leans[0])
    seen = drive.sightings
    keep = np.isin(seen.camera, case.cameras or drive.scenario.cameras)
    stamps = np.empty(seen.frame.size, dtype=np.int64)
    for camera in np.unique(seen.camera):
        rows = seen.camera == camera
        stamps[rows] = drive.frame_host_ns[str(camera)][seen.frame[rows]]
    return Recorded(
        drive,
        trajectory_from_gnss(fixes, arms),
        Sightings(seen.camera[keep], seen.pixel_px[keep]),
        seen.true_pixel_px[keep],
        seen.object_index[keep],
        stamps[keep],
        case.antennas,
        case.stated,
    )


def _of_quality(fixes: GnssFixes, noise: StatedFixes) -> GnssFixes:
    """Fixes with the quality that a receiver of this noise writes, and as late as it usually is."""
    if noise == CARRIER_PHASE:
        return fixes
    stamped_ns = fixes.epoch_ns + round(1e6 * noise.late_ms[0])
    return replace(fixes, quality=np.ones_like(fixes.quality), epoch_ns=stamped_ns)


def with_clock(recording: Recorded, sigmas: float) -> Recorded:
    """Stamp the frames of a drive with a clock that is off by so many of its sigmas."""
    drive = recording.drive
    offset_ms = sigmas * drive.scenario.noise.frame_offset_ms
    later_ns = round(1e6 * (offset_ms - drive.drawn.frame_offset_ms))
    drawn = replace(drive.drawn, frame_offset_ms=offset_ms)
    return recording._replace(drive=replace(drive, drawn=drawn), epoch_ns=recording.epoch_ns + later_ns)


def found_by(method: str, recording: Recorded) -> Found:
    """Positions by one method."""
    drive, trajectory, sightings, _, number, epoch, _, stated, _ = recording
    if method == "adjusted":
        adjusted = adjusted_of(recording, sightings, budget=stated)
        up = adjusted.height_m - drive.objects.height_m[adjusted.object]
        return _found(
            drive,
            adjusted.object,
            offsets(drive, adjusted.object, adjusted.latitude_deg, adjusted.longitude_deg),
            adjusted.covariance_m2,
            up,
            adjusted.sigma_height_m,
        )
    if method == "paper":
        located = locate_paper(
            drive.rig,
            sightings,
            trajectory.nearest_fix(epoch),
            fix_interval_s=trajectory.interval_s,
            delay_ms=trajectory.delay_ms()[0],
        )
    else:
        located = locate_single_frame(drive.rig, sightings, trajectory.poses_at(epoch), stated)
    combined = combine(located, number)
    plane = offsets(drive, combined.group, combined.latitude_deg, combined.longitude_deg)
    unknown = np.full(combined.group.size, np.nan)
    return _found(drive, combined.group, plane, combined.covariance_m2, unknown, unknown)


def _found(
    drive: SimulatedDrive,
    index: IntArray,
    plane_m: FloatArray,
    covariance_m2: FloatArray,
    up_m: FloatArray,
    sigma_height_m: FloatArray,
) -> Found:
    """Lay out what was found of some objects (`index`) as rows of all; `plane_m` already is."""
    count = len(drive.objects.object)
    whole = Found(
        np.column_stack([plane_m, np.full(count, np.nan)]),
        np.full((count, 2, 2), np.nan),
        np.full(count, np.nan),
    )
    whole.offset_m[index, 2] = up_m
    whole.covariance_m2[index], whole.sigma_height_m[index] = covariance_m2, sigma_height_m
    return whole


def adjusted_of(recording: Recorded, sightings: Sightings, **options: object) -> Adjusted:
    """Adjust a recording, all of whose sightings are feet."""
    feet = np.full(sightings.camera.size, Kind.FOOT)
    where = recording.object, recording.epoch_ns, recording.trajectory
    return adjust(
        Observations(recording.drive.rig, sightings, feet, *where),
        **options,  # type: ignore[arg-type]
    )


def bound_m(recording: Recorded) -> FloatArray:
    """Median error (g,) that the Cramér-Rao bound allows each object."""
    true = Sightings(recording.sightings.camera, recording.true_px)
    ideal = adjusted_of(recording, true, budget=_as_drawn(recording), noise=1.0)
    major, minor, _ = ellipse(ideal.covariance_m2)
    return _MEDIAN_OF_SIGMAS * (major + minor)


def _as_drawn(recording: Recorded) -> ErrorBudget:
    """The budget of someone who knows the simulator."""
    world = recording.drive.scenario
    noise, road, antennas = world.noise, world.road, recording.antennas
    kerbs = road.kerb_height_m * np.sqrt(road.kerb_share * (1.0 - road.kerb_share))
    return replace(
        ErrorBudget(),
        pixel_px=noise.annotation_px,
        pitch_jitter_deg=noise.pitch_jitter_deg,
        roll_jitter_deg=noise.roll_jitter_deg,
        ground_height_m=float(np.hypot(road.verge_sigma_m, kerbs)),
        boresight_deg=noise.boresight_deg,
        time_ms=noise.frame_offset_ms,
        lever_arm_m=float(np.hypot(noise.lever_arm_m / np.sqrt(antennas), noise.rig_origin_m)),
        camera_position_m=noise.camera_position_m,
    )


def offsets(drive: SimulatedDrive, index: IntArray, lat: FloatArray, lon: FloatArray) -> FloatArray:
    """Errors (g, 2) of all objects of a drive, east and north; NaN for those without a position."""
    truth = drive.objects
    offsets = np.full((len(truth.object), 2), np.nan)
    east, north = enu_offset(truth.latitude_deg[index], truth.longitude_deg[index], lat, lon)
    offsets[index] = np.stack([east, north], axis=1)
    return offsets


def run_case(case: Case, seeds: int) -> tuple[dict[str, list[Found]], FloatArray]:
    """All drives of a case: what each method found, and the bounds of all objects."""
    count = max(1, round(seeds * case.drives / len(case.speeds_kmh)))
    first = SEEDS_A_CASE * CASES.index(case)
    speeds = [speed for speed in case.speeds_kmh for _ in range(count)]
    drives = list(zip(speeds, range(first, first + len(speeds)), strict=True))
    found: dict[str, list[Found]] = {method: [] for method in METHODS}
    bounds = []
    for speed, seed in track(drives, description=case.label, console=console(stderr=True), transient=True):
        recording = recorded(case, speed, seed)
        chosen = slice(None) if case.object is None else slice(case.object, case.object + 1)
        for method in METHODS:
            one = found_by(method, recording)
            found[method].append(Found(*(column[chosen] for column in one)))
        bounds.append(bound_m(recording)[chosen])
    return found, np.concatenate(bounds)


def without_ids(recording: Recorded) -> Recorded:
    """Number the tracks of each camera by themselves, and join those that show one object."""
    seen = recording.sightings
    tracks = np.array([f"{c}:{o}" for c, o in zip(seen.camera, recording.object, strict=True)])
    feet = np.full(tracks.size, Kind.FOOT)
    number = np.unique(tracks, return_inverse=True)[1]
    where = recording.epoch_ns, recording.trajectory
    observations = Observations(recording.drive.rig, seen, feet, number, *where)
    codes = recording.drive.objects.skiltnummer[recording.object]
    joined = join_cameras(observations, codes, tracks, np.ones(tracks.size, dtype=np.bool_))
    return recording._replace(object=np.unique(joined, return_inverse=True)[1], pole=recording.object)


def _squares(recording: Recorded, only: int | None) -> tuple[FloatArray, FloatArray]:
    """Squared errors over their variances, in the plane and of heights, of one object or of all estimates.

    An estimate's truth is the pole that most of its sightings show.
    """
    found, truth = (
        adjusted_of(recording, recording.sightings, budget=recording.stated),
        recording.drive.objects,
    )
    shown = recording.object if recording.pole is None else recording.pole
    votes = np.zeros((recording.object.max() + 1, truth.object.size))
    np.add.at(votes, (recording.object, shown), 1)
    pole = votes.argmax(axis=1)[found.object]
    chosen = np.isfinite(found.latitude_deg) & ((pole == only) if only is not None else True)
    at = pole[chosen]
    place = found.latitude_deg[chosen], found.longitude_deg[chosen]
    off = np.stack(enu_offset(truth.latitude_deg[at], truth.longitude_deg[at], *place), axis=1)
    up = (found.height_m[chosen] - truth.height_m[at]) / found.sigma_height_m[chosen]
    return nees(off, found.covariance_m2[chosen]), up**2


def run_as_stated(case: Case, seeds: int) -> tuple[FloatArray, FloatArray]:
    """Mean NEES / 2 and height NEES of each drive ``(n,)`` whose errors are those that are stated."""
    count = max(1, round(seeds * case.drives))
    first = AS_STATED_SEED + SEEDS_A_CASE * AS_STATED_CASES.index(case)
    honest, clocks = np.full((2, count), np.nan), evenly(count)
    leans = np.stack([evenly(count, order) for order in (1, 2)], axis=1)
    for i in track(range(count), description=case.label, console=console(stderr=True), transient=True):
        speed = case.speeds_kmh[i % len(case.speeds_kmh)]
        driven = recorded(case, speed, first + i, stated=True, leans=(leans[i, 0], leans[i, 1]))
        recording = with_clock(driven, clocks[i])
        plane, up = _squares(recording if case.has_ids else without_ids(recording), case.object)
        if plane.size:
            honest[:, i] = np.mean(plane) / 2.0, np.mean(up)
    return honest[0], honest[1]


def _with_interval(of_drives: FloatArray) -> str:
    """Mean over drives, and its 95 % interval by drawing them anew."""
    values = of_drives[np.isfinite(of_drives)]
    again = np.random.default_rng(0).choice(values, (2000, values.size)).mean(axis=1)
    low, high = np.percentile(again, [2.5, 97.5])
    return f"{values.mean():.2f} [{low:.2f}, {high:.2f}]"


def show_as_stated(seeds: int, only: str, *, markdown: bool) -> None:
    """Print one row a case whose errors are drawn as stated, and whether it is within the bar."""
    rows: list[tuple[object, ...]] = []
    for case in (one for one in AS_STATED_CASES if only in one.label):
        plane, up = run_as_stated(case, seeds)
        met = ["yes" if HONEST[0] <= np.nanmean(one) <= HONEST[1] else "NO" for one in (plane, up)]
        rows.append((case.label, plane.size, _with_interval(plane), met[0], _with_interval(up), met[1]))
    header = ["case", "drives", "NEES / 2", "0.75-1.3", "height NEES", "0.75-1.3"]
    show("Errors drawn as they are stated", header, rows, markdown=markdown)


def _honesty(squares: FloatArray, height_squares: FloatArray) -> tuple[str, str, str]:
    """Share in the ellipse, NEES in the plane and of heights, which should be 0.75 to 1.3."""
    inside = np.mean(squares <= CHI2_95)
    return f"{inside:.0%}", f"{np.mean(squares) / 2.0:.2f}", f"{np.mean(height_squares):.2f}"


def show(title: str, header: Sequence[str], rows: Sequence[Sequence[object]], *, markdown: bool) -> None:
    """Print a table, for people or as it stands in the docs."""
    if not markdown:
        print_table(title, header, rows, right_from=1)
        return
    print("| " + " | ".join(header) + " |\n|" + "---|" * len(header))
    for row in rows:
        print("| " + " | ".join(map(str, row)) + " |")


def main() -> None:
    """Print one row a case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="drives a case (default 20)")
    parser.add_argument("--markdown", action="store_true", help="print a table for docs/accuracy.md")
    parser.add_argument(
        "--as-stated", action="store_true", help="errors as the budget states them: NEES alone"
    )
    parser.add_argument("--rows", default="", help="with --as-stated: only rows that have this in their name")
    options = parser.parse_args()
    if options.as_stated:
        show_as_stated(options.seeds, options.rows, markdown=options.markdown)
        return
    rows: list[tuple[object, ...]] = []
    squares: dict[str, list[FloatArray]] = {method: [] for method in METHODS}
    heights: list[FloatArray] = []
    for case in CASES:
        found, bounds = run_case(case, options.seeds)
        cells: list[str] = []
        for method in METHODS:
            of_all = Found(*(np.concatenate(column) for column in zip(*found[method], strict=True)))
            known = np.isfinite(of_all.offset_m[:, 0])
            error = np.hypot(*of_all.offset_m[known, :2].T)
            squares[method].append(nees(of_all.offset_m[known, :2], of_all.covariance_m2[known]))
            cells.append(f"{np.median(error):.2f} / {np.percentile(error, 95):.2f}")
        heights.append((of_all.offset_m[known, 2] / of_all.sigma_height_m[known]) ** 2)
        bar = f"{case.bar_m[0]:.2f}" + (f" / {case.bar_m[1]:.2f}" if case.bar_m[1] else "")
        honest = _honesty(squares["adjusted"][-1], heights[-1])
        rows.append((case.label, known.size, *cells, bar, f"{np.nanmedian(bounds):.2f}", *honest))
    whole = {method: np.concatenate(parts) for method, parts in squares.items()}
    share = [f"{np.mean(whole[method] <= CHI2_95):.0%}" for method in METHODS]
    last = _honesty(whole["adjusted"], np.concatenate(heights))
    rows.append(("truth inside the 95 % ellipse", whole["adjusted"].size, *share, "93-97%", "", *last))
    header = ["case", "objects", *METHODS, "bar", "bound", "in ellipse", "NEES / 2", "height NEES"]
    show("Horizontal error, median / 95th percentile [m]", header, rows, markdown=options.markdown)


if __name__ == "__main__":
    main()
