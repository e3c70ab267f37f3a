"""Sign codes of a ``labels.toml`` that may be slips of the pen."""

from __future__ import annotations

import difflib
from functools import cache

from nvdb.datakatalog.ids import SKILTNUMMER
from nvdb.datakatalog.katalog import snapshot
from nvdb.datakatalog.sign_codes import sign_code
from twin.drives.label_map import LabelMap, default_label_map

_MOST_CODES = 8


def unknown_codes_warning(labels: LabelMap, where: str) -> list[str]:
    """List the codes that twin does not know, each with the nearest that it knows; empty if there are none.

    The datakatalog's snapshot holds the common signs only: an unknown code may well be right.
    """
    known = known_codes()
    unknown = [code for code in labels.codes() if code not in known]
    if not unknown:
        return []
    listed = [f"{code} (nearest: {_nearest(code)})" for code in unknown[:_MOST_CODES]]
    more = f" and {len(unknown) - _MOST_CODES} more" if len(unknown) > _MOST_CODES else ""
    warning = (
        f"{where} uses sign codes that are not among the {len(known)} that ship with twin:"
        f" {', '.join(listed)}{more}. They are taken as written; check that NVDB has them."
    )
    return [warning]


@cache
def known_codes() -> frozenset[str]:
    """Sign codes of the datakatalog's snapshot, and those of the labels that ship with twin."""
    values = snapshot().egenskapstyper[SKILTNUMMER].verdier.values()
    codes = {code for value in values if (code := sign_code(str(value))) is not None}
    return frozenset(codes | set(default_label_map().codes()))


def _nearest(code: str) -> str:
    return difflib.get_close_matches(code, sorted(known_codes()), n=1, cutoff=0.0)[0]
