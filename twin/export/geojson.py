"""GeoJSON as RFC 7946 wants it: longitude and latitude in WGS84, no ``crs``, an id on every feature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.export.layers import COLUMNS, EPSG_WGS84, KEY

if TYPE_CHECKING:
    import geopandas as gpd
    import pandas as pd

DECIMALS = 7
"""1.1 cm: RFC 7946, section 11.2, asks for no more than the data need."""


def write_geojson(frame: gpd.GeoDataFrame, layer: str, path: Path) -> None:
    """Write a layer of points, one feature a line, so that two exports compare well line by line.

    Parameters
    ----------
    frame : GeoDataFrame
        In EPSG:4326, normalised.
    layer : str
        A key of :data:`twin.export.layers.COLUMNS`; its key column becomes the features' ``id``.
    path : Path
        Overwritten.

    Raises
    ------
    ValueError
        The frame is not in EPSG:4326.
    """
    if frame.crs is None or frame.crs.to_epsg() != EPSG_WGS84:
        raise ValueError("GeoJSON is written from EPSG:4326")
    names = [column.name for column in COLUMNS[layer]]
    columns = (plain(frame[name]) for name in names)
    # One encoder for all features: json.dumps would make one for each.
    encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
    features = [
        encode(_feature(dict(zip(names, row, strict=True)), KEY[layer], position))
        for *row, position in zip(*columns, _positions(frame), strict=True)
    ]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f'{{"type": "FeatureCollection", "name": {json.dumps(layer)}, "features": [\n')
        file.write(",\n".join(features))
        file.write("\n]}\n" if features else "]}\n")


def _positions(frame: gpd.GeoDataFrame) -> list[list[float] | None]:
    """Longitude and latitude of each point; None where there is none."""
    import shapely

    points = frame.geometry.to_numpy()
    known = ~shapely.is_missing(points)
    positions: list[list[float] | None] = [None] * len(points)
    rounded = np.round(shapely.get_coordinates(points), DECIMALS).tolist()
    for row, position in zip(np.flatnonzero(known).tolist(), rounded, strict=True):
        positions[row] = position
    return positions


def _feature(properties: dict[str, Any], key: str, position: list[float] | None) -> dict[str, Any]:
    geometry = None if position is None else {"type": "Point", "coordinates": position}
    return {"type": "Feature", "id": properties[key], "geometry": geometry, "properties": properties}


def plain(column: pd.Series[Any]) -> list[Any]:
    """Return what JSON knows: null where there is no value, ISO 8601 for a moment, Python's own numbers."""
    import pandas as pd

    if isinstance(column.dtype, pd.DatetimeTZDtype):
        column = column.map(_iso8601, na_action="ignore")
    values = column.to_numpy(dtype=object, copy=True)
    values[column.isna().to_numpy()] = None
    return list(values.tolist())


def _iso8601(moment: pd.Timestamp) -> str:
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
