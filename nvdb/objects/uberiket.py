"""One object of Uberiket V1 → :class:`~nvdb.objects.vegobjekt.Vegobjekt` and the typed view of signs.

Source: schemas ``Vegobjekt``, ``EgenskapVerdi`` and its kinds, ``Geometristruktur`` and ``Stedfesting`` of
the OpenAPI document of June 2026, and recorded answers of other types. As in API Les V4, a field that breaks
the form raises, and a value that cannot be used is named in ``problems``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final

import msgspec

from nvdb.datakatalog.katalog import Datakatalog
from nvdb.objects.geometri import Position
from nvdb.objects.schema import Number, Whole, as_float, field_error, read
from nvdb.objects.skilt import SHOWN, Skiltplate, Skiltpunkt, skilt_from_vegobjekt
from nvdb.objects.vegobjekt import (
    RawObject,
    Relasjon,
    Vegobjekt,
    VegobjektEgenskap,
    VegobjektGeometri,
    VegobjektStedfesting,
    iso_date,
    kvalitet_from,
    own_geometry,
    position_of,
)

_KINDS: Final[Mapping[str, str]] = {
    "BinaerEgenskap": "Binær",
    "BoolskEgenskap": "Boolsk",
    "DatoEgenskap": "Dato",
    "EnumEgenskap": "Tekstenum",
    "FlyttallEgenskap": "Flyttall",
    "GeometriEgenskap": "Geometri",
    "HeltallEgenskap": "Heltall",
    "KortDatoEgenskap": "Kortdato",
    "ListeEgenskap": "Liste",
    "StrukturEgenskap": "Struktur",
    "TekstEgenskap": "Tekst",
    "TidEgenskap": "Tid",
}
"""Kind of property in Uberiket → in API Les V4."""


class _Periode(msgspec.Struct, gc=False):
    startdato: str | None = None
    sluttdato: str | None = None


class _Egenskap(msgspec.Struct, gc=False):
    type: str | None = None
    verdi: Any = None


class _EnumEgenskap(_Egenskap, gc=False, kw_only=True):
    verdi: Whole


class _Kvalitet(msgspec.Struct, gc=False, rename="camel"):
    datafangstmetode: str | None = None
    noyaktighet: Number | None = None
    synbarhet: Whole | None = None
    datafangstmetode_hoyde: str | None = None
    noyaktighet_hoyde: Number | None = None
    maksimalt_avvik: Number | None = None


class _Geometri(msgspec.Struct, gc=False):
    wkt: str | None = None
    kvalitet: _Kvalitet | None = None


class _GeometriEgenskap(_Egenskap, gc=False):
    verdi: _Geometri | None = None


class _StrukturEgenskap(_Egenskap, gc=False):
    verdier: dict[str, Any] | None = None


_SCHEMA_OF_KIND: Final[Mapping[object, type[_Egenskap]]] = {
    "EnumEgenskap": _EnumEgenskap,
    "GeometriEgenskap": _GeometriEgenskap,
    "StrukturEgenskap": _StrukturEgenskap,
}


class _Sted(msgspec.Struct, gc=False):
    id: Whole | None = None
    retning: str | None = None
    kjorefelt: list[str] | None = None
    sideposisjon: str | None = None


class _Punkt(_Sted, gc=False):
    posisjon: Number | None = None


class _Linje(_Sted, gc=False):
    startposisjon: Number | None = None
    sluttposisjon: Number | None = None


class _Stedfesting(msgspec.Struct, gc=False):
    type: str | None = None
    punkter: list[_Punkt] | None = None
    linjer: list[_Linje] | None = None
    id: Any = None


class _Sving(msgspec.Struct, gc=False):
    id: Whole | None = None


class _Objekt(msgspec.Struct, gc=False, rename="camel"):
    id: Whole
    type_id: Whole
    versjon: Whole
    gyldighetsperiode: _Periode | None = None
    egenskaper: dict[str, Any] | None = None
    sist_endret: str | None = None
    stedfesting: _Stedfesting | None = None
    barn: dict[str, Any] | None = None


_NO_PERIODE = _Periode()
_NO_GEOMETRI = _Geometri()


def vegobjekt_from_uberiket(
    raw: RawObject, katalog: Datakatalog, only: frozenset[int] | None = None
) -> Vegobjekt:
    """Parse one member of ``vegobjekter``.

    Parameters
    ----------
    raw : dict
    katalog : Datakatalog
        Names, enum texts and relations. What it does not know is kept by id: an enum then has `enum_id` and
        no `verdi`, and a clause in ``problems``.
    only : frozenset of int, optional
        Properties to read; the others stay in ``raw`` alone.

    Raises
    ------
    SchemaError
        A field that breaks the documented form; the message names the object's id and the field.
    """
    objekt = read(raw, _Objekt, f"vegobjekt {raw.get('id')}")
    reader = _Reader(f"vegobjekt {objekt.id}", katalog)
    problems = reader.problems
    period = objekt.gyldighetsperiode or _NO_PERIODE
    egenskaper = {e.id: e for e in reader.egenskaper(objekt.egenskaper or {}, "egenskaper", only)}
    own = own_geometry(egenskaper, objekt.type_id)
    return Vegobjekt(
        id=objekt.id,
        type_id=objekt.type_id,
        versjon=objekt.versjon,
        startdato=iso_date("startdato", period.startdato, problems),
        sluttdato=iso_date("sluttdato", period.sluttdato, problems),
        sist_modifisert=objekt.sist_endret,
        egenskaper=egenskaper,
        geometri=_geometri(own),
        position=_position(own, problems),
        own_geometry=own is not None,
        kvalitet=own.kvalitet if own else None,
        kommuner=(),
        fylker=(),
        vegsystemreferanser=(),
        stedfestinger=reader.stedfestinger(objekt.stedfesting),
        foreldre=(),
        barn=tuple(reader.barn(objekt.barn or {})),
        problems=tuple(problems),
        raw=raw,
    )


def skilt_from_uberiket(raw: RawObject, type_id: int, katalog: Datakatalog) -> Skiltpunkt | Skiltplate:
    """Parse one object of an answer for `type_id` 95 or 96; SchemaError as above or for another type."""
    vegobjekt = vegobjekt_from_uberiket(raw, katalog, SHOWN.get(type_id))
    return skilt_from_vegobjekt(vegobjekt, type_id, unknown_enums_named=True)


@dataclass(slots=True)
class _Reader:
    """The parts of one object that the datakatalog is needed for; `problems` gathers what cannot be used."""

    where: str
    katalog: Datakatalog
    problems: list[str] = field(default_factory=list)

    def egenskaper(
        self, raw: Mapping[str, Any], place: str, only: frozenset[int] | None = None
    ) -> Iterator[VegobjektEgenskap]:
        for key, item in raw.items():
            if not _is_id(key):
                raise field_error(self.where, f"{place}.{key}", "is not the id of a property")
            number = int(key)
            if only is None or number in only:
                yield self._egenskap(number, {} if item is None else item, f"{place}.{key}")

    def _egenskap(self, number: int, raw: Any, place: str) -> VegobjektEgenskap:
        kind = raw.get("type") if isinstance(raw, Mapping) else None
        schema = _SCHEMA_OF_KIND.get(kind, _Egenskap) if isinstance(kind, str) else _Egenskap
        item = read(raw, schema, self.where, place)
        egenskapstype = self.katalog.egenskapstyper.get(number)
        navn = egenskapstype.navn if egenskapstype else ""
        name = _KINDS.get(item.type or "", item.type or "")
        if isinstance(item, _EnumEgenskap):
            text = self._enum_text(number, item.verdi)
            name = (egenskapstype.egenskapstype if egenskapstype else "") or name
            return VegobjektEgenskap(number, navn, name, text, item.verdi, raw=raw)
        if isinstance(item, _GeometriEgenskap):
            geometri = item.verdi or _NO_GEOMETRI
            kvalitet = kvalitet_from(geometri.kvalitet) if geometri.kvalitet else None
            return VegobjektEgenskap(
                number, navn, name, geometri.wkt, kvalitet=kvalitet, raw=raw.get("verdi") or {}
            )
        if isinstance(item, _StrukturEgenskap):
            innhold = tuple(self.egenskaper(item.verdier or {}, f"{place}.verdier"))
            return VegobjektEgenskap(number, navn, name, None, innhold=innhold, raw=raw)
        # Members of a list have no ids, and a binary resource is only named: both stay in `raw`.
        verdi = None if item.type in {"ListeEgenskap", "BinaerEgenskap"} else item.verdi
        return VegobjektEgenskap(number, navn, name, verdi, raw=raw)

    def _enum_text(self, number: int, enum_id: int) -> object:
        text = self.katalog.enum_value(number, enum_id)
        if text is None:
            self.problems.append(
                f"enum {enum_id} of egenskap {number} is not in datakatalog {self.katalog.version}"
            )
        return text

    def stedfestinger(self, item: _Stedfesting | None) -> tuple[VegobjektStedfesting, ...]:
        if item is None:
            return ()
        steder = [_punkt(punkt) for punkt in item.punkter or ()]
        steder += [_linje(linje) for linje in item.linjer or ()]
        if item.type == "StedfestingSving":
            sving = read({"id": item.id}, _Sving, self.where, "stedfesting")
            steder.append(VegobjektStedfesting(type="Sving", nodeid=sving.id))
        return tuple(steder)

    def barn(self, raw: Mapping[str, Any]) -> Iterator[Relasjon]:
        """Children by type; one that stands under both ids of its relation comes once."""
        by_type: dict[int, tuple[int, dict[int, None]]] = {}
        for key, item in raw.items():
            if not _is_id(key):
                raise field_error(self.where, f"barn.{key}", "is not the id of a relation")
            members = [] if item is None else read(item, list[int], self.where, f"barn.{key}")
            type_id = self.katalog.barn.get(int(key))
            if type_id is None:
                self.problems.append(
                    f"relation {key} is not in datakatalog {self.katalog.version}, its children are left out"
                )
                continue
            by_type.setdefault(type_id, (int(key), {}))[1].update(dict.fromkeys(members))
        for type_id, (relation, ids) in by_type.items():
            yield Relasjon(type_id=type_id, vegobjekter=tuple(ids), id=relation)


@lru_cache(maxsize=4096)
def _is_id(key: str) -> bool:
    return key.isascii() and key.isdigit()


def _geometri(own: VegobjektEgenskap | None) -> VegobjektGeometri | None:
    if own is None or not isinstance(own.verdi, str):
        return None
    srid = own.raw.get("srid")
    return VegobjektGeometri(wkt=own.verdi, srid=None if srid is None else str(srid), egengeometri=True)


def _position(own: VegobjektEgenskap | None, problems: list[str]) -> Position | None:
    if own is None:
        return None
    return position_of(f"egenskap {own.id}", own.verdi, own.raw.get("srid"), problems)


def _punkt(item: _Punkt) -> VegobjektStedfesting:
    return VegobjektStedfesting(
        type="Punkt",
        veglenkesekvensid=item.id,
        relativ_posisjon=as_float(item.posisjon),
        retning=item.retning,
        kjorefelt=tuple(item.kjorefelt or ()),
        sideposisjon=item.sideposisjon,
    )


def _linje(item: _Linje) -> VegobjektStedfesting:
    return VegobjektStedfesting(
        type="Linje",
        veglenkesekvensid=item.id,
        startposisjon=as_float(item.startposisjon),
        sluttposisjon=as_float(item.sluttposisjon),
        retning=item.retning,
        kjorefelt=tuple(item.kjorefelt or ()),
        sideposisjon=item.sideposisjon,
    )
