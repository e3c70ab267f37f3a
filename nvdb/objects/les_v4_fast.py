"""A quick reading of objects in their usual form, for whole countries.

:mod:`nvdb.objects.vegobjekt` reads every object and names every fault, at some 100 µs each. Here the same
fields are looked at with the same demands, but by a compiled checker (msgspec) and without messages: at the
first thing that is unusual, be it wrong or only rare, the answer is None, and the caller takes the other
way. What is accepted here is accepted there, with the same result; tests hold the two together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from typing import Annotated, Any

import msgspec

from nvdb import datakatalog
from nvdb.objects.geometri import position_from_wkt
from nvdb.objects.vegobjekt import RawObject, Stedfesting

_Whole = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""What a database can keep; msgspec takes neither true nor 1.0 for a whole number."""
_Number = Annotated[float, msgspec.Meta(ge=-(2.0**63), lt=2.0**63)]
"""Also a whole number; neither NaN nor infinite."""


class _Enhet(msgspec.Struct, gc=False):
    kortnavn: str | None = None


class _Kvalitet(msgspec.Struct, gc=False):
    datafangstmetode: str | None = None
    noyaktighet: _Number | None = msgspec.field(default=None, name="nøyaktighet")
    synbarhet: _Whole | None = None
    metode_hoyde: str | None = msgspec.field(default=None, name="datafangstmetodeHøyde")
    noyaktighet_hoyde: _Number | None = msgspec.field(default=None, name="nøyaktighetHøyde")
    avvik: _Number | None = msgspec.field(default=None, name="maksimaltAvvik")


class UsualEgenskap(msgspec.Struct, gc=False):
    """A property, checked but for `verdi`."""

    id: _Whole
    navn: str | None = None
    egenskapstype: str | None = None
    verdi: Any = None
    enum_id: _Whole | None = None
    enhet: _Enhet | None = None
    innhold: list[UsualEgenskap] | None = None
    kvalitet: _Kvalitet | None = None
    srid: Any = None


class _Type(msgspec.Struct, gc=False):
    id: _Whole


class _Relasjon(msgspec.Struct, gc=False):
    type: _Type
    vegobjekter: list[_Whole]
    id: _Whole | None = None
    listeid: _Whole | None = None


class _Relasjoner(msgspec.Struct, gc=False):
    foreldre: list[_Relasjon] | None = None
    barn: list[_Relasjon] | None = None


class _Metadata(msgspec.Struct, gc=False):
    type: _Type
    versjon: _Whole | None = None
    startdato: str | None = None
    sluttdato: str | None = None
    sist_modifisert: str | None = None


class _Stedfesting(msgspec.Struct, gc=False, rename={"relativ": "relativPosisjon", "kjorefelt": "kjørefelt"}):
    type: str | None = None
    veglenkesekvensid: _Whole | None = None
    nodeid: _Whole | None = None
    relativ: _Number | None = None
    startposisjon: _Number | None = None
    sluttposisjon: _Number | None = None
    retning: str | None = None
    kjorefelt: list[str] | None = None
    sideposisjon: str | None = None
    kortform: str | None = None


class _Referanse(msgspec.Struct, gc=False):
    kortform: str | None = None


class _Lokasjon(msgspec.Struct, gc=False):
    kommuner: list[_Whole] | None = None
    fylker: list[_Whole] | None = None
    vegsystemreferanser: list[_Referanse] | None = None
    stedfestinger: list[_Stedfesting] | None = None


class _Geometri(msgspec.Struct, gc=False):
    wkt: str
    srid: Any = None
    egengeometri: bool | None = None
    forenklet: bool | None = None


class _Objekt(msgspec.Struct, gc=False):
    id: _Whole
    metadata: _Metadata
    egenskaper: list[UsualEgenskap]
    lokasjon: _Lokasjon
    geometri: _Geometri
    relasjoner: _Relasjoner = msgspec.field(default_factory=_Relasjoner)
    href: Any = None


@dataclass(slots=True)
class UsualParts:
    """Checked parts of an object.

    Attributes
    ----------
    shared : dict
        Arguments of :class:`nvdb.objects.skilt.Skilt`.
    egenskaper : mapping of property id → property
    relasjoner : decoded relations
    """

    shared: dict[str, Any]
    egenskaper: Mapping[int, UsualEgenskap]
    relasjoner: _Relasjoner

    def foreldre(self, type_id: int) -> tuple[int, ...]:
        """Ids of the parents of a type."""
        return _related(self.relasjoner.foreldre, type_id)

    def barn(self, type_id: int) -> tuple[int, ...]:
        """Ids of the children of a type."""
        return _related(self.relasjoner.barn, type_id)


def usual_parts(raw: RawObject, type_id: int) -> UsualParts | None:
    """Read an object of API Les V4; None if anything about it is unusual.

    Parameters
    ----------
    raw : dict
        One member of ``objekter``.
    type_id : int
        The type that was asked for.
    """
    try:
        return _parts(msgspec.convert(raw, _Objekt), raw, type_id)
    except (ValueError, TypeError, RecursionError):
        return None


def _parts(objekt: _Objekt, raw: RawObject, type_id: int) -> UsualParts:
    metadata, lokasjon = objekt.metadata, objekt.lokasjon
    egenskaper = {item.id: item for item in objekt.egenskaper}
    own = egenskaper.get(datakatalog.GEOMETRI_PUNKT[type_id])
    kvalitet = own.kvalitet if own is not None else None
    accuracy = kvalitet.noyaktighet if kvalitet is not None else None
    if (
        metadata.type.id != type_id
        or len(egenskaper) != len(objekt.egenskaper)
        or (own is None and any(item.egenskapstype == "Geometri" for item in objekt.egenskaper))
    ):
        raise _UnusualError
    geometri = objekt.geometri
    wkt, srid = geometri.wkt, geometri.srid
    if own is not None and geometri.egengeometri:
        wkt, srid = own.verdi, own.srid or "5973"
    position, notes = position_from_wkt(wkt, srid)
    if notes:
        raise _UnusualError
    referanser = lokasjon.vegsystemreferanser or ()
    shared = {
        "nvdb_id": objekt.id,
        "version": metadata.versjon,
        "start_date": _iso_date(metadata.startdato),
        "end_date": _iso_date(metadata.sluttdato),
        "last_modified": metadata.sist_modifisert,
        "position": position,
        "own_geometry": bool(geometri.egengeometri),
        "accuracy_cm": None if accuracy is None or accuracy < 0 else accuracy,
        "capture_method": kvalitet.datafangstmetode if kvalitet is not None else None,
        "road_reference": next((item.kortform for item in referanser if item.kortform), None),
        "kommuner": tuple(lokasjon.kommuner or ()),
        "stedfesting": tuple([_stedfesting(item) for item in lokasjon.stedfestinger or ()]),
        "raw": raw,
    }
    return UsualParts(shared, egenskaper, objekt.relasjoner)


class _UnusualError(ValueError):
    """Something that the careful parser has to look at."""


@lru_cache(maxsize=4096)
def _iso_date(text: str | None) -> str | None:
    return None if text is None else date.fromisoformat(text).isoformat()


def _related(relations: list[_Relasjon] | None, type_id: int) -> tuple[int, ...]:
    return tuple([i for item in relations or () if item.type.id == type_id for i in item.vegobjekter])


def _stedfesting(item: _Stedfesting) -> Stedfesting:
    return Stedfesting(
        item.type or "",
        item.veglenkesekvensid,
        item.nodeid,
        item.relativ,
        item.startposisjon,
        item.sluttposisjon,
        item.retning,
        tuple(item.kjorefelt or ()),
        item.sideposisjon,
        item.kortform,
    )
