"""One object of API Les V4 → :class:`~nvdb.objects.vegobjekt.Vegobjekt` and the typed view of signs.

Source: ``/vegobjekter/{type}`` (models ``Vegobjekt``, ``Egenskap``, ``Lokasjon``, ``Stedfesting``) and its
answers. Only ``id`` is always there: the rest depends on ``inkluder``. The schema names what we keep.
"""

from __future__ import annotations

import re
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from nvdb.errors import SchemaError
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

_TYPE_IN_HREF = re.compile(r"/vegobjekter/(\d+)/\d+")


class _Type(msgspec.Struct, gc=False):
    id: Whole


class _AnyType(msgspec.Struct, gc=False):
    id: Whole | None = None


class _Metadata(msgspec.Struct, gc=False):
    type: _AnyType | None = None
    versjon: Whole | None = None
    startdato: str | None = None
    sluttdato: str | None = None
    sist_modifisert: str | None = None


class _Enhet(msgspec.Struct, gc=False):
    kortnavn: str | None = None


class _Kvalitet(
    msgspec.Struct,
    gc=False,
    rename={
        "noyaktighet": "nøyaktighet",
        "datafangstmetode_hoyde": "datafangstmetodeHøyde",
        "noyaktighet_hoyde": "nøyaktighetHøyde",
        "maksimalt_avvik": "maksimaltAvvik",
    },
):
    datafangstmetode: str | None = None
    noyaktighet: Number | None = None
    synbarhet: Whole | None = None
    datafangstmetode_hoyde: str | None = None
    noyaktighet_hoyde: Number | None = None
    maksimalt_avvik: Number | None = None


class _Egenskap(msgspec.Struct, gc=False):
    id: Whole
    navn: str | None = None
    egenskapstype: str | None = None
    verdi: Any = None
    enum_id: Whole | None = None
    enhet: _Enhet | None = None
    innhold: list[_Egenskap] | None = None
    kvalitet: _Kvalitet | UnsetType | None = UNSET


class _Geometri(msgspec.Struct, gc=False):
    wkt: str | None = None
    srid: Any = None
    egengeometri: bool | None = None
    forenklet: bool | None = None


class _Referanse(msgspec.Struct, gc=False):
    kortform: str | None = None


class _Stedfesting(
    msgspec.Struct, gc=False, rename={"relativ_posisjon": "relativPosisjon", "kjorefelt": "kjørefelt"}
):
    type: str | None = None
    veglenkesekvensid: Whole | None = None
    nodeid: Whole | None = None
    relativ_posisjon: Number | None = None
    startposisjon: Number | None = None
    sluttposisjon: Number | None = None
    retning: str | None = None
    kjorefelt: list[str] | None = None
    sideposisjon: str | None = None
    kortform: str | None = None


class _Lokasjon(msgspec.Struct, gc=False):
    kommuner: list[int] | None = None
    fylker: list[int] | None = None
    vegsystemreferanser: list[_Referanse] | None = None
    stedfestinger: list[_Stedfesting] | None = None


class _Relasjon(msgspec.Struct, gc=False):
    """Its members are ids, or whole objects with ``relasjonstype`` ``vegobjekter``."""

    type: _Type
    vegobjekter: list[Whole | _Type] | None = None
    id: Whole | None = None
    listeid: Whole | None = None


class _Relasjoner(msgspec.Struct, gc=False):
    foreldre: list[_Relasjon] | None = None
    barn: list[_Relasjon] | None = None


class _Objekt(msgspec.Struct, gc=False):
    id: Whole
    metadata: _Metadata | None = None
    egenskaper: list[_Egenskap] | None = None
    geometri: _Geometri | None = None
    lokasjon: _Lokasjon | None = None
    relasjoner: _Relasjoner | None = None
    href: Any = None


_NO_METADATA = _Metadata()
_NO_KVALITET = _Kvalitet()
_NO_LOKASJON = _Lokasjon()
_NO_RELASJONER = _Relasjoner()


def vegobjekt_from_les_v4(
    raw: RawObject, *, type_id: int | None = None, only: frozenset[int] | None = None
) -> Vegobjekt:
    """Parse one object of an API Les V4 answer.

    Parameters
    ----------
    raw : dict
        One member of ``objekter``.
    type_id : int, optional
        The type that was asked for; without it the type comes from ``metadata`` or ``href``.
    only : frozenset of int, optional
        Properties to keep, besides geometries; the others are checked and stay in ``raw`` alone.

    Raises
    ------
    SchemaError
        A field that breaks the documented form; the message names the object's id and the field.
    """
    objekt = read(raw, _Objekt, f"vegobjekt {raw.get('id')}")
    problems: list[str] = []
    metadata, lokasjon = objekt.metadata or _NO_METADATA, objekt.lokasjon or _NO_LOKASJON
    relasjoner = objekt.relasjoner or _NO_RELASJONER
    kind = _type_id(objekt, metadata, type_id)
    egenskaper = _egenskaper(objekt, raw, only, problems)
    geometri = _geometri(objekt.geometri)
    own = own_geometry(egenskaper, kind)
    return Vegobjekt(
        id=objekt.id,
        type_id=kind,
        versjon=metadata.versjon,
        startdato=iso_date("startdato", metadata.startdato, problems),
        sluttdato=iso_date("sluttdato", metadata.sluttdato, problems),
        sist_modifisert=metadata.sist_modifisert,
        egenskaper=egenskaper,
        geometri=geometri,
        position=_position(own, geometri, problems),
        own_geometry=geometri is not None and geometri.egengeometri,
        kvalitet=own.kvalitet if own else None,
        kommuner=tuple(lokasjon.kommuner or ()),
        fylker=tuple(lokasjon.fylker or ()),
        vegsystemreferanser=tuple([r.kortform for r in lokasjon.vegsystemreferanser or () if r.kortform]),
        stedfestinger=tuple([_stedfesting(item) for item in lokasjon.stedfestinger or ()]),
        foreldre=tuple([_relasjon(item) for item in relasjoner.foreldre or ()]),
        barn=tuple([_relasjon(item) for item in relasjoner.barn or ()]),
        problems=tuple(problems),
        raw=raw,
    )


def skilt_from_les_v4(raw: RawObject, type_id: int) -> Skiltpunkt | Skiltplate:
    """Parse one object of an answer for `type_id` 95 or 96.

    Raises
    ------
    SchemaError
        The object breaks the documented form, or is of another type.
    """
    vegobjekt = vegobjekt_from_les_v4(raw, type_id=type_id, only=SHOWN.get(type_id))
    return skilt_from_vegobjekt(vegobjekt, type_id)


def type_id_from_href(href: str) -> int | None:
    """Object type in the address of an object, ``…/vegobjekter/96/84130065`` → 96."""
    match = _TYPE_IN_HREF.search(href)
    return int(match.group(1)) if match else None


def _type_id(objekt: _Objekt, metadata: _Metadata, asked: int | None) -> int:
    """The object's type; what was asked for must agree with what the object says."""
    said = metadata.type.id if metadata.type else None
    if said is None and objekt.href is not None:
        if not isinstance(objekt.href, str):
            raise _error(objekt, "href", f"is {objekt.href!r:.40} instead of text")
        said = type_id_from_href(objekt.href)
    if said is not None and asked is not None and said != asked:
        raise _error(objekt, "metadata.type.id", f"is {said}, but {asked} was asked for")
    kind = said if said is not None else asked
    if kind is None:
        raise _error(objekt, "metadata.type.id", "is missing, and nothing else tells the object's type")
    return kind


def _error(objekt: _Objekt, name: str, clause: str) -> SchemaError:
    return field_error(f"vegobjekt {objekt.id}", name, clause)


def _egenskaper(
    objekt: _Objekt, raw: RawObject, only: frozenset[int] | None, problems: list[str]
) -> dict[int, VegobjektEgenskap]:
    by_id: dict[int, VegobjektEgenskap] = {}
    ids: set[int] = set()
    for item, raw_item in zip(objekt.egenskaper or (), raw.get("egenskaper") or (), strict=True):
        if item.id in ids:
            problems.append(f"egenskap {item.id} comes twice, the first is used")
            continue
        ids.add(item.id)
        if only is None or item.id in only or item.egenskapstype == "Geometri":
            by_id[item.id] = _egenskap(item, raw_item)
    return by_id


def _egenskap(item: _Egenskap, raw: RawObject) -> VegobjektEgenskap:
    kvalitet = item.kvalitet
    return VegobjektEgenskap(
        item.id,
        item.navn or "",
        item.egenskapstype or "",
        item.verdi,
        item.enum_id,
        item.enhet.kortnavn if item.enhet else None,
        tuple(map(_egenskap, item.innhold, raw["innhold"])) if item.innhold else (),
        None if isinstance(kvalitet, UnsetType) else kvalitet_from(kvalitet or _NO_KVALITET),
        raw,
    )


def _geometri(item: _Geometri | None) -> VegobjektGeometri | None:
    if item is None or item.wkt is None:
        return None
    srid = None if item.srid is None else str(item.srid)
    return VegobjektGeometri(item.wkt, srid, bool(item.egengeometri), bool(item.forenklet))


def _stedfesting(item: _Stedfesting) -> VegobjektStedfesting:
    return VegobjektStedfesting(
        item.type or "",
        item.veglenkesekvensid,
        item.nodeid,
        as_float(item.relativ_posisjon),
        as_float(item.startposisjon),
        as_float(item.sluttposisjon),
        item.retning,
        tuple(item.kjorefelt or ()),
        item.sideposisjon,
        item.kortform,
    )


def _relasjon(item: _Relasjon) -> Relasjon:
    ids = [member if isinstance(member, int) else member.id for member in item.vegobjekter or ()]
    return Relasjon(item.type.id, tuple(ids), item.id, item.listeid)


def _position(
    own: VegobjektEgenskap | None, geometri: VegobjektGeometri | None, problems: list[str]
) -> Position | None:
    """The best point there is; each source that fails leaves a clause in `problems`."""
    position = None
    if own is not None and (geometri is None or geometri.egengeometri):
        # The property is always UTM33 (EPSG:25833) and carries no srid, whatever srid was asked for.
        position = position_of(f"egenskap {own.id}", own.verdi, own.raw.get("srid") or "5973", problems)
    if position is None and geometri is not None:
        position = position_of("geometri", geometri.wkt, geometri.srid, problems)
    return position
