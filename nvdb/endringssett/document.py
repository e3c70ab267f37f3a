"""The change set: what API Skriv V3 is asked to do, as frozen dataclasses.

Source: API Skriv V3, *Oppbygging*. A field that is None or empty is left out of the document. Whether the
content makes sense is not asked here but by :func:`nvdb.endringssett.validate`, so that a set that somebody
else wrote can be read and its faults be named.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from typing import Final, Literal

from nvdb.errors import RequestError

Operasjon = Literal["registrer", "oppdater", "delvisOppdater", "lukk", "korriger", "delvisKorriger", "fjern"]
OPERASJONER: Final[tuple[Operasjon, ...]] = (
    "registrer", "oppdater", "delvisOppdater", "lukk", "korriger", "delvisKorriger", "fjern",
)  # fmt: skip
"""What can be done to a vegobjekt, in the order in which they are written."""

DELVIS: Final = frozenset({"delvisOppdater", "delvisKorriger"})
"""Operations that give only what changes, each part with an operation of its own."""

MAX_VEGOBJEKTER: Final = 1000
"""More in one set makes its processing slow and conflicts of locks likely, the documentation says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kvalitet:
    """How well a geometry is known.

    Attributes
    ----------
    datafangstmetode, datafangstmetode_hoyde : str or None
        Code such as ``sat`` (GNSS), ``fot`` (photogrammetry), ``ukj`` (unknown).
    noyaktighet_cm, noyaktighet_hoyde_cm : int or None
        Standard deviation of the point in plan, and of its height.
    synbarhet : int or None
        0 (well visible) to 3.
    toleranse_cm : int or None
        Greatest deviation.
    malemetode, malemetode_hoyde : int or None
        The numeric codes that `datafangstmetode` replaced in 2023; read, and never made here.
    """

    datafangstmetode: str | None = None
    noyaktighet_cm: int | None = None
    synbarhet: int | None = None
    datafangstmetode_hoyde: str | None = None
    noyaktighet_hoyde_cm: int | None = None
    toleranse_cm: int | None = None
    malemetode: int | None = None
    malemetode_hoyde: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometri:
    """Value of a geometry property. Only `srid` and `wkt` are demanded by the API; heights are NN2000.

    `referansegeometri` True means that it was derived from the road network: never for a measured sign.
    """

    srid: int
    wkt: str
    lengde_m: float | None = None
    datafangstdato: date | None = None
    temakode: int | None = None
    medium: str | None = None
    kommune: str | None = None
    hoydereferanse: int | None = None
    sosinavn: str | None = None
    referansegeometri: bool | None = None
    verifiseringsdato: date | None = None
    oppdateringsdato: date | None = None
    prosesshistorikk: str | None = None
    kvalitet: Kvalitet | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Egenskap:
    """One property: text values, enum ids, or a geometry; none of them where it is deleted.

    Attributes
    ----------
    type_id : int
        Property id in the datakatalog.
    verdi : tuple of str
    enum : tuple of int
        Enum ids; several where the property takes several values.
    geometri : Geometri or None
    operasjon : {"oppdater", "slett"} or None
        In a partial operation; None in a whole one.
    """

    type_id: int
    verdi: tuple[str, ...] = ()
    enum: tuple[int, ...] = ()
    geometri: Geometri | None = None
    operasjon: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Datter:
    """A child: an object of NVDB, or one that the same set registers. `operasjon`: ``ny`` or ``slett``."""

    nvdb_id: int | None = None
    temp_id: str | None = None
    operasjon: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Assosiasjon:
    """Children of one kind. `type_id` 220004 (or 200004) are the Skiltplater of a Skiltpunkt."""

    type_id: int
    dotre: tuple[Datter, ...] = ()
    operasjon: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Punkt:
    """A place on the road network.

    Attributes
    ----------
    veglenkesekvens_id : int
    posisjon : float
        0 to 1 along the veglenkesekvens.
    retning : {"MED", "MOT"} or None
        Along or against the veglenkesekvens.
    sideposisjon : str or None
        ``H``, ``V``, ``M`` …
    kjorefelt : tuple of str
        Lane codes, ``1``, ``2K``.
    operasjon : {"ny", "slett"} or None
        Only where a partial operation changes a list of places instead of replacing it.
    """

    veglenkesekvens_id: int
    posisjon: float
    retning: str | None = None
    sideposisjon: str | None = None
    kjorefelt: tuple[str, ...] = ()
    operasjon: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Stedfesting:
    """All places of an object. Signs are points: stretches and turns are not written here."""

    punkter: tuple[Punkt, ...] = ()
    operasjon: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Endring:
    """One operation on one version of one vegobjekt.

    Attributes
    ----------
    operasjon : str
        One of `OPERASJONER`.
    type_id : int
    nvdb_id, versjon : int or None
        Which version; both None for an object that is registered. The version is the newest for
        ``oppdater``, ``delvisOppdater`` and ``lukk``, and the one to be put right for ``korriger``.
    temp_id : str or None
        Name of a new object within the set.
    lest_fra_nvdb : datetime or None
        Until when the object was known as it is in NVDB, with a zone; written as UTC, which NVDB's own
        transaction times are. Demanded by ``korriger``, ``delvisKorriger`` and `overskriv`.
    overskriv : bool
        ``oppdater`` and ``delvisOppdater`` without a new version.
    startdato, sluttdato : date or None
        Validity of the object or of its new version.
    lukkedato : date or None
        Of ``lukk``.
    kaskade : bool or None
        Of ``lukk`` and ``fjern``: whether the children go too.
    """

    operasjon: Operasjon
    type_id: int
    nvdb_id: int | None = None
    versjon: int | None = None
    temp_id: str | None = None
    lest_fra_nvdb: datetime | None = None
    overskriv: bool = False
    startdato: date | None = None
    sluttdato: date | None = None
    egenskaper: tuple[Egenskap, ...] = ()
    assosiasjoner: tuple[Assosiasjon, ...] = ()
    stedfesting: Stedfesting | None = None
    lukkedato: date | None = None
    kaskade: bool | None = None

    @property
    def navn(self) -> str:
        """What a message calls it: ``delvisKorriger of 95 Skiltpunkt 78735745 version 3``."""
        kind = {95: "95 Skiltpunkt", 96: "96 Skiltplate"}.get(self.type_id, f"type {self.type_id}")
        if self.nvdb_id is None:
            return f"{self.operasjon} of {kind} {self.temp_id!r}"
        return f"{self.operasjon} of {kind} {self.nvdb_id} version {self.versjon}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Endringssett:
    """A change set.

    Attributes
    ----------
    datakatalogversjon : str
        The version by which it was made, ``2.38``.
    endringer : tuple of Endring
    ansvarlig : str or None
        User name of a person, demanded of service accounts.
    ekstern_ref, kontekst : str or None
        The client's own words.
    """

    datakatalogversjon: str
    endringer: tuple[Endring, ...]
    ansvarlig: str | None = None
    ekstern_ref: str | None = None
    kontekst: str | None = None


def endringssett(
    groups: Iterable[Sequence[Endring]],
    *,
    datakatalogversjon: str,
    ansvarlig: str | None = None,
    ekstern_ref: str | None = None,
    max_objects: int = MAX_VEGOBJEKTER,
) -> tuple[Endringssett, ...]:
    """Pack changes into as few sets as keep their order and every group whole.

    Parameters
    ----------
    groups : iterable of sequences of Endring
        What a builder returns is one group: a Skiltpunkt and its plates must arrive together.
    max_objects : int
        Most objects of one set.

    Raises
    ------
    RequestError
        A group alone is larger than a set may be.
    """
    packed: list[list[Endring]] = []
    for group in groups:
        if len(group) > max_objects:
            msg = (
                f"{group[0].navn} and {len(group) - 1} others belong together, but a set holds {max_objects}."
            )
            raise RequestError(msg)
        if not packed or len(packed[-1]) + len(group) > max_objects:
            packed.append([])
        packed[-1].extend(group)
    return tuple(
        Endringssett(
            datakatalogversjon=datakatalogversjon,
            endringer=tuple(endringer),
            ansvarlig=ansvarlig,
            ekstern_ref=ekstern_ref,
        )
        for endringer in packed
        if endringer
    )
