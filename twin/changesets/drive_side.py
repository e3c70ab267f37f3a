"""What the drives saw of a finding: where it stands, on which day, in which pictures."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.earth.heights import nn2000_from_ellipsoidal
from nvdb.endringssett import Measured
from nvdb.errors import RequestError
from twin.store import schema
from twin.store.records import Finding
from twin.store.sql import each_text
from twin.store.store import Row, Snapshot

_ESTIMATE = ("estimate_id", "drive_id", "object", "east_m", "north_m", "height_m", "sigma_height_m")
_DRIVE = ("drive_id", "name", "started_ns", "ended_ns", "content_sha256", "software")


@dataclass(frozen=True, slots=True)
class Seen:
    """What a finding rests on.

    Attributes
    ----------
    drives : tuple of mapping
        In time order: ``drive_id, name, started_ns, ended_ns, content_sha256, software``.
    estimates : tuple of mapping
        Of the pole, in the order of their ids; empty for what was not seen.
    frames : mapping of drive → camera → frame numbers, ascending
    face_deg : float or None
        Azimuth from grid north, from the pole to the cameras that saw it: which way its face looks. None
        where it was seen from both sides, or the method does not tell where the cameras were.
    """

    drives: tuple[Row, ...]
    estimates: tuple[Row, ...]
    frames: Mapping[str, Mapping[str, list[int]]]
    face_deg: float | None = None

    @property
    def first_day(self) -> dt.date:
        """Day (UTC) of the first drive."""
        return _day(self.drives[0]["started_ns"])

    @property
    def last_day(self) -> dt.date:
        """Day (UTC) of the last drive."""
        return _day(self.drives[-1]["started_ns"])


def seen_of(view: Snapshot, findings: Sequence[Finding], method: str) -> dict[str, Seen]:
    """Gather what findings rest on, by ``change_id``.

    Parameters
    ----------
    view : Snapshot
    findings : sequence of Finding
    method : str
        Whose estimates were matched.
    """
    wanted = {drive_id for finding in findings for drive_id in finding.drive_ids}
    drives = _asked(view, schema.drive, _DRIVE, schema.drive.c.drive_id, wanted)
    drives.sort(key=lambda row: (row["started_ns"], row["drive_id"]))
    estimates = [
        row
        for row in _asked(view, schema.estimate, _ESTIMATE, schema.estimate.c.drive_id, wanted, method)
        if math.isfinite(row["east_m"])
    ]
    keys = {row["member"]: row["pole"] for row in view.rows(sa.select(schema.pole_key))}
    members = _by_pole(estimates, keys)
    poles = {one.change_id: members.get(one.terms.get("pole"), []) for one in findings}
    sightings = _sightings(view, {_member(e) for pole in poles.values() for e in pole}, method)
    return {
        one.change_id: Seen(
            tuple(drive for drive in drives if drive["drive_id"] in one.drive_ids),
            tuple(poles[one.change_id]),
            _frames(sightings, poles[one.change_id]),
            _face_deg(sightings, poles[one.change_id]),
        )
        for one in findings
    }


def measured_position(finding: Finding, seen: Seen) -> Measured:
    """Where a finding's pole stands, in the words of a change set.

    The height is NN2000 of the estimate that knows it best;
    there is none where the method gives no standard deviation of it, or the geoid model is not installed.
    """
    height = height_of(seen)
    return Measured(
        east_m=finding.east_m,
        north_m=finding.north_m,
        std_m=std_in_plan_m(finding),
        captured=seen.last_day,
        height_m=height.height_m,
        std_height_m=height.std_m,
    )


def std_in_plan_m(finding: Finding) -> float:
    """Standard deviation in plan of a measured position, √(σE² + σN²).

    Raises
    ------
    RequestError
        Nothing was measured.
    """
    if finding.covariance_m2 is None:
        raise RequestError("it has no measured position: run `twin match` again")
    east_m2, _, north_m2 = finding.covariance_m2
    return math.sqrt(east_m2 + north_m2)


@dataclass(frozen=True, slots=True)
class Height:
    """Height of a pole's foot in NN2000 and its standard deviation; None where unknown. `how`: a sentence."""

    height_m: float | None
    std_m: float | None
    how: str


def height_of(seen: Seen) -> Height:
    """NN2000 by the estimate that knows its height best."""
    known = [row for row in seen.estimates if row["sigma_height_m"] and math.isfinite(row["height_m"])]
    if not known:
        return Height(None, None, "No height: the method does not say how well it knows heights.")
    best = min(known, key=lambda row: (row["sigma_height_m"], row["estimate_id"]))
    latitude, longitude = geographic_from_utm33(best["east_m"], best["north_m"])
    heights = nn2000_from_ellipsoidal(latitude, longitude, best["height_m"])
    height_m = float(heights.height_m)
    if math.isfinite(height_m):
        return Height(height_m, math.hypot(best["sigma_height_m"], heights.sigma_m), heights.how)
    installed = math.isfinite(heights.sigma_m)
    return Height(None, None, "No height: outside the geoid model." if installed else heights.how)


def _by_pole(estimates: Iterable[Row], keys: Mapping[str, str]) -> dict[str | None, list[Row]]:
    """Estimates that were fused to each pole, in the order of their ids."""
    found: dict[str | None, list[Row]] = {}
    for row in sorted(estimates, key=lambda e: str(e["estimate_id"])):
        if (pole := keys.get(_member(row))) is not None:
            found.setdefault(pole, []).append(row)
    return found


def _member(estimate: Row) -> str:
    return f"{estimate['drive_id']}:{estimate['object']}"


def _sightings(view: Snapshot, members: Iterable[str], method: str) -> dict[tuple[str, str], list[Row]]:
    """Located sightings by drive and object."""
    t = schema.sighting
    member = t.c.drive_id + ":" + t.c.object
    rows = view.rows(
        sa.select(t.c.drive_id, t.c.object, t.c.camera, t.c.frame, t.c.eye_east_m, t.c.eye_north_m)
        .where(t.c.method == method, t.c.rejected == "", member.in_(each_text(members)))
        .order_by(t.c.drive_id, t.c.camera, t.c.frame, t.c.number)
    )
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["drive_id"], row["object"]), []).append(row)
    return found


def _frames(
    sightings: Mapping[tuple[str, str], Sequence[Row]], estimates: Sequence[Row]
) -> dict[str, dict[str, list[int]]]:
    found: dict[str, dict[str, set[int]]] = {}
    for estimate in estimates:
        for row in sightings.get((estimate["drive_id"], estimate["object"]), ()):
            found.setdefault(row["drive_id"], {}).setdefault(row["camera"], set()).add(row["frame"])
    return {
        drive: {camera: sorted(numbers) for camera, numbers in sorted(cameras.items())}
        for drive, cameras in sorted(found.items())
    }


_ONE_SIDE = 0.5
"""Length of the mean of unit vectors: 1 from one point, 0.64 from a half circle, 0 from both sides alike."""


def _face_deg(sightings: Mapping[tuple[str, str], Sequence[Row]], estimates: Sequence[Row]) -> float | None:
    """Mean direction from the pole to the cameras, from grid north; None where there is none."""
    directions = [
        math.atan2(row["eye_east_m"] - estimate["east_m"], row["eye_north_m"] - estimate["north_m"])
        for estimate in estimates
        for row in sightings.get((estimate["drive_id"], estimate["object"]), ())
        if row["eye_east_m"] is not None
    ]
    if not directions:
        return None
    east = math.fsum(map(math.sin, directions)) / len(directions)
    north = math.fsum(map(math.cos, directions)) / len(directions)
    return math.degrees(math.atan2(east, north)) % 360.0 if math.hypot(east, north) >= _ONE_SIDE else None


def _asked(
    view: Snapshot,
    table: sa.Table,
    names: Sequence[str],
    key: sa.Column[Any],
    wanted: Iterable[str],
    method: str | None = None,
) -> list[Row]:
    statement = sa.select(*(table.c[name] for name in names)).where(key.in_(each_text(sorted(wanted))))
    return view.rows(statement if method is None else statement.where(table.c.method == method))


def _day(epoch_ns: int) -> dt.date:
    return dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC).date()
