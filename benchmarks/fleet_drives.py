"""Short simulated drives for a fleet, and what a store holds of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.samples.write_drive import write_driveworks_trip
from twin.store import schema
from twin.store.store import Store

RESULTS = (schema.drive, schema.drive_method, schema.sighting, schema.estimate)


def drives(folder: Path, n: int, minutes: float | None = None) -> list[str]:
    """Write so many different drives, and return their folders: past one sign, or for so long in town."""
    made = []
    for seed in range(n):
        road = scenario("approach") if minutes is None else scenario("urban", seed=seed, minutes=minutes)
        made.append(folder / f"drive{seed}")
        write_driveworks_trip(simulate_drive(road, seed), made[-1])
    return [str(path) for path in made]


def held(store: Store) -> dict[str, list[Any]]:
    """Return every row that came of drives, in an order of its own, as one moment has them."""
    with store.snapshot() as view:
        return {
            table.name: [
                tuple(row.values()) for row in view.rows(sa.select(table).order_by(*table.primary_key))
            ]
            for table in RESULTS
        }


def differing(found: Mapping[str, list[Any]], whole: Mapping[str, list[Any]], *, complete: bool) -> list[str]:
    """Name the tables whose rows are not those of whole drives, or of all of them where that is asked for."""
    ids = {row[0] for row in found["drive"]}
    wrong = []
    for name, rows in whole.items():
        at = list(schema.metadata.tables[name].columns.keys()).index("drive_id")
        expected = rows if complete else [row for row in rows if row[at] in ids]
        if found[name] != expected:
            wrong.append(name)
    return wrong
