"""The store's tables. Coordinates are EPSG:25833 metres, epochs int64 nanoseconds UTC."""

from __future__ import annotations

import sqlalchemy as sa

VERSION = 1
"""Raised with every change of the tables: a store of another version is refused, never guessed at."""

metadata = sa.MetaData()

meta = sa.Table(
    "meta",
    metadata,
    sa.Column("key", sa.String, primary_key=True),
    sa.Column("value", sa.String, nullable=False),
)


def _nvdb_columns() -> list[sa.Column[object]]:
    """Make the columns that both object types carry."""
    return [
        sa.Column("nvdb_id", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("version", sa.Integer),
        sa.Column("start_date", sa.String),
        sa.Column("end_date", sa.String),
        sa.Column("last_modified", sa.String),
        sa.Column("east_m", sa.Float),
        sa.Column("north_m", sa.Float),
        sa.Column("height_m", sa.Float),
        sa.Column("own_geometry", sa.Boolean, nullable=False),
        sa.Column("accuracy_cm", sa.Float),
        sa.Column("capture_method", sa.String),
        sa.Column("road_reference", sa.String),
        sa.Column("kommuner", sa.JSON, nullable=False),
        sa.Column("stedfesting", sa.JSON, nullable=False),
        sa.Column("problems", sa.JSON, nullable=False),
        sa.Column("raw", sa.LargeBinary, nullable=False),
        sa.Column("synced_at", sa.String, nullable=False),
    ]


skiltpunkt = sa.Table(
    "skiltpunkt",
    metadata,
    *_nvdb_columns(),
    sa.Column("plate_ids", sa.JSON, nullable=False),
)

skiltplate = sa.Table(
    "skiltplate",
    metadata,
    *_nvdb_columns(),
    sa.Column("point_id", sa.BigInteger, index=True),
    sa.Column("skiltnummer", sa.String),
    sa.Column("skiltnummer_text", sa.String),
    sa.Column("skiltnummer_enum_id", sa.Integer),
    sa.Column("ansiktsside", sa.String),
    sa.Column("text", sa.String),
    sa.Column("plasseringskode", sa.Integer),
)

drive = sa.Table(
    "drive",
    metadata,
    sa.Column("drive_id", sa.String, primary_key=True),
    sa.Column("name", sa.String, nullable=False),
    sa.Column("started_ns", sa.BigInteger, nullable=False),
    sa.Column("ended_ns", sa.BigInteger, nullable=False),
    sa.Column("datum", sa.String, nullable=False),
    sa.Column("annotations_complete", sa.Boolean, nullable=False),
    sa.Column("n_frames", sa.Integer, nullable=False),
    sa.Column("n_annotations", sa.Integer, nullable=False),
    sa.Column("length_m", sa.Float, nullable=False),
    sa.Column("delay_ms", sa.Float),
    sa.Column("line", sa.LargeBinary, nullable=False),  # WKB LineString, EPSG:25833
    sa.Column("rig", sa.LargeBinary, nullable=False),  # zlib of the rig document
    sa.Column("poses", sa.LargeBinary, nullable=False),  # npz: where the car was, for "was it in view?"
    sa.Column("cameras", sa.JSON, nullable=False),  # annotated cameras
    sa.Column("warnings", sa.JSON, nullable=False),
    sa.Column("skipped", sa.JSON, nullable=False),
    sa.Column("software", sa.String, nullable=False),
)

sighting = sa.Table(
    "sighting",
    metadata,
    sa.Column("drive_id", sa.String, primary_key=True),
    sa.Column("method", sa.String, primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("object", sa.String, nullable=False),
    sa.Column("camera", sa.String, nullable=False),
    sa.Column("frame", sa.Integer, nullable=False),
    sa.Column("epoch_ns", sa.BigInteger, nullable=False),
    sa.Column("u_px", sa.Float, nullable=False),
    sa.Column("v_px", sa.Float, nullable=False),
    sa.Column("east_m", sa.Float),
    sa.Column("north_m", sa.Float),
    sa.Column("range_m", sa.Float),
    sa.Column("speed_mps", sa.Float),
    sa.Column("rejected", sa.String, nullable=False),
)

estimate = sa.Table(
    "estimate",
    metadata,
    sa.Column("estimate_id", sa.String, primary_key=True),
    sa.Column("drive_id", sa.String, nullable=False, index=True),
    sa.Column("object", sa.String, nullable=False),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("skiltnummer", sa.String, nullable=False),
    sa.Column("method", sa.String, nullable=False, index=True),
    sa.Column("east_m", sa.Float, nullable=False),
    sa.Column("north_m", sa.Float, nullable=False),
    sa.Column("height_m", sa.Float, nullable=False),
    sa.Column("cov_ee_m2", sa.Float, nullable=False),  # grid east and grid north
    sa.Column("cov_en_m2", sa.Float, nullable=False),
    sa.Column("cov_nn_m2", sa.Float, nullable=False),
    sa.Column("n_sightings", sa.Integer, nullable=False),
    sa.Column("n_frames", sa.Integer, nullable=False),
    sa.Column("n_cameras", sa.Integer, nullable=False),
    sa.Column("first_ns", sa.BigInteger, nullable=False),
    sa.Column("last_ns", sa.BigInteger, nullable=False),
    sa.Column("range_min_m", sa.Float, nullable=False),
    sa.Column("flags", sa.String, nullable=False),
)

change = sa.Table(
    "change",
    metadata,
    sa.Column("change_id", sa.String, primary_key=True),
    sa.Column("verdict", sa.String, nullable=False, index=True),
    sa.Column("reason", sa.String, nullable=False),
    sa.Column("confidence", sa.Float, nullable=False),
    sa.Column("nvdb_type", sa.Integer, nullable=False),
    sa.Column("nvdb_id", sa.BigInteger),
    sa.Column("nvdb_version", sa.Integer),
    sa.Column("skiltnummer_nvdb", sa.String, nullable=False),
    sa.Column("skiltnummer_seen", sa.String, nullable=False),
    sa.Column("distance_m", sa.Float),
    sa.Column("distance_sigma_m", sa.Float),
    sa.Column("drive_ids", sa.String, nullable=False),
    sa.Column("n_sightings", sa.Integer, nullable=False),
    sa.Column("east_m", sa.Float, nullable=False),
    sa.Column("north_m", sa.Float, nullable=False),
    sa.Column("decision", sa.String, nullable=False),
)
