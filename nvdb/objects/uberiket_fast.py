"""A quick reading of Uberiket's objects in their usual form; :mod:`nvdb.objects.les_v4_fast` says the idea.

What is accepted here is accepted by :mod:`nvdb.objects.uberiket`, with the same result; at the first thing
that is unusual the answer is None, and the caller takes the other way.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from functools import lru_cache
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, UnsetType, field

from nvdb import datakatalog
from nvdb.datakatalog.katalog import Datakatalog
from nvdb.objects.geometri import position_from_wkt
from nvdb.objects.skilt import Skiltplate, Skiltpunkt
from nvdb.objects.vegobjekt import RawObject, Stedfesting

_Whole = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
_Number = Annotated[float, msgspec.Meta(ge=-(2.0**63), lt=2.0**63)]


class _Kvalitet(msgspec.Struct, gc=False):
    datafangstmetode: str | None = None
    noyaktighet: _Number | None = None
    synbarhet: _Whole | None = None
    datafangstmetodeHoyde: str | None = None  # the API's name
    noyaktighetHoyde: _Number | None = None
    maksimaltAvvik: _Number | None = None


class _Geometri(msgspec.Struct, gc=False):
    wkt: str
    srid: Any = None
    kvalitet: _Kvalitet | None = None


class _GeometriEgenskap(msgspec.Struct, gc=False):
    type: Literal["GeometriEgenskap"]
    verdi: _Geometri


class _EnumEgenskap(msgspec.Struct, gc=False):
    type: Literal["EnumEgenskap"]
    verdi: _Whole


class _TekstEgenskap(msgspec.Struct, gc=False):
    type: Literal["TekstEgenskap"]
    verdi: str


class _HeltallEgenskap(msgspec.Struct, gc=False):
    type: Literal["HeltallEgenskap"]
    verdi: _Whole


class _Viewed(msgspec.Struct, gc=False):
    """The properties that the typed view of signs shows; null is unusual."""

    punkt: _GeometriEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.GEOMETRI_PUNKT_95))
    plate: _GeometriEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.GEOMETRI_PUNKT_96))
    nummer: _EnumEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.SKILTNUMMER))
    side: _EnumEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.ANSIKTSSIDE))
    tekst: _TekstEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.TEKST))
    plassering: _HeltallEgenskap | UnsetType = field(default=UNSET, name=str(datakatalog.PLASSERINGSKODE))


class _Punkt(msgspec.Struct, gc=False):
    id: _Whole | None = None
    posisjon: _Number | None = None
    retning: str | None = None
    kjorefelt: list[str] | None = None
    sideposisjon: str | None = None


class _Stedfesting(msgspec.Struct, gc=False):
    type: Literal["StedfestingPunkter"]
    punkter: list[_Punkt]
    linjer: None = None


class _Periode(msgspec.Struct, gc=False):
    startdato: str | None = None
    sluttdato: str | None = None


class _Objekt(msgspec.Struct, gc=False):
    id: _Whole
    typeId: _Whole
    versjon: _Whole
    egenskaper: _Viewed
    stedfesting: _Stedfesting
    gyldighetsperiode: _Periode = field(default_factory=_Periode)
    barn: dict[str, list[_Whole]] = field(default_factory=dict)
    sistEndret: str | None = None


class _UnusualError(ValueError):
    """Something that the careful parser has to look at."""


def usual_skilt(raw: RawObject, type_id: int, katalog: Datakatalog) -> Skiltpunkt | Skiltplate | None:
    """Read an object of Uberiket as a sign; None if anything about it is unusual."""
    try:
        objekt = msgspec.convert(raw, _Objekt)
        if objekt.typeId != type_id or not all(map(_is_plain_id, raw["egenskaper"])):
            return None
        shared = _shared(objekt, raw, type_id)
        children = _children(objekt.barn, katalog)
        if type_id == datakatalog.SKILTPUNKT:
            return Skiltpunkt(**shared, plate_ids=children.get(datakatalog.SKILTPLATE, ()))
        return _plate(objekt.egenskaper, shared, katalog)
    except (ValueError, TypeError, RecursionError):
        return None


def _shared(objekt: _Objekt, raw: RawObject, type_id: int) -> dict[str, Any]:
    """Fields of :class:`nvdb.objects.skilt.Skilt`."""
    viewed, period = objekt.egenskaper, objekt.gyldighetsperiode
    own = viewed.punkt if type_id == datakatalog.SKILTPUNKT else viewed.plate
    made: dict[str, Any] = {
        "nvdb_id": objekt.id,
        "version": objekt.versjon,
        "start_date": _iso_date(period.startdato),
        "end_date": _iso_date(period.sluttdato),
        "last_modified": objekt.sistEndret,
        "own_geometry": own is not UNSET,
        "stedfesting": tuple([_stedfesting(punkt) for punkt in objekt.stedfesting.punkter]),
        "raw": raw,
    }
    if isinstance(own, UnsetType):
        return made
    position, notes = position_from_wkt(own.verdi.wkt, own.verdi.srid)
    if notes:
        raise _UnusualError
    kvalitet = own.verdi.kvalitet or _Kvalitet()
    accuracy = kvalitet.noyaktighet
    made["position"] = position
    made["accuracy_cm"] = None if accuracy is None or accuracy < 0 else accuracy
    made["capture_method"] = kvalitet.datafangstmetode
    return made


def _plate(viewed: _Viewed, shared: Mapping[str, Any], katalog: Datakatalog) -> Skiltplate:
    nummer, side, tekst, code = viewed.nummer, viewed.side, viewed.tekst, viewed.plassering
    if isinstance(nummer, UnsetType):
        raise _UnusualError
    nummer_text = _enum_text(katalog, datakatalog.SKILTNUMMER, nummer)
    side_text = None
    if not isinstance(side, UnsetType):
        side_text = _enum_text(katalog, datakatalog.ANSIKTSSIDE, side)
    skiltnummer = _known_code(nummer_text)
    if skiltnummer is None:
        raise _UnusualError
    return Skiltplate(
        **shared,
        skiltnummer=skiltnummer,
        skiltnummer_text=nummer_text,
        enum_id=nummer.verdi,
        ansiktsside=side_text,
        ansiktsside_enum_id=None if isinstance(side, UnsetType) else side.verdi,
        text=None if isinstance(tekst, UnsetType) else tekst.verdi,
        plasseringskode=None if isinstance(code, UnsetType) else code.verdi,
    )


def _enum_text(katalog: Datakatalog, egenskap_id: int, egenskap: _EnumEgenskap) -> str:
    value = katalog.enum_value(egenskap_id, egenskap.verdi)
    if not isinstance(value, str):
        raise _UnusualError
    return value


def _children(barn: Mapping[str, list[int]], katalog: Datakatalog) -> dict[int, tuple[int, ...]]:
    """Children by type; a type under several relations is unusual, and so is an unknown relation."""
    found: dict[int, tuple[int, ...]] = {}
    for key, members in barn.items():
        type_id = katalog.barn.get(int(key)) if _is_plain_id(key) else None
        if type_id is None or type_id in found:
            raise _UnusualError
        found[type_id] = tuple(dict.fromkeys(members))
    return found


def _stedfesting(punkt: _Punkt) -> Stedfesting:
    return Stedfesting(
        type="Punkt",
        veglenkesekvensid=punkt.id,
        relativ_posisjon=punkt.posisjon,
        retning=punkt.retning,
        kjorefelt=tuple(punkt.kjorefelt or ()),
        sideposisjon=punkt.sideposisjon,
    )


@lru_cache(maxsize=1024)
def _is_plain_id(key: str) -> bool:
    """Whether a key is an id as numbers are written: ``05530`` would be a second 5530."""
    return key.isascii() and key.isdigit() and key == str(int(key))


@lru_cache(maxsize=4096)
def _iso_date(text: str | None) -> str | None:
    return None if text is None else date.fromisoformat(text).isoformat()


@lru_cache(maxsize=4096)
def _known_code(text: str) -> str | None:
    return datakatalog.sign_code(text)
