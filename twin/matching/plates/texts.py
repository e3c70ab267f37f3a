"""Texts of a pole's plates against those of NVDB's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from twin.matching.config import MatchConfig
from twin.matching.plates.readings import family
from twin.matching.plates.wording import similarity
from twin.matching.sites import Plate

_WITH_TEXT = ("7", "8")
"""How the codes of plates begin that carry a text: vegvisning and underskilt."""


def split_texts(text: str | None, codes: Sequence[str]) -> tuple[str, ...]:
    """Give each plate its text, "" where it has none.

    Parameters
    ----------
    text : str or None
        Of the plates top down, joined by ``;`` as their codes are: ``;200 m`` is the second one's. As many
        texts as there are plates that carry one (7xx and 8xx) may stand alone: ``200 m``.
    codes : sequence of str
        Of the plates, top down.

    Returns
    -------
    tuple of str
        As long as `codes`; empty where no plate has a text.
    """
    if not text or not codes:
        return ()
    parts = [part.strip() for part in text.split(";")]
    carriers = [k for k, code in enumerate(codes) if code.startswith(_WITH_TEXT)]
    if len(parts) < len(codes) and len(parts) == len(carriers):
        placed = dict(zip(carriers, parts, strict=True))
    else:
        last = len(codes) - 1
        placed = dict(enumerate([*parts[:last], " ".join(parts[last:])]))
    found = tuple(placed.get(k, "") for k in range(len(codes)))
    return found if any(found) else ()


def text_odds(alike: float, config: MatchConfig) -> float:
    """Log odds that a plate is NVDB's, by how alike their texts are, against another plate of its code.

    Three things may be seen: the same text, one spelt a little otherwise, and another one.

    Parameters
    ----------
    alike : float
        As :func:`wording.similarity` gives it; NaN, where one has no text, is worth nothing.
    """
    if math.isnan(alike):
        return 0.0
    other, misspelt, chance = config.p_text_other, config.p_text_misspelt, config.p_text_by_chance
    if alike == 1.0:
        ratio = max(1 - other - misspelt, _NEVER) / max(chance, _NEVER)
    elif alike >= config.text_alike:
        ratio = max(misspelt, _NEVER) / max(chance, _NEVER)
    else:
        ratio = max(other, _NEVER) / max(1 - 2 * chance, _NEVER)
    return math.log(ratio)


_NEVER = 1e-12


def text_pairs(
    codes: Sequence[str], texts: Sequence[str], plates: Sequence[Plate], config: MatchConfig
) -> list[tuple[int, int, float]]:
    """Pair plates seen with NVDB's of the same code, then of the same family, so that texts fit best.

    Returns
    -------
    list of (plate seen, plate of NVDB, how alike their texts are)
        NaN where one has no text.
    """
    possible = []
    for k, (code, text) in enumerate(zip(codes, texts, strict=True)):
        for j, plate in enumerate(plates):
            if family(code) == family(plate.code):
                alike = similarity(text, plate.text)
                possible.append((code != plate.code, -text_odds(alike, config), k, j, alike))
    found: list[tuple[int, int, float]] = []
    for _, _, k, j, alike in sorted(possible):
        if all(k != one and j != other for one, other, _ in found):
            found.append((k, j, alike))
    return found


def texts_compared(
    codes: Sequence[str], texts: Sequence[str], plates: Sequence[Plate], config: MatchConfig
) -> list[dict[str, Any]]:
    """Say which texts were compared, top down; empty where there is none on one of the sides."""
    if not texts:
        return []
    return [
        {
            "nvdb_id": plates[j].nvdb_id,
            "code": codes[k],
            "seen": texts[k],
            "nvdb": plates[j].text,
            "alike": round(alike, 2),
            "differs": alike < config.text_alike,
        }
        for k, j, alike in sorted(text_pairs(codes, texts, plates, config))
        if not math.isnan(alike)
    ]
