"""``twin export`` and ``twin qgis``: what QGIS opens, and how decisions come home."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.cli.exit_codes import EXIT_DATA
from twin.cli.journal import manner
from twin.cli.options import (
    DEFAULT_SKRIV_API,
    DEFAULT_STORE,
    ByOption,
    JsonOption,
    LangOption,
    SkrivApiOption,
    StoreOption,
    person,
)
from twin.cli.output import note, print_json, print_paths, print_table, steps, warn
from twin.errors import to_type
from twin.store.kinds import Decision
from twin.words import Lang, say

if TYPE_CHECKING:
    from twin.changesets import ChangeSets
    from twin.export.open_in_qgis import QgisExport

app = typer.Typer()


class SetDecision(StrEnum):
    """Decisions whose findings an export turns into change sets."""

    ACCEPT = Decision.ACCEPT
    OPEN = Decision.OPEN


@app.command("export", epilog="Example: twin export out  (then twin qgis out)")
def export(
    folder: Annotated[Path, typer.Argument(help="Where to write; made if it does not exist.", metavar="DIR")],
    by: ByOption = None,
    decision: Annotated[
        SetDecision, typer.Option(help="accept: change sets to send. open: previews, of what is undecided.")
    ] = SetDecision.ACCEPT,
    project: Annotated[
        bool | None,
        typer.Option(
            "--project/--no-project",
            envvar="TWIN_PROJECT",
            help="With a QGIS project in twin_utm33.gpkg: see twin qgis.  [default: if one is there already]",
            show_default=False,
        ),
    ] = None,
    api_url: SkrivApiOption = DEFAULT_SKRIV_API,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Write the findings as GeoPackages (UTM33 and WGS84, styled for QGIS) and GeoJSON.

    Of a store that was never matched with NVDB: the positions with their error ellipses, and the drives.
    Accepted findings are also written as change sets for API Skriv, but for those that --api-url has already:
    see twin submit.
    """
    from twin.export import export_findings as write
    from twin.export.open_in_qgis import has_project
    from twin.store.store import Store

    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        progress("reading the store")  # before the layers' libraries, which take a second to load
        stood_there = has_project(folder)
        report = write(
            opened,
            folder,
            by=person(by, opened),
            decision=decision,
            project=stood_there if project is None else project,
            api_url=api_url,
            lang=lang,
            progress=progress,
        )
    if json_output:
        told = {
            "files": [str(path) for path in report.files],
            "method": report.method,
            "matched": report.matched,
            "unmasked_pictures": report.n_unmasked,
        }
        print_json({**told, **_change_sets_as_json(report.change_sets)})
    else:
        _print_export(report.files, folder, lang)
        if stood_there and not project:
            note(say(lang, "opening.project_kept" if project is None else "opening.project_gone"))
        note(say(lang, "exported.method", method=report.method))
        if not report.matched:
            note(say(lang, "exported.not_matched"))
        if report.n_unmasked:
            note(say(lang, "evidence.unmasked", n=report.n_unmasked))
        _print_change_sets(report.change_sets, folder, api_url, lang)
    if any(sett.errors for sett in report.change_sets.setts):
        raise typer.Exit(EXIT_DATA)


def _print_export(files: Sequence[Path], folder: Path, lang: Lang) -> None:
    from geoloc.earth.heights import nn2000_from_ellipsoidal

    if not manner.quiet:
        print_paths(say(lang, "exported.written"), files)
    note(say(lang, "exported.open", command=to_type("twin", "qgis", folder)))
    geoid = nn2000_from_ellipsoidal([], [], [])
    if math.isnan(geoid.sigma_m):
        note(geoid.how)


def _print_change_sets(change_sets: ChangeSets, folder: Path, api_url: str, lang: Lang) -> None:
    """Say what became of the findings: sets, warnings, what was left out."""
    from twin.changesets.left_out import left_out_sentence

    if change_sets.sent:
        told = left_out_sentence(list(change_sets.sent.values()))
        note(
            f"Of the change sets for {api_url}, {told}. `twin submit --go` finishes what is under way; "
            "--api-url names another API to export for."
        )
    for item in change_sets.left_out:
        warn(item.sentence)
    for number, sett in enumerate(change_sets.setts, start=1):
        for sentence in sett.warnings:
            note(say(lang, "exported.set_note", number=number, sentence=sentence))
        for sentence in sett.errors:
            warn(say(lang, "exported.set_not_written", number=number, sentence=sentence))
        for clause in sett.not_undone:
            note(say(lang, "exported.set_not_undone", number=number, clause=clause))
    n = sum(len(sett.groups) for sett in change_sets.setts if not sett.errors)
    if n and change_sets.is_preview:
        note(say(lang, "exported.previews", n=n))
    elif n:
        note(say(lang, "exported.submit", command=to_type("twin", "submit", folder)))


def _change_sets_as_json(change_sets: ChangeSets) -> dict[str, Any]:
    """The same for programs."""
    return {
        "errors": [sentence for sett in change_sets.setts for sentence in sett.errors],
        "left_out": {item.change_id: item.sentence for item in change_sets.left_out},
        "sent_before": {key: one.set_id for key, one in change_sets.sent.items()},
    }


@app.command("qgis", epilog="Example: twin qgis out   with QGIS started: twin qgis out --open")
def qgis(
    folder: Annotated[
        Path,
        typer.Argument(help="What twin export wrote: the folder, or its GeoPackage.", metavar="[FOLDER]"),
    ] = Path("out"),
    start: Annotated[bool, typer.Option("--open", help="Start QGIS with it.")] = False,
    lang: LangOption = Lang.EN,
    json_output: JsonOption = False,
) -> None:
    """Say how to open an export in QGIS, what its layers are, and how decisions made there come back."""
    from twin.export.open_in_qgis import qgis_export, qgis_program, start_qgis

    exported = qgis_export(folder, lang)
    folder = exported.file.parent
    if not json_output:
        _print(exported, folder, lang)
    program = qgis_program() if start else "qgis"
    if json_output:
        print_json(
            {
                "file": str(exported.file),
                "project": exported.uri,
                "command": [program, *exported.arguments],
                "layers": [
                    {"name": layer.name, "rows": layer.rows, "what": layer.what} for layer in exported.layers
                ],
                "decisions": dict(exported.decisions),
                "decided_in_qgis": dict(exported.edited),
            }
        )
    if start:
        start_qgis(program, exported)


def _print(exported: QgisExport, folder: Path, lang: Lang) -> None:
    from twin.export.qgis.project import PROJECT

    how = say(lang, "opening.how")
    sys.stdout.write(f"{how}\n  {to_type('qgis', *exported.arguments)}\n")
    if exported.uri is None:
        note(say(lang, "opening.no_project", command=to_type("twin", "export", folder, "--project")))
    else:
        note(say(lang, "opening.project", project=PROJECT, file=exported.file.name))
    layers = [(layer.name, f"{layer.rows:,}", layer.what) for layer in exported.layers]
    columns = ["opening.column.layer", "opening.column.rows", "opening.column.what"]
    title = say(lang, "opening.layers", file=str(exported.file))
    print_table(title, [say(lang, key) for key in columns], layers, right_from=3)
    if not any(layer.name == "changes" and layer.rows for layer in exported.layers):
        note(say(lang, "opening.no_findings"))
        return
    columns = ["opening.column.decision", "opening.column.findings"]
    decisions = list(exported.decisions.items())
    print_table(say(lang, "opening.decisions"), [say(lang, key) for key in columns], decisions)
    if exported.edited:
        note(say(lang, "opening.edited", n=len(exported.edited)))
    again = to_type("twin", "export", folder)
    note(say(lang, "opening.decide", again=again))
