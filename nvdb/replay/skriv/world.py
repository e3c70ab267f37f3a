"""What a local API Skriv holds: objects, and what becomes of them when a change set is carried out.

It refuses as *Behandlingsresultat* documents: unknown objects and versions, versions that are not the newest,
corrections of what others have changed since, closed objects, children without a parent, missing rights.
It does not know the road network, and makes no following updates of its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, date, datetime

from nvdb import datakatalog
from nvdb.datakatalog.katalog import Datakatalog
from nvdb.endringssett import Egenskap, Endring, Endringssett, Stedfesting, ValidationFinding, validate
from nvdb.endringssett.finding import FEIL

NO_RIGHT = "MANGLER_TILGANG"


@dataclass(slots=True, kw_only=True)
class ReplayObject:
    """One object as it stands; `sist_modifisert` in UTC."""

    type_id: int
    nvdb_id: int
    versjon: int = 1
    startdato: date = date(2020, 1, 1)
    sluttdato: date | None = None
    sist_modifisert: datetime = datetime(2020, 1, 1, tzinfo=UTC)
    egenskaper: dict[int, Egenskap] = field(default_factory=dict)
    stedfesting: Stedfesting | None = None
    barn: list[int] = field(default_factory=list)


class SkrivWorld:
    """Objects, the datakatalog, and the rights of the one user.

    Parameters
    ----------
    objects : iterable of ReplayObject
    rights : frozenset of int
        Types that the user may write.
    katalog : Datakatalog, optional
        The shipped snapshot if omitted.
    now : callable
        Present time in UTC.
    """

    def __init__(
        self,
        objects: Iterable[ReplayObject] = (),
        *,
        rights: frozenset[int] = frozenset({95, 96}),
        katalog: Datakatalog | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self.objects = {item.nvdb_id: item for item in objects}
        self.rights = rights
        self.katalog = katalog or datakatalog.snapshot()
        self.now = now
        self._ids = itertools.count(max(self.objects, default=1_000_000_000) + 1)

    def refusals(self, sett: Endringssett) -> tuple[ValidationFinding, ...]:
        """Everything that speaks against carrying a set out now, and the warnings."""
        found = list(validate(sett, self.katalog))
        closing = {e.nvdb_id for e in sett.endringer if e.operasjon in {"lukk", "fjern"}}
        for endring in sett.endringer:
            found.extend(
                ValidationFinding(
                    FEIL, code, endring.navn, clause, endring.temp_id, endring.nvdb_id, endring.versjon
                )
                for code, clause in self._against(endring, closing)
            )
        return tuple(found)

    def _against(self, endring: Endring, closing: set[int | None]) -> Iterator[tuple[str, str]]:
        if endring.type_id not in self.rights:
            yield NO_RIGHT, "is of a type that the user may not write: ask for the right"
        for assosiasjon in endring.assosiasjoner:
            for datter in assosiasjon.dotre:
                if datter.nvdb_id is not None and datter.nvdb_id not in self.objects:
                    yield "DATTEROBJEKT_FINNES_IKKE", f"names the child {datter.nvdb_id}, which NVDB has not"
        if endring.operasjon == "registrer":
            return
        there = self.objects.get(endring.nvdb_id or 0)
        if there is None or there.type_id != endring.type_id:
            yield "VEGOBJEKTET_FINNES_IKKE", "is not in NVDB: read it again"
            return
        yield from _against_version(endring, there)
        if endring.operasjon in {"lukk", "fjern"} and not endring.kaskade:
            left = [child for child in there.barn if child not in closing and child in self.objects]
            if left:
                yield "DATTEROBJEKT_UTEN_MOR", f"would leave {left[0]} without a parent: close that too"

    def carry_out(self, sett: Endringssett) -> dict[int, tuple[int, int]]:
        """Do everything that a set says; index of each change → id and version that it led to."""
        names: dict[str, int] = {}
        for endring in sett.endringer:
            if endring.operasjon == "registrer":
                names[endring.temp_id or ""] = next(self._ids)
        return {index: self._carry_out(endring, names) for index, endring in enumerate(sett.endringer)}

    def _carry_out(self, endring: Endring, names: dict[str, int]) -> tuple[int, int]:
        if endring.operasjon == "registrer":
            nvdb_id = names[endring.temp_id or ""]
            there = ReplayObject(
                type_id=endring.type_id, nvdb_id=nvdb_id, startdato=endring.startdato or self.now().date()
            )
            self.objects[nvdb_id] = there
        else:
            there = self.objects[endring.nvdb_id or 0]
        if endring.operasjon == "fjern":
            self._take_away(there, cascade=bool(endring.kaskade))
        elif endring.operasjon == "lukk":
            self._close(there, endring.lukkedato, cascade=bool(endring.kaskade))
        else:
            self._write(there, endring, names)
        return there.nvdb_id, there.versjon

    def _take_away(self, there: ReplayObject, *, cascade: bool) -> None:
        self.objects.pop(there.nvdb_id, None)
        for parent in self.objects.values():
            if there.nvdb_id in parent.barn:
                parent.barn.remove(there.nvdb_id)
        for child in there.barn if cascade else ():
            if child in self.objects:
                self._take_away(self.objects[child], cascade=True)

    def _close(self, there: ReplayObject, on: date | None, *, cascade: bool) -> None:
        there.sluttdato, there.sist_modifisert = on, self.now()
        for child in there.barn if cascade else ():
            if child in self.objects and self.objects[child].sluttdato is None:
                self._close(self.objects[child], on, cascade=True)

    def _write(self, there: ReplayObject, endring: Endring, names: dict[str, int]) -> None:
        if endring.operasjon in {"oppdater", "delvisOppdater"} and not endring.overskriv:
            there.versjon += 1
        if endring.operasjon in {"oppdater", "korriger"}:
            there.egenskaper.clear()
        if endring.startdato is not None:
            there.startdato, there.sluttdato = endring.startdato, endring.sluttdato
        gone = {e.type_id for e in endring.egenskaper if e.operasjon == "slett"}
        there.egenskaper |= {e.type_id: e for e in endring.egenskaper}
        there.egenskaper = {n: e for n, e in there.egenskaper.items() if n not in gone}
        if endring.stedfesting is not None:
            there.stedfesting = endring.stedfesting
        for assosiasjon in endring.assosiasjoner:
            if all(datter.operasjon is None for datter in assosiasjon.dotre):
                there.barn.clear()
            for datter in assosiasjon.dotre:
                child = names[datter.temp_id] if datter.temp_id is not None else datter.nvdb_id or 0
                _set_child(there, child, wanted=datter.operasjon != "slett")
        there.sist_modifisert = self.now()


def _set_child(there: ReplayObject, child: int, *, wanted: bool) -> None:
    there.barn = [number for number in there.barn if number != child] + [child] * wanted


def _against_version(endring: Endring, there: ReplayObject) -> Iterator[tuple[str, str]]:
    """Ask whether the version that is meant is there and may be changed so."""
    corrects = endring.operasjon in {"korriger", "delvisKorriger"} or endring.overskriv
    if corrects:
        if (endring.versjon or 0) > there.versjon:
            yield (
                "VEGOBJEKTVERSJONEN_FINNES_IKKE",
                f"is not there, the newest is {there.versjon}: read it again",
            )
        elif endring.lest_fra_nvdb is not None and there.sist_modifisert > endring.lest_fra_nvdb:
            clause = f"was changed by another at {there.sist_modifisert:%Y-%m-%dT%H:%M:%S}: read it again"
            yield "VEGOBJEKTVERSJON_OVERSKREVET_AV_ANDRE", clause
        return
    if endring.versjon is not None and endring.versjon != there.versjon:
        yield "VERSJONSKONFLIKT", f"is not the newest version, which is {there.versjon}: read it again"
    if endring.operasjon == "fjern":
        return
    if there.sluttdato is not None:
        yield "VEGOBJEKTET_ER_LUKKET", f"was closed on {there.sluttdato}: read it again"
    day = endring.lukkedato or endring.startdato
    if day is not None and day <= there.startdato:
        yield (
            "UGYLDIG_STARTDATO",
            f"is to change on {day}, not after its start {there.startdato}: mend the day",
        )
