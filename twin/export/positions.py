"""Positions as a table, for whoever wants neither QGIS nor GeoPackages: a line an estimate, with sigmas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.export.geojson import plain
from twin.export.layers import COLUMNS
from twin.tables import csv_bytes

if TYPE_CHECKING:
    import geopandas as gpd

_PLACES = {"easting": 4, "northing": 4, "longitude": 9, "latitude": 9}
_DECIMALS = 4


def positions_csv(projected: gpd.GeoDataFrame, geographic: gpd.GeoDataFrame) -> bytes:
    """Write the layer ``estimates``: its columns, then where each stands.

    Parameters
    ----------
    projected, geographic : GeoDataFrame
        The same rows in EPSG:25833 and EPSG:4326.

    Returns
    -------
    bytes
        CSV. ``easting`` and ``northing`` in EPSG:25833, ``longitude`` and ``latitude`` in WGS84, metres and
        degrees; what is not known is empty. `twin evaluate` and others read it as a survey.
    """
    names = [column.name for column in COLUMNS["estimates"]]
    columns = {name: plain(projected[name]) for name in names}
    places = (projected.geometry.x, projected.geometry.y, geographic.geometry.x, geographic.geometry.y)
    for (name, decimals), values in zip(_PLACES.items(), places, strict=True):
        columns[name] = np.round(values.to_numpy(), decimals).tolist()
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    return csv_bytes(
        list(columns),
        (
            {
                name: round(value, _DECIMALS) if isinstance(value, float) and name not in _PLACES else value
                for name, value in row.items()
            }
            for row in rows
        ),
    )
