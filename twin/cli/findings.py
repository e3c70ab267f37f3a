"""``twin match``, ``twin explain`` and ``twin decide``: findings and what people decide."""

from __future__ import annotations

import datetime as dt
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
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
    from twin.store.store import Store

app = typer.Typer()
_UNDO = "undo"
_Told = tuple[Mapping[str, Any], str]
"""What was decided: for ``--json``, and in one sentence."""


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

    config = MatchConfig(tolerance_m=tolerance)
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        report = run(opened, method=method, config=config, progress=progress)
        changes = latest_findings(opened.rows)
    n_open = sum(change.is_open for change in changes)
    for warning in report.warnings:
        warn(warning)
    if json_output:
        print_json({**asdict(report), "n_open": n_open, "changes": [change.as_json() for change in changes]})
    else:
        _print_findings([change for change in changes if change.finding.verdict != Verdict.UNCHANGED])
        print_table("Verdicts", ["verdict", "findings"], list(report.verdicts.items()))
        note(
            f"{report.n_poles} observed poles ({report.method}) against {report.n_sites} sites of NVDB, "
            f"{report.n_in_view} of them in view of a completely annotated drive."
        )
        if report.n_outdated:
            note(
                f"{report.n_outdated} poles of earlier drives were left out: a later drive no longer saw "
                "them."
            )
        if n_open:
            note(f"{n_open} findings are open: decide with `twin decide`, or in QGIS after `twin export`.")
    if exit_code and n_open:
        raise typer.Exit(EXIT_OPEN_FINDINGS)


def _print_findings(changes: Sequence[FindingStatus]) -> None:
    rows = [(c.change_id, c.finding.verdict, c.decision, c.finding.reason) for c in changes]
    print_table("Findings", ["change", "verdict", "decision", "reason"], rows, right_from=4)


@app.command(
    "decide",
    epilog="Example: twin decide dismiss 3f09a1b2c4d5 --reason 'road works'.  In bulk: twin decide accept "
    "--verdict new --class 362 --since 2026-06-01.  From QGIS: twin decide --from out/twin_utm33.gpkg.  "
    "Back: twin decide undo",
)
def decide(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            help="accept, dismiss, defer or open, and change ids (or their first six digits); or undo, and "
            "how many commands.",
            metavar="CHANGE_ID… DECISION",
            show_default=False,
        ),
    ] = None,
    verdict: Annotated[list[FindingVerdict] | None, typer.Option(help="Findings of this verdict.")] = None,
    drive: Annotated[list[str] | None, typer.Option(help="Findings of this drive: its id or name.")] = None,
    area: Annotated[Path | None, typer.Option(help="Findings inside the polygons of a GeoJSON file.")] = None,
    sign_class: Annotated[
        list[str] | None, typer.Option("--class", help="Sign code seen or in NVDB: 362.50, or 362 for all.")
    ] = None,
    since: Annotated[
        dt.datetime | None,
        typer.Option(formats=["%Y-%m-%d"], help="Findings of drives since this day (UTC)."),
    ] = None,
    until: Annotated[
        dt.datetime | None,
        typer.Option(formats=["%Y-%m-%d"], help="Findings of drives until this day (UTC)."),
    ] = None,
    state: Annotated[
        Decision, typer.Option(help="Select among findings that are now so decided.")
    ] = Decision.OPEN,
    from_file: Annotated[
        Path | None, typer.Option("--from", help="Take the decisions made in QGIS in an exported GeoPackage.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Why; kept with the decision.")] = "",
    by: ByOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say which findings would be decided.")
    ] = False,
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
    choices = (Decision.ACCEPT, Decision.DISMISS, Decision.DEFER, Decision.OPEN, _UNDO)
    verbs = [word for word in words or () if word in choices]
    others = [word for word in words or () if word not in choices]
    with Store.open(store, create=False) as opened:
        if from_file is not None:
            _refuse(bool(words) or selects or dry_run, "--from takes nothing but --reason and --by")
            done, sentence = _from_file(opened, from_file, who, reason)
        else:
            _refuse(len(verbs) != 1, f"say one of {', '.join(choices)}, once")
            if verbs[0] == _UNDO:
                _refuse(selects or bool(reason) or dry_run, "undo takes only a number and --by")
                done, sentence = _undo(opened, others, who)
            else:
                _refuse(bool(others) and selects, "name changes, or select them by options, not both")
                _refuse(
                    not others and not selects, "name changes, or select them by --verdict, --drive, --area …"
                )
                if selects:
                    selected = _selected(opened, selection)
                    others = [change.change_id for change in selected]
                    if dry_run and not json_output:
                        _print_findings(selected)
                done, sentence = _decide(opened, others, verbs[0], by=who, reason=reason, dry_run=dry_run)
    if json_output:
        print_json(done)
    else:
        note(sentence)


def _refuse(wrong: bool, cure: str) -> None:
    if wrong:
        raise ConfigError(f"This is no decision that twin understands: {cure} (see `twin decide --help`).")


def _selected(store: Store, selection: Selection) -> list[FindingStatus]:
    from twin.decisions.findings import select

    store.matched()
    selected = select(store.rows, selection)
    if not selected:
        raise RefusedError(
            f"No {selection.decision} finding fits what was selected, so nothing was decided: "
            "`twin match` lists the findings; --state selects those that were decided before."
        )
    return selected


def _decide(
    store: Store, change_ids: Sequence[str], decision: str, *, by: str, reason: str, dry_run: bool
) -> _Told:
    from twin.decisions.record import decide

    store.matched()
    done = decide(store, change_ids, decision, by=by, reason=reason, dry_run=dry_run)
    findings = _findings(done.change_ids)
    if dry_run:
        sentence = f"Would {decision} {findings}; nothing was decided (--dry-run)."
    else:
        already = f"; {len(done.already):,} had it already" if done.already else ""
        sentence = f"{findings}: {decision}{already}."
    return {"would_decide" if dry_run else "decided": decision, **asdict(done)}, sentence


def _from_file(store: Store, path: Path, by: str, reason: str) -> _Told:
    from twin.export import decide_as_in

    done = decide_as_in(store, path, by=by, reason=reason)
    return {"from": str(path), "change_ids": list(done)}, f"{_findings(done)} decided as in {path}."


def _undo(store: Store, numbers: Sequence[str], by: str) -> _Told:
    from twin.decisions.record import undo

    _refuse(len(numbers) > 1 or not all(word.isdigit() for word in numbers), "undo takes one number")
    done = undo(store, int(numbers[0]) if numbers else 1, by=by)
    return {
        "undone": True,
        "change_ids": list(done),
    }, f"{_findings(done)}: the decision of before holds again."


def _findings(change_ids: Sequence[str]) -> str:
    return "1 finding" if len(change_ids) == 1 else f"{len(change_ids):,} findings"


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
        print_pairs("Term by term", dict(_flat("", explained.terms)))
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


def _flat(name: str, value: Any) -> Iterator[tuple[str, object]]:
    """Give nested terms as pairs: ``log_odds, code``; of several the number; nothing of an empty one."""
    if isinstance(value, Mapping):
        parts = list(value.items())
    elif isinstance(value, list):
        parts = list(enumerate(value, start=1))
    else:
        yield name.replace("_", " "), value
        return
    for key, part in parts:
        yield from _flat(f"{name}, {key}" if name else str(key), part)
