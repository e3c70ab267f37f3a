"""``twin findings``: the findings of the last match, chosen, sorted, page by page, or as a file."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.findings import (
    MOST_SHOWN,
    AreaOption,
    ClassOption,
    DriveOption,
    SinceOption,
    UntilOption,
)
from twin.cli.options import (
    DEFAULT_STORE,
    ExcelOption,
    JsonOption,
    LangOption,
    StoreOption,
    need_csv,
    need_place,
)
from twin.cli.output import note, print_json, print_table, warn
from twin.errors import ConfigError
from twin.reports.orders import Order
from twin.store.kinds import Decision, Verdict
from twin.words import Lang, chance_text, decision_title, say, verdict_title

if TYPE_CHECKING:
    from collections.abc import Sequence

    from twin.reports.finding_list import FindingList, FindingRow

app = typer.Typer()
_STDOUT = Path("-")
VerdictsOption = Annotated[
    list[Verdict] | None,
    typer.Option("--verdict", help="Findings of this verdict.  [default: all that ask for a decision]"),
]
StatesOption = Annotated[
    list[Decision] | None,
    typer.Option("--state", help="Findings that are now so decided.  [default: every]"),
]
RoadOption = Annotated[
    str, typer.Option(help="On this road: FV6680, 'FV6680 S1D1', or a street's name.", show_default=False)
]
KommuneOption = Annotated[list[int] | None, typer.Option(help="In this kommune: 5001.")]
MinOption = Annotated[float, typer.Option("--min-confidence", min=0, max=1, help="At least so sure: 0.9.")]
MaxOption = Annotated[float, typer.Option("--max-confidence", min=0, max=1, help="At most so sure.")]
TextOption = Annotated[
    str, typer.Option(help="With this in id, sign, road, street, drive or reason.", show_default=False)
]
NewOption = Annotated[bool, typer.Option("--new", help="Only what is new since the match before the last.")]
SortOption = Annotated[Order, typer.Option(help="What stands first.")]
ReverseOption = Annotated[bool, typer.Option("--reverse", help="The other way round.")]
LimitOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        help=f"Findings of a page.  [default: {MOST_SHOWN} on a terminal, else all]",
        show_default=False,
    ),
]
PageOption = Annotated[int, typer.Option(min=1, help="Which page.")]
IdsOption = Annotated[bool, typer.Option("--ids", help="Print the change ids alone, a line each.")]
CsvOption = Annotated[
    Path | None,
    typer.Option("--csv", help="Write them as CSV; - is standard output.", metavar="FILE.csv"),
]
XlsxOption = Annotated[
    Path | None, typer.Option("--xlsx", help="Write them as an Excel workbook.", metavar="FILE.xlsx")
]
GeojsonOption = Annotated[
    Path | None,
    typer.Option("--geojson", help="Write them as points (WGS84); - is standard output.", metavar="FILE"),
]


@app.command(
    "findings",
    epilog="Example: twin findings --state open --sort road.  For Excel: twin findings --xlsx findings.xlsx."
    "  Decide what is listed: twin decide accept $(twin findings --verdict new --min-confidence 0.99 --ids)",
)
def findings(
    verdict: VerdictsOption = None,
    state: StatesOption = None,
    drive: DriveOption = None,
    road: RoadOption = "",
    kommune: KommuneOption = None,
    sign_class: ClassOption = None,
    area: AreaOption = None,
    since: SinceOption = None,
    until: UntilOption = None,
    min_confidence: MinOption = 0.0,
    max_confidence: MaxOption = 1.0,
    text: TextOption = "",
    new: NewOption = False,
    sort: SortOption = Order.VERDICT,
    reverse: ReverseOption = False,
    limit: LimitOption = None,
    page: PageOption = 1,
    ids: IdsOption = False,
    csv: CsvOption = None,
    xlsx: XlsxOption = None,
    geojson: GeojsonOption = None,
    excel: ExcelOption = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """List the findings of the last match: filter, sort, page, or write them as CSV, Excel or GeoJSON.

    Without --verdict only those that ask for a decision: signs that are unchanged, or could not be seen, are
    left out. Nothing is changed. On a pipe each finding is one line, its cells parted by tabs.
    """
    from twin.decisions.findings import Selection
    from twin.reports.finding_list import Wanted, list_findings
    from twin.store.store import Store

    need_csv(excel, csv)
    if [csv, geojson].count(_STDOUT) + json_output + ids > 1 or xlsx == _STDOUT:
        raise ConfigError(
            "Standard output takes one of --json, --ids, --csv - and --geojson -, no workbook: name files."
        )
    need_place({"--csv": csv, "--xlsx": xlsx, "--geojson": geojson})
    selection = Selection(
        drives=tuple(drive or ()),
        area=area,
        verdicts=tuple(verdict or ()),
        classes=tuple(sign_class or ()),
        since=since.date() if since else None,
        until=until.date() if until else None,
        decisions=tuple(state or ()),
        confidence=(min_confidence, max_confidence),
    )
    wanted = Wanted(selection, road, tuple(kommune or ()), text, new, sort, reverse)
    to_look_at = not (csv or xlsx or geojson or json_output or ids) and sys.stdout.isatty()
    size = MOST_SHOWN if limit is None and (to_look_at or page > 1) else limit
    with Store.open(store, create=False) as opened:
        listed = list_findings(opened, wanted, start=(page - 1) * (size or 0), limit=size, lang=lang)
    if not listed.is_current:
        warn(say(lang, "findings.outdated", at=listed.matched_at))
    _tell_empty(listed, size, lang)
    for path in _written(listed.rows, csv, xlsx, geojson, excel=excel, lang=lang):
        note(say(lang, "findings.wrote", path=str(path), n=len(listed.rows)))
    if json_output:
        print_json(asdict(listed))
    elif ids:
        sys.stdout.writelines(f"{row.change_id}\n" for row in listed.rows)
    elif to_look_at:
        _print_page(listed, page, lang, "findings.shown" if verdict else "findings.shown_asking")
    elif not (csv or xlsx or geojson):
        for row in listed.rows:
            # A line a finding, whatever is written on a sign.
            sys.stdout.write("\t".join(" ".join(cell.split()) for cell in _cells(row, lang)) + "\n")


def _written(
    rows: Sequence[FindingRow],
    csv: Path | None,
    xlsx: Path | None,
    geojson: Path | None,
    *,
    excel: bool,
    lang: Lang,
) -> list[Path]:
    """Write the files that are asked for, and return those that are on a disk."""
    from twin.reports.finding_files import csv_of, geojson_of, xlsx_of
    from twin.store.atomic_files import replace_file

    wanted: list[tuple[Path, bytes]] = []
    if csv is not None:
        wanted.append((csv, csv_of(rows, excel=excel)))
    if xlsx is not None:
        wanted.append((xlsx, xlsx_of(rows, lang)))
    if geojson is not None:
        wanted.append((geojson, geojson_of(rows)))
    for path, content in wanted:
        if path == _STDOUT:
            sys.stdout.write(content.decode())
        else:
            replace_file(path, content)
    return [path for path, _ in wanted if path != _STDOUT]


_COLUMNS = ("change_id", "verdict", "decision", "confidence", "road", "sign", "reason")


def _tell_empty(listed: FindingList, size: int | None, lang: Lang) -> None:
    """Say that nothing fits, or that there is no such page."""
    if not listed.total:
        note(say(lang, "findings.none"))
    elif not listed.rows and size:
        warn(say(lang, "findings.no_page", n=listed.total, last=-(-listed.total // size)))


def _cells(row: FindingRow, lang: Lang) -> tuple[str, ...]:
    road = ", ".join(filter(None, (row.road, row.street)))
    verdict, decision = verdict_title(row.verdict, lang), decision_title(row.decision, lang)
    told = f"{row.seen} {row.reason}"
    return row.change_id, verdict, decision, chance_text(row.confidence, lang), road, row.sign, told


def _print_page(listed: FindingList, page: int, lang: Lang, footer: str) -> None:
    if not listed.rows:
        return
    title = say(lang, "findings.title", at=listed.matched_at)
    columns = [say(lang, f"findings.{name}") for name in _COLUMNS]
    print_table(title, columns, [_cells(row, lang) for row in listed.rows], right_from=len(columns))
    last = listed.start + len(listed.rows)
    note(say(lang, footer, first=listed.start + 1, last=last, n=listed.total))
    if last < listed.total:
        note(say(lang, "findings.next", page=page + 1))
