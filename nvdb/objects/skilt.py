"""Skiltpunkt (95) and Skiltplate (96): the typed view that the twin works with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from nvdb import datakatalog
from nvdb.errors import SchemaError
from nvdb.objects.geometri import Position
from nvdb.objects.vegobjekt import RawObject, Vegobjekt, VegobjektEgenskap, VegobjektStedfesting

SHOWN: Final[Mapping[int, frozenset[int]]] = {
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Skilt:
    """What Skiltpunkt and Skiltplate share.

    Attributes
    ----------
    nvdb_id : int
    version : int or None
    start_date, end_date : str or None
        ISO dates of validity.
    last_modified : str or None
        NVDB's text, UTC by its documentation.
    position : Position or None
        EPSG:25833 and NN2000. A sign's position only if `own_geometry`; else a point on the centre line.
    own_geometry : bool
        ``egengeometri`` is true.
    accuracy_cm : float or None
        Stated standard deviation in plan; None if unknown. 100 by ``ukj`` looks like a default.
    capture_method : str or None
        ``datafangstmetode``: ``sat``, ``fot``, ``dig``, ``ukj`` …
    road_reference : str or None
        Short form of the first vegsystemreferanse.
    kommuner : tuple of int
    stedfesting : tuple of VegobjektStedfesting
    problems : tuple of str
        Values that could not be used, one clause each.
    raw : dict
        The object as received.
    """

    nvdb_id: int
    version: int | None = None
    start_date: str | None = None
    end_date: str | None = None
    last_modified: str | None = None
    position: Position | None = None
    own_geometry: bool = False
    accuracy_cm: float | None = None
    capture_method: str | None = None
    road_reference: str | None = None
    kommuner: tuple[int, ...] = ()
    stedfesting: tuple[VegobjektStedfesting, ...] = ()
    problems: tuple[str, ...] = ()
    raw: RawObject = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Skiltpunkt(Skilt):
    """What plates are mounted on; `plate_ids` are its children of type 96."""

    plate_ids: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Skiltplate(Skilt):
    """One plate.

    Attributes
    ----------
    point_id : int or None
        Its Skiltpunkt; None if the answer names none; the points' `plate_ids` say the same.
    skiltnummer : str or None
        Sign code, ``362.50``; None if the first word of 5530 is no code.
    skiltnummer_text : str or None
        All of 5530, ``362.50 - Fartsgrense, 50 km/t``.
    enum_id : int or None
        Of 5530.
    ansiktsside : str or None
        1894 in words; `ansiktsside_enum_id` is one of :class:`nvdb.datakatalog.ids.Ansiktsside` if known.
    text : str or None
        1910, as written (``.`` and ``N/A`` are fillers).
    plasseringskode : int or None
        5128: 10, 20, 30 … from the top down.
    """

    point_id: int | None = None
    skiltnummer: str | None = None
    skiltnummer_text: str | None = None
    enum_id: int | None = None
    ansiktsside: str | None = None
    ansiktsside_enum_id: int | None = None
    text: str | None = None
    plasseringskode: int | None = None

    @property
    def retired(self) -> bool:
        """Whether the code is one that is no longer put up (``U…``)."""
        return self.skiltnummer is not None and datakatalog.is_retired(self.skiltnummer)


def skilt_from_vegobjekt(
    vegobjekt: Vegobjekt, type_id: int, *, unknown_enums_named: bool = False
) -> Skiltpunkt | Skiltplate:
    """View an object of `type_id` 95 or 96 as a sign; SchemaError if it is of another type.

    With `unknown_enums_named` an enum id without a text is already among the object's ``problems``: its sign
    code is then not called missing as well.
    """
    if vegobjekt.type_id != type_id:
        msg = f"Vegobjekt {vegobjekt.id} is of type {vegobjekt.type_id}, not {type_id}: ask for {type_id}."
        raise SchemaError(msg)
    if type_id == datakatalog.SKILTPUNKT:
        return _skiltpunkt(vegobjekt)
    return _skiltplate(vegobjekt, unknown_enums_named)


def _skiltpunkt(vegobjekt: Vegobjekt) -> Skiltpunkt:
    plates = (
        plate
        for relasjon in vegobjekt.barn
        if relasjon.type_id == datakatalog.SKILTPLATE
        for plate in relasjon.vegobjekter
    )
    return Skiltpunkt(**_shared(vegobjekt, []), plate_ids=tuple(plates))


def _skiltplate(vegobjekt: Vegobjekt, unknown_enums_named: bool) -> Skiltplate:
    problems: list[str] = []
    nummer = vegobjekt.egenskaper.get(datakatalog.SKILTNUMMER)
    nummer_text = _text(nummer, problems)
    unknown_enum = nummer is not None and nummer.enum_id is not None and nummer_text is None
    side = vegobjekt.egenskaper.get(datakatalog.ANSIKTSSIDE)
    return Skiltplate(
        point_id=_point_id(vegobjekt, problems),
        skiltnummer=None if unknown_enum and unknown_enums_named else _code(nummer_text, problems),
        skiltnummer_text=nummer_text,
        enum_id=nummer.enum_id if nummer else None,
        ansiktsside=_text(side, problems),
        ansiktsside_enum_id=side.enum_id if side else None,
        text=_text(vegobjekt.egenskaper.get(datakatalog.TEKST), problems),
        plasseringskode=_integer(vegobjekt.egenskaper.get(datakatalog.PLASSERINGSKODE), problems),
        **_shared(vegobjekt, problems),  # last: the lines above add to `problems`
    )


def _shared(vegobjekt: Vegobjekt, problems: list[str]) -> dict[str, Any]:
    """Fields of :class:`Skilt`."""
    kvalitet = vegobjekt.kvalitet
    return {
        "nvdb_id": vegobjekt.id,
        "version": vegobjekt.versjon,
        "start_date": vegobjekt.startdato,
        "end_date": vegobjekt.sluttdato,
        "last_modified": vegobjekt.sist_modifisert,
        "position": vegobjekt.position,
        "own_geometry": vegobjekt.own_geometry,
        "accuracy_cm": kvalitet.noyaktighet_cm if kvalitet else None,
        "capture_method": kvalitet.datafangstmetode if kvalitet else None,
        "road_reference": next(iter(vegobjekt.vegsystemreferanser), None),
        "kommuner": vegobjekt.kommuner,
        "stedfesting": vegobjekt.stedfestinger,
        "problems": (*vegobjekt.problems, *problems),
        "raw": vegobjekt.raw,
    }


def _point_id(vegobjekt: Vegobjekt, problems: list[str]) -> int | None:
    """The one parent of type 95."""
    parents = {
        parent
        for relasjon in vegobjekt.foreldre
        if relasjon.type_id == datakatalog.SKILTPUNKT
        for parent in relasjon.vegobjekter
    }
    if len(parents) > 1:
        problems.append(f"has {len(parents)} Skiltpunkt above it, none is used")
        return None
    return next(iter(parents), None)


def _code(text: str | None, problems: list[str]) -> str | None:
    code = datakatalog.sign_code(text) if text else None
    if code is None:
        problems.append(f"skiltnummer {text[:30]!r} is no sign code" if text else "skiltnummer is missing")
    return code


def _text(egenskap: VegobjektEgenskap | None, problems: list[str]) -> str | None:
    if egenskap is None or egenskap.verdi is None:
        return None
    if not isinstance(egenskap.verdi, str):
        problems.append(f"egenskap {egenskap.id} is {egenskap.verdi!r:.30} instead of text")
        return None
    return egenskap.verdi


def _integer(egenskap: VegobjektEgenskap | None, problems: list[str]) -> int | None:
    if egenskap is None or egenskap.verdi is None:
        return None
    verdi = egenskap.verdi
    if isinstance(verdi, bool) or not isinstance(verdi, int) or not -(2**63) <= verdi < 2**63:
        problems.append(f"egenskap {egenskap.id} is {egenskap.verdi!r:.30} instead of a whole number")
        return None
    return verdi
