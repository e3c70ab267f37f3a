"""``twin reproduce``: the paper's tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import EpsgOption, JsonOption, PaperOption, WithinOption, paper_asked
from twin.cli.output import note, print_json, print_paths, print_table, steps, warn
from twin.cli.samples import SeedOption

if TYPE_CHECKING:
    from twin.reproduce import Reproduction

app = typer.Typer()


@app.command(
    "reproduce",
    epilog="Example: twin reproduce.  Your own: twin reproduce slow fast --truth survey.csv",
)
def reproduce(
    trips: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Folders of recorded drives; without one, the paper's four experiments are simulated.",
            metavar="TRIP",
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(help="Surveyed positions of the trips, as for twin evaluate.", metavar="TRUTH.csv"),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Where tables and figures go: a new or an empty folder.", metavar="FOLDER")
    ] = Path("reproduced"),
    paper: PaperOption = None,
    seed: SeedOption = 1,
    epsg: EpsgOption = None,
    within: WithinOption = 5.0,
    json_output: JsonOption = False,
) -> None:
    """Make the paper's tables and figures anew: error against distance, by paper, single-frame, adjusted.

    Single pictures as the paper has them, and whole objects; trips past the same objects are slow and fast
    series of one figure. Tables also as CSV, figures as PNG and PDF. See twin help paper.
    """
    from twin.errors import ConfigError
    from twin.ingest.paper import told_readings
    from twin.reports.truth import read_truth
    from twin.reproduce import reproduce as run
    from twin.reproduce import reproduce_simulated, write_reproduction
    from twin.reproduce.files import check_folder

    check_folder(out)
    asked = paper_asked(paper or [])
    if (truth is None) == bool(trips):
        raise ConfigError(
            "Trips and their survey belong together: twin reproduce TRIP --truth TRUTH.csv; without both, "
            "the paper's experiments are simulated."
        )
    with steps(quiet=json_output) as progress:
        if trips and truth is not None:
            result = run(trips, read_truth(truth, epsg=epsg), paper=asked, within_m=within, progress=progress)
        else:
            result = reproduce_simulated(seed=seed, paper=asked, progress=progress)
        progress(f"drawing, and writing {out}")
        result = write_reproduction(result, out)
    for told in told_readings(asked):
        note(told)
    for warning in result.warnings:
        warn(warning)
    if json_output:
        tables = {name: [asdict(row) for row in getattr(result, name)] for name in _TITLES}
        print_json({**tables, "warnings": result.warnings, "files": [str(path) for path in result.files]})
        return
    _print(result)


_TITLES = {
    "standing": "Standing still (table 1): mean error of the pictures of one camera",
    "signs": "On the move (tables 2 and 3): the nearest picture of each object, and all together",
    "bands": "On the move (figures): errors by distance",
    "trends": "Trend lines of the figures: error = at 0 m + slope · distance",
}
_HEADS = {
    "object": "object", "distance_m": "at [m]", "frames": "pictures", "paper_m": "paper [m]",
    "single_frame_m": "single-frame [m]", "adjusted_m": "adjusted [m]", "published_m": "published [m]",
    "drive_id": "drive", "speed_kmh": "km/h", "paper_together_m": "paper, all [m]",
    "single_frame_together_m": "single-frame, all [m]", "from_m": "from [m]", "to_m": "to [m]",
    "median_m": "median [m]", "p95_m": "p95 [m]", "max_m": "max [m]", "at_0_m": "at 0 m [m]",
    "slope": "slope [m/m]", "kind": "of",
}  # fmt: skip


def _print(result: Reproduction) -> None:
    for name, title in _TITLES.items():
        rows: Sequence[object] = getattr(result, name)
        if rows:
            columns = [field.name for field in fields(rows[0])]  # type: ignore[arg-type]
            heads = [_HEADS.get(column, column) for column in columns]
            cells = [[getattr(row, column) for column in columns] for row in rows]
            print_table(title, heads, cells, right_from=3)
    print_paths("Written:", result.files)
    note("What the paper gives beside it, and how its text is read: twin help paper")
