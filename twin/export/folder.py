"""One export: its files, each of them old or new as a whole, none new before all are written."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from twin.changesets.files import is_change_set_file
from twin.errors import ExportRefusedError
from twin.export.derived_layers import file_layers, in_wgs84
from twin.export.geojson import write_geojson
from twin.export.geopackage import Answer, edited_answers, write_geopackage
from twin.export.layers import ExportLayers, data_time, normalised
from twin.export.positions import positions_csv
from twin.store.atomic_files import replacing
from twin.words import Lang

if TYPE_CHECKING:
    import geopandas as gpd

UTM33 = "twin_utm33.gpkg"
WGS84 = "twin_wgs84.gpkg"
GEOJSON = "changes.geojson"
POSITIONS_GEOJSON = "positions.geojson"
POSITIONS_CSV = "positions.csv"
# In the order in which they take the place of older ones. What is not a GeoPackage is derived from the same
# layers and nobody decides in it: it goes last, so that a kill between two renames never leaves it newer than
# a GeoPackage.
FILES = (UTM33, WGS84, GEOJSON, POSITIONS_GEOJSON, POSITIONS_CSV)
GEOPACKAGES = (UTM33, WGS84)
"""The files in which people decide."""


def export_all(
    layers: ExportLayers,
    folder: Path | str,
    *,
    known_answers: Mapping[str, Answer] = MappingProxyType({}),
    log_position: int = 0,
    change_sets: Mapping[str, bytes] = MappingProxyType({}),
    project: bool = False,
    lang: Lang = Lang.EN,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Write the layers for QGIS and for the web.

    ``twin_utm33.gpkg`` (EPSG:25833) and ``twin_wgs84.gpkg`` (EPSG:4326) hold the layers and what
    follows from them (:func:`twin.export.derived_layers.file_layers`), each with its default QGIS style;
    ``changes.geojson`` (RFC 7946) holds the changes, ``positions.geojson`` and ``positions.csv`` the
    estimates with their sigmas. The same layers give the same bytes.
    The files take the place of older ones only when all of them are complete on the disk, one after the other
    in the order above: each is old or new as a whole, and a kill between two renames leaves the first ones
    new and the others old. Exporting again makes them all new. Files of change sets that an earlier export
    wrote and this one does not are removed last: nobody is to send what is no longer accepted.

    Parameters
    ----------
    layers : ExportLayers
    folder : Path or str
        Made if it does not exist.
    known_answers : mapping, optional
        change_id → what was said in the older files that is kept elsewhere, also of changes that `layers` no
        longer have or that are open again.
    log_position : int, optional
        How far the store's log of decisions has come; the GeoPackages note it.
    change_sets : mapping, optional
        Name → content of the files of :func:`twin.changesets.files_of`, which go after those above.
    project : bool, optional
        Also put a QGIS project into ``twin_utm33.gpkg`` (:mod:`twin.export.qgis.project`).
    lang : Lang, optional
        Of what people read in QGIS.
    progress : callable, optional
        Told what is being written.

    Returns
    -------
    list of Path
        The files, in the order above.

    Raises
    ------
    ExportRefusedError
        The layers are not as they must be; the folder cannot be written or the disk is full; a file is open
        in QGIS; or an older file holds decisions that a person has made in QGIS and that neither `layers`
        nor `known_answers` have. The older files are then as they were, except where a rename failed and
        an earlier one could not be taken back (no hard links): the message then names the new files.
    """
    folder = Path(folder)
    from pyogrio.errors import DataLayerError, DataSourceError

    checked = normalised(layers)
    tell = progress or (lambda _message: None)
    try:
        with replacing(folder, (*FILES, *change_sets)) as staging:
            _write(checked, staging, tell, log_position, project, lang)
            for name, content in change_sets.items():
                (staging / name).write_bytes(content)
            _refuse_to_lose_answers(folder, checked.changes, known_answers)
            tell(f"replacing the files in {folder}")
    except (OSError, sqlite3.Error, DataSourceError, DataLayerError) as error:
        raise ExportRefusedError(
            f"cannot export to {folder}: {_cause(error)}; older files there are as they were: "
            "free space on the disk or give a folder that can be written"
        ) from error
    _remove_outdated(folder, change_sets)
    return [folder / name for name in (*FILES, *change_sets)]


def _remove_outdated(folder: Path, change_sets: Mapping[str, bytes]) -> None:
    """Remove sets of earlier exports. One that cannot be removed is not in the provenance: it is not sent."""
    for path in folder.iterdir():
        if is_change_set_file(path.name) and path.name not in change_sets:
            with suppress(OSError):
                path.unlink()


def _cause(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    # GDAL's own text is the SQL that failed; it stays in the chain of exceptions.
    return str(error) if isinstance(error, sqlite3.Error) else "the GeoPackage could not be written in full"


def _write(
    layers: ExportLayers,
    staging: Path,
    tell: Callable[[str], None],
    log_position: int,
    project: bool,
    lang: Lang,
) -> None:
    time = data_time(layers)
    tell(f"writing {UTM33}")
    projected = file_layers(layers)
    write_geopackage(
        projected, staging / UTM33, time=time, log_position=log_position, project=project, lang=lang
    )
    tell(f"writing {WGS84}")
    geographic = in_wgs84(projected)
    write_geopackage(geographic, staging / WGS84, time=time, log_position=log_position, lang=lang)
    tell(f"writing {GEOJSON}")
    write_geojson(geographic["changes"], "changes", staging / GEOJSON)
    tell(f"writing {POSITIONS_GEOJSON} and {POSITIONS_CSV}")
    write_geojson(geographic["estimates"], "estimates", staging / POSITIONS_GEOJSON)
    content = positions_csv(projected["estimates"], geographic["estimates"])
    (staging / POSITIONS_CSV).write_bytes(content)


def _refuse_to_lose_answers(folder: Path, changes: gpd.GeoDataFrame, known: Mapping[str, Answer]) -> None:
    """Raise where a person decided or commented in QGIS and it would be known nowhere after the export."""
    for name in GEOPACKAGES:
        edited = edited_answers(folder / name) if (folder / name).exists() else {}
        rows = changes[changes["change_id"].isin(list(edited))]
        new = {row.change_id: Answer(row.decision, row.comment, row.author) for row in rows.itertuples()}
        lost = {
            change: answer.decision
            for change, answer in edited.items()
            if not (answer.is_said_by(new.get(change)) or answer.is_said_by(known.get(change)))
        }
        if lost:
            change, decision = min(lost.items())
            raise ExportRefusedError(
                f"{folder / name} holds {len(lost)} decision(s) made in QGIS that this export would lose "
                f"(change {change}: {decision}): run `twin export` again or move the file away"
            )
