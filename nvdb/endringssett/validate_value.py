"""Check the value of one property: its kind, its limits, and of a geometry its point and quality."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from datetime import date, time
from typing import Final, Protocol

from nvdb.datakatalog.katalog import Datakatalog, Egenskapstype
from nvdb.endringssett.document import Egenskap, Endring, Geometri, Kvalitet
from nvdb.endringssett.finding import ADVARSEL, FEIL, ValidationFinding
from nvdb.endringssett.rules import (
    DATAFANGSTMETODER,
    GRENSER,
    MAX_NOYAKTIGHET_CM,
    OBLIGATORISK,
    SRID,
    SYNBARHET,
    Grenser,
)
from nvdb.objects.geometri import (
    UNKNOWN_HEIGHT,
    PositionError,
    PositionFault,
    point_from_wkt,
    position_from_wkt,
)

_ENUMS: Final = frozenset({"Tekstenum", "Heltallenum", "Flyttallenum"})
_INTEGER: Final = re.compile(r"[-+]?\d{1,18}")
_DECIMAL: Final = re.compile(r"[-+]?\d{1,18}(\.\d+)?")
_NO_HEIGHT: Final = re.compile(r"\s*POINT\s*(\(|M)", re.IGNORECASE)


class Say(Protocol):
    """Makes a finding of the object in hand."""

    def __call__(
        self, code: str, clause: str, *, severity: str = FEIL, egenskap: int | None = None
    ) -> ValidationFinding:
        """One finding."""


def check_egenskap(
    endring: Endring, egenskap: Egenskap, katalog: Datakatalog, say: Say
) -> Iterator[ValidationFinding]:
    """Check one property of one object."""
    number = egenskap.type_id
    kind = katalog.egenskapstyper.get(number)
    if kind is None or kind.type_id != endring.type_id:
        code = "UKJENT_EGENSKAPSTYPE" if kind is None else "UGYLDIG_EGENSKAPSTYPE"
        yield say(code, f"has the property {number}, which its type has not: leave it out", egenskap=number)
        return
    name = f"{number} {kind.navn}"
    values = len(egenskap.verdi) + len(egenskap.enum) + (egenskap.geometri is not None)
    if egenskap.operasjon == "slett":
        if values:
            yield say("UGYLDIG_TYPE", f"deletes {name} and gives it a value: do one", egenskap=number)
        if number in OBLIGATORISK.get(endring.type_id, frozenset()):
            clause = f"deletes {name}, which it cannot be without: give the right value instead"
            yield say("MANGLER_OBLIGATORISKE_EGENSKAPER", clause, egenskap=number)
        return
    if values != 1:
        clause = f"gives {name} {values} values: give one"
        yield say("FLERE_ENN_MAKSIMUM_ANTALL" if values else "UGYLDIG_TYPE", clause, egenskap=number)
    elif egenskap.geometri is not None or kind.egenskapstype == "Geometri":
        yield from _check_geometry_kind(egenskap, kind, name, say)
    elif egenskap.enum:
        yield from _check_enum(egenskap.enum[0], kind, name, say)
    else:
        yield from _check_text(egenskap.verdi[0], kind, name, say)


def _check_geometry_kind(
    egenskap: Egenskap, kind: Egenskapstype, name: str, say: Say
) -> Iterator[ValidationFinding]:
    if egenskap.geometri is None or kind.egenskapstype != "Geometri":
        clause = (
            f"gives {name} {'a geometry' if egenskap.geometri else 'a text'}, which it cannot take: mend it"
        )
        yield say("UGYLDIG_TYPE", clause, egenskap=kind.id)
        return
    for code, clause, severity in _check_geometri(egenskap.geometri):
        yield say(code, f"has in {name} {clause}", severity=severity, egenskap=kind.id)


def _check_enum(enum_id: int, kind: Egenskapstype, name: str, say: Say) -> Iterator[ValidationFinding]:
    if kind.egenskapstype and kind.egenskapstype not in _ENUMS:
        clause = f"gives {name} the enum id {enum_id}, but it takes {kind.egenskapstype}: give a value"
        yield say("IKKE_FLERVERDIEGENSKAP", clause, egenskap=kind.id)
    elif enum_id not in kind.verdier:
        severity = FEIL if kind.complete else ADVARSEL
        clause = f"gives {name} the enum id {enum_id}, which is not among its values: give one of them"
        if not kind.complete:
            clause = f"gives {name} the enum id {enum_id}, which cannot be checked: {_PARTIAL}"
        yield say("UGYLDIG_FLERVERDI", clause, severity=severity, egenskap=kind.id)


_PARTIAL: Final = "only a part of its values ships with this program, so sync with NVDB first"


def _check_text(text: str, kind: Egenskapstype, name: str, say: Say) -> Iterator[ValidationFinding]:
    if not text.strip():
        yield say("UGYLDIG_TYPE", f"gives {name} an empty value: leave it out or delete it", egenskap=kind.id)
        return
    if kind.egenskapstype in _ENUMS:
        if text not in {str(value) for value in kind.verdier.values()}:
            severity = FEIL if kind.complete else ADVARSEL
            clause = f"gives {name} the value {text[:40]!r}, which is not among its values: give the enum id"
            if not kind.complete:
                clause = f"gives {name} the value {text[:40]!r}, which cannot be checked: {_PARTIAL}"
            yield say("UGYLDIG_FLERVERDI", clause, severity=severity, egenskap=kind.id)
        return
    if not _readable(text, kind.egenskapstype):
        code = _FORMAT_CODES.get(kind.egenskapstype, "UGYLDIG_TYPE")
        clause = f"gives {name} the value {text[:40]!r}, which is not a {kind.egenskapstype}: mend it"
        yield say(code, clause, egenskap=kind.id)
        return
    for code, clause in _check_limits(text, kind, GRENSER.get(kind.id)):
        yield say(code, f"gives {name} the value {text[:40]!r}, {clause}", egenskap=kind.id)


_FORMAT_CODES: Final = {
    "Heltall": "UGYLDIG_HELTALLFORMAT",
    "Flyttall": "UGYLDIG_FLYTTALLFORMAT",
    "Dato": "UGYLDIG_DATOFORMAT",
    "Kortdato": "UGYLDIG_KORTDATOFORMAT",
    "Tid": "UGYLDIG_TIDFORMAT",
    "Boolsk": "UGYLDIG_BOOLSK_FORMAT",
}


def _readable(text: str, egenskapstype: str) -> bool:
    """Whether a text is of its kind; kinds that are not known here are taken as they come."""
    if egenskapstype == "Heltall":
        return _INTEGER.fullmatch(text) is not None
    if egenskapstype == "Flyttall":
        return _DECIMAL.fullmatch(text) is not None
    if egenskapstype == "Boolsk":
        return text.lower() in {"ja", "nei", "true", "false"}
    try:
        if egenskapstype == "Dato":
            date.fromisoformat(text)
        elif egenskapstype == "Kortdato":
            date.fromisoformat(f"2000-{text}" if "-" in text else f"2000{text}")
        elif egenskapstype == "Tid":
            time.fromisoformat(text)
    except ValueError:
        return False
    return True


def _check_limits(text: str, kind: Egenskapstype, limits: Grenser | None) -> Iterator[tuple[str, str]]:
    if limits is None:
        return
    is_number = kind.egenskapstype in {"Heltall", "Flyttall"}
    length = len(text.lstrip("+-")) if is_number else len(text)
    if limits.feltlengde is not None and length > limits.feltlengde:
        yield "OVERSKRIDER_FELTLENGDE", f"longer than {limits.feltlengde} characters: shorten it"
    if not is_number:
        return
    if limits.desimaler is not None and len(text.partition(".")[2].rstrip("0")) > limits.desimaler:
        yield "FOR_MANGE_DESIMALER", f"with more than {limits.desimaler} decimals: round it"
    if limits.minst is not None and float(text) < limits.minst:
        yield "MINDRE_ENN_ABSOLUTT_MINIMUM", f"less than {limits.minst:g}: mend it"
    if limits.hoyst is not None and float(text) > limits.hoyst:
        yield "STØRRE_ENN_ABSOLUTT_MAKSIMUM", f"more than {limits.hoyst:g}: mend it"


_GEOMETRY_CODES: Final = {
    PositionFault.NOT_A_POINT: "UGYLDIG_TYPE",
    PositionFault.OUTSIDE_NORWAY: "GEOMETRI_UTENFOR_OMRISSET_AV_EUREF89_UTM33N",
}


def _check_geometri(geometri: Geometri) -> Iterator[tuple[str, str, str]]:
    """Yield code, clause after "has in 4794 …", severity."""
    if geometri.srid not in SRID:
        yield "UGYLDIG_GEOMETRI_SRID", f"the srid {geometri.srid}, not in use in Norway: give 5973", FEIL
    try:
        x, y, height = point_from_wkt(geometri.wkt)
        if geometri.srid in {5972, 5973, 5975, 25832, 25833, 25835}:
            position_from_wkt(geometri.wkt, geometri.srid)
    except PositionError as error:
        code = _GEOMETRY_CODES.get(error.kind, "UGYLDIG_GEOMETRIFORMAT")
        yield code, f"a geometry that {error}: give a POINT of east and north", FEIL
        return
    if geometri.srid == 4326 and not (math.fabs(x) < 40 < math.fabs(y)):
        yield "UGYLDIG_GEOMETRIFORMAT", "degrees that are not longitude, latitude in Norway: send 5973", FEIL
    has_height = height is not None
    if not has_height and not _NO_HEIGHT.match(geometri.wkt):
        clause = f"the height {UNKNOWN_HEIGHT:.0f}, which means unknown: leave the height out"
        yield "UGYLDIG_GEOMETRIFORMAT", clause, FEIL
    if geometri.referansegeometri:
        yield "UGYLDIG_TYPE", "a referansegeometri, which is no measured position: leave that out", ADVARSEL
    if geometri.datafangstdato is None:
        yield "UGYLDIG_KVALITETSPARAMETER", "no datafangstdato: add the day of measuring", ADVARSEL
    yield from _check_quality(geometri.kvalitet or Kvalitet(), has_height)


def _check_quality(kvalitet: Kvalitet, has_height: bool) -> Iterator[tuple[str, str, str]]:
    """Three parameters for a position in plan, five with a height (Jira NVDB-14179, quoted in a script)."""
    code = "UGYLDIG_KVALITETSPARAMETER"
    of_plan = (kvalitet.datafangstmetode or kvalitet.malemetode, kvalitet.noyaktighet_cm, kvalitet.synbarhet)
    of_height = (
        kvalitet.datafangstmetode_hoyde or kvalitet.malemetode_hoyde,
        kvalitet.noyaktighet_hoyde_cm,
    )
    if None in of_plan:
        yield code, "not all of datafangstmetode, nøyaktighet and synbarhet: give the three", FEIL
    if has_height and None in of_height:
        yield code, "a height without datafangstmetodeHøyde and nøyaktighetHøyde: give both", FEIL
    if not has_height and any(value is not None for value in of_height):
        yield code, "a quality of height but no height: leave it out", FEIL
    for word, method in (
        ("datafangstmetode", kvalitet.datafangstmetode),
        ("datafangstmetodeHøyde", kvalitet.datafangstmetode_hoyde),
    ):
        if method is not None and method not in DATAFANGSTMETODER:
            yield code, f"the {word} {method!r}: give one of {', '.join(sorted(DATAFANGSTMETODER))}", FEIL
    for word, value in (
        ("nøyaktighet", kvalitet.noyaktighet_cm),
        ("nøyaktighetHøyde", kvalitet.noyaktighet_hoyde_cm),
    ):
        if value is not None and value <= 0:
            yield code, f"the {word} {value} cm: give a whole number above 0", FEIL
        elif value is not None and value > MAX_NOYAKTIGHET_CM:
            yield code, f"the {word} {value} cm, which is too coarse for a sign: check the unit", ADVARSEL
    if kvalitet.synbarhet is not None and kvalitet.synbarhet not in SYNBARHET:
        yield code, f"the synbarhet {kvalitet.synbarhet}: give 0 (good) to 3", FEIL
