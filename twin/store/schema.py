"""The store's tables. Coordinates are EPSG:25833 metres, epochs int64 nanoseconds UTC."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from twin.store.kinds import Method

VERSION = 14
"""Raised with every change of the tables: another version is upgraded (:mod:`.upgrades`) or refused."""

metadata = sa.MetaData()

meta = sa.Table(
    "meta",
    metadata,
    sa.Column("key", sa.String, primary_key=True),
    sa.Column("value", sa.String, nullable=False),
)


ROWID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
"""An id that SQLite keeps rows by: INTEGER PRIMARY KEY needs no index of its own, BIGINT would."""


def _nvdb_columns() -> list[sa.Column[Any]]:
    """Make the columns that both object types carry."""
    return [
        sa.Column("nvdb_id", ROWID, primary_key=True, autoincrement=False),
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


def _skiltpunkt_columns() -> list[sa.Column[Any]]:
    return [*_nvdb_columns(), sa.Column("plate_ids", sa.JSON, nullable=False)]


def _skiltplate_columns() -> list[sa.Column[Any]]:
    return [
        *_nvdb_columns(),
        sa.Column("point_id", sa.BigInteger),
        sa.Column("skiltnummer", sa.String),
        sa.Column("skiltnummer_text", sa.String),
        sa.Column("skiltnummer_enum_id", sa.Integer),
        sa.Column("ansiktsside", sa.String),
        sa.Column("text", sa.String),
        sa.Column("plasseringskode", sa.Integer),
    ]


@dataclass(frozen=True, slots=True)
class MirrorTables:
    """The tables of one object type.

    Attributes
    ----------
    visible : Table
        The mirror that everybody reads: always whole.
    aside : Table
        A backfill, or a round of changes, that is not whole yet. Same columns.
    history : Table
        States that were replaced or deleted, with ``seen_until``: when we learnt of it.
    """

    visible: sa.Table
    aside: sa.Table
    history: sa.Table


def _mirror_tables(name: str, columns: Callable[[], list[sa.Column[Any]]]) -> MirrorTables:
    visible = sa.Table(name, metadata, *columns())
    aside = sa.Table(f"{name}_aside", metadata, *columns())
    history = sa.Table(
        f"{name}_history", metadata, *columns(), sa.Column("seen_until", sa.String, primary_key=True)
    )
    return MirrorTables(visible, aside, history)


MIRROR = {
    95: _mirror_tables("skiltpunkt", _skiltpunkt_columns),
    96: _mirror_tables("skiltplate", _skiltplate_columns),
}
"""Vegobjekttype → its tables."""

skiltpunkt = MIRROR[95].visible
skiltplate = MIRROR[96].visible


def _veglenke_columns() -> list[sa.Column[Any]]:
    # NVDB says that sekvens, number and segment are unique; the rest of the key costs nothing and makes sure
    # that a link without a segment number never takes the place of another.
    return [
        sa.Column("veglenkesekvensid", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("veglenkenummer", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("segmentnummer", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("startposisjon", sa.Float, primary_key=True),
        sa.Column("startdato", sa.String, primary_key=True),
        sa.Column("sluttposisjon", sa.Float, nullable=False),
        sa.Column("sluttdato", sa.String),
        sa.Column("konnektering", sa.Boolean, nullable=False),
        sa.Column("detaljert", sa.Boolean, nullable=False),
        sa.Column("type_veg", sa.String, nullable=False),
        sa.Column("detaljniva", sa.String, nullable=False),
        sa.Column("vegkategori", sa.String, nullable=False),
        sa.Column("trafikantgruppe", sa.String, nullable=False),
        sa.Column("kortform", sa.String, nullable=False),
        sa.Column("retning", sa.Integer, nullable=False),  # 1 with the metering, -1 against it, 0 unknown
        sa.Column("fra_meter", sa.Float),
        sa.Column("til_meter", sa.Float),
        sa.Column("geometri", sa.LargeBinary, nullable=False),  # WKB LineString Z, EPSG:25833 and NN2000
    ]


veglenke = sa.Table("veglenke", metadata, *_veglenke_columns())
"""The road network of an area, segmented: the columns of :class:`nvdb.vegnett.Vegnett`."""
veglenke_aside = sa.Table("veglenke_aside", metadata, *_veglenke_columns())
"""A road network whose last page has not come yet."""

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
    sa.Column("content_sha256", sa.String, nullable=False),  # of every file that was read
    sa.Column("fix_quality", sa.JSON, nullable=False),  # GGA quality → fixes
    sa.Column("cameras", sa.JSON, nullable=False),  # annotated cameras
    sa.Column("warnings", sa.JSON, nullable=False),
    sa.Column("skipped", sa.JSON, nullable=False),
    sa.Column("software", sa.String, nullable=False),
)

drive_method = sa.Table(
    "drive_method",
    metadata,
    sa.Column("drive_id", sa.String, primary_key=True),
    sa.Column("method", sa.String, primary_key=True),
    # Annotated objects without a position that may stand near: no sign can be called missing beside them.
    sa.Column("n_unplaced", sa.Integer, nullable=False),
    sa.Column("corrections", sa.JSON, nullable=False),  # what the adjustment found out about the car
    # In which ways the drive does not fit itself, a clause each: its claims are for review.
    sa.Column("misfits", sa.JSON, nullable=False, default=list),
    # Why a sign that it passed and did not see may stand all the same; "" if nothing speaks for that.
    sa.Column("absence_gap", sa.String, nullable=False, default=""),
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
    sa.Column("kind", sa.String, nullable=False),  # foot or box
    sa.Column("u_px", sa.Float, nullable=False),
    sa.Column("v_px", sa.Float, nullable=False),
    sa.Column("east_m", sa.Float),
    sa.Column("north_m", sa.Float),
    sa.Column("cov_ee_m2", sa.Float),  # grid east and grid north
    sa.Column("cov_en_m2", sa.Float),
    sa.Column("cov_nn_m2", sa.Float),
    sa.Column("range_m", sa.Float),
    sa.Column("speed_mps", sa.Float),
    sa.Column("residual_u_px", sa.Float),  # seen minus expected; the adjustment's alone
    sa.Column("residual_v_px", sa.Float),
    sa.Column("eye_east_m", sa.Float),  # the camera's place, EPSG:25833
    sa.Column("eye_north_m", sa.Float),
    sa.Column("rejected", sa.String, nullable=False),
    # False: the annotation tool interpolated it; the object was in view, and the reason stands in `rejected`.
    sa.Column("is_measured", sa.Boolean, nullable=False),
    sa.Column("width_px", sa.Float),  # of a box; null for a foot, and of drives read before schema 11
    sa.Column("height_px", sa.Float),
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
    sa.Column("sigma_height_m", sa.Float),
    sa.Column("cov_ee_m2", sa.Float, nullable=False),  # grid east and grid north
    sa.Column("cov_en_m2", sa.Float, nullable=False),
    sa.Column("cov_nn_m2", sa.Float, nullable=False),
    sa.Column("n_sightings", sa.Integer, nullable=False),
    sa.Column("n_frames", sa.Integer, nullable=False),
    sa.Column("n_cameras", sa.Integer, nullable=False),
    sa.Column("cameras", sa.JSON, nullable=False),
    sa.Column("first_ns", sa.BigInteger, nullable=False),
    sa.Column("last_ns", sa.BigInteger, nullable=False),
    sa.Column("range_min_m", sa.Float, nullable=False),
    sa.Column("n_rejected", sa.Integer, nullable=False),
    sa.Column("flags", sa.String, nullable=False),
    sa.Column("budget", sa.JSON, nullable=False),  # source → covariance, true east and north
    sa.Column("nvdb_type", sa.Integer),  # of an object that is no sign; null for signs
    sa.Column("text", sa.String),  # on its plates, joined as their codes are; null where none was annotated
)

annotation_set = sa.Table(
    "annotation_set",
    metadata,
    sa.Column("drive_id", sa.String, primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("annotations_sha256", sa.String),  # null: read before schema 9, which did not keep it
    sa.Column("read_at", sa.String),  # UTC, when it was last read; null as above
    sa.Column("folder", sa.String, nullable=False),
    sa.Column("is_complete", sa.Boolean, nullable=False),  # declared: every sign in view was annotated
    sa.Column("is_current", sa.Boolean, nullable=False),  # one of each drive
    sa.Column("n_annotations", sa.Integer, nullable=False),
    sa.Column("n_sightings", sa.Integer, nullable=False),  # with a position, of the method read last
    sa.Column("n_objects", sa.Integer, nullable=False),  # likewise
)
"""Each drive's annotations as they were read, a row for each version of them."""


def _kept(table: sa.Table) -> sa.Table:
    columns = (
        sa.Column(c.name, c.type, primary_key=c.primary_key, nullable=c.nullable) for c in table.columns
    )
    number = sa.Column("annotation_set", sa.Integer, primary_key=True)
    return sa.Table(f"{table.name}_kept", metadata, *columns, number)


KEPT = {table: _kept(table) for table in (drive, drive_method, sighting, estimate)}
"""What came of annotation sets that are not current; the tables themselves hold the current ones alone."""

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
    sa.Column("cov_ee_m2", sa.Float),  # of the measured position, grid east and grid north
    sa.Column("cov_en_m2", sa.Float),
    sa.Column("cov_nn_m2", sa.Float),
    sa.Column("drive_ids", sa.String, nullable=False),
    sa.Column("n_sightings", sa.Integer, nullable=False),
    sa.Column("east_m", sa.Float, nullable=False),
    sa.Column("north_m", sa.Float, nullable=False),
    sa.Column("terms", sa.JSON, nullable=False, default=dict),  # what the verdict rests on
    sa.Column("cameras", sa.String),  # that saw it, or looked for it, joined by ","
)

decision_log = sa.Table(
    "decision_log",
    metadata,
    sa.Column("id", ROWID, primary_key=True),
    sa.Column("batch", sa.Integer, nullable=False, index=True),  # what one command or one match decided
    sa.Column("change_id", sa.String, nullable=False, index=True),
    sa.Column("kind", sa.String, nullable=False),  # twin.decisions.log: decided, undone, opinion, ...
    sa.Column("decision", sa.String, nullable=False),  # open, accept, dismiss, defer
    sa.Column("reason", sa.String, nullable=False),
    sa.Column("by", sa.String, nullable=False),
    sa.Column("at", sa.String, nullable=False),  # UTC
    sa.Column("evidence", sa.JSON, nullable=False),  # what the decision rested on
    sa.Column("undo_of", sa.BigInteger),  # the entry that this one takes back
    sa.Column("session", sa.String, nullable=False, index=True),  # of a page in which it was answered; or ""
    # The page's key of its request, which it may send twice.
    sa.Column("request", sa.String, index=True, unique=True),
    sa.Column("cause", sa.JSON(none_as_null=True)),  # twin.words.reasons.Cause; null where there is none
)
"""Every decision ever made: rows are added, never changed; kept also while a finding is absent."""

decision = sa.Table("decision", sa.MetaData(), *(sa.Column(c.name, c.type) for c in decision_log.columns))
"""The decision that holds for each change: a view, the last row of the log that is no opinion."""

_DECISION_LOG_RULES = """
CREATE VIEW decision AS SELECT * FROM decision_log AS e
  WHERE e.id = (SELECT max(n.id) FROM decision_log AS n WHERE n.change_id = e.change_id
    AND n.kind NOT IN ('opinion', 'withdrawn'))
--
CREATE TRIGGER decision_log_keeps BEFORE UPDATE ON decision_log
  BEGIN SELECT RAISE(ABORT, 'decisions are never changed'); END
--
CREATE TRIGGER decision_log_stays BEFORE DELETE ON decision_log
  BEGIN SELECT RAISE(ABORT, 'decisions are never deleted'); END
"""
for _rule in _DECISION_LOG_RULES.split("--"):
    sa.event.listen(metadata, "after_create", sa.DDL(_rule))  # type: ignore[no-untyped-call]

pole_key = sa.Table(
    "pole_key",
    metadata,
    sa.Column("member", sa.String, primary_key=True),  # drive:object
    sa.Column("pole", sa.String, nullable=False),
)
"""Which pole an estimate belonged to in the last match."""

known_mark = sa.Table(
    "known_mark",
    metadata,
    sa.Column("id", ROWID, primary_key=True),
    sa.Column("drive_id", sa.String, nullable=False),
    sa.Column("clicks", sa.String, nullable=False),  # what was clicked for it: twin.matching.poles.seen_in
    sa.Column("pole", sa.String, nullable=False),
    sa.Column("east_m", sa.Float, nullable=False),
    sa.Column("north_m", sa.Float, nullable=False),
    sa.Column("skiltnummer", sa.String, nullable=False),
    sa.UniqueConstraint("drive_id", "clicks", "pole"),
)
"""By what every match knows the poles of earlier ones again: the key that a pole first got stays its own."""


sent = sa.Table(
    "sent",
    metadata,
    sa.Column("id", ROWID, primary_key=True),
    sa.Column("tag", sa.String, nullable=False),  # of the set, which carries it as its eksternRef
    sa.Column("api", sa.String, nullable=False),  # which API Skriv
    # The finding; of a set that names none the SHA-256 of its XML.
    sa.Column("change_id", sa.String, nullable=False, index=True),
    sa.Column("state", sa.String, nullable=False),  # twin.store.kinds.Sending
    sa.Column("set_id", sa.String),  # API Skriv's own, once it is known
    sa.Column("digest", sa.String, nullable=False),  # SHA-256 of the operations
    # Of the operations: type, id, tempId of a new object, and the mirror's version and time of change before.
    sa.Column("objects", sa.JSON, nullable=False),
    sa.Column("file", sa.String, nullable=False),  # that it was sent from
    sa.Column("at", sa.String, nullable=False),  # UTC, of the last change of this row
    sa.UniqueConstraint("tag", "change_id"),
)
"""What was sent to API Skriv: a row for each finding of each set, written before the request."""

crop = sa.Table(
    "crop",
    metadata,
    sa.Column("change_id", sa.String, primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),  # 0 is the best view
    sa.Column("role", sa.String, primary_key=True),  # twin.evidence.Role
    sa.Column("drive_id", sa.String, nullable=False),
    sa.Column("camera", sa.String, nullable=False),
    sa.Column("frame", sa.Integer, nullable=False),
    sa.Column("epoch_ns", sa.BigInteger, nullable=False),
    sa.Column("range_m", sa.Float, nullable=False),
    sa.Column("sha256", sa.String, nullable=False, index=True),  # of the WebP file
    sa.Column("width_px", sa.Integer, nullable=False),
    sa.Column("height_px", sa.Integer, nullable=False),
    sa.Column("is_masked", sa.Boolean, nullable=False),
    sa.Column("proof", sa.JSON, nullable=False),  # twin.evidence.MaskProof
)
"""Crops of pictures that show a finding; the files lie beside the store (:mod:`twin.evidence.files`)."""

crop_gap = sa.Table(
    "crop_gap",
    metadata,
    sa.Column("id", ROWID, primary_key=True),
    sa.Column("change_id", sa.String, nullable=False, index=True),
    sa.Column("drive_id", sa.String, nullable=False),
    sa.Column("kind", sa.String, nullable=False),  # twin.evidence.GapKind
    sa.Column("sentence", sa.String, nullable=False),  # in English
    sa.Column("why", sa.JSON(none_as_null=True)),  # twin.words.WhyNoPicture; none in rows from before 14
)
"""Why a finding has no crops, or fewer than it could have."""

crop_log = sa.Table(
    "crop_log",
    metadata,
    sa.Column("id", ROWID, primary_key=True),
    sa.Column("at", sa.String, nullable=False),  # UTC
    sa.Column("kind", sa.String, nullable=False),  # unmasked, forgotten
    sa.Column("by", sa.String, nullable=False),
    sa.Column("reason", sa.String, nullable=False),
    sa.Column("n_crops", sa.Integer, nullable=False),
    sa.Column("change_ids", sa.JSON, nullable=False),
)
"""When crops were made without masks, and when crops were deleted: rows are added, never changed."""

CROP_LOG_RULES = tuple(
    f"CREATE TRIGGER crop_log_{name} BEFORE {act} ON crop_log "
    "BEGIN SELECT RAISE(ABORT, 'the log of crops is never changed'); END"
    for name, act in (("keeps", "UPDATE"), ("stays", "DELETE"))
)
for _rule in CROP_LOG_RULES:
    sa.event.listen(metadata, "after_create", sa.DDL(_rule))  # type: ignore[no-untyped-call]


METHODS = tuple(Method)
"""Geolocation methods, best first."""
