"""Builders: from what was found on the road to the operations that bring it into NVDB.

Each returns one group of changes that must arrive together; :func:`nvdb.endringssett.endringssett` packs
groups into sets. Which operation fits which finding follows API Skriv V3, *Oppbygging*: a new version
(``delvisOppdater``) for what changed on the road, a correction of the present version (``delvisKorriger``)
for what was registered wrongly.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import date

from nvdb import datakatalog
from nvdb.datakatalog.ids import (
    ANSIKTSSIDE,
    PLASSERINGSKODE,
    SKILTNUMMER,
    SKILTPLATE,
    SKILTPLATER_I_SKILTPUNKT,
    SKILTPUNKT,
    TEKST,
)
from nvdb.datakatalog.katalog import Datakatalog
from nvdb.endringssett.document import (
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Punkt,
)
from nvdb.endringssett.measured import Measured, NewPlate, NewPoint, Target, geometry, place
from nvdb.errors import RequestError


def position_correction(
    point: Target,
    measured: Measured,
    *,
    plates: Iterable[Target] = (),
    stedfesting: Punkt | None = None,
) -> tuple[Endring, ...]:
    """Correct the position of a sign that never moved but is now measured better (``delvisKorriger``).

    Parameters
    ----------
    point : Target
        The Skiltpunkt, or a plate alone where no Skiltpunkt is known.
    measured : Measured
    plates : iterable of Target
        Its plates, which share its place. They get the position in plan only: the measured height is that
        of the foot, and a plate hangs above it.
    stedfesting : Punkt, optional
        New place on the road network, given to all alike; the old one stays if omitted.

    Raises
    ------
    RequestError
        A target without `lest_fra_nvdb`, or a position that cannot be.
    """
    targets = (point, *plates)
    for target in targets:
        _need_read_time(target)
    return tuple(
        Endring(
            operasjon="delvisKorriger",
            type_id=target.type_id,
            nvdb_id=target.nvdb_id,
            versjon=target.versjon,
            lest_fra_nvdb=target.lest_fra_nvdb,
            egenskaper=(
                geometry(target.type_id, measured, "oppdater", with_height=target.type_id == SKILTPUNKT),
            ),
            stedfesting=place(stedfesting, "oppdater"),
        )
        for target in targets
    )


def moved(
    point: Target,
    measured: Measured,
    *,
    on_date: date,
    stedfesting: Punkt,
    plates: Iterable[Target] = (),
) -> tuple[Endring, ...]:
    """Bring in that a sign was moved (``delvisOppdater``): new versions of the point and all its plates.

    They move together: a plate's place has to lie within its Skiltpunkt's.

    Parameters
    ----------
    on_date : date
        From when it stands there; after the start date of the present version.
    stedfesting : Punkt
        New place on the road network, given to all alike.
    point, measured, plates
        As in :func:`position_correction`; `lest_fra_nvdb` is not needed.
    """
    return tuple(
        Endring(
            operasjon="delvisOppdater",
            type_id=target.type_id,
            nvdb_id=target.nvdb_id,
            versjon=target.versjon,
            startdato=on_date,
            egenskaper=(
                geometry(target.type_id, measured, "oppdater", with_height=target.type_id == SKILTPUNKT),
            ),
            stedfesting=place(stedfesting, "oppdater"),
        )
        for target in (point, *plates)
    )


def changed_type(
    plate: Target, skiltnummer: str, *, on_date: date | None = None, katalog: Datakatalog | None = None
) -> tuple[Endring, ...]:
    """Give a plate another sign code.

    Parameters
    ----------
    plate : Target
        Of type 96.
    skiltnummer : str
        Sign code, ``362.60``.
    on_date : date or None
        Day on which the plate was changed on the road: a new version from then. None if the code in NVDB was
        wrong from the start: the present version is corrected.
    katalog : Datakatalog, optional
        Where the code's enum id is looked up; the shipped snapshot, which has the common codes, if omitted.

    Raises
    ------
    RequestError
        The code is not known, or a correction without `lest_fra_nvdb`.
    """
    if on_date is None:
        _need_read_time(plate)
    egenskap = Egenskap(
        type_id=SKILTNUMMER, enum=(skiltnummer_enum(skiltnummer, katalog),), operasjon="oppdater"
    )
    return (
        Endring(
            operasjon="delvisKorriger" if on_date is None else "delvisOppdater",
            type_id=plate.type_id,
            nvdb_id=plate.nvdb_id,
            versjon=plate.versjon,
            lest_fra_nvdb=plate.lest_fra_nvdb if on_date is None else None,
            startdato=on_date,
            egenskaper=(egenskap,),
        ),
    )


def new_sign(
    name: str,
    measured: Measured,
    *,
    on_date: date,
    stedfesting: Punkt,
    plates: Sequence[NewPlate],
    point: NewPoint | None = None,
    katalog: Datakatalog | None = None,
) -> tuple[Endring, ...]:
    """Register a Skiltpunkt with its plates (``registrer``).

    Parameters
    ----------
    name : str
        Becomes the ``tempId``, of the plates with ``#1``, ``#2`` … after it; its own in the whole set.
    on_date : date
        From when it stands there, as far as is known.
    stedfesting : Punkt
    plates : sequence of NewPlate
        From the top down, at least one.
    point : NewPoint, optional
        Further properties of the Skiltpunkt, such as 1876 Oppsettingsutstyr, which NVDB wants where known.
    katalog : Datakatalog, optional

    Raises
    ------
    RequestError
        No plate, an unknown sign code, or a position that cannot be.
    """
    if not plates:
        msg = (
            f"The new sign {name!r} has no plate: a Skiltpunkt is registered together with what hangs on it."
        )
        raise RequestError(msg)
    more = point or NewPoint()
    child_names = [f"{name}#{i}" for i in range(1, len(plates) + 1)]
    parent = Endring(
        operasjon="registrer",
        type_id=SKILTPUNKT,
        temp_id=name,
        startdato=on_date,
        egenskaper=(
            *(Egenskap(type_id=number, verdi=(value,)) for number, value in more.verdi.items()),
            *(Egenskap(type_id=number, enum=(value,)) for number, value in more.enum.items()),
            geometry(SKILTPUNKT, measured, None, with_height=True),
        ),
        assosiasjoner=(_plates_of(child_names, None),),
        stedfesting=place(stedfesting, None),
    )
    return (parent, *_new_plates(child_names, plates, measured, on_date, stedfesting, katalog))


def new_plates(
    point: Target,
    name: str,
    measured: Measured,
    *,
    on_date: date,
    stedfesting: Punkt,
    plates: Sequence[NewPlate],
    katalog: Datakatalog | None = None,
) -> tuple[Endring, ...]:
    """Register plates on a Skiltpunkt that NVDB has: it gets a new version with the children added.

    `stedfesting` has to be the place that the Skiltpunkt has in NVDB; the rest as in :func:`new_sign`.
    """
    if not plates:
        msg = f"There is no plate to register on Skiltpunkt {point.nvdb_id}: give at least one."
        raise RequestError(msg)
    child_names = [f"{name}#{i}" for i in range(1, len(plates) + 1)]
    parent = Endring(
        operasjon="delvisOppdater",
        type_id=point.type_id,
        nvdb_id=point.nvdb_id,
        versjon=point.versjon,
        startdato=on_date,
        assosiasjoner=(_plates_of(child_names, "oppdater"),),
    )
    return (parent, *_new_plates(child_names, plates, measured, on_date, stedfesting, katalog))


def gone(target: Target, *, on_date: date, with_plates: bool = True) -> tuple[Endring, ...]:
    """Close an object that is no longer there (``lukk``): it keeps its history.

    Parameters
    ----------
    target : Target
        A plate, or a Skiltpunkt.
    on_date : date
        From when it is gone; NVDB counts a period without its last day.
    with_plates : bool
        Whether the children are closed too. API Skriv refuses to close a Skiltpunkt and leave its plates.
    """
    return (
        Endring(
            operasjon="lukk",
            type_id=target.type_id,
            nvdb_id=target.nvdb_id,
            versjon=target.versjon,
            lukkedato=on_date,
            kaskade=with_plates,
        ),
    )


def skiltnummer_enum(code: str, katalog: Datakatalog | None = None) -> int:
    """Enum id of a sign code.

    Raises
    ------
    RequestError
        The datakatalog does not have it. The snapshot has 130 codes of 642: its message says to sync first.
    """
    katalog = katalog or datakatalog.snapshot()
    kind = katalog.egenskapstyper.get(SKILTNUMMER)
    for enum_id, text in (kind.verdier if kind is not None else {}).items():
        if datakatalog.sign_code(str(text)) == code:
            return enum_id
    if kind is not None and not kind.complete:
        msg = (
            f"The sign code {code!r} cannot be looked up: only {len(kind.verdier)} codes of datakatalog "
            f"{katalog.version} ship with this program, so sync with NVDB first, which fetches all of them."
        )
        raise RequestError(msg)
    msg = (
        f"Datakatalog {katalog.version} has no sign code {code!r}: correct the code, or sync with NVDB again "
        "if it is a new one."
    )
    raise RequestError(msg)


def _new_plates(
    names: Sequence[str],
    plates: Sequence[NewPlate],
    measured: Measured,
    on_date: date,
    stedfesting: Punkt,
    katalog: Datakatalog | None,
) -> tuple[Endring, ...]:
    return tuple(
        Endring(
            operasjon="registrer",
            type_id=SKILTPLATE,
            temp_id=name,
            startdato=on_date,
            egenskaper=(
                *_plate_values(plate, katalog),
                geometry(SKILTPLATE, measured, None, with_height=False),
            ),
            stedfesting=place(stedfesting, None),
        )
        for name, plate in zip(names, plates, strict=True)
    )


def _plate_values(plate: NewPlate, katalog: Datakatalog | None) -> Iterable[Egenskap]:
    yield Egenskap(type_id=SKILTNUMMER, enum=(skiltnummer_enum(plate.skiltnummer, katalog),))
    if plate.ansiktsside is not None:
        yield Egenskap(type_id=ANSIKTSSIDE, enum=(int(plate.ansiktsside),))
    if plate.plasseringskode is not None:
        yield Egenskap(type_id=PLASSERINGSKODE, verdi=(str(plate.plasseringskode),))
    if plate.tekst is not None:
        yield Egenskap(type_id=TEKST, verdi=(plate.tekst,))


def _plates_of(child_names: Sequence[str], operasjon: str | None) -> Assosiasjon:
    added = None if operasjon is None else "ny"
    return Assosiasjon(
        type_id=SKILTPLATER_I_SKILTPUNKT,
        dotre=tuple(Datter(temp_id=name, operasjon=added) for name in child_names),
        operasjon=operasjon,
    )


def _need_read_time(target: Target) -> None:
    if target.lest_fra_nvdb is None or target.lest_fra_nvdb.tzinfo is None:
        msg = (
            f"The correction of {target.type_id} {target.nvdb_id} needs the time at which it was read from "
            "NVDB, with a zone: read it again and give that time."
        )
        raise RequestError(msg)
