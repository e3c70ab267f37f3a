"""Edits of an exported GeoPackage as QGIS makes them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path


@contextmanager
def opened_as_qgis_does(path: Path) -> Iterator[sqlite3.Connection]:
    """The file, with the functions that GeoPackage's triggers call: QGIS and GDAL bring them along."""
    with closing(sqlite3.connect(path)) as database:
        for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):
            database.create_function(name, 1, lambda _: 0)
        yield database
        database.commit()


def decide_in_qgis(path: Path, change_id: str, decision: str | None, **texts: str | None) -> None:
    """Decide in a row of the layer of changes; `texts` are its ``comment`` and ``author``."""
    with opened_as_qgis_does(path) as database:
        for column, value in {"decision": decision, **texts}.items():
            database.execute(f"UPDATE changes SET {column} = ? WHERE change_id = ?", (value, change_id))
