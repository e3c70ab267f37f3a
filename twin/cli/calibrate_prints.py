"""``twin calibrate print-board``, ``print-tags`` and ``print-yard``: what a calibration needs on paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from twin.cli.options import JsonOption
from twin.cli.output import note, print_json, print_paths

app = typer.Typer()
_LARGEST_M = 1.0
PageOption = Annotated[
    str | None,
    typer.Option(help="A4, A3, A2, A1 or A0; else the smallest that it fits on."),
]
SizeOption = Annotated[
    float, typer.Option(min=0.02, max=_LARGEST_M, help="Edge of the tags' black squares, metres.")
]


@app.command(
    "print-board", epilog="Example: twin calibrate print-board charuco:12x9:0.06:0.045 --out board.pdf"
)
def print_board(
    board: Annotated[
        str,
        typer.Argument(
            help="As --board of intrinsics: charuco:12x9:0.06:0.045 or checkerboard:9x6:0.08.",
            metavar="BOARD",
        ),
    ],
    out: Annotated[Path, typer.Option(help="PDF to write.")] = Path("board.pdf"),
    page: PageOption = None,
    json_output: JsonOption = False,
) -> None:
    """Write a board for `intrinsics` as PDF at true scale, with rulers to check the print."""
    from twin.calibrate.prints.boards import board_pdf
    from twin.calibrate.prints.write import write_print

    _done([write_print(out, board_pdf(board, page))], json_output)
    if not json_output:
        note(f"Next: take pictures, and twin calibrate coverage PICTURES --board {board}")


@app.command(
    "print-tags", epilog="Example: twin calibrate print-tags 0-19 --size 0.16 --page A4 --out tags.pdf"
)
def print_tags(
    ids: Annotated[str, typer.Argument(help="0-19 or 1,2,30-35: 0 to 586.", metavar="IDS")],
    size: SizeOption = 0.16,
    out: Annotated[Path, typer.Option(help="PDF to write, a tag a page.")] = Path("tags.pdf"),
    page: PageOption = None,
    json_output: JsonOption = False,
) -> None:
    """Write AprilTags (36h11) for `extrinsics` as PDF at true scale."""
    from twin.calibrate.prints.tags import ids_from_text, tags_pdf
    from twin.calibrate.prints.write import write_print

    _done([write_print(out, tags_pdf(ids_from_text(ids), size, page))], json_output)


@app.command("print-yard", epilog="Example: twin calibrate print-yard rig.json --size 0.3 --out yard")
def print_yard(
    rig: Annotated[
        Path,
        typer.Argument(
            help="Rig file or drive with the cameras' intrinsics and rough places.", metavar="RIG"
        ),
    ],
    size: SizeOption = 0.3,
    out: Annotated[Path, typer.Option(help="Folder for plan.pdf, tags.pdf and layout.toml.")] = Path("yard"),
    page: PageOption = None,
    json_output: JsonOption = False,
) -> None:
    """Plan where to stand tags around the car: a drawing, a table to fill in, the tags, a layout.toml."""
    from twin.calibrate.prints.yard_plan import write_yard_plan

    files, n_tags = write_yard_plan(rig, out, size, page)
    _done(files, json_output)
    if not json_output:
        note(f"{n_tags} tags of {size:g} m: measure their middles, and complete {files[-1]}.")
        note(f"Next: twin calibrate extrinsics PICTURES --tags {files[-1]} --rig {rig}")


def _done(files: list[Path], json_output: bool) -> None:
    if json_output:
        print_json({"files": [str(file) for file in files]})
        return
    print_paths("Written:", files)
