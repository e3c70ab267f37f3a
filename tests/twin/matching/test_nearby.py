"""The part of the mirror that is read for matching."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import sqlalchemy as sa

from twin.matching.config import MatchConfig
from twin.matching.sites import mirror_near
from twin.store import schema
from twin.store.store import Store

OBJECT: dict[str, Any] = {
    "own_geometry": True,
    "kommuner": [],
    "stedfesting": [],
    "problems": [],
    "raw": b"",
    "synced_at": "2026-06-10T08:00:00Z",
}


def point(nvdb_id: int, east: float | None, *plate_ids: int, north: float = 0.0) -> dict[str, Any]:
    """Make a row of Skiltpunkt."""
    return {"nvdb_id": nvdb_id, "east_m": east, "north_m": north, "plate_ids": list(plate_ids), **OBJECT}


def plate(nvdb_id: int, east: float | None, point_id: int | None, north: float = 0.0) -> dict[str, Any]:
    """Make a row of Skiltplate."""
    return {"nvdb_id": nvdb_id, "east_m": east, "north_m": north, "point_id": point_id, **OBJECT}


def near(
    tmp_path: Path, points: list[dict[str, Any]], plates: list[dict[str, Any]], *places: tuple[float, float]
) -> tuple[list[int], list[int]]:
    """Ids of what is near the places."""
    with Store.open(tmp_path / "twin.db") as store:
        with store.transaction() as connection:
            connection.execute(sa.insert(schema.skiltpunkt), points)
            if plates:
                connection.execute(sa.insert(schema.skiltplate), plates)
        with store.snapshot() as view:
            found = mirror_near(view, np.array(places, dtype=float).reshape(-1, 2), MatchConfig())
    return tuple(sorted(row["nvdb_id"] for row in rows) for rows in found)


def test_mirror_near_has_everything_within_the_distance(tmp_path: Path) -> None:
    """Of random signs about the origin of the grid, those within 1000 m of a place are read, no far one."""
    rng = np.random.default_rng(1)
    place = rng.uniform(-6000, 6000, (400, 2))
    points = [point(k + 1, *xy[:1], north=xy[1]) for k, xy in enumerate(place.tolist())]
    asked = (-30.0, 20.0), (2500.0, -3100.0)
    found, _ = near(tmp_path, points, [], *asked)
    distance = np.min([np.hypot(*(place - np.array(one)).T) for one in asked], axis=0)
    ids = np.arange(1, 401)
    assert set(ids[distance <= 1000.0]) <= set(found)
    assert not set(found) & set(ids[distance > 3000.0])


def test_mirror_near_keeps_families_together(tmp_path: Path) -> None:
    """A plate comes with its point and a point with its plates, whichever of them has a position near."""
    points = [point(1, 10.0, 11), point(2, None), point(3, 90_000.0, 31)]
    plates = [plate(11, None, None), plate(21, 20.0, 2), plate(31, 90_000.0, 3)]
    assert near(tmp_path, points, plates, (0.0, 0.0)) == ([1, 2], [11, 21])


def test_mirror_near_nothing_is_nothing(tmp_path: Path) -> None:
    """Without a place nothing is read."""
    assert near(tmp_path, [point(1, 10.0)], []) == ([], [])
