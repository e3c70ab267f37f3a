"""What is demanded of the properties of Skiltpunkt and Skiltplate beyond ids and kinds.

Source: the datakatalog's type definition of 95 (API Les V3, ``/vegobjekttyper/95``): feltlengde, desimaler,
min, maks, viktighet. That of 96 was not at hand: its texts and numbers have no limits here, and API Skriv's
own validator has the last word.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from nvdb.datakatalog.ids import (
    GEOMETRI_PUNKT_95,
    GEOMETRI_PUNKT_96,
    OPPSETTINGSUTSTYR,
    SKILTNUMMER,
    SKILTPLATE,
    SKILTPUNKT,
)


@dataclass(frozen=True, slots=True)
class Grenser:
    """Limits of a value. `feltlengde` counts characters; of a number, digits and the decimal point."""

    feltlengde: int | None = None
    desimaler: int | None = None
    minst: float | None = None
    hoyst: float | None = None


GRENSER: Final[Mapping[int, Grenser]] = {
    1877: Grenser(1, None, 0, 9),
    1884: Grenser(4, 1, -99.9, 99.9),
    1887: Grenser(1, None, 0, 9),
    2055: Grenser(4, 1, 0.0, 99.9),
    10428: Grenser(4, 2, 0.0, None),
    10854: Grenser(150),
    10894: Grenser(100),
    10929: Grenser(1),
    11078: Grenser(200),
}
"""Property id → its limits, of type 95."""

OBLIGATORISK: Final[Mapping[int, frozenset[int]]] = {
    SKILTPUNKT: frozenset(),
    SKILTPLATE: frozenset({SKILTNUMMER}),
}
"""Type → properties without which an object is refused. Of 95 the datakatalog has none; a plate without a
sign number is refused here, as the one thing that a plate has to say."""

ANBEFALT: Final[Mapping[int, frozenset[int]]] = {
    SKILTPUNKT: frozenset({OPPSETTINGSUTSTYR, GEOMETRI_PUNKT_95}),
    SKILTPLATE: frozenset({GEOMETRI_PUNKT_96}),
}
"""Type → properties that are ``PÅKREVD_IKKE_ABSOLUTT``: API Skriv warns where they are missing."""

SRID: Final = frozenset({4326, 5972, 5973, 5975, 25832, 25833, 25835, 32632, 32633, 32635})
"""Reference systems in use in Norway; API Skriv brings them to 5973 (EUREF89 UTM33, NN2000)."""

DATAFANGSTMETODER: Final = frozenset({"byg", "dig", "fot", "gen", "lan", "pla", "sat", "ukj"})
"""Codes of ``datafangstmetode`` that published scripts of Statens vegvesen's staff take as valid."""

SYNBARHET: Final = range(4)
MAX_NOYAKTIGHET_CM: Final = 1000
"""A sign's position that is worse than 10 m is warned of."""

SIDEPOSISJONER: Final = frozenset({"V", "H", "HV", "M", "K", "MV", "MH", "VT", "HT", "R0", "L"})
"""Values of ``Sideposisjon`` in Uberiket's specification (API Skriv's own list is in its schema)."""
