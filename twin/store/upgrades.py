"""What makes a store of one version one of the next, up to 15: SQL, as it was when that version came."""

from __future__ import annotations

from collections.abc import Mapping

UPGRADES: Mapping[int, tuple[str, ...]] = {
    4: ("ALTER TABLE estimate ADD COLUMN nvdb_type INTEGER",),
    5: (
        "ALTER TABLE estimate ADD COLUMN text VARCHAR",
        "ALTER TABLE change ADD COLUMN cameras VARCHAR",
    ),
    6: (
        "ALTER TABLE drive_method ADD COLUMN misfits JSON NOT NULL DEFAULT '[]'",
        "ALTER TABLE drive_method ADD COLUMN absence_gap VARCHAR NOT NULL DEFAULT ''",
        # They lay in a corner of the corrections.
        (
            "UPDATE drive_method SET misfits = coalesce(json_extract(corrections, '$.misfits'), '[]'), "
            "absence_gap = coalesce(json_extract(corrections, '$.absence_gap'), ''), "
            "corrections = json_remove(corrections, '$.misfits', '$.absence_gap')"
        ),
    ),
    7: (
        (
            "CREATE TABLE sent (id INTEGER NOT NULL PRIMARY KEY, tag VARCHAR NOT NULL, api VARCHAR NOT NULL, "
            "change_id VARCHAR NOT NULL, state VARCHAR NOT NULL, set_id VARCHAR, digest VARCHAR NOT NULL, "
            "objects JSON NOT NULL, file VARCHAR NOT NULL, at VARCHAR NOT NULL, UNIQUE (tag, change_id))"
        ),
        "CREATE INDEX ix_sent_change_id ON sent (change_id)",
    ),
    8: (
        (
            "CREATE TABLE annotation_set (drive_id VARCHAR NOT NULL, number INTEGER NOT NULL, "
            "annotations_sha256 VARCHAR, read_at VARCHAR, folder VARCHAR NOT NULL, is_complete BOOLEAN NOT "
            "NULL, is_current BOOLEAN NOT NULL, n_annotations INTEGER NOT NULL, n_sightings INTEGER NOT "
            "NULL, n_objects INTEGER NOT NULL, PRIMARY KEY (drive_id, number))"
        ),
        (
            "CREATE TABLE drive_kept (drive_id VARCHAR NOT NULL, name VARCHAR NOT NULL, started_ns BIGINT "
            "NOT NULL, ended_ns BIGINT NOT NULL, datum VARCHAR NOT NULL, annotations_complete BOOLEAN NOT "
            "NULL, n_frames INTEGER NOT NULL, n_annotations INTEGER NOT NULL, length_m FLOAT NOT NULL, "
            "delay_ms FLOAT, line BLOB NOT NULL, rig BLOB NOT NULL, poses BLOB NOT NULL, content_sha256 "
            "VARCHAR NOT NULL, fix_quality JSON NOT NULL, cameras JSON NOT NULL, warnings JSON NOT NULL, "
            "skipped JSON NOT NULL, software VARCHAR NOT NULL, annotation_set INTEGER NOT NULL, PRIMARY "
            "KEY (drive_id, annotation_set))"
        ),
        (
            "CREATE TABLE drive_method_kept (drive_id VARCHAR NOT NULL, method VARCHAR NOT NULL, "
            "n_unplaced INTEGER NOT NULL, corrections JSON NOT NULL, misfits JSON NOT NULL, absence_gap "
            "VARCHAR NOT NULL, annotation_set INTEGER NOT NULL, PRIMARY KEY (drive_id, method, "
            "annotation_set))"
        ),
        (
            "CREATE TABLE sighting_kept (drive_id VARCHAR NOT NULL, method VARCHAR NOT NULL, number "
            "INTEGER NOT NULL, object VARCHAR NOT NULL, camera VARCHAR NOT NULL, frame INTEGER NOT NULL, "
            "epoch_ns BIGINT NOT NULL, kind VARCHAR NOT NULL, u_px FLOAT NOT NULL, v_px FLOAT NOT NULL, "
            "east_m FLOAT, north_m FLOAT, cov_ee_m2 FLOAT, cov_en_m2 FLOAT, cov_nn_m2 FLOAT, range_m "
            "FLOAT, speed_mps FLOAT, residual_u_px FLOAT, residual_v_px FLOAT, eye_east_m FLOAT, "
            "eye_north_m FLOAT, rejected VARCHAR NOT NULL, annotation_set INTEGER NOT NULL, PRIMARY KEY "
            "(drive_id, method, number, annotation_set))"
        ),
        (
            "CREATE TABLE estimate_kept (estimate_id VARCHAR NOT NULL, drive_id VARCHAR NOT NULL, object "
            "VARCHAR NOT NULL, label VARCHAR NOT NULL, skiltnummer VARCHAR NOT NULL, method VARCHAR NOT "
            "NULL, east_m FLOAT NOT NULL, north_m FLOAT NOT NULL, height_m FLOAT NOT NULL, sigma_height_m "
            "FLOAT, cov_ee_m2 FLOAT NOT NULL, cov_en_m2 FLOAT NOT NULL, cov_nn_m2 FLOAT NOT NULL, "
            "n_sightings INTEGER NOT NULL, n_frames INTEGER NOT NULL, n_cameras INTEGER NOT NULL, cameras "
            "JSON NOT NULL, first_ns BIGINT NOT NULL, last_ns BIGINT NOT NULL, range_min_m FLOAT NOT NULL, "
            "n_rejected INTEGER NOT NULL, flags VARCHAR NOT NULL, budget JSON NOT NULL, nvdb_type INTEGER, "
            "text VARCHAR, annotation_set INTEGER NOT NULL, PRIMARY KEY (estimate_id, annotation_set))"
        ),
        # Which annotations they were is not known of the drives that are there.
        (
            "INSERT INTO annotation_set SELECT drive_id, 1, NULL, NULL, '', annotations_complete, 1, "
            "n_annotations, (SELECT count(DISTINCT s.number) FROM sighting AS s WHERE s.drive_id = "
            "drive.drive_id AND s.rejected = ''), (SELECT count(DISTINCT e.object) FROM estimate AS e "
            "WHERE e.drive_id = drive.drive_id) FROM drive"
        ),
    ),
    9: (
        "ALTER TABLE sighting ADD COLUMN is_measured BOOLEAN NOT NULL DEFAULT 1",
        "ALTER TABLE sighting_kept RENAME TO sighting_kept_9",
        (
            "CREATE TABLE sighting_kept (drive_id VARCHAR NOT NULL, method VARCHAR NOT NULL, number "
            "INTEGER NOT NULL, object VARCHAR NOT NULL, camera VARCHAR NOT NULL, frame INTEGER NOT NULL, "
            "epoch_ns BIGINT NOT NULL, kind VARCHAR NOT NULL, u_px FLOAT NOT NULL, v_px FLOAT NOT NULL, "
            "east_m FLOAT, north_m FLOAT, cov_ee_m2 FLOAT, cov_en_m2 FLOAT, cov_nn_m2 FLOAT, range_m "
            "FLOAT, speed_mps FLOAT, residual_u_px FLOAT, residual_v_px FLOAT, eye_east_m FLOAT, "
            "eye_north_m FLOAT, rejected VARCHAR NOT NULL, is_measured BOOLEAN NOT NULL, annotation_set "
            "INTEGER NOT NULL, PRIMARY KEY (drive_id, method, number, annotation_set))"
        ),
        (
            "INSERT INTO sighting_kept SELECT drive_id, method, number, object, camera, frame, epoch_ns, "
            "kind, u_px, v_px, east_m, north_m, cov_ee_m2, cov_en_m2, cov_nn_m2, range_m, speed_mps, "
            "residual_u_px, residual_v_px, eye_east_m, eye_north_m, rejected, 1, annotation_set "
            "FROM sighting_kept_9"
        ),
        "DROP TABLE sighting_kept_9",
        (
            "CREATE TABLE known_mark (id INTEGER NOT NULL PRIMARY KEY, drive_id VARCHAR NOT NULL, clicks "
            "VARCHAR NOT NULL, pole VARCHAR NOT NULL, east_m FLOAT NOT NULL, north_m FLOAT NOT NULL, "
            "skiltnummer VARCHAR NOT NULL, UNIQUE (drive_id, clicks, pole))"
        ),
        (
            "INSERT OR IGNORE INTO known_mark (drive_id, clicks, pole, east_m, north_m, skiltnummer) "
            "SELECT e.drive_id, s.clicks, k.pole, e.east_m, e.north_m, e.skiltnummer FROM estimate AS e "
            "JOIN pole_key AS k ON k.member = e.drive_id || ':' || e.object JOIN (SELECT drive_id, method, "
            "object, count(*) || ':' || sum(frame) || ':' || sum(CAST(round(u_px * 1000) AS INTEGER)) || "
            "':' || sum(CAST(round(v_px * 1000) AS INTEGER)) AS clicks FROM sighting GROUP BY drive_id, "
            "method, object) AS s ON s.drive_id = e.drive_id AND s.method = e.method AND s.object = e.object "
            "ORDER BY k.rowid"
        ),
    ),
    10: (
        "ALTER TABLE sighting ADD COLUMN width_px FLOAT",
        "ALTER TABLE sighting ADD COLUMN height_px FLOAT",
        "ALTER TABLE sighting_kept RENAME TO sighting_kept_10",
        (
            "CREATE TABLE sighting_kept (drive_id VARCHAR NOT NULL, method VARCHAR NOT NULL, number "
            "INTEGER NOT NULL, object VARCHAR NOT NULL, camera VARCHAR NOT NULL, frame INTEGER NOT NULL, "
            "epoch_ns BIGINT NOT NULL, kind VARCHAR NOT NULL, u_px FLOAT NOT NULL, v_px FLOAT NOT NULL, "
            "east_m FLOAT, north_m FLOAT, cov_ee_m2 FLOAT, cov_en_m2 FLOAT, cov_nn_m2 FLOAT, range_m "
            "FLOAT, speed_mps FLOAT, residual_u_px FLOAT, residual_v_px FLOAT, eye_east_m FLOAT, "
            "eye_north_m FLOAT, rejected VARCHAR NOT NULL, is_measured BOOLEAN NOT NULL, width_px FLOAT, "
            "height_px FLOAT, annotation_set INTEGER NOT NULL, PRIMARY KEY (drive_id, method, number, "
            "annotation_set))"
        ),
        (
            "INSERT INTO sighting_kept SELECT drive_id, method, number, object, camera, frame, epoch_ns, "
            "kind, u_px, v_px, east_m, north_m, cov_ee_m2, cov_en_m2, cov_nn_m2, range_m, speed_mps, "
            "residual_u_px, residual_v_px, eye_east_m, eye_north_m, rejected, is_measured, NULL, NULL, "
            "annotation_set FROM sighting_kept_10"
        ),
        "DROP TABLE sighting_kept_10",
        (
            "CREATE TABLE crop (change_id VARCHAR NOT NULL, number INTEGER NOT NULL, role VARCHAR NOT NULL, "
            "drive_id VARCHAR NOT NULL, camera VARCHAR NOT NULL, frame INTEGER NOT NULL, epoch_ns BIGINT NOT "
            "NULL, range_m FLOAT NOT NULL, sha256 VARCHAR NOT NULL, width_px INTEGER NOT NULL, height_px "
            "INTEGER NOT NULL, is_masked BOOLEAN NOT NULL, proof JSON NOT NULL, PRIMARY KEY (change_id, "
            "number, role))"
        ),
        "CREATE INDEX ix_crop_sha256 ON crop (sha256)",
        (
            "CREATE TABLE crop_gap (id INTEGER NOT NULL PRIMARY KEY, change_id VARCHAR NOT NULL, drive_id "
            "VARCHAR NOT NULL, kind VARCHAR NOT NULL, sentence VARCHAR NOT NULL)"
        ),
        "CREATE INDEX ix_crop_gap_change_id ON crop_gap (change_id)",
        (
            "CREATE TABLE crop_log (id INTEGER NOT NULL PRIMARY KEY, at VARCHAR NOT NULL, kind VARCHAR NOT "
            'NULL, "by" VARCHAR NOT NULL, reason VARCHAR NOT NULL, n_crops INTEGER NOT NULL, change_ids JSON '
            "NOT NULL)"
        ),
        (
            "CREATE TRIGGER crop_log_keeps BEFORE UPDATE ON crop_log "
            "BEGIN SELECT RAISE(ABORT, 'the log of crops is never changed'); END"
        ),
        (
            "CREATE TRIGGER crop_log_stays BEFORE DELETE ON crop_log "
            "BEGIN SELECT RAISE(ABORT, 'the log of crops is never changed'); END"
        ),
    ),
    11: (
        "ALTER TABLE decision_log ADD COLUMN session VARCHAR NOT NULL DEFAULT ''",
        "ALTER TABLE decision_log ADD COLUMN request VARCHAR",
        "CREATE INDEX ix_decision_log_session ON decision_log (session)",
        "CREATE UNIQUE INDEX ix_decision_log_request ON decision_log (request)",
        "DROP VIEW decision",
        (
            "CREATE VIEW decision AS SELECT * FROM decision_log AS e WHERE e.id = (SELECT max(n.id) FROM "
            "decision_log AS n WHERE n.change_id = e.change_id AND n.kind NOT IN ('opinion', 'withdrawn'))"
        ),
    ),
    12: ("ALTER TABLE decision_log ADD COLUMN cause JSON",),
    13: ("ALTER TABLE crop_gap ADD COLUMN why JSON",),
    14: (
        (
            "CREATE TABLE kept_part (kind VARCHAR NOT NULL, key VARCHAR NOT NULL, arrays BLOB NOT NULL, "
            "PRIMARY KEY (kind, key))"
        ),
        "CREATE INDEX ix_skiltpunkt_east_m ON skiltpunkt (east_m)",
        "CREATE INDEX ix_skiltplate_east_m ON skiltplate (east_m)",
        "CREATE INDEX ix_skiltplate_point_id ON skiltplate (point_id)",
    ),
}
"""What makes a store of one version one of the next; without an entry it is refused."""
