"""Vegobjekt: one object of the road database, parsed once, at the edge.

:mod:`nvdb.objects.les_v4` and :mod:`nvdb.objects.uberiket` read it. A field that breaks the documented form
raises :class:`~nvdb.errors.SchemaError`; a *value* that cannot be used (a date, a position) is left out and
named in ``problems``, and the object is kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from functools import lru_cache
from typing import Any, Protocol

import msgspec

from nvdb import datakatalog
from nvdb.objects.geometri import Position, PositionError, position_from_wkt

RawObject = Mapping[str, Any]


class _Received(msgspec.Struct, frozen=True, gc=False):
    """What keeps beside its fields the ``raw`` they were read from, which is neither compared nor shown.

    A country has millions of these: a Struct costs a fifth of a frozen dataclass, and the garbage collector
    need not follow what holds no circle.
    """

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._fields() == other._fields()

    def __hash__(self) -> int:
        return hash((type(self), self.id))  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={v!r}' for name, v in self._fields().items())})"

    def _fields(self) -> dict[str, object]:
        return {name: getattr(self, name) for name in self.__struct_fields__ if name != "raw"}


class GeometriKvalitet(msgspec.Struct, frozen=True, gc=False):
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


class VegobjektEgenskap(_Received, frozen=True, gc=False):
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
    innhold : tuple of VegobjektEgenskap
        Members of a ``Liste`` or ``Struktur``.
    kvalitet : GeometriKvalitet or None
    raw : dict
        Everything else (``datafangstdato``, ``høydereferanse`` …).
    """

    id: int
    navn: str
    egenskapstype: str
    verdi: object
    enum_id: int | None = None
    enhet: str | None = None
    innhold: tuple[VegobjektEgenskap, ...] = ()
    kvalitet: GeometriKvalitet | None = None
    raw: RawObject = msgspec.field(default_factory=dict)


class VegobjektGeometri(msgspec.Struct, frozen=True, gc=False):
    """The geometry that V4 chose to show: the object's own, or one derived from the road network.

    `egengeometri` False means a point on the road's centre line: never a sign's position.
    """

    wkt: str
    srid: str | None
    egengeometri: bool
    forenklet: bool = False


class VegobjektStedfesting(msgspec.Struct, frozen=True, gc=False):
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


class Relasjon(msgspec.Struct, frozen=True, gc=False):
    """Objects of one type above (`foreldre`) or below (`barn`) this one."""

    type_id: int
    vegobjekter: tuple[int, ...]
    id: int | None = None
    listeid: int | None = None


class Vegobjekt(_Received, frozen=True, gc=False):
    """One object. Fields that were not asked for are None or empty.

    Attributes
    ----------
    id, type_id : int
    versjon : int or None
    startdato, sluttdato : str or None
        ISO dates.
    sist_modifisert : str or None
        NVDB's text, UTC by its documentation.
    egenskaper : mapping of property id → VegobjektEgenskap
    geometri : VegobjektGeometri or None
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
    stedfestinger : tuple of VegobjektStedfesting
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
    egenskaper: Mapping[int, VegobjektEgenskap]
    geometri: VegobjektGeometri | None
    position: Position | None
    own_geometry: bool
    kvalitet: GeometriKvalitet | None
    kommuner: tuple[int, ...]
    fylker: tuple[int, ...]
    vegsystemreferanser: tuple[str, ...]
    stedfestinger: tuple[VegobjektStedfesting, ...]
    foreldre: tuple[Relasjon, ...]
    barn: tuple[Relasjon, ...]
    problems: tuple[str, ...]
    raw: RawObject


class KvalitetRead(Protocol):
    """The quality of a geometry as an API wrote it."""

    datafangstmetode: str | None
    noyaktighet: float | None
    synbarhet: int | None
    datafangstmetode_hoyde: str | None
    noyaktighet_hoyde: float | None
    maksimalt_avvik: float | None


def kvalitet_from(item: KvalitetRead) -> GeometriKvalitet:
    """Quality with -1 read as unknown."""
    return GeometriKvalitet(
        item.datafangstmetode,
        _known(item.noyaktighet),
        item.synbarhet,
        item.datafangstmetode_hoyde,
        _known(item.noyaktighet_hoyde),
        _known(item.maksimalt_avvik),
    )


def _known(value: float | None) -> float | None:
    return None if value is None or value < 0 else float(value)


def iso_date(name: str, text: str | None, problems: list[str]) -> str | None:
    """An ISO date as ``2020-05-04``; None, and a clause in `problems`, for what is none."""
    if text is None:
        return None
    iso = _iso_date(text)
    if iso is None:
        problems.append(f"{name} {text[:30]!r} is not a date")
    return iso


@lru_cache(maxsize=4096)
def _iso_date(text: str) -> str | None:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        return None


def own_geometry(egenskaper: Mapping[int, VegobjektEgenskap], type_id: int) -> VegobjektEgenskap | None:
    """The property with the object's own point: by the datakatalog for signs, else the first geometry."""
    by_id = egenskaper.get(datakatalog.GEOMETRI_PUNKT.get(type_id, -1))
    if by_id is not None:
        return by_id
    return next((e for e in egenskaper.values() if e.egenskapstype == "Geometri"), None)


def position_of(name: str, wkt: object, srid: str | int | None, problems: list[str]) -> Position | None:
    """The point of a geometry; what cannot be used of it becomes a clause in `problems`."""
    try:
        position, notes = position_from_wkt(wkt if isinstance(wkt, str) else "", srid)
    except PositionError as error:
        problems.append(f"{name} {error}")
        return None
    problems.extend(f"{name}: {note}" for note in notes)
    return position
