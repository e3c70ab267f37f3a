"""Check a change set before anything leaves: against the datakatalog, and against API Skriv's written rules.

What needs NVDB's present state (is the version the newest, does the child exist) only API Skriv can check.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from typing import Final

from nvdb import datakatalog
from nvdb.datakatalog.katalog import Datakatalog, Stedfestingskrav
from nvdb.endringssett.document import (
    DELVIS,
    MAX_VEGOBJEKTER,
    Assosiasjon,
    Datter,
    Endring,
    Endringssett,
    Punkt,
)
from nvdb.endringssett.finding import ADVARSEL, FEIL, ValidationFinding
from nvdb.endringssett.rules import ANBEFALT, OBLIGATORISK, SIDEPOSISJONER
from nvdb.endringssett.validate_value import check_egenskap

_FELT: Final = re.compile(r"[1-9]\d?[A-ZØ]{0,2}\d?")
_VERSION: Final = re.compile(r"\d+\.\d+")
_WHOLE: Final = frozenset({"registrer", "oppdater", "korriger"})


def validate(sett: Endringssett, katalog: Datakatalog | None = None) -> tuple[ValidationFinding, ...]:
    """Check a set.

    Parameters
    ----------
    sett : Endringssett
    katalog : Datakatalog, optional
        The shipped snapshot if omitted. Enum lists of the snapshot are partial: an id that it lacks is a
        warning there, and an error against a fetched datakatalog.

    Returns
    -------
    tuple of ValidationFinding
        Empty if nothing is wrong; a set with a finding of severity ``feil`` would be refused.
    """
    katalog = katalog or datakatalog.snapshot()
    found = list(_of_the_set(sett, katalog))
    for endring in sett.endringer:
        found.extend(_of_an_object(endring, katalog))
    found.extend(_of_families(sett, katalog))
    return tuple(found)


def errors(findings: tuple[ValidationFinding, ...]) -> tuple[ValidationFinding, ...]:
    """Those findings for which a set would be refused."""
    return tuple(finding for finding in findings if finding.severity == FEIL)


def _of_the_set(sett: Endringssett, katalog: Datakatalog) -> Iterator[ValidationFinding]:
    where = "endringssett"
    if not sett.endringer:
        yield ValidationFinding(
            FEIL, "TOMT_ENDRINGSSETT", where, "has no vegobjekt: put in at least one change"
        )
    if len(sett.endringer) > MAX_VEGOBJEKTER:
        clause = f"has {len(sett.endringer)} vegobjekter: split it into sets of at most {MAX_VEGOBJEKTER}"
        yield ValidationFinding(FEIL, "FOR_MANGE_VEGOBJEKTER", where, clause)
    if not _VERSION.fullmatch(sett.datakatalogversjon):
        clause = f"has the datakatalogversjon {sett.datakatalogversjon!r}: give one such as {katalog.version}"
        yield ValidationFinding(FEIL, "UGYLDIG_DATAKATALOGVERSJON", where, clause)
    elif sett.datakatalogversjon != katalog.version:
        clause = (
            f"was made by datakatalog {sett.datakatalogversjon}, checked by {katalog.version}: make it anew"
        )
        yield ValidationFinding(ADVARSEL, "IKKE_GJELDENDE_DATAKATALOGVERSJON", where, clause)
    versions = Counter((e.type_id, e.nvdb_id, e.versjon) for e in sett.endringer if e.nvdb_id is not None)
    for (type_id, nvdb_id, versjon), number in versions.items():
        if number > 1:
            place = f"type {type_id} {nvdb_id} version {versjon}"
            clause = f"has {number} operations in one set: give it one, or send the others in a later set"
            yield ValidationFinding(
                FEIL, "KONFLIKT_MELLOM_VEGOBJEKTER", place, clause, nvdb_id=nvdb_id, versjon=versjon
            )
    names = Counter(e.temp_id for e in sett.endringer if e.temp_id is not None)
    for temp_id, number in names.items():
        if number > 1:
            clause = f"names {number} new objects {temp_id!r}: every tempId must be its own"
            yield ValidationFinding(FEIL, "UGYLDIG_TEMPID", where, clause, temp_id=temp_id)


class _Object:
    """Makes the findings of one object."""

    def __init__(self, endring: Endring) -> None:
        self.endring = endring

    def __call__(
        self, code: str, clause: str, *, severity: str = FEIL, egenskap: int | None = None
    ) -> ValidationFinding:
        endring = self.endring
        return ValidationFinding(
            severity, code, endring.navn, clause, endring.temp_id, endring.nvdb_id, endring.versjon, egenskap
        )


def _of_an_object(endring: Endring, katalog: Datakatalog) -> Iterator[ValidationFinding]:
    say = _Object(endring)
    if endring.type_id not in katalog.typer:
        known = ", ".join(str(number) for number in katalog.typer)
        yield say("UKJENT_VEGOBJEKTTYPE", f"is of a type that is not known here: give one of {known}")
        return
    yield from _only_what_belongs(endring, say)
    yield from _identity(endring, say)
    yield from _dates(endring, say)
    yield from _completeness(endring, katalog, say)
    yield from _operations(endring, say)
    for egenskap in endring.egenskaper:
        yield from check_egenskap(endring, egenskap, katalog, say)
    if endring.stedfesting is not None:
        for punkt in endring.stedfesting.punkter:
            yield from _place(punkt, say)
            yield from _what_a_place_says(punkt, endring, katalog, say)


def _identity(endring: Endring, say: _Object) -> Iterator[ValidationFinding]:
    if endring.operasjon == "registrer":
        if not endring.temp_id:
            yield say("UGYLDIG_TEMPID", "has no tempId: name every new object")
        if endring.nvdb_id is not None or endring.versjon is not None:
            yield say("UGYLDIG_TEMPID", "has an nvdbId or a versjon, which NVDB gives: leave them out")
        return
    if endring.nvdb_id is None or endring.nvdb_id <= 0:
        yield say("VEGOBJEKTET_FINNES_IKKE", "has no nvdbId: say which object is meant")
    versjon = endring.versjon
    if (versjon is None and endring.operasjon != "fjern") or (versjon is not None and versjon < 1):
        yield say("VEGOBJEKTVERSJONEN_FINNES_IKKE", "has no versjon: give the one that was read")
    corrects = endring.operasjon in {"korriger", "delvisKorriger"} or endring.overskriv
    if corrects and endring.lest_fra_nvdb is None:
        yield say("MANGLER_LEST_FRA_NVDB", "has no lestFraNvdb: give the time at which it was read from NVDB")
    if endring.lest_fra_nvdb is not None and endring.lest_fra_nvdb.tzinfo is None:
        yield say("MANGLER_LEST_FRA_NVDB", "has a lestFraNvdb without a zone: give it in UTC")
    if endring.overskriv and endring.operasjon not in {"oppdater", "delvisOppdater"}:
        yield say("UGYLDIG_OPERASJON", "has overskriv, which only oppdater and delvisOppdater take")


def _only_what_belongs(endring: Endring, say: _Object) -> Iterator[ValidationFinding]:
    """What the schema has no place for in this operation."""
    ends = endring.operasjon in {"lukk", "fjern"}
    content = (
        endring.egenskaper,
        endring.assosiasjoner,
        endring.stedfesting,
        endring.startdato,
        endring.sluttdato,
    )
    if ends and any(content):
        yield say(
            "UGYLDIG_OPERASJON", "gives values to what ends: change it in a set before, or leave them out"
        )
    if not ends and endring.kaskade is not None:
        yield say("UGYLDIG_OPERASJON", "has kaskade, which only lukk and fjern take: leave it out")
    if endring.operasjon != "lukk" and endring.lukkedato is not None:
        yield say("UGYLDIG_OPERASJON", "has a lukkedato, which only lukk takes: leave it out")


def _dates(endring: Endring, say: _Object) -> Iterator[ValidationFinding]:
    if endring.operasjon in {"registrer", "oppdater", "delvisOppdater"} and endring.startdato is None:
        yield say("UGYLDIG_STARTDATO", "has no startdato: say from which day it holds")
    start, end = endring.startdato, endring.sluttdato
    if start is not None and end is not None and end <= start:
        yield say("UGYLDIG_STARTDATO", f"ends on {end}, not after {start}: mend it")
    for name, day in (("startdato", endring.startdato), ("lukkedato", endring.lukkedato)):
        if day is not None and not date(1950, 1, 1) <= day <= date(2099, 12, 31):
            yield say("UGYLDIG_STARTDATO", f"has the {name} {day}, which no sign can have: mend the year")
    if endring.operasjon == "lukk" and endring.lukkedato is None:
        yield say("UGYLDIG_STARTDATO", "has no lukkedato: say from which day it is gone")
    if endring.operasjon in {"lukk", "fjern"} and endring.kaskade is None:
        yield say("DATTEROBJEKT_UTEN_MOR", "does not say whether its children go too: set kaskade")


def _completeness(endring: Endring, katalog: Datakatalog, say: _Object) -> Iterator[ValidationFinding]:
    given = {egenskap.type_id for egenskap in endring.egenskaper}
    if endring.operasjon in DELVIS:
        may_be_dates = endring.operasjon == "delvisKorriger" and (endring.startdato or endring.sluttdato)
        if not (given or endring.assosiasjoner or endring.stedfesting or may_be_dates):
            yield say("UFULLSTENDIG_VEGOBJEKT", "changes nothing: give a property, a child or a place")
        if endring.stedfesting is not None and not endring.stedfesting.punkter:
            yield say("MANGLER_STEDFESTING", "loses its place on the road network: give the new one")
    if endring.operasjon not in _WHOLE:
        return
    for number in sorted(OBLIGATORISK.get(endring.type_id, frozenset()) - given):
        clause = f"lacks the property {_named(number, katalog)}: add it"
        yield say("MANGLER_OBLIGATORISKE_EGENSKAPER", clause, egenskap=number)
    for number in sorted(ANBEFALT.get(endring.type_id, frozenset()) - given):
        clause = (
            f"lacks the property {_named(number, katalog)}, which NVDB wants where it is known: add it to "
            "the set, or in NVDB afterwards; the set may go without it"
        )
        yield say("MANGLER_ANBEFALTE_EGENSKAPER", clause, severity=ADVARSEL, egenskap=number)
    if endring.stedfesting is None or not endring.stedfesting.punkter:
        yield say("MANGLER_STEDFESTING", "has no place on the road network: add a stedfesting")


def _named(number: int, katalog: Datakatalog) -> str:
    """``1876 Oppsettingsutstyr``."""
    kind = katalog.egenskapstyper.get(number)
    return f"{number} {kind.navn}" if kind is not None else str(number)


def _operations(endring: Endring, say: _Object) -> Iterator[ValidationFinding]:
    """Every part of a partial operation says what is to be done with it; no part of a whole one does."""
    parts = [(f"property {e.type_id}", e.operasjon) for e in endring.egenskaper]
    parts += [(f"association {a.type_id}", a.operasjon) for a in endring.assosiasjoner]
    if endring.stedfesting is not None:
        parts.append(("stedfesting", endring.stedfesting.operasjon))
    allowed: set[str | None] = {"oppdater", "slett"} if endring.operasjon in DELVIS else {None}
    for name, operasjon in parts:
        if operasjon not in allowed:
            wanted = "oppdater or slett" if endring.operasjon in DELVIS else "none"
            yield say(
                "UGYLDIG_OPERASJON", f"has the operation {operasjon} on its {name}: {wanted} belongs there"
            )
    for number, count in Counter(e.type_id for e in endring.egenskaper).items():
        if count > 1:
            yield say("FLERE_ENN_MAKSIMUM_ANTALL", f"gives property {number} {count} times: give it once")
    lists = [[d.operasjon for d in a.dotre] for a in endring.assosiasjoner]
    if endring.stedfesting is not None:
        lists.append([p.operasjon for p in endring.stedfesting.punkter])
    for operations in lists:
        if len({operation is None for operation in operations}) > 1:
            yield say("UGYLDIG_OPERASJON", "marks some members of a list and not others: mark all or none")
        if any(operation not in {None, "ny", "slett"} for operation in operations):
            yield say("UGYLDIG_OPERASJON", "marks a member with something else than ny or slett: mend it")


def _place(punkt: Punkt, say: _Object) -> Iterator[ValidationFinding]:
    if punkt.veglenkesekvens_id <= 0:
        yield say(
            "UKJENT_VEGLENKESEKVENS", f"is on veglenkesekvens {punkt.veglenkesekvens_id}: give a real id"
        )
    if not 0.0 <= punkt.posisjon <= 1.0:
        yield say("UGYLDIG_STEDFESTING", f"is at position {punkt.posisjon}: positions run from 0 to 1")
    if punkt.retning not in {None, "MED", "MOT"}:
        yield say("UGYLDIG_STEDFESTING", f"has the retning {punkt.retning!r}: give MED or MOT")
    if punkt.sideposisjon is not None and punkt.sideposisjon not in SIDEPOSISJONER:
        known = ", ".join(sorted(SIDEPOSISJONER))
        yield say("UGYLDIG_SIDEPOSISJON", f"has the sideposisjon {punkt.sideposisjon!r}: give one of {known}")
    for felt in punkt.kjorefelt:
        if not _FELT.fullmatch(felt):
            yield say("UGYLDIG_FELT", f"is in lane {felt!r}: give a lane code such as 1 or 2K")


def _what_a_place_says(
    punkt: Punkt, endring: Endring, katalog: Datakatalog, say: _Object
) -> Iterator[ValidationFinding]:
    """Direction, side and lanes against what the type wants; nothing where the datakatalog is not known."""
    krav = katalog.stedfesting.get(endring.type_id, Stedfestingskrav())
    if punkt.retning is None and krav.retning:
        yield say("MANGLER_RETNING", "says no retning, which its type must: give MED or MOT")
    elif punkt.retning is None and krav.retning is None and endring.operasjon == "registrer":
        clause = "says no retning, and it is not known whether its type must: give MED or MOT if you know it"
        yield say("MANGLER_RETNING", clause, severity=ADVARSEL)
    if punkt.sideposisjon is not None and krav.sideposisjon == "NEI":
        yield say("UGYLDIG_SIDEPOSISJON", "says a sideposisjon, which its type does not take: leave it out")
    if punkt.sideposisjon is None and krav.sideposisjon == "MÅ":
        yield say("UGYLDIG_SIDEPOSISJON", "says no sideposisjon, which its type must: give H or V")
    if punkt.kjorefelt and krav.kjorefelt == "NEI":
        yield say("UGYLDIG_FELT", "says lanes, which its type does not take: leave them out")


@dataclass(slots=True)
class _Family:
    """New and known objects of a set by name, and how many parents claim each."""

    by_temp_id: dict[str, Endring]
    by_nvdb_id: dict[int, Endring]
    claims: Counter[str]


def _of_families(sett: Endringssett, katalog: Datakatalog) -> Iterator[ValidationFinding]:
    """Parents and children within the set: a new plate has one parent, which stands where it does."""
    family = _Family(
        {e.temp_id: e for e in sett.endringer if e.temp_id is not None},
        {e.nvdb_id: e for e in sett.endringer if e.nvdb_id is not None},
        Counter(),
    )
    for endring in sett.endringer:
        say = _Object(endring)
        for assosiasjon in endring.assosiasjoner:
            yield from _children(endring, assosiasjon, katalog, family, say)
    for endring in sett.endringer:
        if endring.operasjon == "registrer" and endring.type_id == datakatalog.SKILTPLATE:
            parents = family.claims[endring.temp_id or ""]
            if parents != 1:
                code = "MANGLER_MOROBJEKT" if parents == 0 else "MER_ENN_ETT_MOROBJEKT"
                clause = f"is the plate of {parents} Skiltpunkter in this set: exactly one must name it"
                yield _Object(endring)(code, clause)


def _children(
    endring: Endring, assosiasjon: Assosiasjon, katalog: Datakatalog, family: _Family, say: _Object
) -> Iterator[ValidationFinding]:
    number = assosiasjon.type_id
    child_type = katalog.barn.get(number)
    if child_type is None or endring.type_id != datakatalog.SKILTPUNKT:
        code = "UKJENT_EGENSKAPSTYPE" if child_type is None else "UGYLDIG_EGENSKAPSTYPE"
        yield say(code, f"has the association {number}, which its type has not: use 220004", egenskap=number)
        return
    if not assosiasjon.dotre and assosiasjon.operasjon != "slett":
        yield say("UFULLSTENDIG_VEGOBJEKT", f"has the association {number} without a child: name one")
    for datter in assosiasjon.dotre:
        yield from _child(endring, datter, child_type, family, say)


def _child(
    endring: Endring, datter: Datter, child_type: int, family: _Family, say: _Object
) -> Iterator[ValidationFinding]:
    if (datter.nvdb_id is None) == (datter.temp_id is None):
        yield say(
            "DATTEROBJEKT_FINNES_IKKE", "has a child with both or neither of nvdbId and tempId: give one"
        )
        return
    name = datter.temp_id if datter.temp_id is not None else str(datter.nvdb_id)
    child = (
        family.by_temp_id.get(datter.temp_id)
        if datter.temp_id is not None
        else family.by_nvdb_id.get(datter.nvdb_id or 0)
    )
    if datter.temp_id is not None:
        family.claims[datter.temp_id] += datter.operasjon != "slett"
    if child is None:
        if datter.temp_id is not None:
            yield say(
                "DATTEROBJEKT_FINNES_IKKE", f"names the child {name!r}, which the set does not register"
            )
        return
    if child.type_id != child_type:
        yield say(
            "DATTEROBJEKT_AV_FEIL_TYPE", f"has the child {name!r} of type {child.type_id}: not {child_type}"
        )
    yield from _same_place(endring, child, name, say)


def _same_place(parent: Endring, child: Endring, name: str, say: _Object) -> Iterator[ValidationFinding]:
    if parent.stedfesting is None or child.stedfesting is None or child.operasjon in {"lukk", "fjern"}:
        return
    at = {(p.veglenkesekvens_id, p.posisjon): p for p in parent.stedfesting.punkter}
    for punkt in child.stedfesting.punkter:
        mine = at.get((punkt.veglenkesekvens_id, punkt.posisjon))
        if mine is None:
            clause = f"stands elsewhere on the road network than its child {name!r}: give both one place"
            yield say("STEDFESTING_DEKKER_IKKE_DATTEROBJEKT", clause)
        elif mine.sideposisjon != punkt.sideposisjon:
            clause = f"has another sideposisjon than its child {name!r}: give both the same"
            yield say("STEDFESTING_DEKKER_DATTEROBJEKT_MEN_ANNEN_SIDEPOSISJON", clause)
        elif mine.kjorefelt != punkt.kjorefelt:
            clause = f"has other lanes than its child {name!r}: give both the same"
            yield say("STEDFESTING_DEKKER_DATTEROBJEKT_MEN_ANNET_FELT", clause)
