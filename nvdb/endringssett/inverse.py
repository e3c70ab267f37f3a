"""Undo: from a set that was carried out, and the states before it, to the set that brings them back.

API Skriv knows no undo. What is done instead leaves NVDB saying what it said before:

- what was registered is removed (``fjern``, the operation for what should never have been there);
- a corrected version, and the new version of an update, gets the earlier values back (``delvisKorriger``).
  The version stays: removing it would shorten the children's history too;
- what was closed is opened by a correction of its validity, without an end date.

A removal (``fjern``) cannot be undone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date, datetime

from nvdb.endringssett.document import (
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Kvalitet,
    Stedfesting,
)
from nvdb.endringssett.measured import punkt_from_stedfesting
from nvdb.errors import RequestError
from nvdb.objects.geometri import Position
from nvdb.objects.vegobjekt import Vegobjekt


@dataclass(frozen=True, slots=True, kw_only=True)
class Earlier:
    """State of one object before a set was carried out; properties without an operation.

    `dotre`: association type id → ids of the children. Leave out what the set did not touch.
    """

    type_id: int
    nvdb_id: int
    versjon: int
    startdato: date
    egenskaper: tuple[Egenskap, ...] = ()
    stedfesting: Stedfesting | None = None
    dotre: Mapping[int, tuple[int, ...]] | None = None


def inverse(
    sett: Endringssett,
    earlier: Iterable[Earlier],
    *,
    nvdb_ids: Mapping[str, int],
    lest_fra_nvdb: datetime,
) -> Endringssett:
    """Make the set that undoes another.

    Parameters
    ----------
    sett : Endringssett
        As it was carried out.
    earlier : iterable of Earlier
        State before, of each object that it corrected, updated or closed, and of the children that a closing
        took along.
    nvdb_ids : mapping of tempId → nvdbId
        What the new objects became, from the status of the set.
    lest_fra_nvdb : datetime
        Time of the set's transaction, from its status: nobody else may have changed the objects since.

    Raises
    ------
    RequestError
        A state or an id is missing, or the set removed something.
    """
    states = {(state.type_id, state.nvdb_id): state for state in earlier}
    children = _children_names(sett)
    undone: list[Endring] = []
    for endring in sett.endringer:
        if endring.operasjon == "registrer":
            if endring.temp_id not in children:
                undone.append(_remove(endring, nvdb_ids))
        elif endring.operasjon == "fjern":
            msg = f"The {endring.navn} cannot be undone: register the object anew."
            raise RequestError(msg)
        elif endring.operasjon == "lukk":
            undone.extend(_reopen(endring, states, lest_fra_nvdb))
        else:
            undone.append(_restore(endring, _state(endring, states), nvdb_ids, lest_fra_nvdb))
    return Endringssett(
        datakatalogversjon=sett.datakatalogversjon,
        endringer=tuple(undone),
        ansvarlig=sett.ansvarlig,
        ekstern_ref=sett.ekstern_ref,
    )


def _children_names(sett: Endringssett) -> frozenset[str]:
    """Names of new children of new parents: they go with these."""
    return frozenset(
        datter.temp_id
        for endring in sett.endringer
        if endring.operasjon == "registrer"
        for assosiasjon in endring.assosiasjoner
        for datter in assosiasjon.dotre
        if datter.temp_id is not None
    )


def _state(endring: Endring, states: Mapping[tuple[int, int], Earlier]) -> Earlier:
    state = states.get((endring.type_id, endring.nvdb_id or 0))
    if state is None:
        msg = f"The {endring.navn} cannot be undone without the state before it: give that."
        raise RequestError(msg)
    return state


def _new_id(temp_id: str, nvdb_ids: Mapping[str, int]) -> int:
    if temp_id not in nvdb_ids:
        msg = f"The new object {temp_id!r} has no nvdbId: take it from the status of the set."
        raise RequestError(msg)
    return nvdb_ids[temp_id]


def _remove(endring: Endring, nvdb_ids: Mapping[str, int]) -> Endring:
    nvdb_id = _new_id(endring.temp_id or "", nvdb_ids)
    return Endring(operasjon="fjern", type_id=endring.type_id, nvdb_id=nvdb_id, kaskade=True)


def _reopen(
    endring: Endring, states: Mapping[tuple[int, int], Earlier], lest_fra_nvdb: datetime
) -> Iterator[Endring]:
    state = _state(endring, states)
    reopened = [state]
    if endring.kaskade and state.dotre:
        for ids in state.dotre.values():
            for nvdb_id in ids:
                found = next((s for (_, number), s in states.items() if number == nvdb_id), None)
                if found is None:
                    msg = f"The {endring.navn} closed {nvdb_id} too: give the state of that before it."
                    raise RequestError(msg)
                reopened.append(found)
    for item in reopened:
        yield Endring(
            operasjon="delvisKorriger",
            type_id=item.type_id,
            nvdb_id=item.nvdb_id,
            versjon=item.versjon,
            lest_fra_nvdb=lest_fra_nvdb,
            startdato=item.startdato,
        )


def _restore(
    endring: Endring, state: Earlier, nvdb_ids: Mapping[str, int], lest_fra_nvdb: datetime
) -> Endring:
    updated = endring.operasjon in {"oppdater", "delvisOppdater"} and not endring.overskriv
    before = {egenskap.type_id: egenskap for egenskap in state.egenskaper}
    touched = [egenskap.type_id for egenskap in endring.egenskaper]
    if endring.operasjon in {"oppdater", "korriger"}:
        # A whole operation also took away what it did not name.
        touched += [number for number in before if number not in touched]
    return Endring(
        operasjon="delvisKorriger",
        type_id=endring.type_id,
        nvdb_id=endring.nvdb_id,
        versjon=(endring.versjon or 0) + updated,
        lest_fra_nvdb=lest_fra_nvdb,
        egenskaper=tuple(_value_before(number, before) for number in touched),
        assosiasjoner=tuple(_children_before(item, state, nvdb_ids) for item in endring.assosiasjoner),
        stedfesting=None if endring.stedfesting is None else _place_before(endring, state),
    )


def _value_before(number: int, before: Mapping[int, Egenskap]) -> Egenskap:
    earlier = before.get(number)
    if earlier is None:
        return Egenskap(type_id=number, operasjon="slett")
    return Egenskap(
        type_id=number,
        verdi=earlier.verdi,
        enum=earlier.enum,
        geometri=earlier.geometri,
        operasjon="oppdater",
    )


def _children_before(item: Assosiasjon, state: Earlier, nvdb_ids: Mapping[str, int]) -> Assosiasjon:
    incremental = all(datter.operasjon is not None for datter in item.dotre) and item.dotre
    if incremental:
        opposite = {"ny": "slett", "slett": "ny"}
        dotre = tuple(
            Datter(
                nvdb_id=datter.nvdb_id if datter.temp_id is None else _new_id(datter.temp_id, nvdb_ids),
                operasjon=opposite[datter.operasjon or "ny"],
            )
            for datter in item.dotre
        )
        return Assosiasjon(type_id=item.type_id, dotre=dotre, operasjon="oppdater")
    ids = next((ids for number, ids in (state.dotre or {}).items() if _same_list(number, item.type_id)), ())
    if not ids:
        return Assosiasjon(type_id=item.type_id, operasjon="slett")
    dotre = tuple(Datter(nvdb_id=number) for number in ids)
    return Assosiasjon(type_id=item.type_id, dotre=dotre, operasjon="oppdater")


def _same_list(one: int, other: int) -> bool:
    """Whether two ids name one association: the list 220004 and its members 200004 are taken alike."""
    return one == other or abs(one - other) == 20_000


def _place_before(endring: Endring, state: Earlier) -> Stedfesting:
    if state.stedfesting is None or not state.stedfesting.punkter:
        msg = f"The {endring.navn} changed its place: give the stedfesting that it had before."
        raise RequestError(msg)
    return Stedfesting(punkter=state.stedfesting.punkter, operasjon="oppdater")


def earlier_from_vegobjekt(vegobjekt: Vegobjekt) -> Earlier:
    """Take the state of an object of API Les V4, fetched with ``inkluder=alle`` before the set was sent.

    Raises
    ------
    RequestError
        The object came without its version or start date.
    """
    if vegobjekt.versjon is None or vegobjekt.startdato is None:
        msg = f"Vegobjekt {vegobjekt.id} came without its version and dates: fetch it with inkluder=alle."
        raise RequestError(msg)
    places = (punkt_from_stedfesting(place) for place in vegobjekt.stedfestinger)
    punkter = tuple(punkt for punkt in places if punkt is not None)
    return Earlier(
        type_id=vegobjekt.type_id,
        nvdb_id=vegobjekt.id,
        versjon=vegobjekt.versjon,
        startdato=date.fromisoformat(vegobjekt.startdato),
        egenskaper=tuple(_values(vegobjekt)),
        stedfesting=Stedfesting(punkter=punkter) if punkter else None,
        dotre={relasjon.listeid or relasjon.id or 0: relasjon.vegobjekter for relasjon in vegobjekt.barn},
    )


def _values(vegobjekt: Vegobjekt) -> Iterator[Egenskap]:
    for item in vegobjekt.egenskaper.values():
        if item.egenskapstype == "Geometri":
            if vegobjekt.own_geometry and vegobjekt.position is not None:
                yield Egenskap(
                    type_id=item.id, geometri=_geometry_before(vegobjekt, vegobjekt.position, item.raw)
                )
        elif item.enum_id is not None:
            yield Egenskap(type_id=item.id, enum=(item.enum_id,))
        elif isinstance(item.verdi, bool):
            yield Egenskap(type_id=item.id, verdi=("JA" if item.verdi else "NEI",))
        elif isinstance(item.verdi, str | int | float):
            yield Egenskap(type_id=item.id, verdi=(str(item.verdi),))


def _geometry_before(vegobjekt: Vegobjekt, position: Position, raw: Mapping[str, object]) -> Geometri:
    """Write the geometry as it was, without the height that NVDB wrote for "unknown"."""
    height = "" if position.height_m is None else f" {position.height_m!r}"
    wkt = f"POINT{' Z' if height else ''} ({position.east_m!r} {position.north_m!r}{height})"
    said, captured = vegobjekt.kvalitet, raw.get("datafangstdato")
    kvalitet = None
    if said is not None:
        kvalitet = Kvalitet(
            datafangstmetode=said.datafangstmetode,
            noyaktighet_cm=_whole(said.noyaktighet_cm),
            synbarhet=said.synbarhet,
            datafangstmetode_hoyde=said.datafangstmetode_hoyde if height else None,
            noyaktighet_hoyde_cm=_whole(said.noyaktighet_hoyde_cm) if height else None,
        )
    return Geometri(
        srid=5973,
        wkt=wkt,
        datafangstdato=date.fromisoformat(captured) if isinstance(captured, str) else None,
        kvalitet=kvalitet,
    )


def _whole(value: float | None) -> int | None:
    return None if value is None else round(value)
