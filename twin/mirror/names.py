"""Names of sign codes, as the datakatalog and the mirror tell them."""

from __future__ import annotations

import sqlalchemy as sa

from nvdb.datakatalog import SKILTNUMMER, Datakatalog, katalog_from_document, sign_code, snapshot
from twin.store import schema
from twin.store.records import split_codes
from twin.store.store import Snapshot, Store
from twin.words import SignNames, name_in

KATALOG_FACT = "datakatalog"
"""Key of the datakatalog that the last sync fetched."""


def sign_names(store: Store) -> SignNames:
    """Return the names of sign codes: of the datakatalog that a sync fetched, else of the shipped one.

    Where that has codes without names (the shipped one is partial), signs in the mirror tell those of the
    codes that findings have. A code that nobody names is absent.
    """
    with store.snapshot() as view:
        fact = view.fact(KATALOG_FACT)
        katalog = snapshot() if fact is None else katalog_from_document(fact)
        names, nameless = _named(snapshot())
        if katalog is not snapshot():
            fetched, nameless = _named(katalog)
            names |= fetched
        if fact is None or nameless:
            names |= _mirrored(view, _codes(view) - names.keys())
    return names


def shipped_names() -> SignNames:
    """Return the names of the datakatalog that ships with twin: of some codes only."""
    return _named(snapshot())[0]


def sign_codes(store: Store) -> frozenset[str]:
    """Return the sign codes of the datakatalog that a sync fetched, else of the shipped one."""
    with store.snapshot() as view:
        fact = view.fact(KATALOG_FACT)
    return _codes_of(snapshot() if fact is None else katalog_from_document(fact))


def shipped_codes() -> frozenset[str]:
    """Return the sign codes of the datakatalog that ships with twin: some of all."""
    return _codes_of(snapshot())


def _codes_of(katalog: Datakatalog) -> frozenset[str]:
    names, nameless = _named(katalog)
    return frozenset(names) | nameless


def _named(katalog: Datakatalog) -> tuple[dict[str, str], set[str]]:
    """Names of a datakatalog's codes, and its codes without one."""
    kind = katalog.egenskapstyper.get(SKILTNUMMER)
    texts = [str(value) for value in kind.verdier.values()] if kind is not None else []
    names = dict(named for text in texts if (named := name_in(text)) is not None)
    return names, {code for text in texts if (code := sign_code(text)) is not None} - names.keys()


def _codes(view: Snapshot) -> set[str]:
    """Codes that the findings of the last match have."""
    table = schema.change.c
    rows = view.rows(sa.select(table.skiltnummer_nvdb, table.skiltnummer_seen).distinct())
    return {code for row in rows for text in row.values() for code in split_codes(text)}


def _mirrored(view: Snapshot, codes: set[str]) -> dict[str, str]:
    """Names that mirrored plates tell; reads the whole mirror, so only where it is needed."""
    if not codes:
        return {}
    plate = schema.skiltplate.c
    asked = sa.select(plate.skiltnummer_text).where(plate.skiltnummer.in_(codes)).distinct()
    texts = [row["skiltnummer_text"] for row in view.rows(asked)]
    return dict(named for text in texts if text and (named := name_in(text)) is not None)
