"""``twin match``, ``twin explain`` and ``twin decide``: findings and what people decide."""

from __future__ import annotations

import datetime as dt
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.cli.exit_codes import EXIT_OPEN_FINDINGS
from twin.cli.options import DEFAULT_STORE, ByOption, JsonOption, StoreOption, person
from twin.cli.output import note, print_json, print_pairs, print_table, steps, warn
from twin.errors import ConfigError, RefusedError
from twin.store.kinds import Decision, Method, Verdict

if TYPE_CHECKING:
    from twin.decisions.explain import ChangeExplained
    from twin.decisions.findings import FindingStatus, Selection
    from twin.matching.match_store import MatchReport
    from twin.store.store import Store

app = typer.Typer()
_UNDO = "undo"
_FOR = {
    "position": "position",
    "code": "sign codes",
    "text": "texts",
    "facing": "way it faces",
    "side": "side of the road",
    "presence": "NVDB's sign is still there",
}
"""The terms of :data:`twin.matching.likelihood.TERMS` in plain words."""


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
        float, typer.Option(help="Metres from NVDB's position beyond which a sign has moved.")
    ] = 1.0,
    map_aided: Annotated[
        bool,
        typer.Option(
            "--map-aided",
            help="Let signs that NVDB has measured to 10 cm tie drives to the ground, where they agree.",
        ),
    ] = False,
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="Exit with 1 if findings are open, 0 if none is.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates with the mirror: new, missing, moved, wrong type, unchanged, or for review."""
    from twin.decisions.findings import latest_findings
    from twin.matching.config import MatchConfig
    from twin.matching.match_store import match as run
    from twin.store.store import Store

    config = MatchConfig(tolerance_m=tolerance, map_aided=map_aided)
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        report = run(opened, method=method, config=config, progress=progress)
        changes = latest_findings(opened.rows)
    n_open = sum(change.is_open for change in changes)
    for warning in report.warnings:
        warn(warning)
    if json_output:
        document = {"n_open": n_open, "changes": [change.as_json() for change in changes]}
        print_json({**asdict(report), **document})
    else:
        _print_match(report, changes, n_open)
    if exit_code and n_open:
        raise typer.Exit(EXIT_OPEN_FINDINGS)


def _print_match(report: MatchReport, changes: Sequence[FindingStatus], n_open: int) -> None:
    _print_findings([change for change in changes if change.finding.verdict != Verdict.UNCHANGED])
    print_table("Verdicts", ["verdict", "findings"], list(report.verdicts.items()))
    note(
        f"{report.n_poles} observed poles ({report.method}) against {report.n_sites} sites of NVDB, "
        f"{report.n_in_view} of them in view of a completely annotated drive."
    )
    if report.map_aided:
        note(report.map_aided)
    if report.n_outdated:
        note(f"{report.n_outdated} poles of earlier drives were left out: a later drive no longer saw them.")
    if n_open:
        verb = "is" if n_open == 1 else "are"
        note(f"{_findings(n_open)} {verb} open: decide with `twin decide`, or in QGIS after `twin export`.")


def _print_findings(changes: Sequence[FindingStatus]) -> None:
    rows = [(c.change_id, c.finding.verdict, c.decision, c.finding.reason) for c in changes]
    print_table("Findings", ["change", "verdict", "decision", "reason"], rows, right_from=4)


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
    list[str] | None, typer.Option("--class", help="Sign code seen or in NVDB: 362.50, or 362 for all.")
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
    by: ByOption = None,
    dry_run: DryRunOption = False,
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
        decision=state,
    )
    who, selects = person(by), not selection.is_empty
    with Store.open(store, create=False) as opened:
        if from_file is not None:
            _refuse(bool(words) or selects or dry_run, "--from takes nothing but --reason and --by")
            outcome = _from_file(opened, from_file, who, reason)
        else:
            verb, others = _verb_and_others(words or ())
            if verb == _UNDO:
                _refuse(selects or bool(reason) or dry_run, "undo takes only a number and --by")
                outcome = _undo(opened, others, who)
            else:
                change_ids = _meant(opened, others, selection, show=dry_run and not json_output)
                outcome = _decide(opened, change_ids, verb, by=who, reason=reason, dry_run=dry_run)
    if json_output:
        print_json(outcome.document)
    else:
        note(outcome.sentence)


def _verb_and_others(words: Sequence[str]) -> tuple[str, list[str]]:
    """The one word that says what to do, and the others."""
    choices = (Decision.ACCEPT, Decision.DISMISS, Decision.DEFER, Decision.OPEN, _UNDO)
    verbs = [word for word in words if word in choices]
    _refuse(len(verbs) != 1, f"say one of {', '.join(choices)}, once")
    return verbs[0], [word for word in words if word not in choices]


def _meant(store: Store, named: Sequence[str], selection: Selection, *, show: bool) -> Sequence[str]:
    """Ids of the changes that are named, or else selected; these are also shown, if asked for."""
    _refuse(bool(named) and not selection.is_empty, "name changes, or select them by options, not both")
    _refuse(not named and selection.is_empty, "name changes, or select them by --verdict, --drive, --area …")
    if named:
        return named
    selected = _selected(store, selection)
    if show:
        _print_findings(selected)
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
            f"No {selection.decision} finding fits what was selected, so nothing was decided: "
            "`twin match` lists the findings; --state selects those that were decided before."
        )
    return selected


def _decide(
    store: Store, change_ids: Sequence[str], decision: str, *, by: str, reason: str, dry_run: bool
) -> _Outcome:
    from twin.decisions.record import decide

    done = decide(store, change_ids, decision, by=by, reason=reason, dry_run=dry_run)
    findings = _findings(len(done.change_ids))
    if dry_run:
        sentence = f"Would {decision} {findings}; nothing was decided (--dry-run)."
    else:
        already = f"; {len(done.already):,} had it already" if done.already else ""
        sentence = f"{findings}: {decision}{already}."
    return _Outcome({"would_decide" if dry_run else "decided": decision, **asdict(done)}, sentence)


def _from_file(store: Store, path: Path, by: str, reason: str) -> _Outcome:
    from twin.export import decide_as_in

    change_ids = decide_as_in(store, path, by=by, reason=reason)
    document = {"from": str(path), "change_ids": list(change_ids)}
    return _Outcome(document, f"{_findings(len(change_ids))} decided as in {path}.")


def _undo(store: Store, numbers: Sequence[str], by: str) -> _Outcome:
    from twin.decisions.record import undo

    _refuse(
        len(numbers) > 1 or not all(word.isdigit() for word in numbers),
        "undo takes back the last commands, not single findings: say how many, as in twin decide undo 2, or"
        " open findings again by twin decide open and their ids",
    )
    change_ids = undo(store, int(numbers[0]) if numbers else 1, by=by)
    document = {"undone": True, "change_ids": list(change_ids)}
    has = "has" if len(change_ids) == 1 else "have"
    return _Outcome(document, f"Taken back: {_findings(len(change_ids))} {has} the decision of before again.")


def _findings(n: int) -> str:
    return "1 finding" if n == 1 else f"{n:,} findings"


@app.command("explain", epilog="Example: twin explain 3f09a1b2c4d5")
def explain(
    change: Annotated[
        str, typer.Argument(help="A finding's change_id, or its first six digits.", metavar="CHANGE_ID")
    ],
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one finding: verdict, confidence and reason, and who decided what about it."""
    from twin.decisions.explain import explain_change
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        explained = explain_change(opened, change)
    if json_output:
        print_json(explained.as_json())
        return
    sys.stdout.write(f"{explained.sentence}\n")
    print_pairs(f"Change {explained.change.change_id}", _pairs(explained))
    if explained.terms:
        terms = {_PLAIN.get(name, name): value for name, value in _flat("", explained.terms)}
        print_pairs("Term by term", terms)
        if "log_odds" in explained.terms:
            note("Speaks for the pairing: natural log odds; 0 says nothing, -3 is 20 to 1 against it.")
    if explained.history:
        print_table(
            "Decisions",
            ["at", "decision", "by", "how", "reason"],
            [(e.at, e.decision, e.by, e.kind, e.reason) for e in explained.history],
            right_from=5,
        )


def _pairs(explained: ChangeExplained) -> dict[str, object]:
    from twin.decisions.explain import percent

    finding = explained.change.finding
    kind = "Skiltpunkt" if finding.nvdb_type == 95 else "Skiltplate"
    distance, sigma = finding.distance_m, finding.distance_sigma_m
    return {
        "verdict": finding.verdict,
        "confidence": percent(finding.confidence),
        "NVDB": f"{kind} {finding.nvdb_id}, version {finding.nvdb_version}" if finding.nvdb_id else None,
        "sign code in NVDB": " + ".join(finding.skiltnummer_nvdb) or None,
        "sign code seen": " + ".join(finding.skiltnummer_seen) or None,
        "distance from NVDB's position": None if distance is None else f"{distance:.2f} ± {sigma:.2f} m",
        "position, EPSG:25833": f"{finding.east_m:.2f} E  {finding.north_m:.2f} N",
        "sightings": finding.n_sightings,
        "drives": ", ".join(f"{drive.name} {drive.day}" for drive in explained.drives) or None,
        "decision": explained.change.decision,
    }


_PLAIN = {
    "match": "probability of this pairing",
    **{f"log odds, {term}": f"speaks for the pairing: {words}" for term, words in _FOR.items()},
    "sigmas": "distance, in sigmas",
    "nvdb sigma m": "NVDB's position, one sigma [m]",
    "beyond tolerance": "probability: beyond the tolerance",
    "pole": "observed pole",
    "seen, first": "first seen",
    "seen, last": "last seen",
    "seen, drives": "seen in drives",
    "taken down": "probability: taken down since",
    "code": "probability: the code was read right",
    "site, nvdb type": "stands on, NVDB type",
    "site, nvdb id": "stands on, NVDB id",
    "absence, frames": "in view, frames",
    "absence, drives": "in view, drives",
    "absence, gone": "probability: it is gone",
}


def _flat(name: str, value: Any) -> Iterator[tuple[str, object]]:
    """Give nested terms as pairs: ``log_odds, code``; of several the number; nothing of an empty one."""
    if isinstance(value, Mapping):
        parts = list(value.items())
    elif isinstance(value, list):
        parts = list(enumerate(value, start=1))
    else:
        is_id = name.endswith(("nvdb_id", "nvdb_type"))
        yield name.replace("_", " "), str(value) if is_id and value is not None else value
        return
    for key, part in parts:
        yield from _flat(f"{name}, {key}" if name else str(key), part)
