"""The store's tables. Coordinates are EPSG:25833 metres, epochs int64 nanoseconds UTC."""

from __future__ import annotations

import sqlalchemy as sa

from twin.store.crop_tables import CROP_LOG_RULES, crop, crop_gap, crop_log
from twin.store.fleet_tables import fleet_job
from twin.store.kinds import Method
from twin.store.mirror_tables import (
    MIRROR,
    MirrorTables,
    metadata,
    skiltplate,
    skiltpunkt,
    veglenke,
    veglenke_aside,
)
from twin.store.types import JSON, JSON_OR_NULL, REAL, ROWID, TEXT

__all__ = [
    "CROP_LOG_RULES",
    "KEPT",
    "METHODS",
    "MIRROR",
    "ROWID",
    "VERSION",
    "MirrorTables",
    "annotation_set",
    "change",
    "crop",
    "crop_gap",
    "crop_log",
    "decision",
    "decision_log",
    "drive",
    "drive_method",
    "estimate",
    "fleet_job",
    "kept_part",
    "known_mark",
    "meta",
    "metadata",
    "pole_key",
    "sent",
    "sighting",
    "skiltplate",
    "skiltpunkt",
    "veglenke",
    "veglenke_aside",
]

VERSION = 18
"""Raised with every change of the tables: another version is upgraded (:mod:`.migrate`) or refused."""

meta = sa.Table(
    "meta",
    metadata,
    sa.Column(
        "key",
        TEXT,
        primary_key=True,
        comment="what is kept: area, schema version, time of the last match, state of the change feed, …",
    ),
    sa.Column("value", TEXT, nullable=False, comment="its value, as text or JSON"),
    comment="What the store says of itself.",
)


drive = sa.Table(
    "drive",
    metadata,
    sa.Column("drive_id", TEXT, primary_key=True, comment="first 12 digits of what identifies the recording"),
    sa.Column("name", TEXT, nullable=False, comment="as in drive.toml, else the folder's"),
    sa.Column("started_ns", sa.BigInteger, nullable=False, comment="first epoch, nanoseconds UTC"),
    sa.Column("ended_ns", sa.BigInteger, nullable=False, comment="last epoch, nanoseconds UTC"),
    sa.Column("datum", TEXT, nullable=False, comment="of its positions before they were brought to EUREF89"),
    sa.Column(
        "annotations_complete",
        sa.Boolean,
        nullable=False,
        comment="declared: every sign in view was annotated",
    ),
    sa.Column("n_frames", sa.Integer, nullable=False, comment="frames of all cameras"),
    sa.Column("n_annotations", sa.Integer, nullable=False, comment="annotated points and boxes"),
    sa.Column("length_m", REAL, nullable=False, comment="driven, metres"),
    sa.Column("delay_ms", REAL, comment="how late host stamps are after GNSS; null where there are none"),
    sa.Column("line", sa.LargeBinary, nullable=False, comment="WKB LineString of the path, EPSG:25833"),
    sa.Column("rig", sa.LargeBinary, nullable=False, comment="the rig document it was located with, zlib"),
    sa.Column(
        "poses",
        sa.LargeBinary,
        nullable=False,
        comment="where the car was, for whether a sign was in view: npz",
    ),
    sa.Column("content_sha256", TEXT, nullable=False, comment="of every file that was read"),
    sa.Column("fix_quality", JSON, nullable=False, comment="GGA quality → number of fixes"),
    sa.Column("cameras", JSON, nullable=False, comment="annotated cameras"),
    sa.Column("warnings", JSON, nullable=False, comment="sentences for a person"),
    sa.Column("skipped", JSON, nullable=False, comment="what was left out → how many"),
    sa.Column("software", TEXT, nullable=False, comment="version of twin that read it"),
    comment="Recorded drives, with their current annotations.",
)

drive_method = sa.Table(
    "drive_method",
    metadata,
    sa.Column("drive_id", TEXT, primary_key=True, comment="the drive"),
    sa.Column("method", TEXT, primary_key=True, comment="adjusted, single-frame or paper"),
    sa.Column(
        "n_unplaced",
        sa.Integer,
        nullable=False,
        comment="annotated objects without a position that may stand near: no sign is missing beside them",
    ),
    sa.Column("corrections", JSON, nullable=False, comment="what the adjustment found out about the car"),
    sa.Column(
        "misfits",
        JSON,
        nullable=False,
        default=list,
        comment="in which ways the drive does not fit itself: its claims are for review",
    ),
    sa.Column(
        "absence_gap",
        TEXT,
        nullable=False,
        default="",
        comment="why a sign that was not seen may stand all the same; empty where nothing speaks for that",
    ),
    comment="What one method found out about a drive.",
)

sighting = sa.Table(
    "sighting",
    metadata,
    sa.Column("drive_id", TEXT, primary_key=True, comment="the drive"),
    sa.Column("method", TEXT, primary_key=True, comment="the method that located it"),
    sa.Column("number", sa.Integer, primary_key=True, comment="counts the sightings of a drive"),
    sa.Column("object", TEXT, nullable=False, comment="the annotator's or tracker's id"),
    sa.Column("camera", TEXT, nullable=False, comment="the camera"),
    sa.Column("frame", sa.Integer, nullable=False, comment="number of the frame, from 0"),
    sa.Column("epoch_ns", sa.BigInteger, nullable=False, comment="when it was seen, nanoseconds UTC"),
    sa.Column("kind", TEXT, nullable=False, comment="foot or box"),
    sa.Column("u_px", REAL, nullable=False, comment="column, pixels from the centre of the first"),
    sa.Column("v_px", REAL, nullable=False, comment="row, likewise"),
    sa.Column("east_m", REAL, comment="where it puts the object, EPSG:25833, metres; null where it does not"),
    sa.Column("north_m", REAL, comment="likewise"),
    sa.Column("cov_ee_m2", REAL, comment="covariance, grid east and east, m²"),
    sa.Column("cov_en_m2", REAL, comment="grid east and north, m²"),
    sa.Column("cov_nn_m2", REAL, comment="grid north and north, m²"),
    sa.Column("range_m", REAL, comment="from camera to object, metres"),
    sa.Column("speed_mps", REAL, comment="of the car, metres a second"),
    sa.Column("residual_u_px", REAL, comment="seen minus expected, columns; of the adjustment alone"),
    sa.Column("residual_v_px", REAL, comment="likewise, rows"),
    sa.Column("eye_east_m", REAL, comment="where the camera was, EPSG:25833, metres"),
    sa.Column("eye_north_m", REAL, comment="likewise"),
    sa.Column("rejected", TEXT, nullable=False, comment="why it does not count; empty if it does"),
    sa.Column(
        "is_measured",
        sa.Boolean,
        nullable=False,
        comment="false: the annotation tool interpolated it; it counts as seen, not as measured",
    ),
    sa.Column("width_px", REAL, comment="of a box; null for a foot, and of drives read before schema 11"),
    sa.Column("height_px", REAL, comment="likewise"),
    comment="One annotated pixel of one object in one frame.",
)

estimate = sa.Table(
    "estimate",
    metadata,
    sa.Column("estimate_id", TEXT, primary_key=True, comment="drive:object:method"),
    sa.Column("drive_id", TEXT, nullable=False, index=True, comment="the drive"),
    sa.Column("object", TEXT, nullable=False, comment="the annotator's or tracker's id"),
    sa.Column("label", TEXT, nullable=False, comment="as annotated"),
    sa.Column("skiltnummer", TEXT, nullable=False, comment="codes of its plates, top down, joined by ;"),
    sa.Column("method", TEXT, nullable=False, comment="adjusted, single-frame or paper"),
    sa.Column("east_m", REAL, nullable=False, comment="easting, EPSG:25833, metres"),
    sa.Column("north_m", REAL, nullable=False, comment="northing, likewise"),
    sa.Column(
        "height_m", REAL, nullable=False, comment="ellipsoidal, metres; of paper that of the car's fix"
    ),
    sa.Column("sigma_height_m", REAL, comment="one sigma, metres; null where the method does not tell"),
    sa.Column("cov_ee_m2", REAL, nullable=False, comment="covariance, grid east and east, m²"),
    sa.Column("cov_en_m2", REAL, nullable=False, comment="grid east and north, m²"),
    sa.Column("cov_nn_m2", REAL, nullable=False, comment="grid north and north, m²"),
    sa.Column("n_sightings", sa.Integer, nullable=False, comment="that it rests on"),
    sa.Column("n_frames", sa.Integer, nullable=False, comment="in which it was seen"),
    sa.Column("n_cameras", sa.Integer, nullable=False, comment="that saw it"),
    sa.Column("cameras", JSON, nullable=False, comment="their names"),
    sa.Column("first_ns", sa.BigInteger, nullable=False, comment="first sighting, nanoseconds UTC"),
    sa.Column("last_ns", sa.BigInteger, nullable=False, comment="last sighting, nanoseconds UTC"),
    sa.Column("range_min_m", REAL, nullable=False, comment="nearest sighting, metres"),
    sa.Column("n_rejected", sa.Integer, nullable=False, comment="sightings that do not count"),
    sa.Column("flags", TEXT, nullable=False, comment="remarks, joined by ;"),
    sa.Column(
        "budget", JSON, nullable=False, comment="source of error → covariance, true east and north, m²"
    ),
    sa.Column("nvdb_type", sa.Integer, comment="vegobjekttype of an object that is no sign; null for signs"),
    sa.Column(
        "text", TEXT, comment="on its plates, joined as their codes are; null where none was annotated"
    ),
    comment="Where one object stands, by one drive and one method.",
)

annotation_set = sa.Table(
    "annotation_set",
    metadata,
    sa.Column("drive_id", TEXT, primary_key=True, comment="the drive"),
    sa.Column(
        "number", sa.Integer, primary_key=True, autoincrement=False, comment="counts the sets of a drive"
    ),
    sa.Column("annotations_sha256", TEXT, comment="of its files; null: read before schema 9"),
    sa.Column("read_at", TEXT, comment="when it was last read, UTC; null likewise"),
    sa.Column("folder", TEXT, nullable=False, comment="where it was read from"),
    sa.Column(
        "is_complete", sa.Boolean, nullable=False, comment="declared: every sign in view was annotated"
    ),
    sa.Column("is_current", sa.Boolean, nullable=False, comment="whether it counts: one of each drive does"),
    sa.Column("n_annotations", sa.Integer, nullable=False, comment="annotated points and boxes"),
    sa.Column("n_sightings", sa.Integer, nullable=False, comment="with a position, of the method read last"),
    sa.Column("n_objects", sa.Integer, nullable=False, comment="likewise"),
    comment="Each drive's annotations as they were read, a row for each version of them.",
)


def _kept(table: sa.Table) -> sa.Table:
    columns = (
        sa.Column(c.name, c.type, primary_key=c.primary_key, nullable=c.nullable, comment=c.comment)
        for c in table.columns
    )
    number = sa.Column(
        "annotation_set", sa.Integer, primary_key=True, comment="number of the annotation set that it came of"
    )
    said = f"As {table.name}, of annotation sets that are not current."
    return sa.Table(f"{table.name}_kept", metadata, *columns, number, comment=said)


KEPT = {table: _kept(table) for table in (drive, drive_method, sighting, estimate)}
"""What came of annotation sets that are not current; the tables themselves hold the current ones alone."""

change = sa.Table(
    "change",
    metadata,
    sa.Column("change_id", TEXT, primary_key=True, comment="the finding's id: the same in every match"),
    sa.Column(
        "verdict",
        TEXT,
        nullable=False,
        index=True,
        comment="unchanged, moved, wrong_type, new, missing, not_observable or review",
    ),
    sa.Column("reason", TEXT, nullable=False, comment="one sentence, in English"),
    sa.Column("confidence", REAL, nullable=False, comment="probability that the verdict is right, 0 to 1"),
    sa.Column("nvdb_type", sa.Integer, nullable=False, comment="95 Skiltpunkt or 96 Skiltplate"),
    sa.Column("nvdb_id", sa.BigInteger, comment="NVDB's object; null where NVDB has none"),
    sa.Column("nvdb_version", sa.Integer, comment="its version at the match"),
    sa.Column("skiltnummer_nvdb", TEXT, nullable=False, comment="codes in NVDB, top down, joined by ;"),
    sa.Column("skiltnummer_seen", TEXT, nullable=False, comment="codes as seen, likewise"),
    sa.Column("distance_m", REAL, comment="from NVDB's position to the measured one, metres"),
    sa.Column("distance_sigma_m", REAL, comment="its one sigma, metres"),
    sa.Column("cov_ee_m2", REAL, comment="covariance of the measured position, grid east and east, m²"),
    sa.Column("cov_en_m2", REAL, comment="grid east and north, m²"),
    sa.Column("cov_nn_m2", REAL, comment="grid north and north, m²"),
    sa.Column("drive_ids", TEXT, nullable=False, comment="drives that saw it, or looked for it, joined by ,"),
    sa.Column("n_sightings", sa.Integer, nullable=False, comment="that it rests on"),
    sa.Column("east_m", REAL, nullable=False, comment="where the sign stands now, EPSG:25833, metres"),
    sa.Column("north_m", REAL, nullable=False, comment="likewise"),
    sa.Column(
        "terms",
        JSON,
        nullable=False,
        default=dict,
        comment="what verdict and confidence rest on: twin help matching",
    ),
    sa.Column("cameras", TEXT, comment="that saw it, or looked for it, joined by ,"),
    comment="What the last match says of each sign: a finding a row.",
)

decision_log = sa.Table(
    "decision_log",
    metadata,
    sa.Column("id", ROWID, primary_key=True, comment="counts the entries"),
    sa.Column(
        "batch", sa.Integer, nullable=False, index=True, comment="what one command or one match decided"
    ),
    sa.Column("change_id", TEXT, nullable=False, index=True, comment="the finding"),
    sa.Column(
        "kind",
        TEXT,
        nullable=False,
        comment="decided, undone, opinion, …: twin help decisions-and-review",
    ),
    sa.Column("decision", TEXT, nullable=False, comment="open, accept, dismiss or defer"),
    sa.Column("reason", TEXT, nullable=False, comment="why, as the person wrote"),
    sa.Column("by", TEXT, nullable=False, comment="who"),
    sa.Column("at", TEXT, nullable=False, comment="when, UTC"),
    sa.Column("evidence", JSON, nullable=False, comment="what the decision rested on"),
    sa.Column("undo_of", sa.BigInteger, comment="the entry that this one takes back"),
    sa.Column(
        "session",
        TEXT,
        nullable=False,
        index=True,
        comment="of a page in which it was answered; else empty",
    ),
    sa.Column(
        "request",
        TEXT,
        index=True,
        unique=True,
        comment="the page's key of its request, which it may send twice",
    ),
    sa.Column(
        "cause",
        JSON_OR_NULL,
        comment="why it was opened again, as a kind with facts; null where there is none",
    ),
    comment="Every decision ever made: rows are added, never changed; kept also while a finding is absent.",
)
"""Every decision ever made: rows are added, never changed; kept also while a finding is absent."""

decision = sa.Table(
    "decision",
    sa.MetaData(),
    *(sa.Column(c.name, c.type, comment=c.comment) for c in decision_log.columns),
    comment="The decision that holds for each change: a view, the last row of the log that is no opinion.",
)

_DECISION = sa.DDL("""
CREATE VIEW decision AS SELECT * FROM decision_log AS e
  WHERE e.id = (SELECT max(n.id) FROM decision_log AS n WHERE n.change_id = e.change_id
    AND n.kind NOT IN ('opinion', 'withdrawn'))
""")  # type: ignore[no-untyped-call]
sa.event.listen(metadata, "after_create", _DECISION)
_DECISION_LOG_RULES = """
CREATE TRIGGER decision_log_keeps BEFORE UPDATE ON decision_log
  BEGIN SELECT RAISE(ABORT, 'decisions are never changed'); END
--
CREATE TRIGGER decision_log_stays BEFORE DELETE ON decision_log
  BEGIN SELECT RAISE(ABORT, 'decisions are never deleted'); END
"""
for _rule in _DECISION_LOG_RULES.split("--"):
    sa.event.listen(metadata, "after_create", sa.DDL(_rule).execute_if(dialect="sqlite"))  # type: ignore[no-untyped-call]

pole_key = sa.Table(
    "pole_key",
    metadata,
    sa.Column("member", TEXT, primary_key=True, comment="drive:object"),
    sa.Column("pole", TEXT, nullable=False, index=True, comment="key of the pole that it belonged to"),
    comment="Which pole an estimate belonged to in the last match.",
)

known_mark = sa.Table(
    "known_mark",
    metadata,
    sa.Column("id", ROWID, primary_key=True, comment="counts the rows"),
    sa.Column("drive_id", TEXT, nullable=False, comment="the drive"),
    sa.Column("clicks", TEXT, nullable=False, comment="what was clicked for the pole"),
    sa.Column("pole", TEXT, nullable=False, index=True, comment="the key that the pole got first"),
    sa.Column("east_m", REAL, nullable=False, index=True, comment="easting, EPSG:25833, metres"),
    sa.Column("north_m", REAL, nullable=False, comment="northing, likewise"),
    sa.Column("skiltnummer", TEXT, nullable=False, comment="codes of its plates, top down, joined by ;"),
    sa.UniqueConstraint("drive_id", "clicks", "pole"),
    comment="By what every match knows the poles of earlier ones again.",
)
"""By what every match knows the poles of earlier ones again: the key that a pole first got stays its own."""

kept_part = sa.Table(
    "kept_part",
    metadata,
    sa.Column("kind", TEXT, primary_key=True, comment="views, clock, fused, drive, results, …"),
    sa.Column("key", TEXT, primary_key=True, comment="drive, or square of the grid, that it is of"),
    sa.Column(
        "arrays",
        sa.LargeBinary,
        nullable=False,
        comment="what was worked out: a line of JSON that names arrays, then these",
    ),
    comment="What the last match worked out that the next one may use: it can be deleted at any time.",
)


sent = sa.Table(
    "sent",
    metadata,
    sa.Column("id", ROWID, primary_key=True, comment="counts the rows"),
    sa.Column("tag", TEXT, nullable=False, comment="of the set, which carries it as its eksternRef"),
    sa.Column("api", TEXT, nullable=False, comment="which API Skriv"),
    sa.Column(
        "change_id",
        TEXT,
        nullable=False,
        index=True,
        comment="the finding; of a set that names none the SHA-256 of its XML",
    ),
    sa.Column("state", TEXT, nullable=False, comment="how far the sending came"),
    sa.Column("set_id", TEXT, comment="API Skriv's own id, once it is known"),
    sa.Column("digest", TEXT, nullable=False, comment="SHA-256 of the operations"),
    sa.Column(
        "objects",
        JSON,
        nullable=False,
        comment="type, id, tempId of a new object, and the mirror's version and time of change before",
    ),
    sa.Column("file", TEXT, nullable=False, comment="that it was sent from"),
    sa.Column("at", TEXT, nullable=False, comment="last change of this row, UTC"),
    sa.UniqueConstraint("tag", "change_id"),
    comment="What was sent to API Skriv: a row for each finding of each set, written before the request.",
)


METHODS = tuple(Method)
"""Geolocation methods, best first."""
