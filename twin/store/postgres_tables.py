"""What a store has in PostgreSQL alone: positions as PostGIS keeps them, and logs that refuse changes."""

from __future__ import annotations

from collections.abc import Iterator

from twin.store import schema

SCHEMA = "twin"
"""Every table of a store is in it: what else a database holds is somebody else's."""
POSTGIS = "CREATE EXTENSION IF NOT EXISTS postgis"
EPSG = 25833
LOCKS = int.from_bytes(b"twin")
"""First number of every advisory lock of twin."""
WRITER = 0
"""Second number of the lock that a writer holds until its transaction ends; of tasks it is a hash."""

POINTS = (
    schema.skiltpunkt,
    schema.skiltplate,
    schema.estimate,
    schema.change,
)
LINES = ((schema.drive, "line", "LineString"), (schema.veglenke, "geometri", "LineStringZ"))
"""Tables with a line as WKB: its column, and what it holds."""
GEOMETRY = "geom"
"""Column of the tables above: made by the database from their own, so that it is never out of date."""

_NEVER = """
CREATE FUNCTION never_changed() RETURNS trigger LANGUAGE plpgsql AS
$$ BEGIN RAISE EXCEPTION USING MESSAGE = TG_ARGV[0]; END $$
"""
LOGS = (
    (schema.decision_log, "decisions are never changed or deleted"),
    (schema.crop_log, "the log of crops is never changed"),
)


def rules() -> Iterator[str]:
    """Yield what is made after the tables."""
    for table in POINTS:
        point = f"ST_SetSRID(ST_MakePoint(east_m, north_m), {EPSG})"
        yield from _geometry(table.name, "Point", point)
    for table, column, kind in LINES:
        force = "ST_Force3D" if kind.endswith("Z") else "ST_Force2D"
        line = f"{force}(ST_GeomFromWKB({column}, {EPSG}))"
        yield from _geometry(table.name, kind, f"CASE WHEN length({column}) > 0 THEN {line} END")
    yield _NEVER
    for table, said in LOGS:
        does = f"EXECUTE FUNCTION never_changed('{said}')"
        yield (
            f"CREATE TRIGGER {table.name}_keeps BEFORE UPDATE OR DELETE ON {table.name} FOR EACH ROW {does}"
        )
        yield f"CREATE TRIGGER {table.name}_stays BEFORE TRUNCATE ON {table.name} FOR EACH STATEMENT {does}"


def _geometry(table: str, kind: str, made: str) -> Iterator[str]:
    # Stored: of one that is worked out when asked for an index is not used.
    column = f"{GEOMETRY} geometry({kind}, {EPSG}) GENERATED ALWAYS AS ({made}) STORED"
    yield f"ALTER TABLE {table} ADD COLUMN {column}"
    yield f"CREATE INDEX ix_{table}_{GEOMETRY} ON {table} USING gist ({GEOMETRY})"
