"""What matching asks of the store's sightings: who was marked in one picture, from where, by which clicks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sqlalchemy as sa

from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from twin.matching.poles.keys import KnownMark, Mark
from twin.matching.poles.same_pole import Picture
from twin.store import schema
from twin.store.records import Estimate, split_codes
from twin.store.sql import rounded
from twin.store.store import Snapshot


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


def clicks_of(view: Snapshot, method: str) -> dict[str, str]:
    """What was clicked for each object, by member: the same clicks are the same object whatever its id is.

    Count and sums of frames and pixels (to the thousandth) tell a drive's objects apart, and depend on
    neither the order nor the rig.
    """
    t = schema.sighting.c
    sums = {"n": sa.func.count(), "frames": sa.func.sum(t.frame)}
    for name in ("u_px", "v_px"):
        sums[name] = sa.func.sum(rounded(t[name] * 1000))
    asked = sa.select(t.drive_id, t.object, *(total.label(name) for name, total in sums.items()))
    rows = view.rows(asked.where(t.method == method).group_by(t.drive_id, t.object))
    return {f"{r['drive_id']}:{r['object']}": ":".join(str(r[name]) for name in sums) for r in rows}


def marks_of(view: Snapshot, estimates: Sequence[Estimate], method: str) -> dict[str, Mark]:
    """Each estimate's mark, by member."""
    clicks = clicks_of(view, method)
    return {
        e.member: Mark(e.drive_id, clicks[e.member], e.east_m, e.north_m, e.codes)
        for e in estimates
        if e.member in clicks
    }


def known_marks(view: Snapshot) -> list[KnownMark]:
    """Every mark of earlier matches, the oldest first."""
    t = schema.known_mark
    return [
        KnownMark(
            Mark(r["drive_id"], r["clicks"], r["east_m"], r["north_m"], split_codes(r["skiltnummer"])),
            r["pole"],
        )
        for r in view.rows(sa.select(t).order_by(t.c.id))
    ]


def seen_from(view: Snapshot, estimates: Sequence[Estimate], method: str) -> dict[str, frozenset[float]]:
    """From which directions each estimate's object was seen, in steps of 30° from true north."""
    t = schema.sighting
    rows = view.rows(
        sa.select(t.c.drive_id, t.c.object, t.c.eye_east_m, t.c.eye_north_m).where(
            t.c.method == method, t.c.rejected == "", t.c.eye_east_m.is_not(None)
        )
    )
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
