"""``twin belief``: how sure we are of each sign today, and where to drive next."""

from __future__ import annotations

import datetime as dt
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.belief.state import State
from twin.cli.findings import MOST_SHOWN
from twin.cli.list_findings import KommuneOption
from twin.cli.options import (
    DEFAULT_STORE,
    ExcelOption,
    JsonOption,
    LangOption,
    StoreOption,
    need_csv,
    need_place,
)
from twin.cli.output import note, print_json, print_table
from twin.errors import ConfigError
from twin.words import Lang, SignNames, chance_text, say, sign_titles, verdict_title

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from twin.belief.belief import Believed
    from twin.belief.chosen import BeliefList, RoadList
    from twin.belief.files import Rows
    from twin.belief.lifetimes import Lifetimes
    from twin.belief.roads import RoadToDrive

app = typer.Typer()
_STDOUT = Path("-")

NextOption = Annotated[
    bool, typer.Option("--next", help="Rank roads by what one more drive along them is expected to settle.")
]
AtOption = Annotated[
    dt.datetime | None,
    typer.Option(
        formats=["%Y-%m-%d"],
        help="At the start of this day (UTC), not before the newest drive or sync.  [default: now]",
        show_default=False,
    ),
]
StateOption = Annotated[
    list[State] | None, typer.Option(help="Signs in this state; may be repeated.  [default: every]")
]
RoadOption = Annotated[str, typer.Option(help="On this road: FV6680, 'FV6680 S1D1'.", show_default=False)]
MinOption = Annotated[float, typer.Option("--min-probability", min=0, max=1, help="At least so probable.")]
MaxOption = Annotated[float, typer.Option("--max-probability", min=0, max=1, help="At most so probable.")]
DetectionOption = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=1,
        help="With --next: chance that the drive sees a sign that stands.  "
        "[default: that of a completely annotated drive, 1 - p_missed of matching]",
        show_default=False,
    ),
]
LimitOption = Annotated[
    int | None,
    typer.Option(
        min=1, help=f"Rows shown.  [default: {MOST_SHOWN} on a terminal, else all]", show_default=False
    ),
]
CsvOption = Annotated[
    Path | None, typer.Option("--csv", help="Write all as CSV; - is standard output.", metavar="FILE.csv")
]
GeojsonOption = Annotated[
    Path | None,
    typer.Option("--geojson", help="Write all for a map (WGS84); - is standard output.", metavar="FILE"),
]
GpkgOption = Annotated[
    Path | None,
    typer.Option(
        "--gpkg", help="Write a GeoPackage: signs, with --next roads too (UTM33).", metavar="FILE.gpkg"
    ),
]


@app.command(
    "belief",
    epilog="Example: twin belief --kommune 5001 --max-probability 0.8.  "
    "Where to drive: twin belief --next --geojson roads.geojson",
)
def belief(
    next_roads: NextOption = False,
    at: AtOption = None,
    state: StateOption = None,
    road: RoadOption = "",
    kommune: KommuneOption = None,
    min_probability: MinOption = 0.0,
    max_probability: MaxOption = 1.0,
    detection: DetectionOption = None,
    limit: LimitOption = None,
    csv: CsvOption = None,
    geojson: GeojsonOption = None,
    gpkg: GpkgOption = None,
    excel: ExcelOption = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Say how sure we are today that each sign stands, by all drives past it; with --next where to drive.

    The least sure signs come first. Nothing is written into the store, and nothing is kept: it is worked out
    from the drives, the last match and what NVDB has closed.
    """
    from twin.belief.belief import believe
    from twin.belief.chosen import BeliefList, Chosen, RoadList
    from twin.mirror.names import sign_names
    from twin.reports.finding_list import road_written
    from twin.store.store import Store

    need_csv(excel, csv)
    need_place({"--csv": csv, "--geojson": geojson})
    if [csv, geojson].count(_STDOUT) + json_output > 1 or gpkg == _STDOUT:
        raise ConfigError("Standard output takes one of --json, --csv - and --geojson -: name files.")
    chosen = Chosen(
        road=road_written(road),
        kommuner=tuple(kommune or ()),
        states=tuple(state or ()),
        p_stands=(min_probability, max_probability),
    )
    with Store.open(store, create=False) as opened:
        found = believe(opened, at=None if at is None else at.replace(tzinfo=dt.UTC), today=True)
        names = sign_names(opened)
    places = chosen.of(found.places)
    files = {"--csv": csv, "--geojson": geojson, "--gpkg": gpkg}
    to_look_at = not json_output and _STDOUT not in files.values()
    size = MOST_SHOWN if limit is None and to_look_at and sys.stdout.isatty() else limit
    if not places:
        note(say(lang, "belief.none"))
    ranked = RoadList.of(found, places, None, detection) if next_roads else None
    for path, n in _written(places, None if ranked is None else ranked.roads, files, excel=excel):
        note(say(lang, "belief.wrote", path=str(path), n=n))
    if json_output:
        print_json(_cut(ranked, size) if ranked is not None else BeliefList.of(found, places, size))
    elif to_look_at:
        _tell_rates(found.lifetimes, lang)
        if ranked is not None:
            _print_roads(ranked, size, lang)
        else:
            _print_places(BeliefList.of(found, places, size), lang, names)


def _cut(ranked: RoadList, size: int | None) -> RoadList:
    return replace(ranked, roads=ranked.roads[:size])


def _written(
    places: Sequence[Believed],
    roads: Sequence[RoadToDrive] | None,
    files: Mapping[str, Path | None],
    *,
    excel: bool,
) -> Iterator[tuple[Path, int]]:
    """Write the files that are asked for, and tell of those on a disk how many rows each has."""
    from twin.belief.files import csv_of, geojson_of, layer_of, write_geopackage
    from twin.store.atomic_files import replace_file

    rows: Rows = places if roads is None else roads
    for option, path in files.items():
        if path is None:
            continue
        if option == "--gpkg":
            more = {} if roads is None else {"roads": layer_of(roads)}
            write_geopackage({**more, "signs": layer_of(places)}, path)
        else:
            content = csv_of(rows, excel=excel) if option == "--csv" else geojson_of(rows)
            if path == _STDOUT:
                sys.stdout.write(content.decode())
                continue
            replace_file(path, content)
        yield path, len(rows)


def _tell_rates(lifetimes: Lifetimes, lang: Lang) -> None:
    every, default = lifetimes.every, lifetimes.default
    if not every.closed:
        note(say(lang, "belief.stated", default=default))
    else:
        facts = {"rate": every.per_year, "closed": every.closed, "years": every.years}
        note(say(lang, "belief.learnt", **facts, default=default))


_OF_PLACES = ("place_id", "sign", "road", "state", "verdict", "last_seen", "p_stands", "n_seen", "n_missed")
_OF_ROADS = ("road", "kommune", "km", "n_places", "n_unsure", "n_not_passed")
_OF_BITS = ("settled_bits", "settled_bits_per_km")


def _print_places(listed: BeliefList, lang: Lang, names: SignNames) -> None:
    rows = [
        (
            *(one.place_id, sign_titles(one.skiltnummer.split(";"), names), one.road),
            say(lang, f"belief.state.{one.state}"),
            "–" if one.verdict is None else verdict_title(one.verdict, lang),
            say(lang, "belief.never") if one.last_seen is None else one.last_seen[:10],
            chance_text(one.p_stands, lang),
            *(one.n_seen, one.n_missed),
        )
        for one in listed.places
    ]
    title = say(lang, "belief.title", n=listed.total, at=listed.at)
    columns = [say(lang, f"belief.column.{name}") for name in _OF_PLACES]
    print_table(title, columns, rows, right_from=_OF_PLACES.index("p_stands"))
    told = (f"{say(lang, f'belief.state.{name}')} {n:,}" for name, n in listed.states.items() if n)
    note(", ".join(told))
    if len(rows) < listed.total:
        note(say(lang, "belief.shown", shown=len(rows), n=listed.total))


def _print_roads(ranked: RoadList, size: int | None, lang: Lang) -> None:
    shown = ranked.roads[:size]
    columns = [say(lang, f"belief.column.{name}") for name in (*_OF_ROADS, *_OF_BITS)]
    rows = [[getattr(one, name) for name in (*_OF_ROADS, *_OF_BITS)] for one in shown]
    print_table(say(lang, "belief.roads", n=ranked.total, at=ranked.at), columns, rows, right_from=2)
    if ranked.n_off_road:
        note(say(lang, "belief.off_road", n=ranked.n_off_road))
    if len(shown) < ranked.total:
        note(say(lang, "belief.shown_roads", shown=len(shown), n=ranked.total))
