"""The terms of a finding in words: what its confidence is made of, each with what it means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from twin.words.seen import Observed
from twin.words.table import Lang, say


@dataclass(frozen=True, slots=True)
class Term:
    """One term: ``position``, ``+9.4``, and what that weighs."""

    label: str
    value: str
    explanation: str


def terms_in_words(finding: Observed, lang: Lang = Lang.EN) -> tuple[Term, ...]:
    """Return the terms that a finding has, those of its pair first; ids and texts are no terms."""
    return tuple(_terms(finding.terms, lang))


_ODDS = ("position", "code", "text", "facing", "side", "presence")
_CHANCES = ("match", "code", "beyond_tolerance", "taken_down")


def _terms(terms: Mapping[str, Any], lang: Lang) -> Iterator[Term]:
    odds = terms.get("log_odds") or {}
    for name in _ODDS:
        if name in odds:
            yield _term(lang, f"odds_{name}", say(lang, "term.odds", odds=float(odds[name])))
    for name in _CHANCES:
        if terms.get(name) is not None:
            yield _term(lang, name, chance_text(terms[name], lang))
    if "sigmas" in terms:
        yield _term(lang, "sigmas", say(lang, "term.number", number=float(terms["sigmas"])))
    if "nvdb_sigma_m" in terms:
        yield _term(lang, "nvdb_sigma", say(lang, "term.metres", metres=float(terms["nvdb_sigma_m"])))
    if absence := terms.get("absence"):
        yield _term(lang, "frames", say(lang, "term.count", count=int(absence["frames"])))
        yield _term(lang, "gone", chance_text(absence["gone"], lang))


def _term(lang: Lang, name: str, value: str) -> Term:
    return Term(say(lang, f"term.{name}.label"), value, say(lang, f"term.{name}.explanation"))


def chance_text(share: float, lang: Lang = Lang.EN) -> str:
    """Write a probability for people: ``66.9%``; none is a certainty, and none an impossibility."""
    if share >= 0.9995:
        return say(lang, "term.nearly_certain", share=0.999)
    if share < 0.0005:
        return say(lang, "term.hardly", share=0.001)
    return say(lang, "term.chance", share=float(share))
