"""Vegobjekt: one object of the road database, parsed once, at the edge.

Source: API Les V4 (``/vegobjekter/{type}``; models ``Vegobjekt``, ``Egenskap``, ``Lokasjon``,
``Stedfesting``) and its answers. Only ``id`` is always there: the rest depends on ``inkluder``. A field
that breaks the documented form raises :class:`~nvdb.errors.SchemaError`; a *value* that cannot be used (a
date, a position) is left out and named in ``problems``, and the object is kept.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from nvdb import datakatalog
from nvdb.client.fields import INT64, Fields
from nvdb.objects.geometri import Position, position_from_wkt

RawObject = Mapping[str, Any]

_TYPE_IN_HREF = re.compile(r"/vegobjekter/(\d+)/\d+")


@dataclass(frozen=True, slots=True)
class GeometriKvalitet:
    """Quality that a geometry property states. None where it is absent or -1 (unknown).

    ``datafangstmetode`` is a code such as ``sat``, ``fot``, ``dig``, ``ukj``. A round 100 cm by ``ukj`` is
    more likely a default than a measurement.
    """

    datafangstmetode: str | None = None
    noyaktighet_cm: float | None = None
    synbarhet: int | None = None
    datafangstmetode_hoyde: str | None = None
    noyaktighet_hoyde_cm: float | None = None
    maksimalt_avvik_cm: float | None = None


@dataclass(frozen=True, slots=True)
class Egenskap:
    """One property. Unknown kinds and enum ids are kept as they came.

    Attributes
    ----------
    id, navn, egenskapstype
        As in the datakatalog; `egenskapstype` is ``Tekst``, ``Tekstenum``, ``Geometri``, ``Liste`` …
    verdi : object
        As received; None for a list or structure.
    enum_id : int or None
    enhet : str or None
        Unit's short name.
    innhold : tuple of Egenskap
        Members of a ``Liste`` or ``Struktur``.
    kvalitet : GeometriKvalitet or None
    raw : dict
        Everything else (``datafangstdato``, ``høydereferanse`` …).
    """

    id: int
    navn: str
    egenskapstype: str
    verdi: object
    enum_id: int | None
    enhet: str | None
    innhold: tuple[Egenskap, ...]
    kvalitet: GeometriKvalitet | None
    raw: RawObject = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class Geometri:
    """The geometry that V4 chose to show: the object's own, or one derived from the road network.

    `egengeometri` False means a point on the road's centre line: never a sign's position.
    """

    wkt: str
    srid: str | None
    egengeometri: bool
    forenklet: bool = False


@dataclass(frozen=True, slots=True)
class Stedfesting:
    """Where an object is on the road network (a projection onto the centre line).

    Positions are relative, 0 to 1, along the veglenkesekvens. A ``Punkt`` has `relativ_posisjon`, a ``Linje``
    `startposisjon` and `sluttposisjon`, a ``Sving`` only its `kortform`.
    """

    type: str
    veglenkesekvensid: int | None = None
    nodeid: int | None = None
    relativ_posisjon: float | None = None
    startposisjon: float | None = None
    sluttposisjon: float | None = None
    retning: str | None = None
    kjorefelt: tuple[str, ...] = ()
    sideposisjon: str | None = None
    kortform: str | None = None


@dataclass(frozen=True, slots=True)
class Relasjon:
    """Objects of one type above (`foreldre`) or below (`barn`) this one."""

    type_id: int
    vegobjekter: tuple[int, ...]
    id: int | None = None
    listeid: int | None = None


@dataclass(frozen=True, slots=True)
class Vegobjekt:
    """One object. Fields that were not asked for are None or empty.

    Attributes
    ----------
    id, type_id : int
    versjon : int or None
    startdato, sluttdato : str or None
        ISO dates.
    sist_modifisert : str or None
        NVDB's text, UTC by its documentation.
    egenskaper : mapping of property id → Egenskap
    geometri : Geometri or None
    position : Position or None
        From the geometry property where the object has own geometry, else from `geometri`; None if neither
        is a point in Norway.
    own_geometry : bool
        Whether NVDB says ``egengeometri: true``; only then can `position` be where the object stands.
    kvalitet : GeometriKvalitet or None
        Of the geometry property.
    kommuner, fylker : tuple of int
    vegsystemreferanser : tuple of str
        Short forms, ``EV6 S46D1 m1200``.
    stedfestinger : tuple of Stedfesting
    foreldre, barn : tuple of Relasjon
    problems : tuple of str
        Values that could not be used, one clause each.
    raw : dict
        The object as received.
    """

    id: int
    type_id: int
    versjon: int | None
    startdato: str | None
    sluttdato: str | None
    sist_modifisert: str | None
    egenskaper: Mapping[int, Egenskap]
    geometri: Geometri | None
    position: Position | None
    own_geometry: bool
    kvalitet: GeometriKvalitet | None
    kommuner: tuple[int, ...]
    fylker: tuple[int, ...]
    vegsystemreferanser: tuple[str, ...]
    stedfestinger: tuple[Stedfesting, ...]
    foreldre: tuple[Relasjon, ...]
    barn: tuple[Relasjon, ...]
    problems: tuple[str, ...]
    raw: RawObject = field(repr=False, compare=False)


def vegobjekt_from_les_v4(raw: RawObject, *, type_id: int | None = None) -> Vegobjekt:
    """Parse one object of an API Les V4 answer.

    Parameters
    ----------
    raw : dict
        One member of ``objekter``.
    type_id : int, optional
        The type that was asked for; without it the type comes from ``metadata`` or ``href``.

    Raises
    ------
    SchemaError
        A field that breaks the documented form; the message names the object's id and the field.
    """
    top = Fields(raw, f"vegobjekt {raw.get('id')}")
    object_id = top.required_integer("id")
    problems: list[str] = []
    metadata = top.child("metadata")
    lokasjon = top.child("lokasjon")
    relasjoner = top.child("relasjoner")
    kind = _type_id(top, metadata, type_id)
    egenskaper = _egenskaper(top, problems)
    geometri = _geometri(top.child("geometri"))
    eget = _geometry_property(egenskaper, kind)
    return Vegobjekt(
        id=object_id,
        type_id=kind,
        versjon=metadata.integer("versjon"),
        startdato=_iso_date(metadata, "startdato", problems),
        sluttdato=_iso_date(metadata, "sluttdato", problems),
        sist_modifisert=metadata.text("sist_modifisert"),
        egenskaper=egenskaper,
        geometri=geometri,
        position=_position(eget, geometri, problems),
        own_geometry=geometri is not None and geometri.egengeometri,
        kvalitet=eget.kvalitet if eget else None,
        kommuner=lokasjon.integers("kommuner"),
        fylker=lokasjon.integers("fylker"),
        vegsystemreferanser=tuple(
            text for item in lokasjon.children("vegsystemreferanser") if (text := item.text("kortform"))
        ),
        stedfestinger=tuple(_stedfesting(item) for item in lokasjon.children("stedfestinger")),
        foreldre=tuple(_relasjon(item) for item in relasjoner.children("foreldre")),
        barn=tuple(_relasjon(item) for item in relasjoner.children("barn")),
        problems=tuple(problems),
        raw=raw,
    )


def type_id_from_href(href: str) -> int | None:
    """Object type in the address of an object, ``…/vegobjekter/96/84130065`` → 96."""
    match = _TYPE_IN_HREF.search(href)
    return int(match.group(1)) if match else None


def _type_id(top: Fields, metadata: Fields, asked: int | None) -> int:
    """The object's type; what was asked for must agree with what the object says."""
    said = metadata.child("type").integer("id")
    if said is None:
        said = type_id_from_href(top.text("href") or "")
    if said is not None and asked is not None and said != asked:
        raise top.error("metadata.type.id", f"is {said}, but {asked} was asked for")
    kind = said if said is not None else asked
    if kind is None:
        raise top.error("metadata.type.id", "is missing, and nothing else tells the object's type")
    return kind


def _egenskaper(top: Fields, problems: list[str]) -> dict[int, Egenskap]:
    found: dict[int, Egenskap] = {}
    for item in top.children("egenskaper"):
        egenskap = _egenskap(item)
        if egenskap.id in found:
            problems.append(f"egenskap {egenskap.id} comes twice, the first is used")
        else:
            found[egenskap.id] = egenskap
    return found


def _egenskap(item: Fields) -> Egenskap:
    return Egenskap(
        id=item.required_integer("id"),
        navn=item.text("navn") or "",
        egenskapstype=item.text("egenskapstype") or "",
        verdi=item.raw.get("verdi"),
        enum_id=item.integer("enum_id"),
        enhet=item.child("enhet").text("kortnavn"),
        innhold=tuple(_egenskap(member) for member in item.children("innhold")),
        kvalitet=_kvalitet(item.child("kvalitet")) if "kvalitet" in item.raw else None,
        raw=item.raw,
    )


def _kvalitet(item: Fields) -> GeometriKvalitet:
    def known(name: str) -> float | None:
        value = item.number(name)
        return None if value is None or value < 0 else value

    return GeometriKvalitet(
        datafangstmetode=item.text("datafangstmetode"),
        noyaktighet_cm=known("nøyaktighet"),
        synbarhet=item.integer("synbarhet"),
        datafangstmetode_hoyde=item.text("datafangstmetodeHøyde"),
        noyaktighet_hoyde_cm=known("nøyaktighetHøyde"),
        maksimalt_avvik_cm=known("maksimaltAvvik"),
    )


def _geometri(item: Fields) -> Geometri | None:
    wkt = item.text("wkt")
    if wkt is None:
        return None
    srid = item.raw.get("srid")
    return Geometri(
        wkt=wkt,
        srid=None if srid is None else str(srid),
        egengeometri=item.boolean("egengeometri"),
        forenklet=item.boolean("forenklet"),
    )


def _stedfesting(item: Fields) -> Stedfesting:
    return Stedfesting(
        type=item.text("type") or "",
        veglenkesekvensid=item.integer("veglenkesekvensid"),
        nodeid=item.integer("nodeid"),
        relativ_posisjon=item.number("relativPosisjon"),
        startposisjon=item.number("startposisjon"),
        sluttposisjon=item.number("sluttposisjon"),
        retning=item.text("retning"),
        kjorefelt=item.texts("kjørefelt"),
        sideposisjon=item.text("sideposisjon"),
        kortform=item.text("kortform"),
    )


def _relasjon(item: Fields) -> Relasjon:
    """Read a relation; its members are ids, or whole objects with ``relasjonstype`` ``vegobjekter``."""
    members: Sequence[Any] = item.items("vegobjekter")
    ids = [member.get("id") if isinstance(member, Mapping) else member for member in members]
    known = tuple(
        member
        for member in ids
        if isinstance(member, int) and not isinstance(member, bool) and member in INT64
    )
    if len(known) != len(ids):
        raise item.error("vegobjekter", "holds something that is not an id")
    return Relasjon(
        type_id=item.child("type").required_integer("id"),
        vegobjekter=known,
        id=item.integer("id"),
        listeid=item.integer("listeid"),
    )


def _iso_date(metadata: Fields, name: str, problems: list[str]) -> str | None:
    text = metadata.text(name)
    if text is None:
        return None
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        problems.append(f"{name} {text[:30]!r} is not a date")
        return None


def _geometry_property(egenskaper: Mapping[int, Egenskap], type_id: int) -> Egenskap | None:
    """The property with the object's own point: by the datakatalog for signs, else the first geometry."""
    known = egenskaper.get(datakatalog.GEOMETRI_PUNKT.get(type_id, -1))
    if known is not None:
        return known
    return next((e for e in egenskaper.values() if e.egenskapstype == "Geometri"), None)


def _position(eget: Egenskap | None, geometri: Geometri | None, problems: list[str]) -> Position | None:
    """The best point there is; each source that fails leaves a clause in `problems`."""
    sources: list[tuple[str, object, str | int | None]] = []
    if eget is not None and (geometri is None or geometri.egengeometri):
        # The property is always UTM33 (EPSG:25833) and carries no srid, whatever srid was asked for.
        sources.append((f"egenskap {eget.id}", eget.verdi, eget.raw.get("srid") or "5973"))
    if geometri is not None:
        sources.append(("geometri", geometri.wkt, geometri.srid))
    for name, wkt, srid in sources:
        try:
            position, notes = position_from_wkt(wkt if isinstance(wkt, str) else "", srid)
        except ValueError as error:
            problems.append(f"{name} {error}")
            continue
        problems.extend(f"{name}: {note}" for note in notes)
        return position
    return None
