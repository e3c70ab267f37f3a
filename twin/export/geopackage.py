"""GeoPackages that QGIS opens in colour: version 1.3, styles in the file, the same bytes for the same data.

Version 1.3 because QGIS 3.22 and GDAL 3.6, still in use, only half support the 1.4 that newer GDAL writes.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.errors import ExportRefusedError
from twin.export.layers import COLUMNS, EPSG_WGS84, GEOMETRY, description
from twin.export.qgis.project import PROJECTS_TABLE, project_row
from twin.export.qgis.qml import style
from twin.store.kinds import QUIET, Decision
from twin.words import Lang

if TYPE_CHECKING:
    import geopandas as gpd

GEOMETRY_COLUMN = "geom"
_DECISIONS = "twin_decisions"
_COMMENTS = "twin_comments"
_LOG = "twin_log"
_SYNCHRONOUS = "OGR_SQLITE_SYNCHRONOUS"
# Where GDAL keeps the metadata of a layer.
_LAYER_METADATA = """
SELECT metadata FROM gpkg_metadata JOIN gpkg_metadata_reference ON md_file_id = id
WHERE table_name = 'changes' AND md_standard_uri = 'http://gdal.org'
"""

# As QGIS 3.22 itself makes it on "Save style in database".
_LAYER_STYLES = """
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  f_table_catalog TEXT(256), f_table_schema TEXT(256), f_table_name TEXT(256), f_geometry_column TEXT(256),
  styleName TEXT(30), styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN, description TEXT, owner TEXT(30),
  ui TEXT(30), update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now'))
)
"""


def write_geopackage(
    layers: Mapping[str, gpd.GeoDataFrame],
    path: Path,
    *,
    time: str,
    log_position: int = 0,
    project: bool = False,
    lang: Lang = Lang.EN,
) -> None:
    """Write layers with their styles into a new GeoPackage.

    Parameters
    ----------
    layers : mapping
        As :func:`twin.export.derived_layers.file_layers` makes them, or in EPSG:4326.
    path : Path
        Must not exist.
    time : str
        ISO 8601 in UTC; stands wherever GeoPackage wants the time of the last change.
    log_position : int
        How far the log of decisions has come (:func:`twin.decisions.log.position`).
    project : bool
        With a QGIS project of the layers (:mod:`twin.export.qgis.project`).
    lang : Lang
        Of what people read in QGIS.

    Raises
    ------
    ExportRefusedError
        What was written does not read back in full, e.g. because the disk is full.
    """
    import pyogrio

    draft = path.with_stem(f"{path.stem}_draft")
    with _unhurried():
        for number, (name, frame) in enumerate(layers.items()):
            pyogrio.write_dataframe(
                _with_lasting_fid(frame) if name == "changes" else frame,
                draft,
                layer=name,
                driver="GPKG",
                geometry_type=GEOMETRY[name],
                use_arrow=False,
                dataset_options={"VERSION": "1.3"} if number == 0 else None,
                layer_options={
                    "GEOMETRY_NAME": GEOMETRY_COLUMN,
                    "FID": "fid",
                    "SPATIAL_INDEX": "YES",
                    "IDENTIFIER": name,
                    "DESCRIPTION": description(name),
                },
                layer_metadata=_decision_metadata(frame, log_position) if name == "changes" else None,
            )
    styles = {
        name: style(name, verdicts=set(frame.get("verdict", ())), lang=lang) for name, frame in layers.items()
    }
    row = project_row(layers, styles, path.name, time, lang) if project else None
    _finish(draft, path, styles, time, row)
    with closing(sqlite3.connect(path)) as database:
        check_rows(database, path, {name: len(frame) for name, frame in layers.items()})


@dataclass(frozen=True, slots=True)
class Answer:
    """What a person said of a change in an exported file.

    Attributes
    ----------
    decision : str
    comment : str or None
        None where that of the export was left as it is.
    author : str
        "" where nobody is named, or whoever the export named.
    """

    decision: str
    comment: str | None = None
    author: str = ""

    def is_said_by(self, other: Answer | None) -> bool:
        """Whether another one holds all that this one says."""
        return other is not None and (
            self.decision == other.decision
            and self.comment in (None, other.comment)
            and self.author in ("", other.author)
        )

    def joined(self, other: Answer) -> Answer | None:
        """Both together; None where they contradict each other."""
        comment = other.comment if self.comment is None else self.comment
        both = Answer(self.decision, comment, self.author or other.author)
        return both if other.is_said_by(both) else None


def edited_answers(path: Path) -> dict[str, Answer]:
    """Decisions, comments and authors in an exported GeoPackage that people changed since it was written.

    A file of an older version has decisions alone. A name alone, without a decision or a comment, is no
    answer. Errors as of :func:`edited_decisions`.
    """
    with _reading(path) as database:
        noted = _noted(database)
        written: dict[str, str] = json.loads(noted[_DECISIONS])
        texts: dict[str, list[str]] = json.loads(noted.get(_COMMENTS, "{}"))
        has = {name for _, name, *_ in database.execute("PRAGMA table_info(changes)")}
        told = "coalesce(comment, ''), coalesce(author, '')" if {"comment", "author"} <= has else "'', ''"
        asked = f"SELECT change_id, coalesce(decision, 'open'), {told} FROM changes"  # noqa: S608 - our own names
        rows = database.execute(asked).fetchall()
    found = {}
    for change, said, comment, author in rows:
        decided, (old_comment, old_author) = written.get(change, Decision.OPEN), texts.get(change, ("", ""))
        answer = Answer(
            said,
            None if comment.strip() == old_comment.strip() else comment.strip(),
            "" if author.strip() == old_author.strip() else author.strip(),
        )
        is_signed = bool(answer.author) and said != Decision.OPEN
        if said != decided or answer.comment is not None or is_signed:
            found[change] = answer
    return found


def edited_decisions(path: Path | str) -> dict[str, str]:
    """Decisions in an exported GeoPackage that a person has changed since it was written.

    Parameters
    ----------
    path : Path or str
        ``twin_utm33.gpkg`` or ``twin_wgs84.gpkg``.

    Returns
    -------
    dict
        change_id → decision.

    Raises
    ------
    ExportRefusedError
        The file is not an export of twin.
    """
    path = Path(path)
    answers = edited_answers(path)
    with _reading(path) as database:
        written = json.loads(_noted(database)[_DECISIONS])
    said = {change: answer.decision for change, answer in answers.items()}
    return {change: one for change, one in said.items() if one != written.get(change, Decision.OPEN)}


def log_position(path: Path) -> int:
    """How far the log of decisions had come when a GeoPackage was exported; errors as above."""
    with _reading(path) as database:
        return int(_noted(database).get(_LOG, "0"))


def changes_in(path: Path) -> list[dict[str, Any]]:
    """Rows of the layer ``changes`` of an exported GeoPackage, with ``east_m, north_m`` in EPSG:25833.

    Nulls and NaN are None; errors as above.
    """
    import pyogrio

    from geoloc.earth.geodesy import utm33_from_geographic

    edited_answers(path)
    frame = pyogrio.read_dataframe(path, layer="changes")
    east, north = frame.geometry.x.to_numpy(), frame.geometry.y.to_numpy()
    if frame.crs.to_epsg() == EPSG_WGS84:
        east, north = utm33_from_geographic(north, east)
    table = frame.drop(columns=frame.geometry.name).assign(east_m=east, north_m=north)
    table = table.astype(object).where(table.notna(), None)
    whole = ("nvdb_type", "nvdb_id", "nvdb_version")
    return [
        {**row, **{name: None if row[name] is None else int(row[name]) for name in whole}}
        for row in table.to_dict("records")
    ]


@contextmanager
def _reading(path: Path) -> Iterator[sqlite3.Connection]:
    """Open an export, not by GDAL, which opens what is not a GeoPackage with a warning."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            yield database
    except (sqlite3.Error, SyntaxError, KeyError, ValueError) as error:
        raise ExportRefusedError(
            f"{path} is not an export of twin, or is damaged: move it away, then export again"
        ) from error


def _noted(database: sqlite3.Connection) -> dict[str, str]:
    """What twin noted in the metadata of the layer ``changes``."""
    from defusedxml.ElementTree import fromstring

    notes = [fromstring(text) for (text,) in database.execute(_LAYER_METADATA)]
    items = [item for note in notes for item in note.iterfind("./Metadata/MDI")]
    return {item.get("key", ""): item.text or "" for item in items}


@contextmanager
def _unhurried() -> Iterator[None]:
    """Let GDAL not wait for the disk: what it writes is copied, and the copy flushed (:mod:`.atomic`)."""
    import pyogrio

    before = pyogrio.get_gdal_config_option(_SYNCHRONOUS)
    pyogrio.set_gdal_config_options({_SYNCHRONOUS: "OFF"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({_SYNCHRONOUS: before})


def _with_lasting_fid(changes: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """Give a change the same row number in every export.

    QGIS edits by row number. Where it still shows the rows of an older export, a decision must not land on
    another change of the newer one.
    """
    # 56 bits: two of a million changes share one once in 140,000 exports, which SQLite then refuses to write.
    ids = changes["change_id"].to_numpy(dtype=object)
    fid = [int.from_bytes(sha256(change.encode()).digest()[:7]) for change in ids]
    # In the order in which SQLite keeps them anyway, which is quicker than to each its place.
    return changes.assign(fid=np.array(fid, dtype=np.int64)).sort_values("fid", ignore_index=True)


def _decision_metadata(changes: gpd.GeoDataFrame, log_position: int) -> Mapping[str, str]:
    """Note which decisions and comments the file was written with: a person edited what differs later."""
    decided = changes[changes["decision"] != Decision.OPEN]
    noted = dict(zip(decided["change_id"], decided["decision"], strict=True))
    told = changes[(changes["comment"] != "") | (changes["author"] != "")]
    texts = dict(zip(told["change_id"], zip(told["comment"], told["author"], strict=True), strict=True))
    return {
        _DECISIONS: json.dumps(noted, ensure_ascii=False),
        _COMMENTS: json.dumps(texts, ensure_ascii=False),
        _LOG: str(log_position),
    }


def _finish(
    draft: Path, path: Path, styles: Mapping[str, str], time: str, project: tuple[str, str, str] | None
) -> None:
    """Add styles and project, put `time` for the clock's times, and copy it all into the file to keep."""
    with closing(sqlite3.connect(draft, isolation_level=None)) as database:
        database.execute("PRAGMA journal_mode=DELETE")
        database.execute("PRAGMA synchronous=OFF")
        database.execute("BEGIN")
        _add_styles(database, styles, time)
        if project is not None:
            # Not registered in gpkg_contents, as QGIS itself leaves it.
            database.execute(PROJECTS_TABLE)
            database.execute("INSERT INTO qgis_projects VALUES (?, ?, ?)", project)
        database.execute("UPDATE gpkg_contents SET last_change = ?", (time,))
        database.execute("UPDATE gpkg_metadata_reference SET timestamp = ?", (time,))
        database.execute("COMMIT")
        # Into a new file: nothing stays of the clock's times in freed space, nor of SQLite's count of writes,
        # which depends on whether the clock's millisecond changed between two of GDAL's.
        database.execute("VACUUM INTO ?", (str(path),))
    draft.unlink()


def _add_styles(database: sqlite3.Connection, styles: Mapping[str, str], time: str) -> None:
    database.execute(_LAYER_STYLES)
    database.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description) VALUES (?, ?, ?, ?)",
        ("layer_styles", "attributes", "layer_styles", "QGIS styles"),
    )
    database.executemany(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
        "styleName, styleQML, styleSLD, useAsDefault, description, owner, update_time) "
        "VALUES ('', '', ?, ?, ?, ?, '', 1, ?, '', ?)",
        [(name, GEOMETRY_COLUMN, name, qml, description(name), time) for name, qml in styles.items()],
    )


def check_rows(database: sqlite3.Connection, path: Path, rows: Mapping[str, int]) -> None:
    """Read back what GDAL may have failed to write without saying so."""
    problems = [text for (text,) in database.execute("PRAGMA quick_check") if text != "ok"]
    for name, wanted in rows.items():
        found = database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]  # noqa: S608 - our own names
        if found != wanted:
            problems.append(f"layer {name} has {found} of {wanted} rows")
    if problems:
        raise ExportRefusedError(f"{path.name} could not be written in full: {'; '.join(problems)}")


@dataclass(frozen=True, slots=True)
class Contents:
    """What an exported GeoPackage holds.

    Attributes
    ----------
    rows : mapping of layer → number of rows
        In the order of :data:`twin.export.layers.COLUMNS`.
    decisions : mapping of decision → number of changes
        As they stand in the file, in the order of :class:`twin.store.kinds.Decision`, then others. What
        nobody has to decide (unchanged, not observable) does not count as open.
    projects : tuple of str
        Names of its QGIS projects.
    """

    rows: Mapping[str, int]
    decisions: Mapping[str, int]
    projects: tuple[str, ...]


def contents_of(path: Path) -> Contents:
    """Say what an exported GeoPackage holds; errors as of :func:`edited_decisions`."""
    with _reading(path) as database:
        rows = {
            name: database.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0]  # noqa: S608 - our names
            for name in COLUMNS
        }
        # What agrees with NVDB, or could not be seen, waits for nobody: "open" there is nothing to decide.
        said = (
            "SELECT coalesce(decision, 'open') AS said, count(*) FROM changes "
            "WHERE said <> 'open' OR verdict NOT IN (SELECT value FROM json_each(?)) "
            "GROUP BY said ORDER BY said"
        )
        counts = dict(database.execute(said, (json.dumps(sorted(QUIET)),)).fetchall())
        known: dict[str, int] = {name: counts.pop(name) for name in Decision if name in counts}
        has = database.execute("SELECT 1 FROM sqlite_master WHERE name = 'qgis_projects'").fetchone()
        names = database.execute("SELECT name FROM qgis_projects ORDER BY name").fetchall() if has else []
    return Contents(rows=rows, decisions=known | counts, projects=tuple(name for (name,) in names))
