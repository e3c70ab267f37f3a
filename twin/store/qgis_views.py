"""The live layers for QGIS: views over a store in PostgreSQL, in a schema of their own.

They have the names and columns of the exported layers, so that the styles fit both. A decision that somebody
sets in ``changes`` is added to the log as `twin.decisions.record.decide` would, in the name of the login.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from twin.store.kinds import Decision
from twin.store.postgres_tables import GEOMETRY, LOCKS, SCHEMA, WRITER

QGIS_SCHEMA = "twin_qgis"
"""Apart from the tables, so that QGIS's browser shows layers and nothing else."""
CHANGES = ("changes", "changes_wgs84")
EDITABLE = ("decision", "comment")
"""Columns of `CHANGES` that take an answer."""
FUNCTION = f"{QGIS_SCHEMA}.decide"

LAYERS: Mapping[str, str] = MappingProxyType(
    {
        "changes": "changes",
        "changes_wgs84": "changes",
        "estimates": "estimates",
        "nvdb_signs": "nvdb_signs",
        "drives": "drives",
    }
)
"""View → the exported layer whose style it has; the first column of a view is its key."""

# As in twin.decisions.log, which stands above this room.
_BY_TWIN = "('reopened', 'suppressed', 'lifted')"
_SILENT = "('opinion', 'withdrawn')"
_METHOD = "(SELECT CAST(value AS json) ->> 'method' FROM meta WHERE key = 'last_match')"
_SPREAD = "sqrt(power((e.cov_ee_m2 - e.cov_nn_m2) / 2, 2) + power(e.cov_en_m2, 2))"
_MIDDLE = "(e.cov_ee_m2 + e.cov_nn_m2) / 2"
_WGS84 = f"CAST(ST_Transform({GEOMETRY}, 4326) AS geometry(Point, 4326)) AS {GEOMETRY}"

_COLUMNS = (
    *("change_id", "verdict", "reason", "confidence", "nvdb_type", "nvdb_id", "nvdb_version"),
    *("skiltnummer_nvdb", "skiltnummer_seen", "distance_m", "distance_sigma_m", "drive_ids", "n_sightings"),
    *("decision", "cameras", "sign", "road", "comment", "author"),
)

_VIEWS = {
    "changes": f"""
SELECT c.change_id, c.verdict, c.reason, c.confidence, c.nvdb_type, c.nvdb_id, c.nvdb_version,
  c.skiltnummer_nvdb, c.skiltnummer_seen, c.distance_m, c.distance_sigma_m, c.drive_ids, c.n_sightings,
  coalesce(d.decision, 'open') AS decision, coalesce(c.cameras, '') AS cameras,
  replace(CASE WHEN c.verdict = 'wrong_type' THEN c.skiltnummer_nvdb || ' → ' || c.skiltnummer_seen
    WHEN c.skiltnummer_seen <> '' THEN c.skiltnummer_seen ELSE c.skiltnummer_nvdb END, ';', ' + ') AS sign,
  coalesce(p.road_reference, q.road_reference, '') AS road,
  CASE WHEN d.kind NOT IN {_BY_TWIN} THEN d.reason ELSE '' END AS comment,
  CASE WHEN d.kind NOT IN {_BY_TWIN} THEN d."by" ELSE '' END AS author,
  c.{GEOMETRY}
FROM change AS c
LEFT JOIN LATERAL (SELECT l.decision, l.kind, l.reason, l."by" FROM decision_log AS l
  WHERE l.change_id = c.change_id AND l.kind NOT IN {_SILENT} ORDER BY l.id DESC LIMIT 1) AS d ON true
LEFT JOIN skiltpunkt AS p ON c.nvdb_type = 95 AND p.nvdb_id = c.nvdb_id
LEFT JOIN skiltplate AS q ON c.nvdb_type = 96 AND q.nvdb_id = c.nvdb_id
""",
    "changes_wgs84": f"SELECT {', '.join(_COLUMNS)}, {_WGS84} FROM {QGIS_SCHEMA}.changes",
    "estimates": f"""
SELECT e.estimate_id, e.drive_id, e.object, e.label, e.skiltnummer, coalesce(e.nvdb_type, 95) AS nvdb_type,
  e.method, e.n_sightings, e.n_frames, e.n_cameras,
  to_timestamp(e.first_ns / 1e9) AT TIME ZONE 'UTC' AS first_seen,
  to_timestamp(e.last_ns / 1e9) AT TIME ZONE 'UTC' AS last_seen, e.range_min_m, e.height_m,
  sqrt({_MIDDLE} + {_SPREAD}) AS sigma_major_m, sqrt(greatest({_MIDDLE} - {_SPREAD}, 0)) AS sigma_minor_m,
  e.flags, e.sigma_height_m, sqrt(e.cov_ee_m2) AS sigma_east_m, sqrt(e.cov_nn_m2) AS sigma_north_m,
  e.{GEOMETRY}
FROM estimate AS e WHERE e.method = coalesce({_METHOD}, e.method)
""",
    "nvdb_signs": f"""
SELECT nvdb_id, 95 AS nvdb_type, version, CAST(NULL AS bigint) AS point_id,
  CAST('' AS text) COLLATE "C" AS skiltnummer, CAST('' AS text) COLLATE "C" AS text, own_geometry,
  accuracy_cm, capture_method, road_reference, CAST('' AS text) COLLATE "C" AS ansiktsside, last_modified,
  synced_at, {GEOMETRY} FROM skiltpunkt
UNION ALL SELECT nvdb_id, 96, version, point_id, skiltnummer, text, own_geometry, accuracy_cm,
  capture_method, road_reference, ansiktsside, last_modified, synced_at, {GEOMETRY} FROM skiltplate
""",
    "drives": f"""
SELECT drive_id, name, to_timestamp(started_ns / 1e9) AT TIME ZONE 'UTC' AS started,
  to_timestamp(ended_ns / 1e9) AT TIME ZONE 'UTC' AS ended, n_frames, annotations_complete, datum, length_m,
  {GEOMETRY} FROM drive
""",
}

_DECIDE = f"""
CREATE FUNCTION {FUNCTION}() RETURNS trigger LANGUAGE plpgsql
  SET search_path = {SCHEMA}, public, pg_temp SET extra_float_digits = 1 AS
$$ DECLARE
  edited record := NEW;
  told text;
  said decision_log;
  present record;
  number integer;
BEGIN
  edited.decision := OLD.decision;
  edited.comment := OLD.comment;
  IF edited IS DISTINCT FROM OLD THEN
    RAISE EXCEPTION 'only decision and comment can be edited: the author is who is logged in';
  END IF;
  IF NEW.decision IS NULL OR NEW.decision NOT IN ({", ".join(f"'{one}'" for one in Decision)}) THEN
    RAISE EXCEPTION 'this is no decision: choose one of {", ".join(Decision)}';
  END IF;
  IF current_setting('transaction_isolation') <> 'read committed' THEN
    RAISE EXCEPTION 'decide in a transaction that is READ COMMITTED: another would not see what others said';
  END IF;
  -- As every writer of twin: one at a time, until the transaction ends.
  PERFORM set_config('lock_timeout', '10s', true);
  PERFORM pg_advisory_xact_lock({LOCKS}, {WRITER});

  IF (SELECT CAST(value AS json) ->> 'revision' FROM meta WHERE key = 'last_match') IS DISTINCT FROM
      coalesce((SELECT CAST(value AS json) ->> 'n' FROM meta WHERE key = 'revision'), '0') THEN
    RAISE EXCEPTION 'drives or mirror have changed since the last match: twin match has to run first';
  END IF;
  SELECT c.*, coalesce(p.east_m, q.east_m) AS nvdb_east_m, coalesce(p.north_m, q.north_m) AS nvdb_north_m
    INTO present FROM change AS c
    LEFT JOIN skiltpunkt AS p ON c.nvdb_type = 95 AND p.nvdb_id = c.nvdb_id
    LEFT JOIN skiltplate AS q ON c.nvdb_type = 96 AND q.nvdb_id = c.nvdb_id
    WHERE c.change_id = OLD.change_id;
  IF NOT FOUND THEN
    RAISE EXCEPTION USING MESSAGE = 'a match has meanwhile taken the finding ' || OLD.change_id ||
      ' away: load the layer again';
  END IF;
  SELECT * INTO said FROM decision_log AS l WHERE l.change_id = OLD.change_id AND l.kind NOT IN {_SILENT}
    ORDER BY l.id DESC LIMIT 1;
  IF said.kind = 'suppressed' OR EXISTS (SELECT FROM (SELECT l.cause FROM decision_log AS l
      WHERE l.change_id = OLD.change_id AND l.kind NOT IN {_BY_TWIN} AND l.kind NOT IN {_SILENT}
      ORDER BY l.id DESC LIMIT 1) AS last WHERE last.cause IS NOT NULL) THEN
    RAISE EXCEPTION 'this finding goes with others of the same road works: decide it by twin decide';
  END IF;

  IF btrim(coalesce(NEW.comment, '')) <> btrim(coalesce(OLD.comment, '')) THEN
    told := btrim(coalesce(NEW.comment, ''));
  END IF;
  IF coalesce(said.decision, 'open') = NEW.decision
      AND (told IS NULL OR told = coalesce(said.reason, '') OR (told = '' AND NEW.decision = 'open')) THEN
    RETURN NEW;
  END IF;
  -- What one saving of edits decides is one batch: twin decide undo takes it back together.
  number := nullif(current_setting('twin.batch', true), '');
  IF number IS NULL THEN
    SELECT coalesce(max(batch), 0) + 1 INTO number FROM decision_log;
    PERFORM set_config('twin.batch', CAST(number AS text), true);
  END IF;
  INSERT INTO decision_log
    (batch, change_id, kind, decision, reason, "by", at, evidence, undo_of, session, request, cause)
  VALUES (number, OLD.change_id, 'decided', NEW.decision, coalesce(told, ''), session_user,
    to_char(clock_timestamp() AT TIME ZONE 'UTC', 'YYYY-MM-DD"T"HH24:MI:SS"Z"'),
    jsonb_build_object(
      'verdict', present.verdict, 'nvdb_type', present.nvdb_type, 'nvdb_id', present.nvdb_id,
      'nvdb_version', present.nvdb_version, 'skiltnummer_nvdb', present.skiltnummer_nvdb,
      'skiltnummer_seen', present.skiltnummer_seen,
      'distance_m', round(CAST(present.distance_m AS numeric), 3),
      'east_m', round(CAST(present.east_m AS numeric), 3),
      'north_m', round(CAST(present.north_m AS numeric), 3),
      'covariance_m2', CASE
        WHEN num_nulls(present.cov_ee_m2, present.cov_en_m2, present.cov_nn_m2) = 0
        THEN jsonb_build_array(present.cov_ee_m2, present.cov_en_m2, present.cov_nn_m2)
        WHEN present.distance_sigma_m IS NOT NULL
        THEN jsonb_build_array(power(present.distance_sigma_m, 2), 0.0, power(present.distance_sigma_m, 2))
        END,
      'nvdb_east_m', round(CAST(present.nvdb_east_m AS numeric), 3),
      'nvdb_north_m', round(CAST(present.nvdb_north_m AS numeric), 3),
      'pole', coalesce(present.terms ->> 'pole', ''),
      'confidence', round(CAST(present.confidence AS numeric), 4),
      'n_drives', cardinality(array_remove(string_to_array(present.drive_ids, ','), ''))),
    NULL, '', NULL, NULL);
  RETURN NEW;
END $$
"""


def views() -> Iterator[str]:
    """Yield what makes the layers, in a schema that is there."""
    yield _DECIDE
    for name, select in _VIEWS.items():
        yield f"CREATE VIEW {QGIS_SCHEMA}.{name} AS {select}"
    for name in CHANGES:
        yield (
            f"CREATE TRIGGER decides INSTEAD OF UPDATE ON {QGIS_SCHEMA}.{name} FOR EACH ROW "
            f"EXECUTE FUNCTION {FUNCTION}()"
        )


def no_views() -> Iterator[str]:
    """Yield what takes them away: PostgreSQL changes no column that a view shows."""
    # Without CASCADE, which would also take what others have built on them.
    for name in reversed(_VIEWS):
        yield f"DROP VIEW IF EXISTS {QGIS_SCHEMA}.{name}"
    yield f"DROP FUNCTION IF EXISTS {FUNCTION}()"
