"""The bodies of ``twin match``, ``twin decide`` and ``twin explain``: findings and what people decide."""

from __future__ import annotations

import datetime as dt
import getpass
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from twin.cli.output import note, print_json, print_pairs, print_table, steps, warn
from twin.errors import ConfigError, RefusedError

if TYPE_CHECKING:
    from twin.decisions.findings import Selection
    from twin.store.store import Store

Row = Mapping[str, Any]

_WORDS = ("accept", "dismiss", "defer", "open")
_UNDO = "undo"
_EXIT_OPEN_FINDINGS = 1
"""As of ``git diff --exit-code``, and only where it was asked for."""


def person() -> str:
    """Return the login name, "" where the system knows none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""


def match(method: str | None, tolerance: float, exit_code: bool, store: Path, json_output: bool) -> None:
    """``twin match``."""
    from twin.decisions.findings import findings, is_open
    from twin.matching.config import MatchConfig
    from twin.matching.match import match as run
    from twin.store.store import Store

    config = MatchConfig(tolerance_m=tolerance)
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        report = run(opened, method=method, config=config, progress=progress)
        changes = findings(opened.rows)
    n_open = sum(is_open(change) for change in changes)
    for warning in report.warnings:
        warn(warning)
    if json_output:
        print_json({**asdict(report), "n_open": n_open, "changes": changes})
    else:
        _print_findings([change for change in changes if change["verdict"] != "unchanged"])
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
        raise typer.Exit(_EXIT_OPEN_FINDINGS)


def _print_findings(changes: Sequence[Row]) -> None:
    rows = [(c["change_id"], c["verdict"], c["decision"], c["reason"]) for c in changes]
    print_table("Findings", ["change", "verdict", "decision", "reason"], rows, right_from=4)


def decide(
    words: Sequence[str],
    wanted: Selection,
    from_file: Path | None,
    reason: str,
    by: str | None,
    dry_run: bool,
    store: Path,
    json_output: bool,
) -> None:
    """``twin decide``."""
    from twin.store.store import Store

    who = person() if by is None else by
    verbs = [word for word in words if word in (*_WORDS, _UNDO)]
    others = [word for word in words if word not in verbs]
    with Store.open(store, create=False) as opened:
        if from_file is not None:
            _refuse(
                bool(words) or not wanted.is_empty or dry_run, "--from takes nothing but --reason and --by"
            )
            _from_file(opened, from_file, who, reason, json_output)
            return
        _refuse(len(verbs) != 1, f"say one of {', '.join((*_WORDS, _UNDO))}, once")
        if verbs[0] == _UNDO:
            _refuse(not wanted.is_empty or bool(reason) or dry_run, "undo takes only a number and --by")
            _undo(opened, others, who, json_output)
            return
        _refuse(bool(others) and not wanted.is_empty, "name changes, or select them by options, not both")
        _refuse(
            not others and wanted.is_empty, "name changes, or select them by --verdict, --drive, --area …"
        )
        _decide(opened, verbs[0], others, wanted, (who, reason), dry_run, json_output)


def _refuse(wrong: bool, cure: str) -> None:
    if wrong:
        raise ConfigError(f"This is no decision that twin understands: {cure} (see `twin decide --help`).")


def _decide(
    store: Store,
    decision: str,
    change_ids: Sequence[str],
    wanted: Selection,
    by_and_reason: tuple[str, str],
    dry_run: bool,
    json_output: bool,
) -> None:
    from twin.decisions.decide import decide as run
    from twin.decisions.findings import select

    store.matched()
    if not change_ids:
        rows = select(store.rows, wanted)
        if not rows:
            raise RefusedError(
                f"No {wanted.decision} finding fits what was selected, so nothing was decided: "
                "`twin match` lists the findings; --state selects those that were decided before."
            )
        change_ids = [row["change_id"] for row in rows]
        if dry_run and not json_output:
            _print_findings(rows)
    by, reason = by_and_reason
    done = run(store, change_ids, decision, by=by, reason=reason, dry_run=dry_run)
    _tell({"would_decide" if dry_run else "decided": decision, **asdict(done)}, json_output)


def _from_file(store: Store, path: Path, by: str, reason: str, json_output: bool) -> None:
    from twin.export import decide_as_in

    done = decide_as_in(store, path, by=by, reason=reason)
    _tell({"from": str(path), "change_ids": list(done)}, json_output)


def _undo(store: Store, others: Sequence[str], by: str, json_output: bool) -> None:
    from twin.decisions.decide import undo

    _refuse(len(others) > 1 or not all(word.isdigit() for word in others), "undo takes one number")
    done = undo(store, int(others[0]) if others else 1, by=by)
    _tell({"undone": True, "change_ids": list(done)}, json_output)


def _tell(done: Mapping[str, Any], json_output: bool) -> None:
    """Print what was decided: JSON, or a sentence with the number of changes."""
    if json_output:
        print_json(done)
        return
    n = len(done["change_ids"])
    changes = "1 finding" if n == 1 else f"{n:,} findings"
    if "would_decide" in done:
        note(f"Would {done['would_decide']} {changes}; nothing was decided (--dry-run).")
    elif "from" in done:
        note(f"{changes} decided as in {done['from']}.")
    elif "undone" in done:
        note(f"{changes}: the decision of before holds again.")
    else:
        already = f"; {len(done['already']):,} had it already" if done["already"] else ""
        note(f"{changes}: {done['decided']}{already}.")


def explain(change_id: str, store: Path, json_output: bool) -> None:
    """``twin explain``."""
    from twin.decisions.explain import explain_change
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        explained = explain_change(opened, change_id)
    if json_output:
        print_json(explained.as_json())
        return
    sys.stdout.write(f"{explained.sentence}\n")
    print_pairs(f"Change {explained.change['change_id']}", _pairs(explained.change, explained.drives))
    if explained.terms:
        _print_terms(explained.terms)
    if explained.history:
        print_table(
            "Decisions",
            ["at", "decision", "by", "how", "reason"],
            [(e["at"], e["decision"], e["by"], e["kind"], e["reason"]) for e in explained.history],
            right_from=5,
        )


def _pairs(change: Row, drives: Sequence[Row]) -> dict[str, object]:
    from twin.decisions.explain import percent

    kind = "Skiltpunkt" if change["nvdb_type"] == 95 else "Skiltplate"
    distance, sigma = change["distance_m"], change["distance_sigma_m"]
    days = (dt.datetime.fromtimestamp(drive["started_ns"] / 1e9, tz=dt.UTC) for drive in drives)
    return {
        "verdict": change["verdict"],
        "confidence": percent(change["confidence"]),
        "NVDB": f"{kind} {change['nvdb_id']}, version {change['nvdb_version']}"
        if change["nvdb_id"]
        else None,
        "sign code in NVDB": change["skiltnummer_nvdb"].replace(";", " + ") or None,
        "sign code seen": change["skiltnummer_seen"].replace(";", " + ") or None,
        "distance from NVDB's position": None if distance is None else f"{distance:.2f} ± {sigma:.2f} m",
        "position, EPSG:25833": f"{change['east_m']:.2f} E  {change['north_m']:.2f} N",
        "sightings": change["n_sightings"],
        "drives": ", ".join(f"{d['name']} {day:%Y-%m-%d}" for d, day in zip(drives, days, strict=True))
        or None,
        "decision": change["decision"],
    }


def _print_terms(terms: Any) -> None:
    """Print what the verdict rests on, a term a line."""
    print_pairs("Term by term", dict(_flat("", terms)))


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
