"""The findings of the last match as people read them: with their decision, and what changed since."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from twin.decisions.evidence import Ask, Row
from twin.decisions.log import REOPENED
from twin.errors import ConfigError, FileError
from twin.store import schema
from twin.store.kinds import QUIET, Decision, Verdict
from twin.store.records import Finding, split_codes
from twin.store.sql import each_text
from twin.words.reasons import Reopened, Told, cause_from_json

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

NORWAY_DEG = (-10.0, 57.0, 35.0, 82.0)
"""Longitude and latitude, least and most, with Svalbard and Jan Mayen."""
SHORTEST_ID = 6
"""Digits of a change id that are taken for the whole of it, where no other begins with them."""


@dataclass(frozen=True, slots=True)
class FindingStatus:
    """A finding of the last match, and what is decided about it.

    Attributes
    ----------
    finding : Finding
        One that is open again says what changed since it was decided (`Finding.reopened`).
    decision : Decision
        That holds now.
    """

    finding: Finding
    decision: Decision

    @property
    def change_id(self) -> str:
        """The finding's id."""
        return self.finding.change_id

    @property
    def is_quiet(self) -> bool:
        """Whether the finding asks nobody to decide."""
        return self.finding.verdict in QUIET

    @property
    def is_open(self) -> bool:
        """Whether somebody still has to decide: a finding that differs from NVDB and is ``open``."""
        return self.decision == Decision.OPEN and not self.is_quiet

    def as_json(self) -> dict[str, Any]:
        """Return it with the names and in the order of the table ``change``, the decision last."""
        row = self.finding.to_row()
        columns = {column.name: row[column.name] for column in schema.change.columns}
        return {**columns, "decision": self.decision}


@dataclass(frozen=True, slots=True)
class Brief:
    """What of a finding of the last match is needed to choose it: quick to read where there are thousands.

    The attributes are those of :class:`twin.store.records.Finding`, and the decision that holds.
    """

    change_id: str
    verdict: Verdict
    decision: Decision
    confidence: float
    nvdb_type: int
    nvdb_id: int | None
    skiltnummer_nvdb: tuple[str, ...]
    skiltnummer_seen: tuple[str, ...]
    drive_ids: tuple[str, ...]
    distance_m: float | None
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class Selection:
    """Which findings are meant: those that fit every criterion that is given.

    Attributes
    ----------
    drives : tuple of str
        Seen, or not seen, in one of these: ids or names.
    area : Path or None
        GeoJSON with polygons (RFC 7946: longitude and latitude).
    verdicts : tuple of Verdict
        Without any, every verdict that asks for a decision.
    classes : tuple of str
        Sign codes seen or in NVDB: ``362.50``, ``362`` for all of its kind, ``3`` for the 300s.
    since, until : date or None
        Days (UTC, both included) of at least one of the finding's drives.
    decisions : tuple of Decision
        The decision that holds now is one of these; without any, whichever it is.
    confidence : (float, float)
        Least and most.
    """

    drives: tuple[str, ...] = ()
    area: Path | None = None
    verdicts: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    since: dt.date | None = None
    until: dt.date | None = None
    decisions: tuple[Decision, ...] = (Decision.OPEN,)
    confidence: tuple[float, float] = (0.0, 1.0)

    @property
    def is_empty(self) -> bool:
        """Whether no criterion is given; the present decision and the confidence alone are none."""
        return not (self.drives or self.area or self.verdicts or self.classes or self.since or self.until)


def latest_findings(ask: Ask, only: Collection[str] | None = None) -> list[FindingStatus]:
    """Return the findings of the last match, or those named, by their ids, each with its decision."""
    asked = findings_statement(*schema.change.columns)
    if only is not None:
        asked = asked.where(schema.change.c.change_id.in_(each_text(sorted(only))))
    rows = ask(asked)
    return [
        FindingStatus(replace(Finding.from_row(row), reopened=_reopened(row)), Decision(row["decision"]))
        for row in rows
    ]


def whole_ids(given: Collection[str], existing: Collection[str]) -> list[str]:
    """Return the ids that are meant by whole ids, or by their first digits where only one begins so.

    Parameters
    ----------
    given : collection of str
        As people write them; at least `SHORTEST_ID` digits.
    existing : collection of str

    Returns
    -------
    list of str
        Each once, in the order given. What fits none is returned as it is.

    Raises
    ------
    ConfigError
        Several begin so.
    """
    meant: dict[str, None] = {}
    for text in given:
        fits = sorted(one for one in existing if one.startswith(text)) if len(text) >= SHORTEST_ID else []
        if text in existing or not fits:
            meant[text] = None
        elif len(fits) == 1:
            meant[fits[0]] = None
        else:
            shown = ", ".join(fits[:5]) + (f" and {len(fits) - 5} more" if len(fits) > 5 else "")
            raise ConfigError(f"{len(fits)} changes begin with {text}: write more of {shown}.")
    return list(meant)


def findings_statement(*columns: sa.Column[Any]) -> sa.Select[Any]:
    """Ask for columns of ``change``, their ``decision``, and its ``kind``, ``note`` and ``cause``."""
    change, said = schema.change, schema.decision
    return (
        sa.select(
            *columns,
            sa.func.coalesce(said.c.decision, Decision.OPEN).label("decision"),
            said.c.kind.label("kind"),
            said.c.reason.label("note"),
            said.c.cause.label("cause"),
        )
        .select_from(change.outerjoin(said, said.c.change_id == change.c.change_id))
        .order_by(change.c.change_id)
    )


def drive_days(ask: Ask) -> dict[str, dt.date]:
    """Return the UTC day on which each drive of the store began."""
    drive = schema.drive.c
    return {
        row["drive_id"]: _day(row["started_ns"]) for row in ask(sa.select(drive.drive_id, drive.started_ns))
    }


def select(ask: Ask, wanted: Selection) -> list[FindingStatus]:
    """Return the findings that a selection means, by their ids, as :func:`select_briefly`."""
    return latest_findings(ask, {one.change_id for one in select_briefly(ask, wanted)})


def select_briefly(ask: Ask, wanted: Selection) -> list[Brief]:
    """Return what tells the findings that a selection means, by their ids.

    Raises
    ------
    ConfigError
        A drive is not in the store, or the area is not a GeoJSON file with polygons.
    """
    verdicts = wanted.verdicts or tuple(verdict for verdict in Verdict if verdict not in QUIET)
    decisions = wanted.decisions or tuple(Decision)
    least, most = wanted.confidence
    selected = [
        one
        for one in _briefs(ask)
        if one.verdict in verdicts and one.decision in decisions and least <= one.confidence <= most
    ]
    if wanted.classes:
        selected = [one for one in selected if _has_class(one, wanted.classes)]
    if wanted.drives or wanted.since or wanted.until:
        drives = _drives(ask, wanted)
        selected = [one for one in selected if not drives.isdisjoint(one.drive_ids)]
    if wanted.area is not None:
        inside = _inside(read_area(wanted.area), selected)
        selected = [one for one, is_inside in zip(selected, inside, strict=True) if is_inside]
    return selected


def read_area(path: Path) -> BaseGeometry:
    """Read polygons from a GeoJSON file, in degrees.

    Raises
    ------
    FileError
        It cannot be read.
    ConfigError
        It is no GeoJSON, has no polygon, or its coordinates are no longitude and latitude
        in Norway.
    """
    import shapely

    try:
        text = path.read_text(encoding="utf-8")
        json.loads(text)
        area = shapely.from_geojson(text)
    except OSError as error:
        raise FileError(f"The area {path} cannot be read ({error.strerror}): name a GeoJSON file.") from error
    except (ValueError, shapely.errors.GEOSException) as error:
        raise ConfigError(f"The area {path} is not GeoJSON: give a file with polygons.") from error
    polygons = [part for part in shapely.get_parts(shapely.get_parts(area)) if part.geom_type == "Polygon"]
    if not polygons:
        raise ConfigError(f"The area {path} has no polygon: draw one around the findings.")
    west, south, east, north = shapely.total_bounds(polygons)
    if max(-west, east) > 180 or max(-south, north) > 90:
        raise ConfigError(
            f"The area {path} is not in longitude and latitude: save it as GeoJSON in EPSG:4326 (WGS84)."
        )
    least_lon, least_lat, most_lon, most_lat = NORWAY_DEG
    if east < least_lon or west > most_lon or north < least_lat or south > most_lat:
        raise ConfigError(
            f"The area {path} lies outside Norway, from longitude {west:.2f} to {east:.2f} and latitude "
            f"{south:.2f} to {north:.2f}: GeoJSON has longitude first, then latitude."
        )
    return shapely.union_all([shapely.make_valid(polygon) for polygon in polygons])


def _reopened(row: Row) -> Reopened | Told | None:
    """Why a finding is open again, from the entry that opened it."""
    if row["kind"] != REOPENED:
        return None
    cause = None if row["cause"] is None else cause_from_json(row["cause"])
    # Entries of before causes were kept have their sentence alone.
    return cause if isinstance(cause, Reopened) else Told(row["note"])


def _briefs(ask: Ask) -> list[Brief]:
    change = schema.change.c
    plain = (change.change_id, change.confidence, change.nvdb_type, change.nvdb_id, change.distance_m)
    lists = (change.skiltnummer_nvdb, change.skiltnummer_seen, change.drive_ids)
    rows = ask(findings_statement(*plain, *lists, change.verdict, change.east_m, change.north_m))
    return [
        Brief(
            **{column.name: row[column.name] for column in (*plain, change.east_m, change.north_m)},
            verdict=Verdict(row["verdict"]),
            decision=Decision(row["decision"]),
            skiltnummer_nvdb=split_codes(row["skiltnummer_nvdb"]),
            skiltnummer_seen=split_codes(row["skiltnummer_seen"]),
            drive_ids=tuple(row["drive_ids"].split(",")),
        )
        for row in rows
    ]


def _has_class(finding: Brief, classes: Collection[str]) -> bool:
    codes = (*finding.skiltnummer_seen, *finding.skiltnummer_nvdb)
    # One digit is the whole hundred: 3 for every prohibitory sign.
    beginnings = [c if len(c) == 1 else f"{c}." for c in classes]
    return any(code.strip() in classes or code.strip().startswith(tuple(beginnings)) for code in codes)


def _drives(ask: Ask, wanted: Selection) -> set[str]:
    """Ids of the drives that are named and of the days."""
    drive = schema.drive.c
    rows = ask(sa.select(drive.drive_id, drive.name, drive.started_ns, drive.ended_ns))
    names = {name for row in rows for name in (row["drive_id"], row["name"])}
    if unknown := sorted(set(wanted.drives) - names):
        raise ConfigError(f"The store has no drive {', '.join(unknown)}: `twin drives` lists them.")
    return {
        row["drive_id"]
        for row in rows
        if (not wanted.drives or row["drive_id"] in wanted.drives or row["name"] in wanted.drives)
        and (wanted.since is None or _day(row["ended_ns"]) >= wanted.since)
        and (wanted.until is None or _day(row["started_ns"]) <= wanted.until)
    }


def _day(epoch_ns: int) -> dt.date:
    return dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC).date()


def _inside(area: BaseGeometry, findings: Sequence[Brief]) -> Sequence[bool]:
    import shapely

    from geoloc.earth.geodesy import geographic_from_utm33

    if not findings:
        return []
    east, north = np.array([(finding.east_m, finding.north_m) for finding in findings]).T
    lat, lon = geographic_from_utm33(east, north)
    inside: list[bool] = shapely.intersects_xy(area, lon, lat).tolist()
    return inside
