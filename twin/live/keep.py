"""What is final, in a GeoPackage that is whole at every moment: one transaction a second.

It is written by plain SQL, since rows are added to a file that others may be reading. The journal is a
write-ahead log while the drive goes on, so that QGIS, which reads, stops no writing; at the end all is one
file again.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Thread
from typing import Any, NamedTuple

from twin._version import __version__
from twin.errors import FileError, RefusedError
from twin.live.car_state import KeepState
from twin.live.estimates import Estimate
from twin.live.features import grid_m
from twin.live.lanes import Lanes
from twin.live.ports import Said

EVERY_S = 1.0
_AGAIN_S = 0.1
_EPSG = 25833
_APPLICATION_ID, _VERSION_1_3 = 0x47504B47, 10300
_MOST, _AT_ONCE = 100_000, 5000
_log = logging.getLogger("twin.live")

ESTIMATES: Mapping[str, str] = {
    "state": "TEXT",
    "object": "TEXT",
    "label": "TEXT",
    "skiltnummer": "TEXT",
    "n_sightings": "INTEGER",
    "first_seen": "DATETIME",
    "last_seen": "DATETIME",
    "at": "DATETIME",
    "easting": "REAL",
    "northing": "REAL",
    "height_m": "REAL",
    "sigma_major_m": "REAL",
    "sigma_minor_m": "REAL",
    "sigma_azimuth_deg": "REAL",
    "major95_m": "REAL",
    "minor95_m": "REAL",
    "sigma_east_m": "REAL",
    "sigma_north_m": "REAL",
    "sigma_height_m": "REAL",
}
"""Columns of the layer of final estimates, by the names of their properties in lines."""
VERDICTS: Mapping[str, str] = {
    "verdict": "TEXT",
    "was": "TEXT",
    "final": "BOOLEAN",
    "why": "TEXT",
    "confidence": "REAL",
    "nvdb_type": "INTEGER",
    "nvdb_id": "INTEGER",
    "pole": "TEXT",
    "skiltnummer_seen": "TEXT",
    "skiltnummer_nvdb": "TEXT",
    "distance_m": "REAL",
    "distance_sigma_m": "REAL",
    "first_seen": "DATETIME",
    "at": "DATETIME",
    "easting": "REAL",
    "northing": "REAL",
    "major95_m": "REAL",
    "minor95_m": "REAL",
    "sigma_azimuth_deg": "REAL",
}
"""Columns of the layer of verdicts; `why` is JSON."""
_KEY = ("run", "id")
_LAYERS = {"estimates": ESTIMATES, "verdicts": VERDICTS}
_CORE = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY,
  organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL,
  description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL,
  identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE runs (run INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, source TEXT, began DATETIME NOT NULL,
  ended DATETIME, twin TEXT NOT NULL);
"""
"""As the standard (OGC 12-128r18, annex C) has them; `runs` is ours."""


class Keeper:
    """Writes what is final, from a thread of its own.

    Parameters
    ----------
    path : Path
        A new file, or one of an earlier run, to which this run is added.
    source : str
        What is run, for people.

    Raises
    ------
    RefusedError
        The file is none of these.
    FileError
        It cannot be written.
    """

    def __init__(self, path: Path, source: str) -> None:
        self.path = path
        self._waiting: Lanes[_Row] = Lanes(1, _MOST)
        self._held: list[_Row] = []
        self._until_s = 0.0
        self._failing = False
        try:
            self._database = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=0.5)
            self._run = _began(self._database, path, source)
        except sqlite3.Error as error:
            raise FileError(
                f"{path} cannot be written ({error}): name another file with --keep, in a folder that"
                " is there and that this user may write to."
            ) from error
        self._end = Event()
        self._thread = Thread(target=self._write_all, name="keep", daemon=True)
        self._thread.start()

    @property
    def state(self) -> KeepState:
        """How it does now."""
        waiting = len(self._waiting) + len(self._held)
        return KeepState(self.path.name, self._failing, waiting, self._waiting.lost[0])

    def keep(self, said: Said) -> None:
        """Take what is final; it is in the file a second later."""
        self._waiting.put(_row(said), 0)

    def close(self, within_s: float) -> bool:
        """Write what waits; return whether all is in the file."""
        self._until_s = time.monotonic() + within_s
        self._end.set()
        self._thread.join(within_s)
        return not self._thread.is_alive() and not self.state.waiting

    def _write_all(self) -> None:
        while not self._end.wait(EVERY_S):
            self._write()
        while len(self._waiting) or self._held:
            if not self._write():
                if time.monotonic() > self._until_s:
                    break
                time.sleep(_AGAIN_S)
        with suppress(sqlite3.Error):
            self._database.execute("UPDATE runs SET ended = ? WHERE run = ?", (_now(), self._run))
            self._database.execute("PRAGMA journal_mode=DELETE")
        self._database.close()

    def _write(self) -> bool:
        while len(self._held) < _AT_ONCE and (one := self._waiting.get(0.0)) is not None:
            self._held.append(one)
        if not self._held:
            return True
        try:
            self._database.execute("BEGIN IMMEDIATE")
            for row in self._held:
                self._insert(row)
            self._database.execute("COMMIT")
        except sqlite3.Error as error:
            with suppress(sqlite3.Error):
                self._database.execute("ROLLBACK")
            if not self._failing:
                _log.warning("%s: %s", self.path, error)
            self._failing = True
            return False
        self._held, self._failing = [], False
        return True

    def _insert(self, row: _Row) -> None:
        values = {"run": self._run, **row.values}
        names, marks = ", ".join(values), ", ".join("?" * len(values))
        renewed = ", ".join(f"{name} = excluded.{name}" for name in values if name not in _KEY)
        self._database.execute(
            f"INSERT INTO {row.layer} ({names}) VALUES ({marks}) "  # noqa: S608 - our own names
            f"ON CONFLICT ({', '.join(_KEY)}) DO UPDATE SET {renewed}",
            list(values.values()),
        )
        changed = "UPDATE gpkg_contents SET last_change = ? WHERE table_name = ?"
        self._database.execute(changed, (_now(), row.layer))


class _Row(NamedTuple):
    """A row but for its run."""

    layer: str
    values: dict[str, Any]


def _row(said: Said) -> _Row:
    layer = "estimates" if isinstance(said, Estimate) else "verdicts"
    feature = said.feature()
    about = feature["properties"]
    values = {name: about.get(name) for name in _LAYERS[layer]}
    if isinstance(values.get("why"), dict):
        values["why"] = json.dumps(values["why"], ensure_ascii=False)
    return _Row(layer, {"id": said.id, "geom": _blob(feature["geometry"]), **values})


def _began(database: sqlite3.Connection, path: Path, source: str) -> int:
    """Make the file if it is new, and begin a run in it; return the run's number."""
    if _is_another_s(database):
        database.close()
        raise RefusedError(f"{path} is no file of twin live of this version: name another with --keep.")
    database.execute("PRAGMA journal_mode=WAL")
    # Also after a power cut: a car has no other end.
    database.execute("PRAGMA synchronous=FULL")
    database.execute("BEGIN IMMEDIATE")
    if not _tables(database):
        _make(database)
    cursor = database.execute(
        "INSERT INTO runs (source, began, twin) VALUES (?, ?, ?)", (source, _now(), __version__)
    )
    database.execute("COMMIT")
    assert cursor.lastrowid is not None  # noqa: S101 - of an INSERT
    return cursor.lastrowid


def _tables(database: sqlite3.Connection) -> set[str]:
    return {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def _is_another_s(database: sqlite3.Connection) -> bool:
    """Whether there are tables that are not ours; looks, and changes nothing."""
    tables = _tables(database)
    ours = {"runs", *_LAYERS} <= tables and all(_has_columns(database, name) for name in _LAYERS)
    return bool(tables) and not ours


def _make(database: sqlite3.Connection) -> None:
    from pyproj import CRS

    database.execute(f"PRAGMA application_id={_APPLICATION_ID}")
    database.execute(f"PRAGMA user_version={_VERSION_1_3}")
    for statement in _CORE.split(";"):
        database.execute(statement)
    grid = CRS.from_epsg(_EPSG)
    wgs84 = CRS.from_epsg(4326)
    database.executemany(
        "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, NULL)",
        [
            ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined"),
            ("Undefined geographic SRS", 0, "NONE", 0, "undefined"),
            (wgs84.name, 4326, "EPSG", 4326, wgs84.to_wkt("WKT1_GDAL")),
            (grid.name, _EPSG, "EPSG", _EPSG, grid.to_wkt("WKT1_GDAL")),
        ],
    )
    for name, columns in _LAYERS.items():
        declared = ", ".join(f"{column} {kind}" for column, kind in columns.items())
        database.execute(
            f"CREATE TABLE {name} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT, "
            f"run INTEGER NOT NULL, id TEXT NOT NULL, {declared}, UNIQUE ({', '.join(_KEY)}))"
        )
        _contents(database, name, "features", _EPSG)
        database.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POINT', ?, 0, 0)", (name, _EPSG)
        )
    _contents(database, "runs", "attributes", None)


def _contents(database: sqlite3.Connection, name: str, kind: str, srs: int | None) -> None:
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES (?, ?, ?, ?)",
        (name, kind, name, srs),
    )


def _has_columns(database: sqlite3.Connection, layer: str) -> bool:
    found = {row[1] for row in database.execute(f"PRAGMA table_info({layer})")}
    return {"geom", *_KEY, *_LAYERS[layer]} <= found


def _blob(geometry: dict[str, Any] | None) -> bytes | None:
    """A GeoJSON point as GeoPackage has it, in EPSG:25833: its header without an envelope, and WKB."""
    if geometry is None:
        return None
    longitude, latitude = geometry["coordinates"][:2]
    point = struct.pack("<BIdd", 1, 1, *grid_m(latitude, longitude))
    return struct.pack("<2sBBi", b"GP", 0, 1, _EPSG) + point


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
