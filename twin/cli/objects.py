"""``twin objects``: what lies on the ground, beside signs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.drives import ErrorOption, LabelsOption, stated_errors
from twin.cli.mirror import DEFAULT_API, ApiOption
from twin.cli.options import ContactOption, JsonOption
from twin.cli.output import note, print_json, print_paths, print_table, steps, warn
from twin.errors import ConfigError

if TYPE_CHECKING:
    from twin.objects import Comparison, DriveObjects, NvdbObjects, ObjectsReport

app = typer.Typer()
_HIGHEST_TYPE = 9999

OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Write a GeoPackage (UTM33) and GeoJSON (WGS84) to this folder."),
]
NvdbOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TYPE[=FILE]",
        help="Compare with NVDB's objects of this type: from a file (GeoJSON, GeoPackage, an answer of API "
        "Les), else from API Les; may be repeated.",
    ),
]
NvdbSigmaOption = Annotated[
    float, typer.Option(min=0.0, help="One sigma of NVDB's positions, a horizontal axis, metres.")
]
AllDrawnOption = Annotated[
    bool,
    typer.Option(
        "--all-drawn", help="Every object of the compared types in view was drawn: only then one is missing."
    ),
]
ExampleOption = Annotated[
    bool, typer.Option("--example", help="Write a simulated drive with such objects to DRIVE, and leave.")
]


@app.command(
    "objects",
    epilog="Example: twin objects trial --example; twin objects trial --out found --nvdb 9=kerbs.gpkg",
)
def objects(
    drive: Annotated[Path, typer.Argument(help="The drive's folder.", metavar="DRIVE")],
    out: OutOption = None,
    nvdb: NvdbOption = None,
    nvdb_sigma: NvdbSigmaOption = 0.3,
    all_drawn: AllDrawnOption = False,
    error: ErrorOption = None,
    labels: LabelsOption = None,
    api_url: ApiOption = DEFAULT_API,
    contact: ContactOption = None,
    example: ExampleOption = False,
    json_output: JsonOption = False,
) -> None:
    """Locate what was drawn on the ground: damages, kerbs, guard rails, posts; compare it with NVDB.

    Labels that `labels.toml` calls `ground = true` are drawn as points, lines and polygons.
    """
    from twin.objects import compare, locate_objects, write_objects

    if example:
        _write_example(drive)
        return
    asked = [_type_and_file(text) for text in nvdb or []]
    with steps(quiet=json_output) as progress:
        found = locate_objects(drive, labels=labels, errors=stated_errors(error or []), progress=progress)
        known = _nvdb_objects(found, asked, api_url, contact)
        comparison = compare(found, known, nvdb_sigma_m=nvdb_sigma, all_drawn=all_drawn) if asked else None
        files = write_objects(found, out, comparison) if out is not None else []
    report = _report(found, comparison, files)
    for warning in report.warnings:
        warn(warning)
    if json_output:
        print_json(report)
        return
    _print(report)


def _write_example(folder: Path) -> None:
    from twin.errors import RefusedError
    from twin.samples.ground_objects import simulate_ground_objects

    if folder.is_dir() and any(folder.iterdir()):
        raise RefusedError(f"{folder} is not empty: name a new folder for the example.")
    print_paths("Simulated drive:", simulate_ground_objects(folder))
    note(f"Now: twin objects {folder} --out found --all-drawn --nvdb 9={folder / 'nvdb_9.geojson'}")


def _type_and_file(text: str) -> tuple[int, Path | None]:
    number, _, file = text.partition("=")
    if not number.strip().isdecimal() or not 0 < int(number) <= _HIGHEST_TYPE or ("=" in text and not file):
        raise ConfigError(f"--nvdb takes a type of NVDB and a file, 5=rails.geojson, but not {text:.80}.")
    return int(number), Path(file) if file else None


def _nvdb_objects(
    found: DriveObjects, asked: list[tuple[int, Path | None]], api_url: str, contact: str | None
) -> list[NvdbObjects]:
    from nvdb import NvdbClient
    from twin.objects import fetch_nvdb_objects, read_nvdb_objects

    known = []
    for nvdb_type, file in asked:
        if file is not None:
            known.append(read_nvdb_objects(file, nvdb_type))
            continue
        with NvdbClient(api_url, contact=contact) as client:
            known.append(fetch_nvdb_objects(client, nvdb_type, found.bounds_m()))
    return known


def _report(found: DriveObjects, comparison: Comparison | None, files: list[Path]) -> ObjectsReport:
    from twin.objects import ComparedRow, ObjectRow, ObjectsReport

    return ObjectsReport(
        drive=found.drive.name,
        n_drawn=found.n_drawn,
        objects=[ObjectRow.of(one) for one in found.objects],
        left_out=dict(found.left_out),
        compared=[ComparedRow.of(one) for one in comparison.rows] if comparison else [],
        nvdb_left_out=comparison.left_out if comparison else 0,
        nvdb_elsewhere=comparison.elsewhere if comparison else 0,
        warnings=list(found.warnings),
        files=[str(file) for file in files],
    )


def _print(report: ObjectsReport) -> None:
    print_table(
        f"Objects on the ground of {report.drive}: {len(report.objects)} from {report.n_drawn} drawings",
        ["label", "kind", "length m", "area m²", "sigma m", "nearest m", "drawn", "used"],
        [
            (
                *(one.label, one.kind),
                _measured(one.length_m, one.length_sigma_m) + ("" if one.is_whole else " or more"),
                _measured(one.area_m2, one.area_sigma_m2),
                *(one.sigma_major_m, one.range_min_m, one.n_drawn, one.n_used),
            )
            for one in report.objects
        ],
        right_from=2,
    )
    if report.compared:
        print_table(
            "Compared with NVDB",
            ["verdict", "type", "NVDB id", "distance m", "in NVDB", "in view", "found", "beyond m", "sigma"],
            [
                (
                    *(one.verdict, str(one.nvdb_type), one.nvdb_id or None, one.distance_m, one.nvdb_size),
                    *(one.seen_size, one.found_size, one.beyond_m, one.size_sigma),
                )
                for one in report.compared
            ],
            right_from=3,
        )
    if report.nvdb_left_out:
        note(f"{report.nvdb_left_out} objects of NVDB have no geometry of their own, and were not compared.")
    if report.nvdb_elsewhere:
        note(f"{report.nvdb_elsewhere:,} objects of NVDB lie more than 30 m from where the car drove.")
    if report.left_out:
        print_table("Left out", ["drawings", "count"], list(report.left_out.items()))
    if report.files:
        print_paths("Files:", report.files)


def _measured(value: float | None, sigma: float | None) -> str:
    return "–" if value is None else f"{value:.2f} ± {sigma or 0.0:.2f}"
