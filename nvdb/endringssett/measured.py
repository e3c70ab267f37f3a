"""What a builder is given: which object, and where its sign was measured to stand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime

from nvdb.datakatalog.ids import GEOMETRI_PUNKT, SKILTPLATE, SKILTPUNKT
from nvdb.endringssett.document import Egenskap, Geometri, Kvalitet, Punkt, Stedfesting
from nvdb.errors import RequestError
from nvdb.objects.geometri import in_norway
from nvdb.objects.skilt import Skiltplate, Skiltpunkt
from nvdb.objects.vegobjekt import VegobjektStedfesting


@dataclass(frozen=True, slots=True)
class Target:
    """One version of one object of NVDB.

    Attributes
    ----------
    type_id : int
        95 or 96.
    nvdb_id, versjon : int
    lest_fra_nvdb : datetime or None
        Until when it was known as it is in NVDB, with a zone. A correction cannot do without.
    """

    type_id: int
    nvdb_id: int
    versjon: int
    lest_fra_nvdb: datetime | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Where a sign's pole meets the ground.

    Attributes
    ----------
    east_m, north_m : float
        EPSG:25833, EUREF89.
    std_m : float
        Standard deviation of the point in plan, metres. NVDB asks for the *punktstandardavvik*; its documents
        do not say whether of one axis or of both. √(σE² + σN²) is the larger, and so the careful one.
    captured : date
        Day of measuring.
    height_m, std_height_m : float or None
        NN2000; both or neither.
    method, method_height : str
        ``datafangstmetode``: ``fot`` for a position from pictures, ``sat`` from a GNSS receiver held there.
    visibility : int
        ``synbarhet``: 0 well visible, to 3.
    """

    east_m: float
    north_m: float
    std_m: float
    captured: date
    height_m: float | None = None
    std_height_m: float | None = None
    method: str = "fot"
    method_height: str = "fot"
    visibility: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class NewPlate:
    """A plate that NVDB does not have.

    Attributes
    ----------
    skiltnummer : str
        Sign code, ``362.50``.
    ansiktsside : int or None
        Enum id, see :class:`nvdb.datakatalog.ids.Ansiktsside`.
    plasseringskode : int or None
        10, 20, 30 … from the top down.
    tekst : str or None
        What is written on it, where the code alone does not say it.
    """

    skiltnummer: str
    ansiktsside: int | None = None
    plasseringskode: int | None = None
    tekst: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NewPoint:
    """A Skiltpunkt that NVDB does not have: its enum ids and values by property id."""

    enum: Mapping[int, int] = field(default_factory=dict)
    verdi: Mapping[int, str] = field(default_factory=dict)


def target_from_skilt(skilt: Skiltpunkt | Skiltplate, *, lest_fra_nvdb: datetime | None = None) -> Target:
    """Take the object and version of a sign that was read from API Les.

    Parameters
    ----------
    skilt : Skiltpunkt or Skiltplate
    lest_fra_nvdb : datetime, optional
        The sign's own ``sist_modifisert`` if omitted: whatever was changed after that is somebody else's.

    Raises
    ------
    RequestError
        It came without its version.
    """
    if skilt.version is None:
        msg = f"Sign {skilt.nvdb_id} came without its version: fetch it with inkluder=metadata."
        raise RequestError(msg)
    moment = lest_fra_nvdb
    if moment is None and skilt.last_modified is not None:
        said = datetime.fromisoformat(skilt.last_modified)
        moment = said.replace(tzinfo=UTC) if said.tzinfo is None else said
    kind = SKILTPUNKT if isinstance(skilt, Skiltpunkt) else SKILTPLATE
    return Target(kind, skilt.nvdb_id, skilt.version, moment)


def punkt_from_stedfesting(place: VegobjektStedfesting) -> Punkt | None:
    """Turn a place as API Les gives it into one to write; None where it is no point."""
    if place.veglenkesekvensid is None or place.relativ_posisjon is None:
        return None
    return Punkt(
        veglenkesekvens_id=place.veglenkesekvensid,
        posisjon=place.relativ_posisjon,
        retning=place.retning,
        sideposisjon=place.sideposisjon,
        kjorefelt=place.kjorefelt,
    )


def place(punkt: Punkt | None, operasjon: str | None) -> Stedfesting | None:
    """Make the stedfesting; NVDB keeps 8 decimals of a position."""
    if punkt is None:
        return None
    rounded = replace(punkt, posisjon=round(punkt.posisjon, 8), operasjon=None)
    return Stedfesting(punkter=(rounded,), operasjon=operasjon)


def geometry(type_id: int, measured: Measured, operasjon: str | None, *, with_height: bool) -> Egenskap:
    """Make the geometry property: to the millimetre, five quality parameters with a height, three without."""
    _check_measured(measured)
    east, north = f"{measured.east_m:.3f}", f"{measured.north_m:.3f}"
    kvalitet = Kvalitet(
        datafangstmetode=measured.method,
        noyaktighet_cm=_centimetres(measured.std_m),
        synbarhet=measured.visibility,
    )
    wkt = f"POINT ({east} {north})"
    if with_height and measured.height_m is not None and measured.std_height_m is not None:
        wkt = f"POINT Z ({east} {north} {measured.height_m:.3f})"
        kvalitet = replace(
            kvalitet,
            datafangstmetode_hoyde=measured.method_height,
            noyaktighet_hoyde_cm=_centimetres(measured.std_height_m),
        )
    geometri = Geometri(srid=5973, wkt=wkt, datafangstdato=measured.captured, kvalitet=kvalitet)
    return Egenskap(type_id=GEOMETRI_PUNKT[type_id], geometri=geometri, operasjon=operasjon)


def _centimetres(std_m: float) -> int:
    """Whole centimetres, rounded up, so that a position is never claimed to be better than it is."""
    return max(1, math.ceil(round(100.0 * std_m, 6)))


def _check_measured(measured: Measured) -> None:
    numbers = (measured.std_m, measured.height_m, measured.std_height_m)
    finite = all(number is None or math.isfinite(number) for number in numbers)
    positive = measured.std_m > 0 and (measured.std_height_m is None or measured.std_height_m > 0)
    if not (in_norway(measured.east_m, measured.north_m) and finite and positive):
        msg = (
            f"The position {measured.east_m:.2f}, {measured.north_m:.2f} ± {measured.std_m:.2f} m cannot be "
            "sent: give EPSG:25833 in Norway, finite numbers and standard deviations above 0."
        )
        raise RequestError(msg)
    if (measured.height_m is None) != (measured.std_height_m is None):
        msg = "A measured height needs its standard deviation, and that needs a height: give both or neither."
        raise RequestError(msg)
