"""``twin calibrate coverage``: which pictures of the board are still missing."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.calibrate import BoardOption, EveryOption, SourcesArgument
from twin.cli.options import JsonOption
from twin.cli.output import bar, note, print_json, print_line, print_pairs

if TYPE_CHECKING:
    from twin.calibrate.coverage.look import CoverageReport

app = typer.Typer()
_LOOK_S = 1.0


@app.command(
    "coverage", epilog="Example: twin calibrate coverage pictures --board charuco:12x9:0.06:0.045 --watch"
)
def coverage(
    sources: SourcesArgument,
    board: BoardOption,
    plot: Annotated[
        Path | None, typer.Option(help="PNG, SVG or PDF: where boards were seen, and how tilted.")
    ] = None,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Follow a folder in which pictures arrive, until there are enough."),
    ] = False,
    every: EveryOption = None,
    json_output: JsonOption = False,
) -> None:
    """Say which views of the board are still missing, and what to do next."""
    from twin.calibrate.coverage.look import look_at
    from twin.calibrate.coverage.plots import draw_coverage
    from twin.errors import ConfigError
    from twin.store.figure_files import check_figure_name

    if plot is not None:
        check_figure_name(plot)
    if watch and json_output:
        raise ConfigError("--watch prints a line a picture, for a person: leave --json out.")
    if watch:
        _watch(sources, board, plot)
        return
    with bar(quiet=json_output) as progress:
        log, shown = look_at(sources, board, every, progress)
    report = log.report(shown)
    if plot is not None and log.size_px is not None:
        draw_coverage(shown, report, log.size_px, plot)
    if json_output:
        from dataclasses import asdict

        print_json({**asdict(report), "plot": None if plot is None else str(plot)})
        return
    _print(report)
    if plot is not None:
        note(f"wrote {plot}")
    if not report.missing:
        note(f"Next: twin calibrate intrinsics {sources[0]} --board {board} --out calibrated")


def _watch(sources: list[Path], board: str, plot: Path | None) -> None:
    from twin.calibrate.coverage.look import watch
    from twin.calibrate.coverage.plots import draw_coverage
    from twin.errors import ConfigError

    if len(sources) != 1:
        raise ConfigError("--watch follows one folder: name it alone.")
    note(f"Following {sources[0]}; Ctrl-C ends it.")
    for name, log, shown in watch(sources[0], board, lambda: time.sleep(_LOOK_S)):
        report = log.report(shown)
        seen = (
            "no board in it"
            if name in report.without_board
            else "blurred"
            if name in report.blurred
            else "ok"
        )
        print_line(f"{name}: {seen}. {_missing(report)} {next(iter(report.next), '')}")
        if plot is not None and log.size_px is not None:
            draw_coverage(shown, report, log.size_px, plot)
    note(f"Next: twin calibrate intrinsics {sources[0]} --board {board} --out calibrated")


def _print(report: CoverageReport) -> None:
    unused = {"no board in": report.without_board, "blurred": report.blurred}
    print_pairs(
        "Pictures of the board",
        {
            "pictures": f"{report.pictures} looked at, {report.boards} show the board, {report.alike} of "
            "them just as another does",
            **{what: ", ".join(names) for what, names in unused.items() if names},
            "covered": f"{report.part_of_the_image:.0%} of the picture",
            "boards over its ninths": "; ".join(
                " ".join(f"{zone:.1f}" for zone in row) for row in report.zone_views
            ),
            "tilted towards the camera": ", ".join(f"{tilt} side {n}" for tilt, n in report.tilts.items()),
            "size": ", ".join(f"{reach} {n}" for reach, n in report.reaches.items()),
            "turned by a quarter": report.turned,
        },
    )
    print_line(_missing(report))
    for hint in report.next:
        print_line(f"- {hint}")


def _missing(report: CoverageReport) -> str:
    return "These are enough." if not report.missing else f"About {report.missing} more."
