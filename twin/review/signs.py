"""Names of signs, as the datakatalog of the store has them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import sqlalchemy as sa

from nvdb.datakatalog import SKILTNUMMER, katalog_from_document, sign_code, snapshot
from twin.review.records import Sign
from twin.store import schema
from twin.store.store import Snapshot

_DASH = " – "


class SignNames:
    """Sign code → name.

    Parameters
    ----------
    names : mapping of str → str
    """

    def __init__(self, names: Mapping[str, str]) -> None:
        self._names = names

    def sign(self, code: str) -> Sign:
        """Return the sign of a code, with its name or, where that is not known, its code again."""
        return Sign(code, self._names.get(code, code))

    def title(self, codes: Iterable[str]) -> str:
        """``142 – Barn + 802 – Avstand``."""
        named = (self.sign(code) for code in codes)
        return " + ".join(f"{s.code}{_DASH}{s.name}" if s.name != s.code else s.code for s in named)


def sign_names(view: Snapshot) -> SignNames:
    """Gather names from the shipped catalogue, the one of the last sync, and the mirrored plates."""
    plate = schema.skiltplate.c
    mirrored = view.columns(sa.select(plate.skiltnummer_text).distinct())["skiltnummer_text"]
    kept = view.fact("datakatalog")
    catalogues = [snapshot(), *([] if kept is None else [katalog_from_document(kept)])]
    values = [value for one in catalogues for value in one.egenskapstyper[SKILTNUMMER].verdier.values()]
    names: dict[str, str] = {}
    for text in (*map(str, values), *(text for text in mirrored if text)):
        code, (_, _, name) = sign_code(text), text.partition(" - ")
        if code is not None and name:
            names[code] = name.strip()
    return SignNames(names)
