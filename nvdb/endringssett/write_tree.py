"""Between the dataclasses and the document's own words: one tree, from which XML and JSON are both made.

The tree has the form of the JSON document (``{"registrer": {"vegobjekter": [{"typeId": 95, …}]}}``). What is
documented of it are the examples of API Skriv V3; where JSON shows nothing, the XML's words are used.
"""

from __future__ import annotations

from datetime import UTC, date, datetime
from decimal import Decimal
from typing import Any, Final

from nvdb.endringssett.document import (
    OPERASJONER,
    Assosiasjon,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Punkt,
    Stedfesting,
)

Tree = dict[str, Any]

_KVALITET: Final = {
    "datafangstmetode": "datafangstmetode",
    "målemetode": "malemetode",
    "datafangstmetodeHøyde": "datafangstmetode_hoyde",
    "målemetodeHøyde": "malemetode_hoyde",
    "nøyaktighet": "noyaktighet_cm",
    "nøyaktighetHøyde": "noyaktighet_hoyde_cm",
    "synbarhet": "synbarhet",
    "toleranse": "toleranse_cm",
}
_GEOMETRI: Final = {
    "srid": "srid",
    "wkt": "wkt",
    "lengde": "lengde_m",
    "datafangstdato": "datafangstdato",
    "temakode": "temakode",
    "medium": "medium",
    "kommune": "kommune",
    "høydereferanse": "hoydereferanse",
    "sosinavn": "sosinavn",
    "referansegeometri": "referansegeometri",
    "verifiseringsdato": "verifiseringsdato",
    "oppdateringsdato": "oppdateringsdato",
    "prosesshistorikk": "prosesshistorikk",
}


def decimal_text(value: float) -> str:
    """Write a number with all its digits and without an exponent.

    >>> decimal_text(0.3), decimal_text(1e-07)
    ('0.3', '0.0000001')
    """
    return format(Decimal(repr(value)), "f")


def nvdb_time(moment: datetime) -> str:
    """Write a moment as NVDB writes the times of its transactions: UTC, without a zone."""
    utc = moment.astimezone(UTC).replace(tzinfo=None)
    return utc.isoformat(timespec="milliseconds" if utc.microsecond else "seconds")


def tree_from_endringssett(sett: Endringssett) -> Tree:
    """Write a set as a tree; :func:`nvdb.endringssett.read_tree.endringssett_from_tree` is the inverse."""
    tree: Tree = _given(
        {
            "datakatalogversjon": sett.datakatalogversjon,
            "ansvarlig": sett.ansvarlig,
            "eksternRef": sett.ekstern_ref,
            "kontekst": sett.kontekst,
        }
    )
    for operasjon in OPERASJONER:
        vegobjekter = [_vegobjekt(endring) for endring in sett.endringer if endring.operasjon == operasjon]
        if vegobjekter:
            tree[operasjon] = {"vegobjekter": vegobjekter}
    return tree


def _given(tree: Tree) -> Tree:
    """Leave out what is not given: None, and empty lists and mappings."""
    return {key: value for key, value in tree.items() if value is not None and value not in ([], {})}


def _iso(day: date | None) -> str | None:
    return None if day is None else day.isoformat()


def _ja_nei(value: bool | None) -> str | None:
    return None if value is None else ("JA" if value else "NEI")


def _vegobjekt(endring: Endring) -> Tree:
    lest = endring.lest_fra_nvdb
    kaskade = "kaskadelukking" if endring.operasjon == "lukk" else "kaskadefjerning"
    return _given(
        {
            "typeId": endring.type_id,
            "nvdbId": endring.nvdb_id,
            "tempId": endring.temp_id,
            "versjon": endring.versjon,
            "overskriv": "JA" if endring.overskriv else None,
            "validering": _given({"lestFraNvdb": None if lest is None else nvdb_time(lest)}),
            "gyldighetsperiode": _given(
                {"startdato": _iso(endring.startdato), "sluttdato": _iso(endring.sluttdato)}
            ),
            "egenskaper": [_egenskap(egenskap) for egenskap in endring.egenskaper],
            "assosiasjoner": [_assosiasjon(item) for item in endring.assosiasjoner],
            "stedfesting": None if endring.stedfesting is None else _stedfesting(endring.stedfesting),
            "lukkedato": _iso(endring.lukkedato),
            kaskade: _ja_nei(endring.kaskade),
        }
    )


def _egenskap(egenskap: Egenskap) -> Tree:
    return _given(
        {
            "typeId": egenskap.type_id,
            "operasjon": egenskap.operasjon,
            "verdi": list(egenskap.verdi),
            "enum": list(egenskap.enum),
            "geometri": [] if egenskap.geometri is None else [_geometri(egenskap.geometri)],
        }
    )


def _geometri(geometri: Geometri) -> Tree:
    tree: Tree = {}
    for word, name in _GEOMETRI.items():
        value = getattr(geometri, name)
        tree[word] = value.isoformat() if isinstance(value, date) else value
    tree["srid"] = str(geometri.srid)
    if geometri.kvalitet is not None:
        tree["kvalitet"] = _given(
            {word: getattr(geometri.kvalitet, name) for word, name in _KVALITET.items()}
        )
    return _given(tree)


def _assosiasjon(item: Assosiasjon) -> Tree:
    # All nvdbId have to come before the first tempId.
    return _given(
        {
            "typeId": item.type_id,
            "operasjon": item.operasjon,
            "nvdbId": [
                _given({"verdi": datter.nvdb_id, "operasjon": datter.operasjon})
                for datter in item.dotre
                if datter.nvdb_id is not None
            ],
            "tempId": [
                _given({"verdi": datter.temp_id, "operasjon": datter.operasjon})
                for datter in item.dotre
                if datter.temp_id is not None
            ],
        }
    )


def _stedfesting(stedfesting: Stedfesting) -> Tree:
    return _given(
        {"operasjon": stedfesting.operasjon, "punkt": [_punkt(punkt) for punkt in stedfesting.punkter]}
    )


def _punkt(punkt: Punkt) -> Tree:
    return _given(
        {
            "veglenkesekvensNvdbId": punkt.veglenkesekvens_id,
            "posisjon": punkt.posisjon,
            "operasjon": punkt.operasjon,
            "retning": punkt.retning,
            "sideposisjon": punkt.sideposisjon,
            "kjørefelt": list(punkt.kjorefelt),
        }
    )
