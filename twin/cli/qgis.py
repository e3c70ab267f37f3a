"""The command ``twin qgis``: how to open an export, what is in it, and how decisions come home."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.output import note, print_json, print_table

if TYPE_CHECKING:
    from twin.export.open_in_qgis import QgisExport


def qgis(
    folder: Annotated[
        Path, typer.Argument(help="The folder that twin export wrote to.", metavar="[FOLDER]")
    ] = Path("out"),
    start: Annotated[bool, typer.Option("--open", help="Start QGIS with it.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Say how to open an export in QGIS, what its layers are, and how decisions made there come back."""
    from twin.export.open_in_qgis import qgis_export, qgis_program, start_qgis

    found = qgis_export(folder)
    if not json_output:
        _print(found, folder)
    program = qgis_program() if start else "qgis"
    if json_output:
        print_json(
            {
                "file": str(found.file),
                "project": found.uri,
                "command": [program, *found.arguments],
                "layers": [
                    {"name": layer.name, "rows": layer.rows, "what": layer.what} for layer in found.layers
                ],
                "decisions": dict(found.decisions),
                "decided_in_qgis": dict(found.edited),
            }
        )
    if start:
        start_qgis(program, found)


def _print(found: QgisExport, folder: Path) -> None:
    from twin.export.qgis.project import PROJECT

    sys.stdout.write(f"Open it:\n  {shlex.join(['qgis', *found.arguments])}\n")
    if found.uri is None:
        note(f"It has no QGIS project: `twin export {folder} --project` puts one in.")
    else:
        note(f"or in QGIS: in the browser panel, the project {PROJECT} below the file {found.file.name}.")
    layers = [(layer.name, f"{layer.rows:,}", layer.what) for layer in found.layers]
    print_table(f"Layers of {found.file}", ["layer", "rows", "what"], layers, right_from=3)
    print_table("Decisions", ["decision", "findings"], list(found.decisions.items()))
    if found.edited:
        note(f"{len(found.edited)} decided in QGIS since the export: the next export brings them home.")
    again = f"twin export {folder}" + (" --project" if found.uri else "")
    note(
        "Decide in the column decision of the layer changes: accept, dismiss or defer; open takes a decision "
        f"back. Save the edits and close QGIS; then `{again}` keeps what was decided."
    )
