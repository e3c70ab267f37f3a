"""The layers in WGS84, by the null transformation that NVDB itself uses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33
from twin.export.layers import EPSG_WGS84

if TYPE_CHECKING:
    import geopandas as gpd
    from numpy.typing import NDArray


def in_wgs84(layers: Mapping[str, gpd.GeoDataFrame]) -> dict[str, gpd.GeoDataFrame]:
    """Layers in EPSG:4326, x longitude and y latitude in degrees.

    EUREF89's degrees are taken as WGS84's, as NVDB does; the two drift apart by 2.5 cm a year.

    Parameters
    ----------
    layers : mapping
        Name → layer, in EPSG:25833.
    """
    return {name: _frame_in_wgs84(frame) for name, frame in layers.items()}


def _frame_in_wgs84(frame: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    import geopandas as gpd
    import shapely

    geometry = shapely.transform(frame.geometry.to_numpy(), _lon_lat)
    return frame.set_geometry(gpd.GeoSeries(geometry, index=frame.index, crs=EPSG_WGS84))


def _lon_lat(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    latitude_deg, longitude_deg = geographic_from_utm33(xy[:, 0], xy[:, 1])
    return np.column_stack([longitude_deg, latitude_deg])
