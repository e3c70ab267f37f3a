"""From the tree of a change set (see :mod:`nvdb.endringssett.write_tree`) to its dataclasses.

Reading is strict: a word that is not known here is refused by name, never dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, date, datetime
from typing import Any, TypeVar

from nvdb.endringssett.document import (
    OPERASJONER,
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Kvalitet,
    Operasjon,
    Punkt,
    Stedfesting,
)
from nvdb.endringssett.write_tree import decimal_text
from nvdb.errors import SchemaError

T = TypeVar("T")


class _Node:
    """A mapping that is being read: every word is taken once, and what is left over is refused."""

    def __init__(self, raw: object, where: str) -> None:
        if not isinstance(raw, Mapping):
            msg = (
                f"The change set has {type(raw).__name__} at {where}, where an object belongs: mend it there."
            )
            raise SchemaError(msg)
        self._raw = dict(raw)
        self.where = where

    def take(self, word: str, read: Callable[[Any], T]) -> T | None:
        """Read one value; None if it is absent."""
        raw = self._raw.pop(word, None)
        if raw is None:
            return None
        try:
            return read(raw)
        except (ValueError, TypeError, OverflowError) as error:
            msg = f"The change set has {str(raw)[:60]!r} for {word} at {self.where}: mend it there."
            raise SchemaError(msg) from error

    def need(self, word: str, read: Callable[[Any], T]) -> T:
        """Read one value that has to be there."""
        value = self.take(word, read)
        if value is None:
            msg = f"The change set has no {word} at {self.where}: add it there."
            raise SchemaError(msg)
        return value

    def node(self, word: str) -> _Node | None:
        """Go down one level."""
        raw = self._raw.pop(word, None)
        return None if raw is None else _Node(raw, f"{self.where}.{word}")

    def nodes(self, word: str) -> list[_Node]:
        """Go down into each member of a list; a single object counts as a list of one."""
        raw = self._raw.pop(word, None)
        members = raw if isinstance(raw, list) else [] if raw is None else [raw]
        return [_Node(member, f"{self.where}.{word}[{i}]") for i, member in enumerate(members)]

    def end(self) -> None:
        """Refuse what is left."""
        if self._raw:
            msg = f"The change set has {next(iter(self._raw))!r} at {self.where}, which is not written here."
            raise SchemaError(msg)


def _text(raw: Any) -> str:
    if isinstance(raw, bool) or not isinstance(raw, str | int | float):
        raise TypeError
    return decimal_text(raw) if isinstance(raw, float) else str(raw)


def _integer(raw: Any) -> int:
    if isinstance(raw, bool) or not isinstance(raw, str | int):
        raise TypeError
    return int(raw)


def _number(raw: Any) -> float:
    if isinstance(raw, bool):
        raise TypeError
    return float(raw)


def _day(raw: Any) -> date:
    return date.fromisoformat(raw)


def _moment(raw: Any) -> datetime:
    moment = datetime.fromisoformat(raw)
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment


def _truth(raw: Any) -> bool:
    try:
        return {"ja": True, "true": True, "nei": False, "false": False}[str(raw).lower()]
    except KeyError as error:
        raise ValueError from error


def _list(read: Callable[[Any], T]) -> Callable[[Any], tuple[T, ...]]:
    return lambda raw: tuple(read(item) for item in (raw if isinstance(raw, list) else [raw]))


def endringssett_from_tree(tree: object) -> Endringssett:
    """Read a tree.

    Raises
    ------
    SchemaError
        A word that is not known, a value that cannot be read, or one that is missing; it says where.
    """
    top = _Node(tree, "endringssett")
    sett = Endringssett(
        datakatalogversjon=top.need("datakatalogversjon", _text),
        ansvarlig=top.take("ansvarlig", _text),
        ekstern_ref=top.take("eksternRef", _text),
        kontekst=top.take("kontekst", _text),
        endringer=tuple(endring for operasjon in OPERASJONER for endring in _endringer(top, operasjon)),
    )
    top.end()
    return sett


def _endringer(top: _Node, operasjon: Operasjon) -> list[Endring]:
    block = top.node(operasjon)
    if block is None:
        return []
    endringer = [_read_endring(item, operasjon) for item in block.nodes("vegobjekter")]
    block.end()
    return endringer


def _read_endring(item: _Node, operasjon: Operasjon) -> Endring:
    validering = item.node("validering")
    periode = item.node("gyldighetsperiode")
    stedfesting = item.node("stedfesting")
    kaskade = "kaskadelukking" if operasjon == "lukk" else "kaskadefjerning"
    endring = Endring(
        operasjon=operasjon,
        type_id=item.need("typeId", _integer),
        nvdb_id=item.take("nvdbId", _integer),
        temp_id=item.take("tempId", _text),
        versjon=item.take("versjon", _integer),
        overskriv=item.take("overskriv", _truth) or False,
        lest_fra_nvdb=validering.take("lestFraNvdb", _moment) if validering else None,
        startdato=periode.take("startdato", _day) if periode else None,
        sluttdato=periode.take("sluttdato", _day) if periode else None,
        egenskaper=tuple(_read_egenskap(node) for node in item.nodes("egenskaper")),
        assosiasjoner=tuple(_read_assosiasjon(node) for node in item.nodes("assosiasjoner")),
        stedfesting=_read_stedfesting(stedfesting) if stedfesting else None,
        lukkedato=item.take("lukkedato", _day),
        kaskade=item.take(kaskade, _truth),
    )
    for node in (item, validering, periode):
        if node is not None:
            node.end()
    return endring


def _read_egenskap(node: _Node) -> Egenskap:
    geometrier = node.nodes("geometri")
    if len(geometrier) > 1:
        msg = f"The change set has {len(geometrier)} geometries at {node.where}: one property has one."
        raise SchemaError(msg)
    egenskap = Egenskap(
        type_id=node.need("typeId", _integer),
        verdi=node.take("verdi", _list(_text)) or (),
        enum=node.take("enum", _list(_integer)) or (),
        geometri=_read_geometri(geometrier[0]) if geometrier else None,
        operasjon=node.take("operasjon", _text),
    )
    node.end()
    return egenskap


def _read_geometri(node: _Node) -> Geometri:
    kvalitet = node.node("kvalitet")
    geometri = Geometri(
        srid=node.need("srid", _integer),
        wkt=node.need("wkt", _text),
        lengde_m=node.take("lengde", _number),
        datafangstdato=node.take("datafangstdato", _day),
        temakode=node.take("temakode", _integer),
        medium=node.take("medium", _text),
        kommune=node.take("kommune", _text),
        hoydereferanse=node.take("høydereferanse", _integer),
        sosinavn=node.take("sosinavn", _text),
        referansegeometri=node.take("referansegeometri", _truth),
        verifiseringsdato=node.take("verifiseringsdato", _day),
        oppdateringsdato=node.take("oppdateringsdato", _day),
        prosesshistorikk=node.take("prosesshistorikk", _text),
        kvalitet=_read_kvalitet(kvalitet) if kvalitet else None,
    )
    node.end()
    return geometri


def _read_kvalitet(node: _Node) -> Kvalitet:
    kvalitet = Kvalitet(
        datafangstmetode=node.take("datafangstmetode", _text),
        malemetode=node.take("målemetode", _integer),
        datafangstmetode_hoyde=node.take("datafangstmetodeHøyde", _text),
        malemetode_hoyde=node.take("målemetodeHøyde", _integer),
        noyaktighet_cm=node.take("nøyaktighet", _integer),
        noyaktighet_hoyde_cm=node.take("nøyaktighetHøyde", _integer),
        synbarhet=node.take("synbarhet", _integer),
        toleranse_cm=node.take("toleranse", _integer),
    )
    node.end()
    return kvalitet


def _read_assosiasjon(node: _Node) -> Assosiasjon:
    dotre = []
    for item in node.nodes("nvdbId"):
        dotre.append(Datter(nvdb_id=item.need("verdi", _integer), operasjon=item.take("operasjon", _text)))
        item.end()
    for item in node.nodes("tempId"):
        dotre.append(Datter(temp_id=item.need("verdi", _text), operasjon=item.take("operasjon", _text)))
        item.end()
    assosiasjon = Assosiasjon(
        type_id=node.need("typeId", _integer), dotre=tuple(dotre), operasjon=node.take("operasjon", _text)
    )
    node.end()
    return assosiasjon


def _read_stedfesting(node: _Node) -> Stedfesting:
    punkter = []
    for item in node.nodes("punkt"):
        punkter.append(
            Punkt(
                veglenkesekvens_id=item.need("veglenkesekvensNvdbId", _integer),
                posisjon=item.need("posisjon", _number),
                retning=item.take("retning", _text),
                sideposisjon=item.take("sideposisjon", _text),
                kjorefelt=item.take("kjørefelt", _list(_text)) or (),
                operasjon=item.take("operasjon", _text),
            )
        )
        item.end()
    stedfesting = Stedfesting(punkter=tuple(punkter), operasjon=node.take("operasjon", _text))
    node.end()
    return stedfesting
