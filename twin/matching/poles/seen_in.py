"""What matching asks of the store's sightings: who was marked in one picture, and from where it was seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sqlalchemy as sa

from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from twin.matching.poles.same_pole import Picture
from twin.store import schema
from twin.store.records import Estimate
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
