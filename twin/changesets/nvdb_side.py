"""What NVDB says, by the mirror: sites of findings, versions, times of reading, places, earlier states."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sqlalchemy as sa

from nvdb.datakatalog import Datakatalog
from nvdb.endringssett import Earlier, Endring, Punkt, Target, earlier_from_vegobjekt
from nvdb.errors import NvdbError, RequestError
from nvdb.objects import vegobjekt_from_les_v4, vegobjekt_from_uberiket
from twin.matching.config import MatchConfig
from twin.matching.sites import SKILTPLATE, SKILTPUNKT, Site, mirror_near, sites_from_mirror
from twin.mirror.raw import raw_object
from twin.store import schema
from twin.store.records import Finding
from twin.store.sql import from_json
from twin.store.store import Row, Snapshot

Key = tuple[int, int]
"""Type and id of an object."""

_NEAR_M = 100.0
"""Far beyond matching's gate."""


@dataclass(frozen=True, slots=True)
class Mirrored:
    """The part of the mirror that findings are about.

    Attributes
    ----------
    rows : mapping of (type, id) → row of the mirror
    by_id : mapping of (type, id) → Site
        Of Skiltpunkter and of plates.
    """

    rows: Mapping[Key, Row]
    by_id: Mapping[Key, Site]

    def site_of(self, finding: Finding) -> Site | None:
        """The site that a finding is about; None for a new pole, or where the mirror has none."""
        kind, number = finding.nvdb_type, finding.nvdb_id
        if number is None:
            # A new plate's finding names the pole that it hangs on.
            site = finding.terms.get("site")
            return None if site is None else self.by_id.get((site["nvdb_type"], site["nvdb_id"]))
        return self.by_id.get((kind, number))

    def target(self, kind: int, number: int) -> Target:
        """Version and time of reading of an object.

        Raises
        ------
        RequestError
            The mirror does not have it, or has it without a version.
        """
        row = self.rows.get((kind, number))
        if row is None or row["version"] is None:
            raise RequestError(
                f"the mirror has no version of {name(kind, number)}: run `twin sync-nvdb` again"
            )
        read = dt.datetime.fromisoformat(row["synced_at"])
        return Target(kind, number, row["version"], read if read.tzinfo else read.replace(tzinfo=dt.UTC))

    def newer_than(self, key: Key, day: dt.date) -> None:
        """Raise RequestError where NVDB's version does not begin before the day from which we would write."""
        start = self.rows[key]["start_date"] if key in self.rows else None
        if start is not None and day <= dt.date.fromisoformat(start):
            raise RequestError(
                f"NVDB's version of {name(*key)} is from {start}, the drive of {day}: defer it until a "
                "later drive sees it"
            )

    def place(self, key: Key) -> Punkt:
        """Where NVDB has an object on the road network; RequestError where it says no point."""
        places = from_json(self.rows[key]["stedfesting"]) if key in self.rows else []
        for said in places or []:
            sekvens, posisjon = said.get("veglenkesekvensid"), said.get("relativ_posisjon")
            if sekvens is not None and posisjon is not None:
                return Punkt(
                    veglenkesekvens_id=sekvens,
                    posisjon=posisjon,
                    retning=said.get("retning"),
                    sideposisjon=said.get("sideposisjon"),
                    kjorefelt=tuple(said.get("kjorefelt") or ()),
                )
        raise RequestError(f"the mirror has no stedfesting of {name(*key)}: run `twin sync-nvdb` again")


def mirrored_near(view: Snapshot, findings: Sequence[Finding]) -> Mirrored:
    """Read the part of the mirror around findings."""
    places = np.array([(finding.east_m, finding.north_m) for finding in findings]).reshape(-1, 2)
    config = replace(MatchConfig(), mirrored_m=_NEAR_M)
    points, plates = mirror_near(view, places, config)
    rows = {(SKILTPUNKT, row["nvdb_id"]): row for row in points}
    rows |= {(SKILTPLATE, row["nvdb_id"]): row for row in plates}
    sites = sites_from_mirror(points, plates, config)
    by_id = {(SKILTPLATE, plate.nvdb_id): site for site in sites for plate in site.plates}
    by_id |= {(site.nvdb_type, site.nvdb_id): site for site in sites}
    return Mirrored(rows, by_id)


def earlier_states(
    view: Snapshot, endringer: Iterable[Endring], katalog: Datakatalog
) -> tuple[list[Mapping[str, Any]], list[str]]:
    """Objects as received that changes would change, and what stands against undoing.

    Returns
    -------
    objects : list of JSON objects
        Of every object that is named by its id, and of the children that a closing takes along.
    problems : list of str
        A clause for each object that the mirror lacks or that cannot be read as an earlier state.
    """
    found: list[Mapping[str, Any]] = []
    problems: list[str] = []
    seen: set[Key] = set()
    keys = [(e.type_id, e.nvdb_id, bool(e.kaskade)) for e in endringer if e.nvdb_id is not None]
    while keys:
        kind, number, children = keys.pop(0)
        if (kind, number) in seen:
            continue
        seen.add((kind, number))
        table = schema.MIRROR[kind].visible
        rows = view.rows(sa.select(table.c.raw).where(table.c.nvdb_id == number))
        try:
            raw = raw_object(rows[0])
            state = earlier_from_raw(raw, kind, katalog)
        except (IndexError, NvdbError, ValueError):
            problems.append(f"the mirror has no readable state of {name(kind, number)}")
            continue
        found.append(raw)
        if children:
            keys += [(SKILTPLATE, child, False) for ids in (state.dotre or {}).values() for child in ids]
    return found, problems


def earlier_from_raw(raw: Mapping[str, Any], kind: int | None, katalog: Datakatalog) -> Earlier:
    """State of an object as received from either API (Uberiket says its type in ``typeId``)."""
    if "typeId" in raw:
        return earlier_from_vegobjekt(vegobjekt_from_uberiket(raw, katalog))
    return earlier_from_vegobjekt(vegobjekt_from_les_v4(raw, type_id=kind))


def name(kind: int, number: int) -> str:
    """``Skiltpunkt 17``."""
    return f"{'Skiltpunkt' if kind == SKILTPUNKT else 'Skiltplate'} {number}"
