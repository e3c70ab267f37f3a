"""``twin match`` and ``twin decide``: findings and what people decide."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.exit_codes import EXIT_OPEN_FINDINGS
from twin.cli.journal import manner
from twin.cli.options import DEFAULT_STORE, ByOption, JsonOption, LangOption, StoreOption, person
from twin.cli.output import note, print_json, print_table, steps, warn
from twin.cli.told import Told, told_in
from twin.errors import ConfigError, RefusedError
from twin.store.kinds import Decision, Method, Verdict
from twin.words import (
    Lang,
    decision_title,
    reason_of,
    say,
    verdict_title,
)

if TYPE_CHECKING:
    from twin.decisions.findings import FindingStatus, Selection
    from twin.matching.match_store import MatchReport
    from twin.store.store import Store

app = typer.Typer()
_UNDO = "undo"
_DONE = {
    Decision.ACCEPT: "decided.accept",
    Decision.DISMISS: "decided.dismiss",
    Decision.DEFER: "decided.defer",
    Decision.OPEN: "decided.open",
}
_MOST_IDS = 10
MOST_SHOWN = 50
"""Findings that a table shows unless more are asked for."""


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What was decided: for ``--json``, and in one sentence."""

    document: Mapping[str, object]
    sentence: str


class FindingVerdict(StrEnum):
    """Verdicts that ask for a decision."""

    NEW = Verdict.NEW
    MISSING = Verdict.MISSING
    MOVED = Verdict.MOVED
    WRONG_TYPE = Verdict.WRONG_TYPE
    REVIEW = Verdict.REVIEW


@app.command("match", epilog="Example: twin match")
def match(
    method: Annotated[
        Method | None, typer.Option(help="Whose estimates to match. Default: the best in the store.")
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            envvar="TWIN_TOLERANCE",
            help="Metres from NVDB's position beyond which a sign has moved.  [default: 1.0]",
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            envvar="TWIN_MATCH_SETTINGS",
            help="Settings of matching: the table [matching] of a TOML file.",
            metavar="FILE.toml",
        ),
    ] = None,
    map_aided: Annotated[
        bool,
        typer.Option(
            "--map-aided/--no-map-aided",
            envvar="TWIN_MAP_AIDED",
            help="Let signs that NVDB has measured to 10 cm tie drives to the ground, where they agree.",
        ),
    ] = False,
    anew: Annotated[
        bool,
        typer.Option(
            "--all",
            help="Work everything out anew, and say whether what was kept of earlier matches agrees.",
        ),
    ] = False,
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="Exit with 1 if findings are open, 0 if none is.")
    ] = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates with the mirror: new, missing, moved, wrong type, unchanged, or for review."""
    from twin.decisions.findings import latest_findings
    from twin.matching.config import MatchConfig, settings_from
    from twin.matching.match_store import match as run
    from twin.store.store import Store

    config = MatchConfig() if settings is None else settings_from(settings)
    config = replace(
        config, tolerance_m=config.tolerance_m if tolerance is None else tolerance, map_aided=map_aided
    )
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        before = {change.change_id for change in latest_findings(opened.rows) if change.is_open}
        report = run(opened, method=method, config=config, progress=progress, anew=anew)
        changes = latest_findings(opened.rows)
        shown = _news_of(report, changes)
        told = told_in(opened, shown[:MOST_SHOWN], lang)
    n_open = sum(change.is_open for change in changes)
    for warning in report.warnings:
        warn(warning)
    if report.kept_agree is False:
        warn(say(lang, "match.kept_differs"))
    if json_output:
        document = {"n_open": n_open, "changes": [change.as_json() for change in changes]}
        print_json({**asdict(report), **document})
    elif manner.quiet:
        news = [change for change in changes if change.is_open and change.change_id not in before]
        if news:
            _print_findings(news, told)
    else:
        _print_summary(report, changes, lang)
        _print_news(report, shown, told)
        _print_match(report, n_open, lang)
    if exit_code and n_open:
        raise typer.Exit(EXIT_OPEN_FINDINGS)


def _news_of(report: MatchReport, changes: Sequence[FindingStatus]) -> list[FindingStatus]:
    """What the match before did not say; of a first match what is open."""
    if report.news is None:
        return [change for change in changes if change.is_open]
    return [change for change in changes if change.change_id in report.news.change_ids]


def _print_match(report: MatchReport, n_open: int, lang: Lang) -> None:
    note(
        say(
            lang,
            "match.compared",
            poles=report.n_poles,
            method=report.method,
            sites=report.n_sites,
            in_view=report.n_in_view,
        )
    )
    if report.kept_agree:
        note(say(lang, "match.kept_agrees"))
    if report.map_aided:
        note(report.map_aided)
    if report.n_outdated:
        note(say(lang, "match.outdated", poles=report.n_outdated))
    if n_open:
        note(say(lang, "match.open", n=n_open))


def _print_summary(report: MatchReport, changes: Sequence[FindingStatus], lang: Lang) -> None:
    """Count findings by verdict, and how many of them are still to decide."""
    n_open = Counter(change.finding.verdict for change in changes if change.is_open)
    rows = [(verdict_title(verdict, lang), n, n_open[verdict]) for verdict, n in report.verdicts.items()]
    columns = [say(lang, "match.verdict"), say(lang, "match.findings"), say(lang, "match.n_open")]
    print_table(say(lang, "match.verdicts"), columns, rows)


def _print_news(report: MatchReport, shown: Sequence[FindingStatus], told: Told) -> None:
    """Print what is new, the first of it as a table, and what has another verdict or is gone."""
    news, lang = report.news, told.lang
    if shown:
        title = "match.title" if news is None else "match.news_title"
        _print_findings(shown[:MOST_SHOWN], told, say(lang, title))
    if len(shown) > MOST_SHOWN:
        option = "" if news is None else " --new"
        note(say(lang, "match.more", n=len(shown) - MOST_SHOWN, option=option))
    if news is None:
        return
    counts = {"n_new": len(news.new), "n_changed": len(news.changed), "n_gone": len(news.gone)}
    note(say(lang, "match.news" if any(counts.values()) else "match.no_news", since=news.since, **counts))
    for one in news.changed[:MOST_SHOWN]:
        verdicts = {"before": verdict_title(one.before, lang), "now": verdict_title(one.verdict, lang)}
        note(say(lang, "match.other_verdict", change=one.change_id, **verdicts))
    for gone in news.gone[:MOST_SHOWN]:
        verdict = verdict_title(gone.verdict, lang)
        note(say(lang, "match.gone", change=gone.change_id, verdict=verdict))


def _print_findings(changes: Sequence[FindingStatus], told: Told, title: str = "") -> None:
    lang = told.lang
    rows: list[tuple[str, ...]] = [
        (
            change.change_id,
            verdict_title(change.finding.verdict, lang),
            decision_title(change.decision, lang),
            str(told.roads.get(change.change_id) or ""),
            f"{told.seen(change.finding)} {reason_of(change.finding, lang, told.names)}",
        )
        for change in changes
    ]
    columns = [say(lang, f"match.{name}") for name in ("change", "verdict", "decision", "road", "reason")]
    if not any(row[3] for row in rows):  # neither Les V4's objects nor a road network: no empty column
        columns, rows = [*columns[:3], columns[4]], [(*row[:3], row[4]) for row in rows]
    print_table(title or say(lang, "match.title"), columns, rows, right_from=5)


WordsArgument = Annotated[
    list[str] | None,
    typer.Argument(
        help="accept, dismiss, defer or open, and change ids (or their first six digits); or undo, and how "
        "many of the last commands to take back (1 if not said).",
        metavar="CHANGE_ID… DECISION",
        show_default=False,
    ),
]
VerdictOption = Annotated[list[FindingVerdict] | None, typer.Option(help="Findings of this verdict.")]
DriveOption = Annotated[list[str] | None, typer.Option(help="Findings of this drive: its id or name.")]
AreaOption = Annotated[Path | None, typer.Option(help="Findings inside the polygons of a GeoJSON file.")]
ClassOption = Annotated[
    list[str] | None,
    typer.Option("--class", help="Sign code seen or in NVDB: 362.50; 362 or 3 for all such."),
]
SinceOption = Annotated[
    dt.datetime | None,
    typer.Option(formats=["%Y-%m-%d"], help="Findings of drives since this day (UTC)."),
]
UntilOption = Annotated[
    dt.datetime | None,
    typer.Option(formats=["%Y-%m-%d"], help="Findings of drives until this day (UTC)."),
]
StateOption = Annotated[Decision, typer.Option(help="Select among findings that are now so decided.")]
FromOption = Annotated[
    Path | None, typer.Option("--from", help="Take the decisions made in QGIS in an exported GeoPackage.")
]
ReasonOption = Annotated[str, typer.Option(help="Why; kept with the decision.")]
TemporaryOption = Annotated[
    bool,
    typer.Option(
        "--temporary",
        help="With dismiss: the sign stands for road works; others of the same works are dismissed too.",
    ),
]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Only say which findings would be decided.")]


@app.command(
    "decide",
    epilog="Example: twin decide dismiss 3f09a1b2c4d5 --reason 'road works'.  In bulk: twin decide accept "
    "--verdict new --class 362 --since 2026-06-01.  From QGIS: twin decide --from out/twin_utm33.gpkg.  "
    "Back: twin decide undo",
)
def decide(
    words: WordsArgument = None,
    verdict: VerdictOption = None,
    drive: DriveOption = None,
    area: AreaOption = None,
    sign_class: ClassOption = None,
    since: SinceOption = None,
    until: UntilOption = None,
    state: StateOption = Decision.OPEN,
    from_file: FromOption = None,
    reason: ReasonOption = "",
    temporary: TemporaryOption = False,
    by: ByOption = None,
    dry_run: DryRunOption = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Decide about findings: one by one, in bulk, or as decided in QGIS. Undo takes the last command back.

    A decision holds until what it rests on really changes; then the finding is open again and says why.
    """
    from twin.decisions.findings import Selection
    from twin.store.store import Store

    selection = Selection(
        drives=tuple(drive or ()),
        area=area,
        verdicts=tuple(verdict or ()),
        classes=tuple(sign_class or ()),
        since=since.date() if since else None,
        until=until.date() if until else None,
        decisions=(state,),
    )
    selects = not selection.is_empty
    with Store.open(store, create=False) as opened:
        who = person(by, opened)
        if from_file is not None:
            _refuse(
                bool(words) or selects or dry_run or temporary, "--from takes nothing but --reason and --by"
            )
            outcome = _from_file(opened, from_file, who, reason, lang)
        else:
            verb, others = _verb_and_others(words or ())
            if verb == _UNDO:
                _refuse(selects or bool(reason) or dry_run or temporary, "undo takes only a number and --by")
                outcome = _undo(opened, others, who, lang)
            else:
                change_ids = _meant(opened, others, selection, lang if dry_run and not json_output else None)
                options = {"temporary": temporary, "dry_run": dry_run}
                outcome = _decide(opened, change_ids, verb, by=who, reason=reason, lang=lang, **options)
    if json_output:
        print_json(outcome.document)
    else:
        note(outcome.sentence)


def _verb_and_others(words: Sequence[str]) -> tuple[str, list[str]]:
    """The one word that says what to do, and the others."""
    choices = (Decision.ACCEPT, Decision.DISMISS, Decision.DEFER, Decision.OPEN, _UNDO)
    verbs = [word for word in words if word in choices]
    _refuse(len(verbs) != 1, f"say exactly one of {', '.join(choices)}")
    return verbs[0], [word for word in words if word not in choices]


def _meant(store: Store, named: Sequence[str], selection: Selection, show: Lang | None) -> Sequence[str]:
    """Ids of the changes that are named, or else selected; these are also shown, in the language given."""
    _refuse(bool(named) and not selection.is_empty, "name changes, or select them by options, not both")
    _refuse(not named and selection.is_empty, "name changes, or select them by --verdict, --drive, --area …")
    if named:
        return named
    selected = _selected(store, selection)
    if show is not None:
        _print_findings(selected, told_in(store, selected, show))
    return [change.change_id for change in selected]


def _refuse(wrong: bool, cure: str) -> None:
    if wrong:
        raise ConfigError(f"This is no decision that twin understands: {cure} (see `twin decide --help`).")


def _selected(store: Store, selection: Selection) -> list[FindingStatus]:
    from twin.decisions.findings import select

    with store.snapshot() as view:
        view.matched()
        selected = select(view.rows, selection)
    if not selected:
        raise RefusedError(
            f"No {' or '.join(selection.decisions)} finding fits what was selected, so nothing was decided: "
            "`twin findings` lists them; --state selects those that were decided before."
        )
    return selected


def _decide(
    store: Store,
    change_ids: Sequence[str],
    decision: str,
    *,
    by: str,
    reason: str,
    temporary: bool,
    dry_run: bool,
    lang: Lang,
) -> _Outcome:
    from twin.decisions.record import decide

    done = decide(store, change_ids, decision, by=by, reason=reason, temporary=temporary, dry_run=dry_run)
    n, ids = len(done.change_ids), _listed(done.change_ids)
    if dry_run:
        sentence = say(lang, "decided.would", decision=decision, n=n, ids=ids)
    else:
        already = say(lang, "decided.already", n=len(done.already)) if done.already else ""
        what = say(lang, _DONE[Decision(decision)], n=n)
        sentence = say(lang, "decided.by", done=what, by=by, ids=ids, already=already)
    return _Outcome({"would_decide" if dry_run else "decided": decision, **asdict(done)}, sentence)


def _from_file(store: Store, path: Path, by: str, reason: str, lang: Lang) -> _Outcome:
    from twin.export import decide_as_in

    change_ids = decide_as_in(store, path, by=by, reason=reason)
    document = {"from": str(path), "change_ids": list(change_ids)}
    n, ids = len(change_ids), _listed(change_ids)
    return _Outcome(document, say(lang, "decided.from_file", path=str(path), n=n, ids=ids))


def _undo(store: Store, numbers: Sequence[str], by: str, lang: Lang) -> _Outcome:
    from twin.decisions.record import undo

    _refuse(
        len(numbers) > 1 or not all(word.isdigit() for word in numbers),
        "undo takes back the last commands, not single findings: say how many, as in twin decide undo 2, or"
        " open findings again by twin decide open and their ids",
    )
    change_ids = undo(store, int(numbers[0]) if numbers else 1, by=by)
    document = {"undone": True, "change_ids": list(change_ids)}
    return _Outcome(document, say(lang, "decided.undone", n=len(change_ids), ids=_listed(change_ids)))


def _listed(change_ids: Sequence[str]) -> str:
    """Ids in brackets; nothing where they are too many to read."""
    return f" ({', '.join(change_ids)})" if 0 < len(change_ids) <= _MOST_IDS else ""
