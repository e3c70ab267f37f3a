"""One export: all its files, all or none."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import ExportRefusedError
from twin.export.atomic import replacing
from twin.export.geojson import write_geojson
from twin.export.geopackage import edited_decisions, write_geopackage
from twin.export.layers import EPSG_UTM33, EPSG_WGS84, ExportLayers, data_time, normalised
from twin.export.wgs84 import in_wgs84

if TYPE_CHECKING:
    import geopandas as gpd

UTM33 = "twin_utm33.gpkg"
WGS84 = "twin_wgs84.gpkg"
GEOJSON = "changes.geojson"
FILES = (UTM33, WGS84, GEOJSON)


def export_all(
    layers: ExportLayers, folder: Path, *, progress: Callable[[str], None] | None = None
) -> list[Path]:
    """Write the layers for QGIS and for the web.

    ``twin_utm33.gpkg`` (EPSG:25833) and ``twin_wgs84.gpkg`` (EPSG:4326) hold the four layers, each with its
    default QGIS style; ``changes.geojson`` (RFC 7946) holds the changes. The same layers give the same bytes.
    The files take the place of older ones only when all of them are complete on the disk.

    Parameters
    ----------
    layers : ExportLayers
    folder : Path
        Made if it does not exist.
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
        in QGIS; or an older file holds decisions that a person has made in QGIS and that `layers` do not
        have. The older files are then as they were.
    """
    from pyogrio.errors import DataLayerError, DataSourceError

    checked = normalised(layers)
    tell = progress or (lambda _message: None)
    try:
        with replacing(folder, FILES) as staging:
            _write(checked, staging, tell)
            _refuse_to_lose_decisions(folder, checked.changes)
            tell(f"replacing the files in {folder}")
    except (OSError, sqlite3.Error, DataSourceError, DataLayerError) as error:
        raise ExportRefusedError(
            f"cannot export to {folder}: {_cause(error)}; older files there are as they were: "
            "free space on the disk or give a folder that can be written"
        ) from error
    return [folder / name for name in FILES]


def _cause(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    # GDAL's own text is the SQL that failed; it stays in the chain of exceptions.
    return str(error) if isinstance(error, sqlite3.Error) else "the GeoPackage could not be written in full"


def _write(layers: ExportLayers, staging: Path, tell: Callable[[str], None]) -> None:
    time = data_time(layers)
    tell(f"writing {UTM33}")
    write_geopackage(layers, staging / UTM33, epsg=EPSG_UTM33, time=time)
    tell(f"writing {WGS84}")
    geographic = in_wgs84(layers)
    write_geopackage(geographic, staging / WGS84, epsg=EPSG_WGS84, time=time)
    tell(f"writing {GEOJSON}")
    write_geojson(geographic.changes, "changes", staging / GEOJSON)


def _refuse_to_lose_decisions(folder: Path, changes: gpd.GeoDataFrame) -> None:
    """Raise where a person decided in QGIS and the new file would not say so."""
    new = dict(zip(changes["change_id"], changes["decision"], strict=True))
    for name in (UTM33, WGS84):
        if not (folder / name).exists():
            continue
        lost = {
            change: decision
            for change, decision in edited_decisions(folder / name).items()
            if new.get(change) != decision
        }
        if lost:
            change, decision = min(lost.items())
            raise ExportRefusedError(
                f"{folder / name} holds {len(lost)} decision(s) made in QGIS that this export would lose "
                f"(change {change}: {decision}): move the file away or export to another folder"
            )
