"""A quick reading of objects in their usual form, for whole countries.

:mod:`nvdb.vegobjekt` reads every object and names every fault, at some 100 µs each. Here the same fields are
looked at with the same demands, but nothing is wrapped and no message is made: at the first thing that is
unusual, be it wrong or only rare, the answer is None, and the caller takes the other way. What is accepted
here is accepted there, with the same result; tests hold the two together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import lru_cache
from math import isfinite
from types import NoneType
from typing import Any, Final

from nvdb import datakatalog
from nvdb.fields import INT64
from nvdb.geometri import Position, position_from_wkt
from nvdb.vegobjekt import RawObject, Stedfesting

_TEXT: Final = frozenset({str, NoneType})
_STRING: Final = frozenset({str})
_INTEGER: Final = frozenset({int})
_FLAG: Final = frozenset({bool, NoneType})
_EMPTY: Final[Mapping[str, Any]] = {}


class _UnusualError(Exception):
    """Something that the careful parser has to look at."""


@dataclass(slots=True)
class UsualParts:
    """Checked parts of an object.

    Attributes
    ----------
    shared : dict
        Arguments of :class:`nvdb.skilt.Skilt`.
    egenskaper : mapping of property id → property as received
        The first of each id, checked but for ``verdi``.
    relasjoner : mapping
        As received, checked.
    """

    shared: dict[str, Any]
    egenskaper: Mapping[int, Mapping[str, Any]]
    relasjoner: Mapping[str, Any]

    def related(self, name: str, type_id: int) -> tuple[int, ...]:
        """Ids of the ``foreldre`` or ``barn`` of a type."""
        relations = self.relasjoner.get(name) or ()
        return tuple(i for item in relations if item["type"]["id"] == type_id for i in item["vegobjekter"])


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
        return _parts(raw, type_id)
    except (_UnusualError, LookupError, TypeError, AttributeError, ValueError):
        return None


def _parts(raw: RawObject, type_id: int) -> UsualParts:
    metadata, lokasjon = raw["metadata"], raw["lokasjon"]
    relasjoner = raw.get("relasjoner", _EMPTY)
    versjon, modified = metadata.get("versjon"), metadata.get("sist_modifisert")
    _demand(
        type(raw["id"]) is int
        and raw["id"] in INT64
        and type(metadata["type"]["id"]) is int
        and metadata["type"]["id"] == type_id
        and (versjon is None or (type(versjon) is int and versjon in INT64))
        and type(modified) in _TEXT
        and type(relasjoner) is dict
        and type(raw["egenskaper"]) is list
    )
    for name in ("foreldre", "barn"):
        _check_relations(relasjoner.get(name))
    egenskaper = _egenskaper(raw["egenskaper"])
    own = _own_geometry(egenskaper, type_id)
    kvalitet = (own.get("kvalitet") if own is not None else None) or {}
    accuracy = kvalitet.get("nøyaktighet")
    return UsualParts(
        {
            "nvdb_id": raw["id"],
            "version": versjon,
            "start_date": _iso_date(metadata.get("startdato")),
            "end_date": _iso_date(metadata.get("sluttdato")),
            "last_modified": modified,
            **_place(own, raw["geometri"]),
            "accuracy_cm": None if accuracy is None or accuracy < 0 else float(accuracy),
            "capture_method": kvalitet.get("datafangstmetode"),
            **_on_the_network(lokasjon),
            "raw": raw,
        },
        egenskaper,
        relasjoner,
    )


def _demand(usual: bool) -> None:
    if not usual:
        raise _UnusualError


def _is_whole(value: object) -> bool:
    return value is None or (type(value) is int and value in INT64)


@lru_cache(maxsize=4096)
def _iso_date(text: str | None) -> str | None:
    return None if text is None else date.fromisoformat(text).isoformat()


def _check_relations(relations: list[Any] | None) -> None:
    if relations is None:
        return
    _demand(type(relations) is list)
    for item in relations:
        _demand(
            type(item["type"]["id"]) is int
            and item["type"]["id"] in INT64
            and _is_whole(item.get("id"))
            and _is_whole(item.get("listeid"))
            and type(item["vegobjekter"]) is list
        )
        for member in item["vegobjekter"]:
            if type(member) is not int or member not in INT64:
                raise _UnusualError


def _egenskaper(items: list[Any]) -> dict[int, dict[str, Any]]:
    """Properties by id. Each is checked as a whole: one bad field makes an object unreadable."""
    found: dict[int, dict[str, Any]] = {}
    for item in items:
        get = item.get
        number, enum_id = item["id"], get("enum_id")
        navn, kind = get("navn"), get("egenskapstype")
        if (
            type(number) is not int
            or number not in INT64
            or type(navn) not in _TEXT
            or type(kind) not in _TEXT
            or (enum_id is not None and (type(enum_id) is not int or enum_id not in INT64))
        ):
            raise _UnusualError
        found[number] = item
        # id, navn, egenskapstype and verdi, or these and enum_id: that is all of most properties.
        n_known = 4 if enum_id is None else 5
        if len(item) == n_known and navn is not None and kind is not None and "verdi" in item:
            continue
        enhet, innhold, kvalitet = get("enhet"), get("innhold"), get("kvalitet")
        if enhet is not None and (type(enhet) is not dict or type(enhet.get("kortnavn")) not in _TEXT):
            raise _UnusualError
        if innhold is not None:
            _demand(type(innhold) is list)
            for member in innhold:
                _egenskaper([member])
        if kvalitet is not None:
            _check_kvalitet(kvalitet)
    if len(found) != len(items):
        raise _UnusualError
    return found


def _check_kvalitet(item: dict[str, Any]) -> None:
    _demand(
        type(item) is dict
        and type(item.get("datafangstmetode")) in _TEXT
        and _is_whole(item.get("synbarhet"))
        and type(item.get("datafangstmetodeHøyde")) in _TEXT
    )
    for name in ("nøyaktighet", "nøyaktighetHøyde", "maksimaltAvvik"):
        _number(item.get(name))


def _number(value: object) -> float | None:
    if value is None:
        return None
    if type(value) is float and isfinite(value):
        return value
    if type(value) is int and value in INT64:
        return float(value)
    raise _UnusualError


def _own_geometry(egenskaper: Mapping[int, Mapping[str, Any]], type_id: int) -> Mapping[str, Any] | None:
    own = egenskaper.get(datakatalog.GEOMETRI_PUNKT[type_id])
    if own is None:
        _demand(all(item.get("egenskapstype") != "Geometri" for item in egenskaper.values()))
    return own


def _place(own: Mapping[str, Any] | None, geometri: dict[str, Any]) -> dict[str, Any]:
    """``position`` and ``own_geometry``; see :mod:`nvdb.vegobjekt` for which of two points counts."""
    wkt, srid = geometri["wkt"], geometri.get("srid")
    own_geometry = geometri.get("egengeometri")
    _demand(type(wkt) is str and type(own_geometry) in _FLAG and type(geometri.get("forenklet")) in _FLAG)
    if own is not None and own_geometry:
        wkt, srid = own["verdi"], own.get("srid") or "5973"
        _demand(type(wkt) is str)
    position: Position
    position, notes = position_from_wkt(wkt, srid)
    _demand(not notes)
    return {"position": position, "own_geometry": bool(own_geometry)}


def _on_the_network(lokasjon: dict[str, Any]) -> dict[str, Any]:
    """``road_reference``, ``kommuner`` and ``stedfesting``."""
    _demand(type(lokasjon) is dict)
    kommuner, fylker = _list(lokasjon, "kommuner"), _list(lokasjon, "fylker")
    _demand(_INTEGER.issuperset(map(type, (*kommuner, *fylker))))
    kortformer = [item.get("kortform") for item in _list(lokasjon, "vegsystemreferanser")]
    _demand(_TEXT.issuperset(map(type, kortformer)))
    return {
        "road_reference": next((text for text in kortformer if text), None),
        "kommuner": tuple(kommuner),
        "stedfesting": tuple([_stedfesting(item) for item in _list(lokasjon, "stedfestinger")]),
    }


def _list(item: dict[str, Any], name: str) -> list[Any]:
    value: Any = item.get(name)
    if value is None:
        return []
    if type(value) is not list:
        raise _UnusualError
    return value


def _stedfesting(item: dict[str, Any]) -> Stedfesting:
    get = item.get
    lanes = _list(item, "kjørefelt")
    kind, retning, side, kortform = get("type"), get("retning"), get("sideposisjon"), get("kortform")
    link, node = get("veglenkesekvensid"), get("nodeid")
    _demand(
        _STRING.issuperset(map(type, lanes))
        and type(kind) in _TEXT
        and type(retning) in _TEXT
        and type(side) in _TEXT
        and type(kortform) in _TEXT
        and _is_whole(link)
        and _is_whole(node)
    )
    return Stedfesting(
        kind or "",
        link,
        node,
        _number(get("relativPosisjon")),
        _number(get("startposisjon")),
        _number(get("sluttposisjon")),
        retning,
        tuple(lanes),
        side,
        kortform,
    )
