"""Whether sightings would be read or written faster if PostgreSQL kept them by area.

Usage: python benchmarks/partitions.py

Sightings of 200 drives past 330 signs, ten each, in five towns side by side: in one table with an index of
places (GiST), in 16 partitions by easting with the same index, and in one table in the order of places with
an index of ranges (BRIN). Milliseconds in the server, median of seven: reading what stands within 1.2 km,
reading three drives, writing a drive's rows and taking them away again.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

import psycopg

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from postgres_server import running

from twin.cli.output import print_table
from twin.store.address import StoreAddress

_MADE = """
CREATE TABLE one AS SELECT 'D' || d AS drive_id, o * 10 + k AS number, (d / 40) * 6000 + random() * 5000
  AS east_m, 7040000 + random() * 5000 AS north_m, random() AS u_px, repeat('x', 80) AS rest
  FROM generate_series(0, 199) AS d, generate_series(1, 330) AS o, generate_series(1, 10) AS k;
ALTER TABLE one ADD PRIMARY KEY (drive_id, number);
CREATE INDEX ON one USING gist (ST_MakePoint(east_m, north_m));
CREATE TABLE parted (LIKE one) PARTITION BY RANGE (east_m);
"""
_FILLED = """
INSERT INTO parted SELECT * FROM one;
ALTER TABLE parted ADD PRIMARY KEY (drive_id, number, east_m);
CREATE INDEX ON parted USING gist (ST_MakePoint(east_m, north_m));
CREATE TABLE ranged AS SELECT * FROM one ORDER BY east_m, north_m;
ALTER TABLE ranged ADD PRIMARY KEY (drive_id, number);
CREATE INDEX ON ranged USING brin (east_m, north_m);
"""
_BOX = "east_m BETWEEN 12000 AND 13200 AND north_m BETWEEN 7042000 AND 7043200"
_PLACES = "ST_MakePoint(east_m, north_m) && ST_MakeEnvelope(12000, 7042000, 13200, 7043200)"
_WHERE = {"one": _PLACES, "parted": f"{_PLACES} AND {_BOX}", "ranged": _BOX}
_OF_DRIVES = "drive_id IN ('D70', 'D71', 'D72')"
ROUNDS = 7


def read_ms(connection: psycopg.Connection, table: str, where: str) -> float:
    """What the server takes to plan and to run a query."""
    took: list[float] = []
    for _ in range(ROUNDS):
        asked = f"EXPLAIN (ANALYZE, TIMING OFF, FORMAT JSON) SELECT sum(u_px) FROM {table} WHERE {where}"
        row = connection.execute(asked).fetchone()
        assert row is not None
        (said,) = row[0]
        took.append(said["Planning Time"] + said["Execution Time"])
    return statistics.median(took)


def write_ms(connection: psycopg.Connection, table: str) -> float:
    """What it takes to write a drive's rows, and to take them away."""
    took = []
    for number in range(ROUNDS):
        start = time.perf_counter()
        for statement in (
            (
                f"INSERT INTO {table} SELECT 'N{number}', number, east_m, north_m, u_px, rest FROM one "
                "WHERE drive_id = 'D70'"
            ),
            f"DELETE FROM {table} WHERE drive_id = 'N{number}'",
        ):
            connection.execute(statement)
        took.append(1e3 * (time.perf_counter() - start))
    return statistics.median(took)


def main() -> None:
    """Print the table."""
    with running() as server:
        url = StoreAddress(server.new("postgis")).connected()
        host, name = str(url.query["host"]), url.database
        with psycopg.connect(host=host, dbname=name, user="postgres", autocommit=True) as connection:
            connection.execute(_MADE)
            for k in range(16):
                bounds = f"FROM ({k * 2048}) TO ({(k + 1) * 2048})"
                connection.execute(f"CREATE TABLE parted_{k} PARTITION OF parted FOR VALUES {bounds}")
            connection.execute(_FILLED)
            connection.execute("VACUUM ANALYZE")
            rows = [
                [
                    table,
                    f"{read_ms(connection, table, where):.1f}",
                    f"{read_ms(connection, table, _OF_DRIVES):.1f}",
                    f"{write_ms(connection, table):.0f}",
                ]
                for table, where in _WHERE.items()
            ]
    columns = ["table", "places [ms]", "three drives [ms]", "a drive written [ms]"]
    print_table("660,000 sightings of 200 drives", columns, rows, right_from=1)


if __name__ == "__main__":
    main()
