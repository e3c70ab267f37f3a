"""One object of Uberiket V1 → :class:`~nvdb.objects.vegobjekt.Vegobjekt` and the typed view of signs.

Source: schemas ``Vegobjekt``, ``EgenskapVerdi`` and its kinds, ``Geometristruktur`` and ``Stedfesting`` of
the OpenAPI document of June 2026, and recorded answers of other types. As in API Les V4, a field that breaks
the form raises, and a value that cannot be used is named in ``problems``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import date
from typing import Any, Final

from nvdb import datakatalog
from nvdb.client.fields import Fields
from nvdb.datakatalog.katalog import Datakatalog
from nvdb.objects.geometri import Position, position_from_wkt
from nvdb.objects.skilt import Skiltplate, Skiltpunkt, skiltplate_from_vegobjekt, skiltpunkt_from_vegobjekt
from nvdb.objects.uberiket_fast import usual_skilt
from nvdb.objects.vegobjekt import (
    Egenskap,
    Geometri,
    GeometriKvalitet,
    RawObject,
    Relasjon,
    Stedfesting,
    Vegobjekt,
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

_NO_CODE: Final = "skiltnummer is missing"
"""What :mod:`nvdb.objects.skilt` says of a plate without text in 5530."""


_VIEWED: Final[Mapping[int, frozenset[int]]] = {
    datakatalog.SKILTPUNKT: frozenset({datakatalog.GEOMETRI_PUNKT_95}),
    datakatalog.SKILTPLATE: frozenset(
        {
            datakatalog.GEOMETRI_PUNKT_96,
            datakatalog.SKILTNUMMER,
            datakatalog.ANSIKTSSIDE,
            datakatalog.TEKST,
            datakatalog.PLASSERINGSKODE,
        }
    ),
}
"""Vegobjekttype → the properties that the typed view of signs shows."""


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
    top = Fields(raw, f"vegobjekt {raw.get('id')}")
    object_id, type_id = top.required_integer("id"), top.required_integer("typeId")
    problems: list[str] = []
    period = top.child("gyldighetsperiode")
    egenskaper = {
        egenskap.id: egenskap for egenskap in _egenskaper(top.child("egenskaper"), katalog, problems, only)
    }
    eget = _own_geometry(egenskaper, type_id)
    return Vegobjekt(
        id=object_id,
        type_id=type_id,
        versjon=top.required_integer("versjon"),
        startdato=_iso_date(period, "startdato", problems),
        sluttdato=_iso_date(period, "sluttdato", problems),
        sist_modifisert=top.text("sistEndret"),
        egenskaper=egenskaper,
        geometri=_geometri(eget),
        position=_position(eget, problems),
        own_geometry=eget is not None,
        kvalitet=eget.kvalitet if eget else None,
        kommuner=(),
        fylker=(),
        vegsystemreferanser=(),
        stedfestinger=tuple(_stedfestinger(top.child("stedfesting"))),
        foreldre=(),
        barn=tuple(_barn(top.child("barn"), katalog, problems)),
        problems=tuple(problems),
        raw=raw,
    )


def skilt_from_uberiket(raw: RawObject, type_id: int, katalog: Datakatalog) -> Skiltpunkt | Skiltplate:
    """Parse one object of an answer for `type_id` 95 or 96; SchemaError as above or for another type."""
    usual = usual_skilt(raw, type_id, katalog)
    if usual is not None:
        return usual
    return careful_skilt(raw, type_id, katalog)


def careful_skilt(raw: RawObject, type_id: int, katalog: Datakatalog) -> Skiltpunkt | Skiltplate:
    """Parse an object that may be unusual, and say what is wrong with it."""
    vegobjekt = vegobjekt_from_uberiket(raw, katalog, _VIEWED.get(type_id))
    if type_id == datakatalog.SKILTPUNKT:
        return skiltpunkt_from_vegobjekt(vegobjekt)
    plate = skiltplate_from_vegobjekt(vegobjekt)
    if plate.enum_id is not None and plate.skiltnummer_text is None:
        # The number is there, its text is unknown, and that has been said.
        return replace(plate, problems=tuple(p for p in plate.problems if p != _NO_CODE))
    return plate


def _egenskaper(
    item: Fields, katalog: Datakatalog, problems: list[str], only: frozenset[int] | None = None
) -> Iterator[Egenskap]:
    for key in item.raw:
        if not (key.isascii() and key.isdigit()):
            raise item.error(key, "is not the id of a property")
        if only is not None and int(key) not in only:
            continue
        yield _egenskap(int(key), item.child(key), katalog, problems)


def _egenskap(number: int, item: Fields, katalog: Datakatalog, problems: list[str]) -> Egenskap:
    kind = item.text("type") or ""
    known = katalog.egenskapstyper.get(number)
    made: dict[str, Any] = {"verdi": item.raw.get("verdi"), "enum_id": None, "innhold": (), "kvalitet": None}
    egenskapstype = _KINDS.get(kind, kind)
    if kind == "EnumEgenskap":
        enum_id = item.required_integer("verdi")
        made |= {"verdi": katalog.enum_value(number, enum_id), "enum_id": enum_id}
        egenskapstype = (known.egenskapstype if known else "") or egenskapstype
        if made["verdi"] is None:
            problems.append(f"enum {enum_id} of egenskap {number} is not in datakatalog {katalog.version}")
    elif kind == "GeometriEgenskap":
        geometry = item.child("verdi")
        made |= {"verdi": geometry.text("wkt"), "kvalitet": _kvalitet(geometry)}
        item = geometry
    elif kind == "StrukturEgenskap":
        made |= {"verdi": None, "innhold": tuple(_egenskaper(item.child("verdier"), katalog, problems))}
    elif kind in {"ListeEgenskap", "BinaerEgenskap"}:
        made["verdi"] = None  # members have no ids, and a resource is only named: both stay in `raw`
    return Egenskap(
        id=number,
        navn=known.navn if known else "",
        egenskapstype=egenskapstype,
        enhet=None,
        raw=item.raw,
        **made,
    )


def _kvalitet(geometry: Fields) -> GeometriKvalitet | None:
    if geometry.raw.get("kvalitet") is None:
        return None
    item = geometry.child("kvalitet")

    def known(name: str) -> float | None:
        value = item.number(name)
        return None if value is None or value < 0 else value

    return GeometriKvalitet(
        datafangstmetode=item.text("datafangstmetode"),
        noyaktighet_cm=known("noyaktighet"),
        synbarhet=item.integer("synbarhet"),
        datafangstmetode_hoyde=item.text("datafangstmetodeHoyde"),
        noyaktighet_hoyde_cm=known("noyaktighetHoyde"),
        maksimalt_avvik_cm=known("maksimaltAvvik"),
    )


def _own_geometry(egenskaper: Mapping[int, Egenskap], type_id: int) -> Egenskap | None:
    """The property with the object's own point: by the datakatalog for signs, else the first geometry."""
    known = egenskaper.get(datakatalog.GEOMETRI_PUNKT.get(type_id, -1))
    if known is not None:
        return known
    return next((e for e in egenskaper.values() if e.egenskapstype == "Geometri"), None)


def _geometri(eget: Egenskap | None) -> Geometri | None:
    if eget is None or not isinstance(eget.verdi, str):
        return None
    srid = eget.raw.get("srid")
    return Geometri(wkt=eget.verdi, srid=None if srid is None else str(srid), egengeometri=True)


def _position(eget: Egenskap | None, problems: list[str]) -> Position | None:
    if eget is None:
        return None
    try:
        position, notes = position_from_wkt(
            eget.verdi if isinstance(eget.verdi, str) else "", eget.raw.get("srid")
        )
    except ValueError as error:
        problems.append(f"egenskap {eget.id} {error}")
        return None
    problems.extend(f"egenskap {eget.id}: {note}" for note in notes)
    return position


def _stedfestinger(item: Fields) -> Iterator[Stedfesting]:
    kind = item.text("type") or ""
    for point in item.children("punkter"):
        yield Stedfesting(
            type="Punkt",
            veglenkesekvensid=point.integer("id"),
            relativ_posisjon=point.number("posisjon"),
            retning=point.text("retning"),
            kjorefelt=point.texts("kjorefelt"),
            sideposisjon=point.text("sideposisjon"),
        )
    for line in item.children("linjer"):
        yield Stedfesting(
            type="Linje",
            veglenkesekvensid=line.integer("id"),
            startposisjon=line.number("startposisjon"),
            sluttposisjon=line.number("sluttposisjon"),
            retning=line.text("retning"),
            kjorefelt=line.texts("kjorefelt"),
            sideposisjon=line.text("sideposisjon"),
        )
    if kind == "StedfestingSving":
        yield Stedfesting(type="Sving", nodeid=item.integer("id"))


def _barn(item: Fields, katalog: Datakatalog, problems: list[str]) -> Iterator[Relasjon]:
    """Children by type; one that stands under both ids of its relation comes once."""
    by_type: dict[int, tuple[int, dict[int, None]]] = {}
    for key in item.raw:
        if not (key.isascii() and key.isdigit()):
            raise item.error(key, "is not the id of a relation")
        members = item.integers(key)
        type_id = katalog.barn.get(int(key))
        if type_id is None:
            problems.append(
                f"relation {key} is not in datakatalog {katalog.version}, its children are left out"
            )
            continue
        by_type.setdefault(type_id, (int(key), {}))[1].update(dict.fromkeys(members))
    for type_id, (relation, ids) in by_type.items():
        yield Relasjon(type_id=type_id, vegobjekter=tuple(ids), id=relation)


def _iso_date(period: Fields, name: str, problems: list[str]) -> str | None:
    text = period.text(name)
    if text is None:
        return None
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        problems.append(f"{name} {text[:30]!r} is not a date")
        return None
