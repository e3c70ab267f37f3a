"""Beliefs and roads to drive as files: CSV, GeoJSON, GeoPackage."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33
from twin.belief.belief import Believed
from twin.belief.roads import RoadToDrive
from twin.errors import ExportRefusedError
from twin.store.atomic_files import replacing
from twin.tables import csv_bytes

if TYPE_CHECKING:
    import geopandas as gpd

EPSG_UTM33 = 25833
Rows = Sequence[Believed] | Sequence[RoadToDrive]
_LINE = "line_m"


def _columns(rows: Rows) -> list[str]:
    """Names of the rows' columns: a road's line is its geometry."""
    kind = RoadToDrive if rows and isinstance(rows[0], RoadToDrive) else Believed
    return [field.name for field in fields(kind) if field.name != _LINE]


def csv_of(rows: Rows, *, excel: bool = False) -> bytes:
    """Write a line a row; `excel` as :func:`twin.tables.csv_bytes`."""
    return csv_bytes(_columns(rows), map(asdict, rows), excel=excel)


def geojson_of(rows: Rows) -> bytes:
    """Write points or lines as RFC 7946 wants them, one a line: WGS84, longitude first."""
    names, features = _columns(rows), []
    for row in rows:
        is_road = isinstance(row, RoadToDrive)
        place = np.array(row.line_m if isinstance(row, RoadToDrive) else [(row.east_m, row.north_m)])
        latitude, longitude = geographic_from_utm33(*place.T)
        at = np.round(np.stack([longitude, latitude], axis=1), 7).tolist()
        geometry = {"type": "LineString" if is_road else "Point", "coordinates": at if is_road else at[0]}
        told = {name: getattr(row, name) for name in names}
        feature = {"type": "Feature", "geometry": geometry, "properties": told}
        features.append(json.dumps(feature, ensure_ascii=False, allow_nan=False))
    body = ",\n".join(features)
    return f'{{"type": "FeatureCollection", "features": [\n{body}\n]}}\n'.encode()


def layer_of(rows: Rows) -> gpd.GeoDataFrame:
    """Return points or lines in EPSG:25833."""
    import geopandas as gpd
    import pandas as pd
    import shapely

    shapes = [
        shapely.LineString(row.line_m)
        if isinstance(row, RoadToDrive)
        else shapely.Point(row.east_m, row.north_m)
        for row in rows
    ]
    names = _columns(rows)
    data = pd.DataFrame([[getattr(row, name) for name in names] for row in rows], columns=names)
    whole = [name for name in ("nvdb_type", "nvdb_id") if name in names]
    data = data.astype(dict.fromkeys(whole, "Int64"))
    return gpd.GeoDataFrame(data, geometry=shapes, crs=EPSG_UTM33)


def write_geopackage(layers: Mapping[str, gpd.GeoDataFrame], path: Path) -> None:
    """Write layers into a GeoPackage: the whole of it or nothing.

    Raises
    ------
    ExportRefusedError
        It cannot be written, or is open in QGIS: what was there is as it was.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    try:
        with replacing(path.parent, (path.name,)) as staging:
            for number, (name, frame) in enumerate(layers.items()):
                options: dict[str, Any] = {"dataset_options": {"VERSION": "1.3"}} if number == 0 else {}
                pyogrio.write_dataframe(
                    frame,
                    staging / path.name,
                    layer=name,
                    driver="GPKG",
                    geometry_type="LineString" if name == "roads" else "Point",
                    layer_options={"GEOMETRY_NAME": "geom", "FID": "fid", "SPATIAL_INDEX": "YES"},
                    **options,
                )
    except (OSError, DataSourceError, DataLayerError) as error:
        why = getattr(error, "strerror", None) or "it could not be written in full"
        raise ExportRefusedError(
            f"cannot write {path} ({why}): free space on the disk or name a file that can be written"
        ) from error
