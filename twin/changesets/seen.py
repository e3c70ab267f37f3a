"""What the drives saw of a finding: where it stands, on which day, in which pictures."""

from __future__ import annotations

import datetime as dt
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from geoloc.geodesy import geographic_from_utm33
from geoloc.heights import nn2000_from_ellipsoidal
from nvdb.endringssett import Measured
from twin import schema
from twin.store import Snapshot

Row = Mapping[str, Any]

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
    """

    drives: tuple[Row, ...]
    estimates: tuple[Row, ...]
    frames: Mapping[str, Mapping[str, list[int]]]

    @property
    def first_day(self) -> dt.date:
        """Day (UTC) of the first drive."""
        return _day(self.drives[0]["started_ns"])

    @property
    def last_day(self) -> dt.date:
        """Day (UTC) of the last drive."""
        return _day(self.drives[-1]["started_ns"])


def seen_of(view: Snapshot, findings: Sequence[Row], method: str) -> dict[str, Seen]:
    """Gather what findings rest on, by ``change_id``.

    Parameters
    ----------
    view : Snapshot
    findings : rows of the ``change`` table
    method : str
        Whose estimates were matched.
    """
    wanted = {drive_id for row in findings for drive_id in row["drive_ids"].split(",")}
    drives = _asked(view, schema.drive, _DRIVE, schema.drive.c.drive_id, wanted)
    drives.sort(key=lambda row: (row["started_ns"], row["drive_id"]))
    estimates = [
        row
        for row in _asked(view, schema.estimate, _ESTIMATE, schema.estimate.c.drive_id, wanted, method)
        if math.isfinite(row["east_m"])
    ]
    keys = {row["member"]: row["pole"] for row in view.rows(sa.select(schema.pole_key))}
    poles = {row["change_id"]: _of_the_pole(row, estimates, keys) for row in findings}
    frames = _frames(view, {_member(e) for pole in poles.values() for e in pole}, method)
    return {
        row["change_id"]: Seen(
            tuple(drive for drive in drives if drive["drive_id"] in row["drive_ids"].split(",")),
            tuple(poles[row["change_id"]]),
            _together(frames, poles[row["change_id"]]),
        )
        for row in findings
    }


def measured_position(finding: Row, seen: Seen) -> Measured:
    """Where a finding's pole stands, in the words of a change set.

    The standard deviation in plan is √(σE² + σN²). The height is NN2000 of the estimate that knows it best;
    there is none where the method gives no standard deviation of it, or the geoid model is not installed.
    """
    height_m, std_height_m = _height(seen.estimates)
    return Measured(
        east_m=finding["east_m"],
        north_m=finding["north_m"],
        std_m=math.sqrt(finding["cov_ee_m2"] + finding["cov_nn_m2"]),
        captured=seen.last_day,
        height_m=height_m,
        std_height_m=std_height_m,
    )


def _height(estimates: Sequence[Row]) -> tuple[float | None, float | None]:
    known = [row for row in estimates if row["sigma_height_m"] and math.isfinite(row["height_m"])]
    if not known:
        return None, None
    best = min(known, key=lambda row: (row["sigma_height_m"], row["estimate_id"]))
    latitude, longitude = geographic_from_utm33(best["east_m"], best["north_m"])
    heights = nn2000_from_ellipsoidal(latitude, longitude, best["height_m"])
    height_m = float(heights.height_m)
    if not math.isfinite(height_m):
        return None, None
    return height_m, math.hypot(best["sigma_height_m"], heights.sigma_m)


def _of_the_pole(finding: Row, estimates: Sequence[Row], keys: Mapping[str, str]) -> list[Row]:
    """Estimates that were fused to the pole of a finding: the nearest one says which pole that is."""
    drives = set(finding["drive_ids"].split(","))
    own = [row for row in estimates if row["drive_id"] in drives and _member(row) in keys]
    if not own or not finding["n_sightings"]:
        return []
    nearest = min(own, key=lambda e: math.dist(_place(e), _place(finding)))
    pole = keys[_member(nearest)]
    return sorted((e for e in own if keys[_member(e)] == pole), key=lambda e: str(e["estimate_id"]))


def _place(row: Row) -> tuple[float, float]:
    return row["east_m"], row["north_m"]


def _member(estimate: Row) -> str:
    return f"{estimate['drive_id']}:{estimate['object']}"


def _frames(view: Snapshot, members: Iterable[str], method: str) -> dict[tuple[str, str], list[Row]]:
    """Located sightings by drive and object."""
    t = schema.sighting
    member = t.c.drive_id + ":" + t.c.object
    rows = view.rows(
        sa.select(t.c.drive_id, t.c.object, t.c.camera, t.c.frame)
        .where(t.c.method == method, t.c.rejected == "", member.in_(_values(members)))
        .order_by(t.c.drive_id, t.c.camera, t.c.frame)
    )
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["drive_id"], row["object"]), []).append(row)
    return found


def _together(
    frames: Mapping[tuple[str, str], Sequence[Row]], estimates: Sequence[Row]
) -> dict[str, dict[str, list[int]]]:
    found: dict[str, dict[str, set[int]]] = {}
    for estimate in estimates:
        for row in frames.get((estimate["drive_id"], estimate["object"]), ()):
            found.setdefault(row["drive_id"], {}).setdefault(row["camera"], set()).add(row["frame"])
    return {
        drive: {camera: sorted(numbers) for camera, numbers in sorted(cameras.items())}
        for drive, cameras in sorted(found.items())
    }


def _asked(
    view: Snapshot,
    table: sa.Table,
    names: Sequence[str],
    key: sa.Column[Any],
    wanted: Iterable[str],
    method: str | None = None,
) -> list[Row]:
    statement = sa.select(*(table.c[name] for name in names)).where(key.in_(_values(wanted)))
    return view.rows(statement if method is None else statement.where(table.c.method == method))


def _values(texts: Iterable[str]) -> sa.Select[tuple[str]]:
    """Any number of texts as one parameter."""
    return sa.select(sa.func.json_each(json.dumps(sorted(texts))).table_valued("value").c.value)


def _day(epoch_ns: int) -> dt.date:
    return dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC).date()
