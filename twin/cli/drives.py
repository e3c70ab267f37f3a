"""``twin ingest-drive``, ``twin drives`` and ``twin inspect``: recorded drives."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.cost import CostOption, CostPerHourOption, CostPerKmOption, SecondsPerMarkOption, print_cost
from twin.cli.exit_codes import EXIT_DATA
from twin.cli.journal import manner
from twin.cli.made_store import made_store
from twin.cli.options import DEFAULT_STORE, JsonOption, PaperOption, StoreOption, paper_asked
from twin.cli.output import note, print_json, print_line, print_pairs, print_table, steps, warn
from twin.errors import to_type
from twin.store.kinds import Method

if TYPE_CHECKING:
    from geoloc.trajectory.vehicle_motion import MotionFound
    from twin.drives.inspection.inspect import CameraSeen, Inspection
    from twin.ingest import IngestReport
    from twin.reports.drive_list import DriveItem
    from twin.store.annotation_sets import AnnotationSet, NamedSet

app = typer.Typer()
_MOST_FILES = 40
_MOST_SKIPPED = 20


MethodOption = Annotated[
    Method,
    typer.Option(
        envvar="TWIN_METHOD",
        help="adjusted: all sightings together. single-frame: each by itself. paper: the baseline.",
    ),
]
TerrainOption = Annotated[
    Path | None,
    typer.Option(envvar="TWIN_TERRAIN", help="Ground raster (GeoTIFF) instead of the plane of the road."),
]
TerrainHeightsOption = Annotated[
    str | None,
    typer.Option(envvar="TWIN_TERRAIN_HEIGHTS", help="NN2000 or ellipsoidal, where the raster does not say."),
]
ErrorOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="One sigma of a term of the error budget, boresight_deg=0.1; may be repeated.",
    ),
]
LabelsOption = Annotated[
    Path | None,
    typer.Option(envvar="TWIN_LABELS", help="What labels mean, instead of the drive's labels.toml."),
]
DetectorOption = Annotated[
    Path | None,
    typer.Option(
        envvar="TWIN_DETECTOR", help="Find the signs by this network (ONNX) instead of annotations."
    ),
]
DetectorEveryOption = Annotated[
    int, typer.Option(min=1, envvar="TWIN_DETECTOR_EVERY", help="Run the detector on every so many frames.")
]
DetectorThresholdOption = Annotated[
    float,
    typer.Option(
        envvar="TWIN_DETECTOR_THRESHOLD", help="Lowest score of a box that counts, between 0 and 1."
    ),
]
ReplaceOption = Annotated[
    bool,
    typer.Option("--replace", help="Delete what the store has of other annotations of this recording."),
]


PartialOption = Annotated[
    bool,
    typer.Option("--partial", help="Take the drive although more than half of its annotations are left out."),
]


@app.command("ingest-drive", epilog="Example: twin ingest-drive data/trip_trondheim")
def ingest_drive(
    drive: Annotated[Path, typer.Argument(help="The drive's folder.", metavar="DRIVE")],
    method: MethodOption = Method.ADJUSTED,
    terrain: TerrainOption = None,
    terrain_heights: TerrainHeightsOption = None,
    error: ErrorOption = None,
    paper: PaperOption = None,
    labels: LabelsOption = None,
    detector: DetectorOption = None,
    detector_every: DetectorEveryOption = 1,
    detector_threshold: DetectorThresholdOption = 0.25,
    replace: ReplaceOption = False,
    partial: PartialOption = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Locate what was annotated in a recorded drive, and keep it in the store."""
    from twin.drives.detection.run import DetectorOptions
    from twin.ingest.ingest import ingest_drive as ingest

    with made_store(store) as opened, steps(quiet=json_output) as progress:
        report = ingest(
            opened,
            drive,
            method=method,
            terrain=terrain,
            terrain_heights=terrain_heights,
            errors=stated_errors(error or []),
            labels=labels,
            paper=paper_asked(paper or []),
            detector=DetectorOptions(detector, detector_every, detector_threshold) if detector else None,
            replace=replace,
            partial=partial,
            progress=progress,
        )
    for warning in report.warnings:
        warn(warning)
    if json_output:
        print_json(report)
        return
    if manner.quiet:
        told = f"{report.n_estimates:,} of {report.n_objects:,} objects located"
        print_line(f"Drive {report.name} ({report.drive_id}): {told}")
        return
    print_pairs(f"Drive {report.name}", _ingest_pairs(report))
    if report.skipped:
        print_table("Left out", ["what", "count"], list(report.skipped.items()))


def stated_errors(texts: list[str]) -> dict[str, float]:
    """Terms of the error budget by name."""
    from twin.errors import ConfigError

    errors = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            errors[name.strip()] = float(value)
        except ValueError:
            raise ConfigError(
                f"--error takes a name and a number, boresight_deg=0.1, but not {text:.80}."
            ) from None
    return errors


def _ingest_pairs(report: IngestReport) -> dict[str, object]:
    delay = None if report.delay_ms is None else f"{report.delay_ms:.1f} ms"
    return {
        "drive id": report.drive_id,
        "method": report.method,
        "length": f"{report.length_m:.0f} m",
        "GNSS host stamps late by (median)": delay,
        "GNSS fixes": ", ".join(f"{n:,} {quality}" for quality, n in report.fix_quality.items()) or None,
        "the car's own motion": None if report.motion is None else _motion_text(report.motion),
        "annotations": report.n_annotations,
        "sightings located": f"{report.n_located:,} of {report.n_sightings:,}",
        "objects located": f"{report.n_estimates:,} of {report.n_objects:,}",
    }


def _motion_text(motion: MotionFound) -> str:
    """What was found of the car's own sensors, in a clause each."""
    told = []
    if motion.wheel_scale is not None:
        told.append(f"wheels × {motion.wheel_scale.value:.4f} ± {motion.wheel_scale.sigma:.4f}")
    if motion.gyro_bias_radps is not None:
        bias = motion.gyro_bias_radps
        told.append(f"gyro {math.degrees(bias.value):+.3f} ± {math.degrees(bias.sigma):.3f} °/s")
    if motion.steering_offset_rad is not None:
        offset = motion.steering_offset_rad
        told.append(f"steering {math.degrees(offset.value):+.2f} ± {math.degrees(offset.sigma):.2f}°")
    told.append(f"{motion.bridged_s:.0f} s without fixes bridged")
    if not motion.turns_show:
        told.append("too few bends to check the sign and unit of turns")
    return ", ".join(told)


WordsArgument = Annotated[
    list[str] | None,
    typer.Argument(help="use, a drive's id or name, and a set's number.", metavar="use DRIVE N"),
]


@app.command(
    "drives", epilog="Example: twin drives.  Let an earlier set count: twin drives use trip_trondheim 1"
)
def drives(
    words: WordsArgument = None,
    cost: CostOption = False,
    cost_per_km: CostPerKmOption = None,
    cost_per_hour: CostPerHourOption = None,
    seconds_per_mark: SecondsPerMarkOption = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """List the store's drives: when, how long, what is to decide; `use` lets other annotations count.

    Other annotations of a recording that the store has are a set of their own. The newest complete one counts
    in matches, exports and reports; what came of the others is kept.
    """
    from twin.errors import ConfigError
    from twin.reports.cost import Rates, cost_of
    from twin.reports.drive_list import list_drives
    from twin.store.annotation_sets import all_annotation_sets, use_annotation_set
    from twin.store.store import Store

    verb, *asked = words or ["list"]
    if words and (verb != "use" or len(asked) != 2 or not asked[1].isdecimal()):
        raise ConfigError(
            "`twin drives` stands alone, or with use, a drive and the number of one of its annotation sets: "
            "twin drives use trip_trondheim 1."
        )
    with Store.open(store, create=False) as opened:
        changed = use_annotation_set(opened, asked[0], int(asked[1])) if words else None
        sets, items = all_annotation_sets(opened), list_drives(opened)
    rates = Rates(cost_per_km, cost_per_hour, seconds_per_mark)
    if json_output:
        of_drive = {
            item.drive_id: {**_as_json(item), "cost": asdict(cost_of([item], rates)) if cost else None}
            for item in items
        }
        print_json(
            [
                {"drive": one.drive, **of_drive[one.annotation_set.drive_id], **asdict(one.annotation_set)}
                for one in sets
            ]
        )
        return
    if cost:
        print_cost(items, rates)
        return
    folders = {
        s.annotation_set.drive_id: s.annotation_set.folder for s in sets if s.annotation_set.is_current
    }
    print_table("Drives", _DRIVE_COLUMNS, [_drive_row(item) for item in items], right_from=3)
    for item in items:
        folder = folders.get(item.drive_id) or "a folder that the store does not know"
        note(f"{item.name} was read from {folder}.")
        if item.doubt:
            warn(f"{item.name}: {item.doubt}")
    if len(sets) > len(items):
        print_table("Annotation sets", _SET_COLUMNS, [_set_row(one) for one in sets])
    if changed is not None:
        note(_change(*changed))


_DRIVE_COLUMNS = (
    "drive", "id", "began (UTC)", "length", "annotations", "complete", "objects", "findings", "to decide",
)  # fmt: skip


def _drive_row(item: DriveItem) -> tuple[object, ...]:
    best = next((item.n_objects[method] for method in Method if method in item.n_objects), 0)
    return (
        *(item.name, item.drive_id, f"{item.started:%Y-%m-%d %H:%M}", f"{item.length_m / 1000:.1f} km"),
        *(item.n_annotations, "yes" if item.is_complete else "no", best),
        *((item.n_findings, item.n_open) if item.is_matched else ("not matched", None)),
    )


def _as_json(item: DriveItem) -> dict[str, object]:
    times = {name: f"{getattr(item, name):%Y-%m-%dT%H:%M:%SZ}" for name in ("started", "ended")}
    names = ("length_m", "is_matched", "n_findings", "n_open", "doubt")
    return {**times, **{name: getattr(item, name) for name in names}, "objects": dict(item.n_objects)}


_SET_COLUMNS = (
    "drive", "id", "folder", "read", "set", "counts", "complete", "annotations", "sightings", "objects",
)  # fmt: skip


def _set_row(named: NamedSet) -> tuple[object, ...]:
    one = named.annotation_set
    return (
        *(named.drive, one.drive_id, one.folder or None, one.read_at, one.number),
        *("yes" if one.is_current else "no", "yes" if one.is_complete else "no"),
        *(one.n_annotations, one.n_sightings, one.n_objects),
    )


def _change(before: AnnotationSet, now: AnnotationSet) -> str:
    if before.number == now.number:
        return f"Set {now.number} counts already: nothing was changed."
    return (
        f"Set {now.number} counts now ({now.n_objects} objects), set {before.number} is kept "
        f"({before.n_objects} objects): run `twin match` again."
    )


@app.command("inspect", epilog="Example: twin inspect path/to/trip --out timeline.png")
def inspect(
    drive: Annotated[Path, typer.Argument(help="A folder with a recorded drive.", metavar="DRIVE")],
    out: Annotated[Path | None, typer.Option(help="PNG, SVG or PDF of all sensors in time.")] = None,
    json_output: JsonOption = False,
) -> None:
    """Show what a drive folder holds: files, sensors on one timeline, gaps, delays, and what is missing."""
    from twin.drives.inspection.inspect import inspect_drive
    from twin.drives.inspection.picture import draw_timeline

    with steps(quiet=json_output) as say:
        inspection = inspect_drive(drive, progress=say)
    picture = draw_timeline(inspection, out) if out is not None and inspection.sensors else None
    if json_output:
        print_json({**inspection.as_json(), "picture": None if picture is None else str(picture)})
    else:
        _print(inspection, out, picture)
    if not inspection.ready:
        raise typer.Exit(EXIT_DATA)


@app.command("trajectory", epilog="Example: twin trajectory path/to/trip --out poses.csv")
def trajectory(
    drive: Annotated[Path, typer.Argument(help="A folder with a recorded drive.", metavar="DRIVE")],
    out: Annotated[
        Path,
        typer.Option(
            help="A name that ends with .csv (as poses.csv of a drive folder) or .gpkg (a GeoPackage).",
            metavar="FILE",
        ),
    ],
    json_output: JsonOption = False,
) -> None:
    """Write a drive's smoothed trajectory: a pose of the car at each recorded epoch, with its sigmas.

    It is what ingest-drive works on, before the adjustment; no store and no annotations are needed.
    """
    import numpy as np

    from twin.drives.epochs import utc_text
    from twin.drives.track.formats.poses_csv import write_poses
    from twin.errors import ConfigError, RefusedError
    from twin.export.poses import write_poses_geopackage
    from twin.ingest.trajectory import smoothed_poses
    from twin.store.atomic_files import replace_file

    if out.suffix.lower() not in (".csv", ".gpkg"):
        raise ConfigError(f"{out} ends with neither .csv nor .gpkg, the formats of a trajectory: name it so.")
    if out.resolve().is_relative_to(drive.resolve()):
        raise RefusedError(f"{out} lies in the drive's folder, and would be its recording: name another.")
    with steps(quiet=json_output) as say:
        poses, warnings = smoothed_poses(drive, progress=say)
    if out.suffix.lower() == ".gpkg":
        write_poses_geopackage(poses, out)
    else:
        replace_file(out, write_poses(poses))
    for warning in warnings:
        warn(warning)
    first_ns, last_ns = int(poses.epoch_ns[0]), int(poses.epoch_ns[-1])
    sigmas = {
        name: float(np.median(getattr(poses, name)))
        for name in ("sigma_horizontal_m", "sigma_vertical_m", "sigma_heading_deg")
    }
    if json_output:
        told = {"file": str(out), "poses": len(poses.epoch_ns), "first_ns": first_ns, "last_ns": last_ns}
        print_json({**told, "median": sigmas, "warnings": list(warnings)})
        return
    medians = {f"median {name}": f"{value:.3f}" for name, value in sigmas.items()}
    when = f"{utc_text(first_ns)} and {(last_ns - first_ns) / 1e9:.1f} s on"
    print_pairs(f"Trajectory {out}", {"poses": len(poses.epoch_ns), "from": when, **medians})


def _print(inspection: Inspection, out: Path | None, picture: Path | None) -> None:
    _print_files(inspection)
    _print_rig(inspection)
    _print_sensors(inspection)
    for skipped in inspection.skipped[:_MOST_SKIPPED]:
        note(f"left out: {skipped.count:,} {skipped.what} of {skipped.where}: {skipped.reason}")
    if len(inspection.skipped) > _MOST_SKIPPED:
        note(f"… and {len(inspection.skipped) - _MOST_SKIPPED} more; --json lists them all.")
    for warning in inspection.warnings:
        warn(warning)
    if picture is not None:
        note(f"wrote {picture}")
    elif out is not None:
        note(f"Nothing in {inspection.path} has a time, so there is no timeline to draw.")
    if inspection.ready:
        note(f"Ready: {to_type('twin', 'ingest-drive', inspection.path)}")
    for refusal in inspection.refusals:
        note(f"twin ingest-drive would refuse: {refusal}")


def _print_files(inspection: Inspection) -> None:
    rows = [
        (
            file.name,
            f"{file.count:,}" if file.count > 1 else "",
            _size(file.size_bytes),
            file.kind,
            _used(file.used),
        )
        for file in inspection.files[:_MOST_FILES]
    ]
    print_table(f"{inspection.name}: files", ["file", "", "size", "what it is", "read"], rows)
    if len(inspection.files) > _MOST_FILES:
        note(f"… and {len(inspection.files) - _MOST_FILES} more files; --json lists them all.")


def _used(used: bool) -> str:
    return "yes" if used else ""


def _size(n_bytes: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n_bytes >= factor:
            return f"{n_bytes / factor:.1f} {unit}"
    return f"{n_bytes} B"


def _print_rig(inspection: Inspection) -> None:
    cameras = {camera.name: _camera(camera) for camera in inspection.cameras}
    antennas = {
        name: f"lever arm {x:g}, {y:g}, {z:g} m" if any((x, y, z)) else "lever arm all zero"
        for name, (x, y, z) in inspection.antennas.items()
    }
    print_pairs("Drive", {**inspection.settings, **cameras, **antennas})


def _camera(camera: CameraSeen) -> str:
    if camera.size_px is None:
        return camera.problem
    width, height = camera.size_px
    across = "" if camera.horizontal_fov_deg is None else f", {camera.horizontal_fov_deg:.0f}° across"
    return f"{camera.model}, {width} x {height}{across}"


def _print_sensors(inspection: Inspection) -> None:
    if not inspection.sensors:
        return
    from twin.drives.epochs import utc_text
    from twin.drives.inspection.picture import text_timeline, told

    first, last = min(s.first_ns for s in inspection.sensors), max(s.last_ns for s in inspection.sensors)
    lines = text_timeline(inspection.sensors)
    print_table(
        f"Sensors, {utc_text(first)} and {(last - first) / 1e9:.1f} s on",
        ["sensor", "", "timeline", "samples"],
        [(s.name, s.kind, line, told(s)) for s, line in zip(inspection.sensors, lines, strict=True)],
        right_from=4,
    )
