"""``twin explain``: one finding, term by term, and who decided what about it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, JsonOption, LangOption, StoreOption
from twin.cli.output import print_json, print_pairs, print_table
from twin.cli.told import Told, told_in
from twin.words import (
    Lang,
    chance_text,
    decision_title,
    nvdb_type_title,
    say,
    sign_titles,
    terms_in_words,
    verdict_title,
)

if TYPE_CHECKING:
    from twin.decisions.explain import ChangeExplained

app = typer.Typer()


@app.command("explain", epilog="Example: twin explain 3f09a1b2c4d5")
def explain(
    change: Annotated[
        str, typer.Argument(help="A finding's change_id, or its first six digits.", metavar="CHANGE_ID")
    ],
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one finding: verdict, confidence and reason, and who decided what about it."""
    from twin.decisions.explain import explain_change
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        explained = explain_change(opened, change)
        told = told_in(opened, [explained.change], lang)
    if json_output:
        print_json(explained.as_json())
        return
    sys.stdout.write(f"{told.seen(explained.change.finding)}\n")
    sys.stdout.write(f"{explained.in_words(lang, told.names)}\n")
    print_pairs(say(lang, "explain.title", change=explained.change.change_id), dict(_pairs(explained, told)))
    terms = terms_in_words(explained.change.finding, lang)
    if terms:
        columns = [say(lang, f"explain.{name}") for name in ("term", "value", "meaning")]
        rows = [(term.label, term.value, term.explanation) for term in terms]
        print_table(say(lang, "explain.terms"), columns, rows, right_from=3)
    if explained.history:
        print_table(
            say(lang, "explain.decisions"),
            [say(lang, f"explain.{name}") for name in ("at", "decision", "by", "how", "reason")],
            [
                (
                    e.at,
                    decision_title(e.decision, lang),
                    e.by,
                    say(lang, f"entry.{e.kind}"),
                    e.told(lang, told.names),
                )
                for e in explained.history
            ],
            right_from=5,
        )


def _pairs(explained: ChangeExplained, told: Told) -> Iterator[tuple[str, object]]:
    finding, lang, names = explained.change.finding, told.lang, told.names
    known = None
    if finding.nvdb_id is not None:
        kind = nvdb_type_title(finding.nvdb_type)
        facts = {"object": f"{kind} {finding.nvdb_id}", "version": str(finding.nvdb_version)}
        known = say(lang, "explain.known_as", **facts)
    distance = None
    if finding.distance_m is not None and finding.distance_sigma_m is not None:
        metres = {"distance_m": finding.distance_m, "sigma_m": finding.distance_sigma_m}
        distance = say(lang, "explain.metres", **metres)
    drives = [f"{drive.name} {drive.day}" for drive in explained.drives]
    pairs = {
        "verdict": verdict_title(finding.verdict, lang),
        "confidence": chance_text(finding.confidence, lang),
        "nvdb": known,
        "road": str(told.roads.get(finding.change_id) or "") or None,
        "code_nvdb": sign_titles(finding.skiltnummer_nvdb, names) or None,
        "code_seen": sign_titles(finding.skiltnummer_seen, names) or None,
        "distance": distance,
        "position": say(lang, "explain.grid", east=finding.east_m, north=finding.north_m),
        "sightings": finding.n_sightings,
        "drives": ", ".join(drives) or None,
        "decided": decision_title(explained.change.decision, lang),
    }
    for name, value in pairs.items():
        yield say(lang, f"explained.{name}"), value
