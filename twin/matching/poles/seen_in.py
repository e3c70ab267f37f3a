"""What matching asks of the store's sightings: who was marked in one picture, from where, by which clicks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from twin.matching.cells import CELL_M, are_among, cells_of
from twin.matching.poles.keys import KnownMark, Mark
from twin.matching.poles.same_pole import Picture
from twin.matching.reading import rows_of_drives
from twin.store import schema
from twin.store.records import Estimate, split_codes
from twin.store.sql import each_text, rounded
from twin.store.store import Row, Snapshot


def pictures_of(
    view: Snapshot, pairs: Sequence[tuple[str, str]], method: str
) -> dict[str, frozenset[Picture]]:
    """In which pictures the objects of pairs were marked, be it by interpolation, and as what."""
    t = schema.sighting
    wanted = {tuple(member.split(":", 1)) for pair in pairs for member in pair}
    found: dict[str, set[Picture]] = {}
    for drive_id in sorted({drive_id for drive_id, _ in wanted}):
        is_there = (t.c.rejected == "") | ~t.c.is_measured
        mine = (t.c.drive_id == drive_id, t.c.method == method, is_there)
        for row in view.rows(sa.select(t.c.object, t.c.camera, t.c.frame, t.c.kind).where(*mine)):
            if (drive_id, row["object"]) in wanted:
                picture = row["camera"], row["frame"], row["kind"]
                found.setdefault(f"{drive_id}:{row['object']}", set()).add(picture)
    return {member: frozenset(pictures) for member, pictures in found.items()}


def clicks_of(view: Snapshot, method: str, only: Collection[str] | None = None) -> dict[str, dict[str, str]]:
    """What was clicked for each object, by drive and object: the same clicks are the same object.

    Count and sums of frames and pixels (to the thousandth) tell a drive's objects apart, and depend on
    neither the order nor the rig, nor on an object's id.

    Parameters
    ----------
    only : collection of str, optional
        Drives of these ids.
    """
    t = schema.sighting.c
    sums = {"n": sa.func.count(), "frames": sa.func.sum(t.frame)}
    for name in ("u_px", "v_px"):
        sums[name] = sa.func.sum(rounded(t[name] * 1000))
    asked = sa.select(t.drive_id, t.object, *(total.label(name) for name, total in sums.items()))
    asked = asked.where(t.method == method).group_by(t.drive_id, t.object)
    found: dict[str, dict[str, str]] = {}
    for row in rows_of_drives(view, asked, t.drive_id, only):
        said = ":".join(str(row[name]) for name in sums)
        found.setdefault(row["drive_id"], {})[row["object"]] = said
    return found


def marks_of(estimates: Sequence[Estimate], clicks: Mapping[str, Mapping[str, str]]) -> dict[str, Mark]:
    """Each estimate's mark, by member; `clicks` by drive and object."""
    return {
        e.member: Mark(e.drive_id, clicks[e.drive_id][e.object], e.east_m, e.north_m, e.codes)
        for e in estimates
        if clicks.get(e.drive_id, {}).get(e.object)
    }


def known_marks(view: Snapshot) -> list[KnownMark]:
    """Every mark of earlier matches, the oldest first."""
    columns = view.columns(_MARKS.order_by(schema.known_mark.c.id))
    return [_known(*row) for row in zip(*(columns[name] for name in _COLUMNS[1:]), strict=True)]


def known_marks_about(
    view: Snapshot,
    clicked: Set[tuple[str, str]],
    drives: Collection[str],
    about: IntArray,
    place_m: FloatArray,
) -> list[KnownMark]:
    """Marks of earlier matches that can be of some poles, the oldest first.

    Parameters
    ----------
    clicked : set of (drive, clicks)
        Marks of these are wanted wherever they are.
    drives : collection of str
        Of these, and of others that went, which have a mark there.
    about : int64 (n,)
        Cells in which marks are wanted, sorted.
    place_m : float64 (m, 2)
        Of the poles.
    """
    t = schema.known_mark.c
    (west, south), (east, north) = place_m.min(axis=0) - CELL_M, place_m.max(axis=0) + CELL_M
    box = t.east_m.between(float(west), float(east)) & t.north_m.between(float(south), float(north))
    mine, others = t.drive_id.in_(each_text(sorted(drives))), t.drive_id.not_in(each_text(sorted(drives)))
    found: list[KnownMark] = []
    numbers: list[int] = []
    for asked in (_MARKS.where(mine), _MARKS.where(box, others)):
        columns = view.columns(asked)
        place = np.array([columns["east_m"], columns["north_m"]], dtype=np.float64).T
        near = are_among(cells_of(place), about).tolist()
        for is_near, number, *row in zip(near, *(columns[name] for name in _COLUMNS), strict=True):
            if is_near or (row[0], row[1]) in clicked:
                numbers.append(number)
                found.append(_known(*row))
    return [found[k] for k in np.argsort(np.array(numbers, dtype=np.int64)).tolist()]


def marks_named(view: Snapshot, names: Set[tuple[str, str, str]]) -> dict[tuple[str, str, str], Row]:
    """Rows of marks by drive, clicks and pole."""
    t = schema.known_mark.c
    rows = rows_of_drives(view, _MARKS, t.drive_id, {drive_id for drive_id, _, _ in names})
    found = {(row["drive_id"], row["clicks"], row["pole"]): row for row in rows}
    return {name: row for name, row in found.items() if name in names}


_COLUMNS = ("id", "drive_id", "clicks", "pole", "east_m", "north_m", "skiltnummer")
_MARKS = sa.select(*(schema.known_mark.c[name] for name in _COLUMNS))


def _known(
    drive_id: str, clicks: str, pole: str, east_m: float, north_m: float, skiltnummer: str
) -> KnownMark:
    return KnownMark(Mark(drive_id, clicks, east_m, north_m, split_codes(skiltnummer)), pole)


def ever_used(view: Snapshot, keys: Collection[str]) -> set[str]:
    """Which keys some pole of an earlier match had."""
    t = schema.known_mark.c
    asked = sa.select(t.pole).distinct()
    return {row["pole"] for row in rows_of_drives(view, asked, t.pole, keys)}


def keys_held(view: Snapshot, members: Collection[str]) -> dict[str, str]:
    """Key of the pole that each of these estimates belonged to at the last match, by member."""
    t = schema.pole_key.c
    rows = rows_of_drives(view, sa.select(t.member, t.pole), t.member, members)
    return {row["member"]: row["pole"] for row in rows}


def holders_of(view: Snapshot, keys: Collection[str]) -> list[tuple[str, str]]:
    """Members of the poles that had these keys at the last match, each with its key."""
    t = schema.pole_key.c
    rows = rows_of_drives(view, sa.select(t.member, t.pole), t.pole, keys)
    return [(row["member"], row["pole"]) for row in rows]


def seen_from(
    view: Snapshot, estimates: Sequence[Estimate], method: str, only: Collection[str] | None = None
) -> dict[str, frozenset[float]]:
    """From which directions each estimate's object was seen, in steps of 30° from true north."""
    t = schema.sighting
    asked = sa.select(t.c.drive_id, t.c.object, t.c.eye_east_m, t.c.eye_north_m).where(
        t.c.method == method, t.c.rejected == "", t.c.eye_east_m.is_not(None)
    )
    rows = rows_of_drives(view, asked, t.c.drive_id, only)
    foot = {(e.drive_id, e.object): (e.east_m, e.north_m) for e in estimates}
    kept = [row for row in rows if (row["drive_id"], row["object"]) in foot]
    if not kept:
        return {}
    eye = np.array([(row["eye_east_m"], row["eye_north_m"]) for row in kept])
    place = np.array([foot[row["drive_id"], row["object"]] for row in kept])
    east, north = (eye - place).T
    turn = grid_convergence_deg(*geographic_from_utm33(*place.T))
    azimuth = np.round((np.rad2deg(np.arctan2(east, north)) + turn) / _STEP_DEG) * _STEP_DEG % 360.0
    found: dict[str, set[float]] = {}
    for row, degrees in zip(kept, azimuth.tolist(), strict=True):
        found.setdefault(f"{row['drive_id']}:{row['object']}", set()).add(degrees)
    return {member: frozenset(directions) for member, directions in found.items()}


_STEP_DEG = 30.0


def bits_of(directions: Collection[float]) -> int:
    """Directions as one number."""
    return sum(1 << round(degrees / _STEP_DEG) for degrees in directions)


def directions_from(bits: int) -> frozenset[float]:
    """Inverse of :func:`bits_of`."""
    return frozenset(k * _STEP_DEG for k in range(round(360.0 / _STEP_DEG)) if bits >> k & 1)
