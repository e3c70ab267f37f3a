"""Property and enum ids of Skiltpunkt (95) and Skiltplate (96), and how to read a sign code.

Snapshot of the datakatalog 2.38 (its XSD and type definitions, NLOD 1.0), completed with ids seen in
answers of API Les V4. The datakatalog only ever adds ids, so an id that is missing here is kept as it
came, never refused. The constants are what the code reasons with; :class:`Datakatalog` is the whole list,
shipped as a dated snapshot (``katalog_snapshot.json``) and refreshed from the API.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from nvdb.errors import SchemaError
from nvdb.fields import Fields

if TYPE_CHECKING:
    from nvdb.client import NvdbClient

DATAKATALOG_VERSION: Final = "2.38"

SKILTPUNKT: Final = 95
"""Vegobjekttype: what a sign stands on, and where."""
SKILTPLATE: Final = 96
"""Vegobjekttype: one plate with one motive."""
VARIABELT_SKILT: Final = 97

GEOMETRI_PUNKT_95: Final = 4794
GEOMETRI_PUNKT_96: Final = 4795
GEOMETRI_PUNKT: Final[Mapping[int, int]] = {SKILTPUNKT: GEOMETRI_PUNKT_95, SKILTPLATE: GEOMETRI_PUNKT_96}
"""Vegobjekttype → the property that holds the object's own point."""

OPPSETTINGSUTSTYR: Final = 1876
AVSTAND_FRA_DEKKEKANT: Final = 1884
HOYDE_OVER_VEGKANT: Final = 2055

SKILTNUMMER: Final = 5530
TEKST: Final = 1910
PLASSERINGSKODE: Final = 5128
ANSIKTSSIDE: Final = 1894

SKILTPLATER_I_SKILTPUNKT: Final = 220004
"""Relation 95 → 96 (the list; its members are 200004)."""

EGENSKAPER_95: Final[Mapping[int, str]] = {
    1876: "Oppsettingsutstyr",
    1877: "Antall oppsettingsutstyr",
    10428: "Høyde mast/stolpe (m)",
    2055: "Høyde over vegkant (m)",
    1884: "Avstand fra dekkekant (m)",
    8772: "Avskjæringsledd",
    1671: "Fundamentering",
    10854: "Tilleggsinformasjon",
    11078: "Prosjektreferanse",
    12318: "ProsjektInternObjekt_ID",
    7999: "Eier",
    8063: "Vedlikeholdsansvarlig",
    4794: "Geometri, punkt",
}

EGENSKAPER_96: Final[Mapping[int, str]] = {
    5530: "Skiltnummer",
    1910: "Tekst",
    5128: "Plasseringskode",
    1894: "Ansiktsside, rettet mot",
    9484: "Tosidig plate med ulike motiv",
    1897: "Himmelretning",
    1970: "Størrelse",
    1588: "Høyde, egen (mm)",
    1328: "Bredde, målt (mm)",
    1892: "Skiltform",
    1912: "Tekst-/Symbolhøyde (mm)",
    1294: "Farge",
    1879: "Belysning",
    1921: "Folieklasse",
    8828: "Klappskilt",
    1890: "Vedtaksnummer",
    2108: "Oppsettingsdato",
    2107: "Skiftet dato",
    10479: "Driftsmerking",
    11861: "Produktnavn",
    1494: "Leverandør",
    11536: "Tilleggsinformasjon",
    9154: "Arkivnummer",
    11079: "Prosjektreferanse",
    12319: "ProsjektInternObjekt_ID",
    11826: "Eier",
    8064: "Vedlikeholdsansvarlig",
    4795: "Geometri, punkt",
}


class Ansiktsside(IntEnum):
    """Enum ids of 1894 *Ansiktsside, rettet mot*: the traffic that the face is for."""

    MED_METRERINGSRETNING = 2714
    MOT_METRERINGSRETNING = 2717
    PARALLELT_MOT_VEG = 2837
    PARALLELT_FRA_VEG = 2838
    TOSIDIG = 3698


SKILTNUMMER_ENUM: Final[Mapping[str, int]] = {
    # fareskilt
    "108": 7610, "142": 7633, "146.1": 8867,
    # vikeplikt- og forkjørsskilt
    "202": 7642, "204": 7643,
    # forbudsskilt
    "302": 7649, "306.3": 7652, "306.6": 7655, "306.7": 7656, "306.8": 7657, "306.9": 7658, "308": 9152,
    "310": 10079, "312": 7659, "314": 7660, "316": 7661, "318.1": 7662, "318.2": 7663, "320": 7664,
    "322": 7665, "324.1": 7666, "324.2": 9776, "326": 7667, "330.1": 7668, "330.2": 7669, "332": 7670,
    "334": 7671, "335": 9153, "336": 7672, "337": 9154, "362.20": 11578, "362.30": 8872, "362.40": 8873,
    "362.50": 8874, "362.60": 8875, "362.70": 8876, "362.80": 8877, "362.90": 8878, "362.100": 8879,
    "362.110": 11816, "364.20": 12146, "364.30": 9155, "364.40": 9156, "364.50": 9157, "364.60": 9158,
    "364.70": 9159, "366": 7675, "367": 21392, "368": 7676, "369": 21393, "370": 7677, "372": 7678,
    "376.1": 7679, "376.2": 7680, "377": 21394, "378.1": 7681, "378.2": 7682, "379": 21395,
    "380": 21396, "382": 21397,
    # påbudsskilt
    "402.1": 7683, "402.2": 7684, "402.3": 7685, "402.4": 7686, "402.5": 7687, "402.6": 7688,
    "402.7": 7689, "402.8": 7690, "404.1": 7691, "404.2": 7692, "406": 7693, "408": 17312,
    # opplysningsskilt
    "502": 9160, "503": 9161, "504": 9162, "505": 9163, "506": 17313, "507": 17314, "508.1": 7699,
    "508.2": 7700, "509": 9164, "510.1": 7701, "510.2": 7702, "511": 9165, "512": 7703, "513": 9166,
    "514": 7704, "516": 7705, "518": 7706, "520": 7707, "521": 9167, "521.2": 13465, "522": 7708,
    "524": 7709, "526.1": 7710, "526.2": 7711, "527.1": 9168, "527.2": 9169, "528": 7712, "530.01": 7713,
    "530.11": 7714, "532.H03": 8916, "536.102": 8939, "560.2": 12147,
    # serviceskilt, vegvisningsskilt, underskilt, markeringsskilt
    "600": 9179, "701.1": 7760, "711.R": 9198, "711.V90": 12120, "711.H90": 12118, "711.V135": 16049,
    "711.H135": 16052, "713.H": 12121, "713.V": 9199, "727.1": 7756, "727.3F": 12151, "727.3K": 9382,
    "802": 7781, "808.105": 7798, "810.H90": 9250, "906V": 7842, "906H": 7843, "912": 7846,
    # retired codes that objects still carry
    "U324": 9945, "U544": 7726, "U546": 7727, "U721.1": 7762, "U721.2": 7763, "U722.2": 7765,
    "U722.3": 7766, "U999": 9358,
}  # fmt: skip
"""Sign code → enum id of 5530 *Skiltnummer*, for the common signs: 130 of 642."""

_CODE = re.compile(r"U?\d{3,4}[A-ZÆØÅ]{0,3}(\.[0-9A-ZÆØÅ]+)*(?=[\s,:;-]|$)")
_FAMILY = re.compile(r"U?\d+")


def sign_code(verdi: str) -> str | None:
    """Sign code of a value of 5530: its first word, or None if that is no code.

    >>> sign_code("362.50 - Fartsgrense, 50 km/t")
    '362.50'
    """
    match = _CODE.match(verdi.strip())
    return match.group() if match else None


def sign_family(code: str) -> str:
    """Family of a sign code: what is left without the variant. A retired code keeps its ``U``.

    >>> sign_family("362.50"), sign_family("906H"), sign_family("U722.2")
    ('362', '906', 'U722')
    """
    match = _FAMILY.match(code)
    return match.group() if match else code


def is_retired(code: str) -> bool:
    """Whether a sign code is one that is no longer put up (``U…``, *utgått*) but still stands on objects."""
    return code.startswith("U")


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
        """Value of an enum id, as API Les V4 shows it in ``verdi``; None if it is not known."""
        kind = self.egenskapstyper.get(egenskap_id)
        return kind.verdier.get(enum_id) if kind is not None else None

    def enum_text(self, egenskap_id: int, enum_id: int) -> str | None:
        """Text of an enum id, ``362.50 - Fartsgrense, 50 km/t``; in the snapshot often the code alone."""
        value = self.enum_value(egenskap_id, enum_id)
        return None if value is None else str(value)

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
    text = files("nvdb").joinpath("katalog_snapshot.json").read_text(encoding="utf-8")
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
