"""The datakatalog: object types, properties and enum values, as NVDB has them.

Snapshot of the datakatalog 2.38 (its XSD and type definitions, NLOD 1.0), completed with ids seen in
answers of API Les V4. The datakatalog only ever adds ids, so an id that is missing here is kept as it
came, never refused. :class:`Datakatalog` is the whole list, shipped as a dated snapshot
(``katalog_snapshot.json``) and refreshed from the API.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from nvdb.client.fields import Fields
from nvdb.datakatalog.ids import (
    SKILTPLATE,
    SKILTPUNKT,
)
from nvdb.errors import SchemaError

if TYPE_CHECKING:
    from nvdb.client.client import NvdbClient

DATAKATALOG_VERSION: Final = "2.38"


@dataclass(frozen=True, slots=True)
class Egenskapstype:
    """One property type.

    Attributes
    ----------
    id, type_id : int
        Of the property, and of the vegobjekttype that has it.
    navn, egenskapstype : str
        ``egenskapstype`` in V4's words (``Tekstenum``, ``Heltall`` …); empty if the snapshot does not know.
    verdier : mapping of enum id → value
        Of an enum: text for a ``Tekstenum``, a number for ``Heltallenum`` and ``Flyttallenum``.
    complete : bool
        Whether `verdier` holds every value of this version. False in the snapshot, where lists are partial.
    """

    id: int
    type_id: int
    navn: str
    egenskapstype: str
    verdier: Mapping[int, str | int | float] = field(default_factory=dict)
    complete: bool = True


@dataclass(frozen=True, slots=True)
class Stedfestingskrav:
    """What a type wants its place on the road network to say.

    Attributes
    ----------
    retning : bool or None
        Whether it has to say a direction; None if not known.
    sideposisjon, kjorefelt : str or None
        ``KAN``, ``NEI`` or ``MÅ``; None if not known.
    """

    retning: bool | None = None
    sideposisjon: str | None = None
    kjorefelt: str | None = None


@dataclass(frozen=True, slots=True)
class Datakatalog:
    """What the ids of some vegobjekttyper mean, in one version.

    Attributes
    ----------
    version : str
        ``2.38``.
    date : str
        ISO date of the version; of the shipped snapshot, the day it was put together.
    egenskapstyper : mapping of property id → Egenskapstype
        Property ids are unique over all types.
    barn : mapping of relation id → vegobjekttype
        What the lists under ``barn`` hold. Both ids of a relation are keys: of the list (220004) and of its
        members (200004), since it is not documented which of them Uberiket uses.
    typer : mapping of vegobjekttype → name
    stedfesting : mapping of vegobjekttype → Stedfestingskrav
        Absent where it is not known.
    """

    version: str
    date: str
    egenskapstyper: Mapping[int, Egenskapstype]
    barn: Mapping[int, int]
    typer: Mapping[int, str]
    stedfesting: Mapping[int, Stedfestingskrav] = field(default_factory=dict)

    def enum_value(self, egenskap_id: int, enum_id: int) -> str | int | float | None:
        """Value of an enum id, as API Les V4 shows it in ``verdi``; None if it is not known.

        ``362.50 - Fartsgrense, 50 km/t``; in the snapshot often the code alone.
        """
        kind = self.egenskapstyper.get(egenskap_id)
        return kind.verdier.get(enum_id) if kind is not None else None

    def is_unknown(self, egenskap_id: int, enum_id: int | None = None) -> bool:
        """Whether a property or enum id is new: absent, and not only absent from a partial list."""
        kind = self.egenskapstyper.get(egenskap_id)
        if kind is None:
            return True
        return enum_id is not None and kind.complete and enum_id not in kind.verdier

    def to_document(self) -> dict[str, Any]:
        """As JSON, in the form of the snapshot; :func:`katalog_from_document` is the inverse."""
        typer: dict[str, Any] = {
            str(type_id): {"navn": navn, "egenskapstyper": {}} for type_id, navn in self.typer.items()
        }
        for type_id, krav in self.stedfesting.items():
            typer[str(type_id)]["stedfesting"] = asdict(krav)
        for kind in self.egenskapstyper.values():
            typer[str(kind.type_id)]["egenskapstyper"][str(kind.id)] = {
                "navn": kind.navn,
                "type": kind.egenskapstype,
                "complete": kind.complete,
                "verdier": {str(enum_id): value for enum_id, value in kind.verdier.items()},
            }
        barn = {str(relation): type_id for relation, type_id in self.barn.items()}
        return {"version": self.version, "date": self.date, "barn": barn, "vegobjekttyper": typer}


@cache
def snapshot() -> Datakatalog:
    """Return the datakatalog that ships with this package."""
    text = files("nvdb.datakatalog").joinpath("katalog_snapshot.json").read_text(encoding="utf-8")
    return katalog_from_document(json.loads(text))


def katalog_from_document(document: Mapping[str, Any]) -> Datakatalog:
    """Read what :meth:`Datakatalog.to_document` wrote.

    Raises
    ------
    SchemaError
        The document is not of that form.
    """
    try:
        kinds = [
            Egenskapstype(
                int(number),
                int(type_id),
                str(raw["navn"]),
                str(raw["type"]),
                {int(enum_id): value for enum_id, value in raw["verdier"].items()},
                bool(raw["complete"]),
            )
            for type_id, vegobjekttype in document["vegobjekttyper"].items()
            for number, raw in vegobjekttype["egenskapstyper"].items()
        ]
        return Datakatalog(
            str(document["version"]),
            str(document["date"]),
            {kind.id: kind for kind in kinds},
            {int(relation): int(type_id) for relation, type_id in document["barn"].items()},
            {int(number): str(raw["navn"]) for number, raw in document["vegobjekttyper"].items()},
            {
                int(number): Stedfestingskrav(**raw["stedfesting"])
                for number, raw in document["vegobjekttyper"].items()
                if "stedfesting" in raw
            },
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        msg = f"The saved datakatalog cannot be read ({error!r}): fetch it again."
        raise SchemaError(msg) from error


def hent_datakatalog(client: NvdbClient, type_ids: tuple[int, ...] = (SKILTPUNKT, SKILTPLATE)) -> Datakatalog:
    """Fetch the current datakatalog of some types.

    Source: Datakatalog API v1, ``/vegobjekttyper/{id}?inkluder=alle`` and ``/versjon``.

    Raises
    ------
    TransportError
        The API could not be asked.
    SchemaError
        An answer is not what the API documents.
    """
    versjon = _document(client.get_json("/datakatalog/api/v1/versjon"), "the version of the datakatalog")
    version, released = versjon.text("versjon"), versjon.text("dato")
    if not version:
        raise versjon.error("versjon", "is missing")
    kinds: dict[int, Egenskapstype] = {}
    barn: dict[int, int] = {}
    typer: dict[int, str] = {}
    krav: dict[int, Stedfestingskrav] = {}
    for type_id in type_ids:
        answer = client.get_json(f"/datakatalog/api/v1/vegobjekttyper/{type_id}", {"inkluder": "alle"})
        top = _document(answer, f"the datakatalog's type {type_id}")
        typer[type_id] = top.text("navn") or ""
        kinds.update((kind.id, kind) for kind in _egenskapstyper(top, type_id))
        barn.update(_barn(top))
        if "stedfesting" in top.raw:
            stedfesting = top.child("stedfesting")
            listed = "innhold" in stedfesting.raw  # where a type takes several places
            krav[type_id] = _stedfestingskrav(stedfesting.child("innhold") if listed else stedfesting)
    return Datakatalog(version, released or "", kinds, barn, typer, krav)


def _stedfestingskrav(raw: Fields) -> Stedfestingskrav:
    return Stedfestingskrav(
        retning=raw.boolean("retning_relevant") if "retning_relevant" in raw.raw else None,
        sideposisjon=raw.text("sideposisjon_relevant"),
        kjorefelt=raw.text("kjørefelt_relevant"),
    )


def _document(answer: object, what: str) -> Fields:
    if not isinstance(answer, Mapping):
        msg = f"The answer about {what} is not an object: check that the API URL is NVDB's."
        raise SchemaError(msg)
    return Fields(answer, what)


def _egenskapstyper(top: Fields, type_id: int) -> Iterator[Egenskapstype]:
    """Properties of a type. Relations and stedfesting stand among them too, and are no properties."""
    for item in top.children("egenskapstyper"):
        kind = item.text("egenskapstype") or ""
        if (
            kind in {"Assosiasjon", "Stedfesting"}
            or item.child("innhold").text("egenskapstype") == "Assosiasjon"
        ):
            continue
        verdier: dict[int, str | int | float] = {}
        for value in item.children("tillatte_verdier"):
            shown = value.raw.get("verdi", value.raw.get("kortnavn", ""))
            verdier[value.required_integer("id")] = (
                shown if isinstance(shown, str | int | float) else str(shown)
            )
        yield Egenskapstype(item.required_integer("id"), type_id, item.text("navn") or "", kind, verdier)


def _barn(top: Fields) -> Iterator[tuple[int, int]]:
    for relation in top.child("relasjonstyper").children("barn"):
        inner = relation.child("innhold")
        type_id = inner.child("type").integer("id")
        if type_id is None:
            continue
        for number in (relation.integer("id"), inner.integer("id")):
            if number is not None:
                yield number, type_id
