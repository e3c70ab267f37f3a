"""``twin evaluate``, ``status`` and ``confidence``: what the store holds, and how good it is."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from enum import StrEnum
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import (
    DEFAULT_STORE,
    EpsgOption,
    ExcelOption,
    JsonOption,
    LangOption,
    StoreOption,
    WithinOption,
    need_csv,
    need_place,
)
from twin.cli.output import cell, note, print_json, print_pairs, print_table, warn
from twin.words import Lang, decision_title, number_text, say, verdict_title

if TYPE_CHECKING:
    from twin.decisions.opinions import Agreement
    from twin.reports.confidences import ConfidenceReport
    from twin.reports.error_groups import GroupErrors
    from twin.reports.evaluation import MethodResult, RangeErrors
    from twin.reports.store_status import Status

app = typer.Typer()


class PairBy(StrEnum):
    """How estimates find their truth, as in :data:`twin.reports.evaluation.PAIR_BY`."""

    AUTO = "auto"
    ID = "id"
    POSITION = "position"


class PlotFormat(StrEnum):
    """Formats of figures, as in :data:`twin.figures.FORMATS`."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


@app.command("evaluate", epilog="Example: twin evaluate data/truth.csv --plots plots --by camera,range")
def evaluate(
    truth: Annotated[
        Path,
        typer.Argument(
            help="CSV with object, easting, northing and, if known, label, height (ellipsoidal), epsg.",
            metavar="TRUTH.csv",
        ),
    ],
    by: Annotated[
        str | None,
        typer.Option(
            help="Also group the errors by these: any of camera, speed, range.", metavar="camera,speed,range"
        ),
    ] = None,
    pair_by: Annotated[
        PairBy,
        typer.Option(help="How estimates find their truth: auto takes the ids, or positions if no id fits."),
    ] = PairBy.AUTO,
    within: WithinOption = 5.0,
    plots: Annotated[
        Path | None, typer.Option(help="Folder for the figures error–distance and error–speed.")
    ] = None,
    plots_as: Annotated[
        PlotFormat | None, typer.Option(help="Format of the figures.  [default: png]", show_default=False)
    ] = None,
    objects: Annotated[
        bool, typer.Option("--objects", help="Also print the error of each object, forward and to the left.")
    ] = False,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            help="Also write the error of each object; with --by the groups too, as FILE_by.csv.",
            metavar="FILE.csv",
        ),
    ] = None,
    excel: ExcelOption = False,
    epsg: EpsgOption = None,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates of every method with surveyed positions, and heights where TRUTH has some."""
    from twin.errors import ConfigError
    from twin.reports.error_groups import check_groups, groups_csv
    from twin.reports.error_picture import plot
    from twin.reports.evaluation import evaluate as run
    from twin.reports.evaluation import read_truth
    from twin.reports.object_errors import csv_of
    from twin.store.atomic_files import replace_file
    from twin.store.store import Store

    need_csv(excel, csv)
    if plots_as is not None and plots is None:
        raise ConfigError("--plots-as says how --plots are drawn: name a folder by --plots too.")
    need_place({"--csv": csv})
    groups_by = check_groups([name.strip() for name in by.split(",")]) if by is not None else ()
    truths = read_truth(truth, epsg=epsg)
    with Store.open(store, create=False) as opened:
        evaluation = run(opened, truths, pair_by=pair_by.value, within_m=within)
    groups = evaluation.grouped(groups_by) if groups_by else ()
    files = plot(evaluation, plots, ending=f".{plots_as or PlotFormat.PNG}") if plots is not None else []
    tables: list[Path] = []
    if csv is not None:
        each = [error for method in evaluation.methods for error in method.each]
        replace_file(csv, csv_of(each, excel=excel))
        tables.append(csv)
        if groups:
            tables.append(csv.with_name(f"{csv.stem}_by{csv.suffix}"))
            replace_file(tables[-1], groups_csv(groups, excel=excel))
    doubts = [
        say(lang, f"evaluate.{one.kind}", drive=one.drive_id, metres=one.metres) for one in evaluation.doubts
    ]
    if json_output:
        written = {"plots": [str(path) for path in files], "csv": None if csv is None else str(csv)}
        by_group = [asdict(group) for group in groups]
        print_json({"methods": evaluation.as_json(), "groups": by_group, "warnings": doubts, **written})
        return
    for doubt in doubts:
        warn(doubt)
    if evaluation.methods[0].paired_by == "position":
        note(say(lang, "evaluate.by_position", within=within))
    print_errors(evaluation.methods, lang)
    for kind, title in (("objects", "objects_by"), ("sightings", "sightings_by")):
        _print_groups(title, [group for group in groups if group.kind == kind], groups_by, lang)
    if objects:
        _print_objects(evaluation.methods, lang)
    for path in (*files, *tables):
        note(say(lang, "output.wrote", path=str(path)))


def print_errors(methods: tuple[MethodResult, ...], lang: Lang = Lang.EN) -> None:
    """Print the error tables: objects, then single sightings by range."""
    names = ("mean", "median", "p95", "max", "rmse")
    numbers = attrgetter(*names)
    rows: list[list[object]] = [
        [m.method, m.objects.n, *numbers(m.objects), f"{m.coverage95:.0%}", m.nees_per_dof] for m in methods
    ]
    _print_numbers("horizontal", ("method", "number", *names, "in_ellipse", "nees"), rows, lang)
    if any(m.heights.n for m in methods):
        rows = [
            [m.method, m.heights.n, m.heights.mean, m.heights.rmse, m.heights.nees_per_dof] for m in methods
        ]
        _print_numbers("heights", ("method", "number", "mean", "rmse", "nees"), rows, lang)
    for kind in ("objects_by_range", "sightings_by_range"):
        rows = [
            [m.method, _bin(b), b.n, *numbers(b), f"{b.coverage95:.0%}"]
            for m in methods
            for b in getattr(m, kind)
        ]
        if rows:
            _print_numbers(kind, ("method", "range", "number", *names, "in_ellipse"), rows, lang)
    for m in methods:
        if m.not_estimated:
            objects, number = ", ".join(m.not_estimated), len(m.not_estimated)
            warn(say(lang, "evaluate.not_estimated", method=m.method, number=number, objects=objects))
        if m.not_in_truth:
            warn(say(lang, "evaluate.not_in_truth", method=m.method, number=m.not_in_truth))


def _print_groups(title: str, groups: Sequence[GroupErrors], by: Sequence[str], lang: Lang) -> None:
    """Print the errors of objects, or of single sightings, a group a row."""
    numbers = attrgetter("n", "mean", "median", "p95", "max", "rmse")
    rows = []
    for one in groups:
        names = {
            "camera": one.camera,
            "speed": _span(one.speed_from_kmh, one.speed_to_kmh),
            "range": _span(one.range_from_m, one.range_to_m),
        }
        inside = None if one.coverage95 is None else f"{one.coverage95:.0%}"
        rows.append([one.method, *(names[name] for name in by), *numbers(one), inside])
    if rows:
        columns = ("method", *by, "number", "mean", "median", "p95", "max", "rmse", "in_ellipse")
        _print_numbers(title, columns, rows, lang)


def _print_objects(methods: tuple[MethodResult, ...], lang: Lang) -> None:
    """Print the error of each object, a table a method, the largest first."""
    numbers = attrgetter("error_m", "error_forward_m", "error_left_m", "error_height_m", "nees_per_dof")
    columns = ("object", "drive", "error", "forward", "left", "height", "nees", "inside")
    inside = {True: say(lang, "evaluate.yes"), False: say(lang, "evaluate.no"), None: None}
    for m in methods:
        rows = [
            (
                one.object,
                one.drive_id,
                *(number_text(lang, cell(value)) for value in numbers(one)),
                inside[one.inside95],
            )
            for one in sorted(m.each, key=attrgetter("error_m"), reverse=True)
        ]
        names = [say(lang, f"evaluate.{name}") for name in columns]
        print_table(say(lang, "evaluate.each", method=m.method), names, rows)


def _print_numbers(
    title: str, columns: tuple[str, ...], rows: Sequence[Sequence[object]], lang: Lang
) -> None:
    """Print a table of a method a row, its numbers as the language writes them."""
    written = [[method, *(number_text(lang, cell(value)) for value in numbers)] for method, *numbers in rows]
    names = [say(lang, f"evaluate.{name}") for name in columns]
    print_table(say(lang, f"evaluate.{title}"), names, written)


def _bin(errors: RangeErrors) -> str:
    return _span(errors.from_m, errors.to_m)


def _span(low: float | None, high: float | None) -> str:
    return f"≥ {low or 0.0:.0f}" if high is None else f"{low or 0.0:.0f}–{high:.0f}"


@app.command("status", epilog="Example: twin status")
def status(
    prometheus: Annotated[
        bool, typer.Option("--prometheus", help="Print the numbers as Prometheus reads them.")
    ] = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Say what the store holds: the mirror and its age, drives, queue, estimates, findings."""
    from twin.errors import ConfigError
    from twin.reports.prometheus import prometheus_text
    from twin.reports.store_status import status as status_of
    from twin.store.store import Store

    if prometheus and json_output:
        raise ConfigError("--json and --prometheus are two forms of the same: give one of them.")
    with Store.open(store, create=False) as opened:
        held = status_of(opened)
    if prometheus:
        sys.stdout.write(prometheus_text(held))
        return
    if json_output:
        print_json(held.as_json())
        return
    pairs = {
        **_mirror_pairs(held, lang),
        "drives": _drives(held, lang),
        **_fleet_pairs(held, lang),
        "estimates": ", ".join(f"{n} {m}" for m, n in held.estimates.items()) or None,
        "last_match": held.last_match.at if held.last_match else None,
        "findings": ", ".join(f"{n} {verdict_title(v, lang)}" for v, n in held.verdicts.items()) or None,
        "decisions": _decisions(held, lang),
        "oldest_open": _oldest_open(held, lang),
        "agreement": _agreement(held.opinions, lang),
    }
    title = say(lang, "status.title", store=str(held.store))
    print_pairs(title, {say(lang, f"status.{name}"): value for name, value in pairs.items()})


_MOST_DRIVES = 10


def _drives(held: Status, lang: Lang) -> str | None:
    """The drives by name and day, the latest first where there are many."""
    names = [f"{drive.name} ({drive.started[:10]}, {drive.length_m:.0f} m)" for drive in held.drives]
    if len(names) > _MOST_DRIVES:
        rest = len(names) - _MOST_DRIVES
        names = [*names[: -_MOST_DRIVES - 1 : -1], say(lang, "status.more_drives", n=rest)]
    return "\n".join(names) or None


def _fleet_pairs(held: Status, lang: Lang) -> dict[str, object]:
    """The last days on which drives were read; the queue, where there ever was one."""
    days = [say(lang, "status.day", day=one.day, n=one.n, km=one.length_m / 1000) for one in held.days]
    pairs: dict[str, object] = {"days": "\n".join(days) or None}
    queue = held.queue
    if any(queue.jobs.values()):
        told = [say(lang, f"status.{state}", n=n) for state, n in queue.jobs.items()]
        if queue.failing:
            told.append(say(lang, "status.failing", n=queue.failing))
        if queue.oldest:
            told.append(say(lang, "status.oldest", at=queue.oldest))
        pairs["queue"] = ", ".join(told)
    if queue.parked:
        kinds = ", ".join(f"{n:,} {kind}" for kind, n in queue.parked.items())
        pairs["parked_why"] = f"{kinds}: twin fleet status"
    return pairs


def _oldest_open(held: Status, lang: Lang) -> str | None:
    one = held.oldest_open
    if one is None:
        return None
    verdict = verdict_title(one.verdict, lang)
    return say(lang, "status.of_day", id=one.change_id[:8], verdict=verdict, day=one.since[:10])


def _decisions(held: Status, lang: Lang) -> str | None:
    """``3 open, 1 accepted``."""
    if not sum(held.decisions.values()):
        return None
    return ", ".join(f"{n:,} {decision_title(decision, lang)}" for decision, n in held.decisions.items() if n)


def _agreement(opinions: Mapping[str, Agreement], lang: Lang) -> str | None:
    """``new: 40 of 42`` for each verdict that people have reviewed blindly."""
    told = (
        say(lang, "status.agreed", verdict=verdict_title(verdict, lang), agreed=one.n_agreed, of=one.n)
        for verdict, one in opinions.items()
    )
    return ", ".join(told) or None


def _mirror_pairs(held: Status, lang: Lang) -> dict[str, object]:
    mirror = held.mirror
    pairs: dict[str, object] = {
        "area": mirror.area if mirror else None,
        "skiltpunkt": held.skiltpunkt,
        "skiltplate": held.skiltplate,
        "synced": f"{mirror.synced_at}, {_ago(mirror.age_hours, lang)}" if mirror else None,
        "source": mirror.source if mirror else None,
        "position": mirror.position if mirror else None,
    }
    if held.unfinished:
        kept = [f"{n:,} {name}" for name, n in held.unfinished.kept.items()]
        both = say(lang, "status.both", first=kept[0], second=kept[-1])
        pairs["unfinished"] = say(lang, "status.so_far", area=held.unfinished.area, kept=both)
    if network := held.vegnett:
        pairs["network"] = say(
            lang, "status.links", links=network.count, area=network.area, at=network.fetched_at
        )
    return pairs


def _ago(hours: float, lang: Lang) -> str:
    if hours < 1:
        return say(lang, "status.minutes_ago", minutes=hours * 60)
    if hours < 48:
        return say(lang, "status.hours_ago", hours=hours)
    return say(lang, "status.days_ago", days=hours / 24)


@app.command("confidence", epilog="Example: twin confidence --out confidence.svg")
def confidence(
    out: Annotated[
        Path | None, typer.Option(help="Also draw the reliability diagram: PNG, SVG or PDF.", metavar="FILE")
    ] = None,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Hold the confidences against people's decisions, and say what the priors would be; changes nothing."""
    from twin.reports.confidence_picture import draw_confidences
    from twin.reports.confidences import confidences_against_decisions
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        report = confidences_against_decisions(opened)
    if out is not None:
        draw_confidences(report, out, lang)
    if json_output:
        print_json({**report.as_json(), "picture": None if out is None else str(out)})
        return
    _print_confidences(report, lang)
    if out is not None:
        note(say(lang, "output.wrote", path=str(out)))


def _print_confidences(report: ConfidenceReport, lang: Lang) -> None:
    from twin.reports.confidences import ENOUGH, priors_toml

    rows = [
        (
            verdict_title(one.verdict, lang) if one.verdict else say(lang, "confidence.all"),
            one.n,
            one.n_right,
            say(lang, "term.chance", share=one.mean_confidence) if one.n else None,
            None
            if one.brier is None or one.low is None or one.high is None
            else say(lang, "confidence.interval", value=one.brier, low=one.low, high=one.high),
            say(lang, "confidence.score", value=one.brier_if_true) if one.n else None,
        )
        for one in report.scores
    ]
    names = ("verdict", "decided", "right", "mean", "brier", "if_true")
    columns = [say(lang, f"confidence.{name}") for name in names]
    print_table(say(lang, "confidence.title"), columns, rows)
    if few := [one for one in report.scores if one.n < ENOUGH]:
        which = [verdict_title(one.verdict, lang) for one in few if one.verdict]
        told = ", ".join(which) or say(lang, "confidence.all")
        note(say(lang, "confidence.too_few", which=told, enough=ENOUGH))
    for name, n in (
        ("deferred", report.n_deferred),
        ("temporary", report.n_temporary),
        ("unknown", report.n_unknown),
    ):
        if n:
            note(say(lang, f"confidence.{name}", n=n))
    for prior in report.priors:
        if prior.fitted is None:
            note(say(lang, "confidence.not_fitted", name=prior.name, decided=prior.n, enough=ENOUGH))
    if toml := priors_toml(report.priors):
        note(say(lang, "confidence.priors"))
        sys.stdout.write(toml)
