"""The body of ``twin inspect``: a drive folder in tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from twin.cli import EXIT_DATA
from twin.cli.output import note, print_json, print_pairs, print_table, steps, warn

if TYPE_CHECKING:
    from twin.drives.inspection.inspect import CameraSeen, Inspection

_MOST_FILES = 40
_MOST_SKIPPED = 20


def inspect(drive: Path, out: Path | None, json_output: bool) -> None:
    """``twin inspect``; leaves with the exit code of bad data where ``ingest-drive`` would refuse."""
    from twin.drives.inspection.inspect import inspect_drive
    from twin.drives.inspection.picture import draw_timeline

    with steps(quiet=json_output) as say:
        found = inspect_drive(drive, progress=say)
    picture = draw_timeline(found, out) if out is not None and found.sensors else None
    if json_output:
        print_json({**found.as_json(), "picture": None if picture is None else str(picture)})
    else:
        _print(found, out, picture)
    if not found.ready:
        raise typer.Exit(EXIT_DATA)


def _print(found: Inspection, out: Path | None, picture: Path | None) -> None:
    _print_files(found)
    _print_rig(found)
    _print_sensors(found)
    for skipped in found.skipped[:_MOST_SKIPPED]:
        note(f"left out: {skipped.count:,} {skipped.what} of {skipped.where}: {skipped.reason}")
    if len(found.skipped) > _MOST_SKIPPED:
        note(f"… and {len(found.skipped) - _MOST_SKIPPED} more; --json lists them all.")
    for warning in found.warnings:
        warn(warning)
    if picture is not None:
        note(f"wrote {picture}")
    elif out is not None:
        note(f"Nothing in {found.path} has a time, so there is no timeline to draw.")
    if found.ready:
        note(f"Ready: twin ingest-drive {found.path}")
    for refusal in found.refusals:
        note(f"twin ingest-drive would refuse: {refusal}")


def _print_files(found: Inspection) -> None:
    rows = [
        (
            file.name,
            f"{file.count:,}" if file.count > 1 else "",
            _size(file.size_bytes),
            file.kind,
            _used(file.used),
        )
        for file in found.files[:_MOST_FILES]
    ]
    print_table(f"{found.name}: files", ["file", "", "size", "what it is", "read"], rows)
    if len(found.files) > _MOST_FILES:
        note(f"… and {len(found.files) - _MOST_FILES} more files; --json lists them all.")


def _used(used: bool) -> str:
    return "yes" if used else ""


def _size(n_bytes: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n_bytes >= factor:
            return f"{n_bytes / factor:.1f} {unit}"
    return f"{n_bytes} B"


def _print_rig(found: Inspection) -> None:
    cameras = {camera.name: _camera(camera) for camera in found.cameras}
    antennas = {
        name: f"lever arm {x:g}, {y:g}, {z:g} m" if any((x, y, z)) else "lever arm all zero"
        for name, (x, y, z) in found.antennas.items()
    }
    print_pairs("Drive", {**found.settings, **cameras, **antennas})


def _camera(camera: CameraSeen) -> str:
    if camera.size_px is None:
        return camera.problem
    width, height = camera.size_px
    across = "" if camera.horizontal_fov_deg is None else f", {camera.horizontal_fov_deg:.0f}° across"
    return f"{camera.model}, {width} x {height}{across}"


def _print_sensors(found: Inspection) -> None:
    if not found.sensors:
        return
    from twin.drives.epochs import utc_text
    from twin.drives.inspection.picture import text_timeline, told

    first, last = min(s.first_ns for s in found.sensors), max(s.last_ns for s in found.sensors)
    lines = text_timeline(found.sensors)
    print_table(
        f"Sensors, {utc_text(first)} and {(last - first) / 1e9:.1f} s on",
        ["sensor", "", "timeline", "samples"],
        [(s.name, s.kind, line, told(s)) for s, line in zip(found.sensors, lines, strict=True)],
        right_from=4,
    )
