"""The layers that follow from the others: error ellipses, and lines from NVDB's positions to ours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.locate.combine import SIGMAS_95
from twin.export.layers import COLUMNS, EPSG_UTM33, GIVEN, ExportLayers

if TYPE_CHECKING:
    import geopandas as gpd
    from numpy.typing import NDArray
from collections.abc import Mapping
from typing import TYPE_CHECKING

from twin.export.layers import EPSG_WGS84

if TYPE_CHECKING:
    import geopandas as gpd
    from numpy.typing import NDArray

N_VERTICES = 64
"""Corners of an ellipse's polygon; it covers 99.8 % of the ellipse."""


def file_layers(layers: ExportLayers) -> dict[str, gpd.GeoDataFrame]:
    """Return every layer of a file, the one on top of the map first.

    Parameters
    ----------
    layers : ExportLayers
        Normalised.

    Returns
    -------
    dict
        Name → layer in EPSG:25833, for every key of :data:`twin.export.layers.COLUMNS`.
    """
    every = {name: getattr(layers, name) for name in GIVEN}
    every |= {"moves": moves(layers.changes, layers.nvdb_signs), "ellipses": ellipses(layers.estimates)}
    return {name: every[name] for name in COLUMNS}


def ellipses(estimates: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """Draw the ellipses that hold the signs with 95 % probability.

    Parameters
    ----------
    estimates : GeoDataFrame of Point
        Normalised, EPSG:25833.

    Returns
    -------
    GeoDataFrame of Polygon
        An estimate a row, each of `N_VERTICES` corners on the ellipse. An estimate without a position or
        with an axis that is not known has none.
    """
    import geopandas as gpd
    import shapely

    shape = estimates[["sigma_major_m", "sigma_minor_m", "sigma_azimuth_deg"]].notna().all(axis=1)
    known = estimates[shape & estimates.geometry.notna()]
    east, north = shapely.get_coordinates(known.geometry.to_numpy()).T
    convergence = grid_convergence_deg(*geographic_from_utm33(east, north))
    azimuth = np.radians(known["sigma_azimuth_deg"].to_numpy() - convergence)[:, None]
    turn = np.linspace(0.0, 2 * np.pi, N_VERTICES, endpoint=False)
    along = SIGMAS_95 * known["sigma_major_m"].to_numpy()[:, None] * np.cos(turn)
    across = SIGMAS_95 * known["sigma_minor_m"].to_numpy()[:, None] * np.sin(turn)
    ring_east = east[:, None] + along * np.sin(azimuth) - across * np.cos(azimuth)
    ring_north = north[:, None] + along * np.cos(azimuth) + across * np.sin(azimuth)
    polygons = shapely.polygons(np.stack([ring_east, ring_north], axis=-1))
    columns = [column.name for column in COLUMNS["ellipses"]]
    return gpd.GeoDataFrame(known[columns].reset_index(drop=True), geometry=polygons, crs=EPSG_UTM33)


def moves(changes: gpd.GeoDataFrame, nvdb_signs: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """Draw lines from NVDB's positions to the measured ones.

    Parameters
    ----------
    changes, nvdb_signs : GeoDataFrame of Point
        Normalised, EPSG:25833.

    Returns
    -------
    GeoDataFrame of LineString
        A row for each change of an object of NVDB whose distance is known.
    """
    import geopandas as gpd
    import shapely

    paired = changes[changes["nvdb_id"].notna() & changes["distance_m"].notna() & changes.geometry.notna()]
    seen = shapely.get_coordinates(paired.geometry.to_numpy())
    start = _nvdb_positions(paired, seen, nvdb_signs)
    known = np.isfinite(start).all(axis=1)
    columns = [column.name for column in COLUMNS["moves"]]
    return gpd.GeoDataFrame(
        paired.loc[known, columns].reset_index(drop=True),
        geometry=shapely.linestrings(np.stack([start[known], seen[known]], axis=1)),
        crs=EPSG_UTM33,
    )


def _nvdb_positions(
    changes: gpd.GeoDataFrame, seen: NDArray[np.float64], nvdb_signs: gpd.GeoDataFrame
) -> NDArray[np.float64]:
    """Positions in NVDB (n, 2) from which the distances were measured; NaN where there is none.

    Matching measures from one position for all plates of a Skiltpunkt: the point's, or that of a plate. Of
    these, the one that fits the distance is meant.
    """
    import shapely

    ids = nvdb_signs["nvdb_id"].to_numpy()
    poles = nvdb_signs["point_id"].fillna(nvdb_signs["nvdb_id"]).to_numpy(np.int64)
    placed = np.flatnonzero(nvdb_signs.geometry.notna())
    placed = placed[np.argsort(poles[placed], kind="stable")]
    at, pole = shapely.get_coordinates(nvdb_signs.geometry.to_numpy()[placed]), poles[placed]

    wanted = changes["nvdb_id"].to_numpy(np.int64)
    row = np.minimum(np.searchsorted(ids, wanted), max(len(ids) - 1, 0))
    # A finding about an object that the mirror no longer has stands for itself.
    wanted = np.where(ids[row] == wanted, poles[row], wanted) if len(ids) else wanted
    first = np.searchsorted(pole, wanted, side="left")
    n = np.searchsorted(pole, wanted, side="right") - first
    change = np.repeat(np.arange(len(wanted)), n)
    sign = np.repeat(first - (np.cumsum(n) - n), n) + np.arange(len(change))
    apart = np.linalg.norm(at[sign] - seen[change], axis=1)
    misfit = np.abs(apart - changes["distance_m"].to_numpy()[change])
    best = np.lexsort((misfit, change))
    best = best[np.flatnonzero(np.diff(change[best], prepend=-1))]
    found = np.full((len(changes), 2), np.nan)
    found[change[best]] = at[sign[best]]
    return found


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
