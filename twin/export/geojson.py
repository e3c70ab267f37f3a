"""GeoJSON as RFC 7946 wants it: longitude and latitude in WGS84, no ``crs``, an id on every feature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    rows = zip(*(_plain(frame[name]) for name in names), strict=True)
    features = [
        json.dumps(
            _feature(dict(zip(names, row, strict=True)), KEY[layer], point),
            ensure_ascii=False,
            allow_nan=False,
        )
        for row, point in zip(rows, frame.geometry, strict=True)
    ]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f'{{"type": "FeatureCollection", "name": {json.dumps(layer)}, "features": [\n')
        file.write(",\n".join(features))
        file.write("\n]}\n" if features else "]}\n")


def _feature(properties: dict[str, Any], key: str, point: Any) -> dict[str, Any]:
    geometry = None
    if point is not None:
        position = [round(point.x, DECIMALS), round(point.y, DECIMALS)]
        geometry = {"type": "Point", "coordinates": position}
    return {"type": "Feature", "id": properties[key], "geometry": geometry, "properties": properties}


def _plain(column: pd.Series[Any]) -> list[Any]:
    """Give what JSON knows: null where there is no value, ISO 8601 for a moment, Python's own numbers."""
    import pandas as pd

    if isinstance(column.dtype, pd.DatetimeTZDtype):
        column = column.map(_iso8601, na_action="ignore")
    values: list[Any] = column.astype(object).where(column.notna(), None).tolist()
    return values


def _iso8601(moment: pd.Timestamp) -> str:
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
