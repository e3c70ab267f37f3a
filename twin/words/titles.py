"""Names of verdicts, decisions and object types, for people."""

from __future__ import annotations

from twin.words.table import Lang, say


def verdict_title(verdict: str, lang: Lang = Lang.EN) -> str:
    """``wrong type``, ``feil skilttype``."""
    return say(lang, f"verdict.{verdict}")


def decision_title(decision: str, lang: Lang = Lang.EN) -> str:
    """``accepted``, ``godtatt``."""
    return say(lang, f"decision.{decision}")


def nvdb_type_title(nvdb_type: int) -> str:
    """``Skiltpunkt`` or ``Skiltplate``: the database's own nouns in every language."""
    return "Skiltpunkt" if nvdb_type == 95 else "Skiltplate"
