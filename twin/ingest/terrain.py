"""A ground raster (GeoTIFF) → :class:`~geoloc.earth.terrain.Terrain` of the surroundings of a drive."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, utm33_from_geographic
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.earth.heights import ellipsoidal_from_nn2000
from geoloc.earth.terrain import Terrain
from geoloc.trajectory.trajectory import Trajectory
from twin.errors import ConfigError, MissingExtraError, TerrainError
from twin.store.kinds import Method

if TYPE_CHECKING:
    from pyproj import CRS


HEIGHT_SYSTEMS = ("NN2000", "ellipsoidal")
MARGIN_M = MAX_RANGE_M + 20.0
"""Ground further from the drive than this is never looked at."""
MAX_NODES = 50_000_000
"""400 MB of heights: 7 km by 7 km at 1 m."""

EPSG_UTM33 = 25833
_UTM33 = f"EPSG:{EPSG_UTM33}"
_NN2000 = 5941
_LOWEST_M, _HIGHEST_M = -500.0, 9000.0


def ground_of(
    path: Path | str | None, heights: str | None, trajectory: Trajectory, method: str
) -> Terrain | None:
    """Read the terrain around a drive; None where none was named.

    Raises
    ------
    ConfigError
        Heights are declared of no terrain, or the method knows none.
    TerrainError
        As :func:`read_terrain`.
    """
    if path is None:
        if heights is not None:
            raise ConfigError(
                "Heights of a terrain are declared, but there is no terrain: give --terrain too."
            )
        return None
    if method == Method.PAPER:
        raise ConfigError(
            "The paper's method knows no terrain: leave --terrain out, or use another --method."
        )
    knots = trajectory.knots
    return read_terrain(
        path, *utm33_from_geographic(knots.latitude_deg, knots.longitude_deg), heights=heights
    )


def read_terrain(
    path: Path | str,
    east_m: ArrayLike,
    north_m: ArrayLike,
    *,
    heights: str | None = None,
    margin_m: float = MARGIN_M,
    noise_m: float = 0.02,
) -> Terrain:
    """Read the ground around a drive from a raster that GDAL knows, best a GeoTIFF.

    Only the part around the drive is read, whatever the raster's size. One in another CRS than EPSG:25833 is
    resampled to it.

    Parameters
    ----------
    path : Path or str
        One raster; tiles are joined by ``gdalbuildvrt``.
    east_m, north_m : array_like (n,)
        Where the car drove, EPSG:25833. NaN is passed over.
    heights : {"NN2000", "ellipsoidal"}, optional
        What the raster's heights are. Default: what its vertical CRS says.
    margin_m : float
        How far around the drive.
    noise_m : float
        One sigma of what each node has for itself: 2 cm for a model of asphalt from laser scanning.

    Returns
    -------
    Terrain
        Ellipsoidal heights; NaN where the raster has none.

    Raises
    ------
    MissingExtraError
        The extra `terrain` is not installed.
    TerrainError
        The raster cannot be read, has no CRS, does not say what its heights are, or lies elsewhere; NN2000
        cannot be turned into ellipsoidal heights; or the part is too large.
    """
    path = Path(path)
    if heights is not None and heights not in HEIGHT_SYSTEMS:
        raise TerrainError(f'The heights of {path} are "{heights}": use one of {", ".join(HEIGHT_SYSTEMS)}.')
    east, north = np.asarray(east_m, dtype=np.float64), np.asarray(north_m, dtype=np.float64)
    known = np.isfinite(east) & np.isfinite(north)
    if not known.any():
        raise TerrainError(f"No position of the drive is known, so no part of {path} can be chosen.")
    bounds = (
        east[known].min() - margin_m,
        north[known].min() - margin_m,
        east[known].max() + margin_m,
        north[known].max() + margin_m,
    )
    west, south, step, grid, system = _part(path, bounds, heights)
    if system == "NN2000":
        grid = _ellipsoidal(path, west, south, step, grid)
    return Terrain(west, south, step, grid, noise_m=noise_m)


def _part(
    path: Path, bounds: tuple[float, ...], heights: str | None
) -> tuple[float, float, float, FloatArray, str]:
    """South-western node, step and heights inside the bounds, rows going north, and their height system."""
    try:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError as error:
        raise MissingExtraError(f"The ground raster {path}", "rasterio", "terrain") from error
    try:
        # A raster without georeference is told so below, in a sentence.
        with warnings.catch_warnings(action="ignore", category=NotGeoreferencedWarning):
            source = rasterio.open(path)
        with source:
            crs = _crs(path, source)
            system = heights or _height_system(path, crs)
            return (*_window(path, source, crs, bounds), system)
    except (RasterioError, OSError) as error:
        raise TerrainError(f"The ground raster {path} cannot be read ({error}): give a GeoTIFF.") from error


def _crs(path: Path, source: Any) -> CRS:
    from pyproj import CRS

    if source.crs is None:
        raise TerrainError(
            f"The ground raster {path} has no CRS: add one, e.g. gdal_edit.py -a_srs EPSG:5973."
        )
    return CRS.from_user_input(source.crs)


def _height_system(path: Path, crs: CRS) -> str:
    """What the vertical part of the CRS says."""
    vertical = next((part for part in crs.sub_crs_list if part.is_vertical), None)
    if vertical is None and len(crs.axis_info) == 3:
        return "ellipsoidal"
    if vertical is not None and vertical.to_epsg() == _NN2000:
        return "NN2000"
    what = "does not say what its heights are" if vertical is None else f"has heights in {vertical.name}"
    choices = " or ".join(f'"{system}"' for system in HEIGHT_SYSTEMS)
    raise TerrainError(f"The ground raster {path} {what}: declare heights as {choices}.")


def _window(
    path: Path, source: Any, crs: CRS, bounds: tuple[float, ...]
) -> tuple[float, float, float, FloatArray]:
    """Read the part inside the bounds, in EPSG:25833 and with square pixels."""
    from rasterio.enums import Resampling
    from rasterio.vrt import WarpedVRT
    from rasterio.windows import Window

    # The horizontal part alone: GDAL would shift heights on the way, by grids that it may not have.
    flat = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()
    transform, columns, rows = _square_pixels(source, flat)
    step = float(transform.a)
    first = np.array([bounds[0] - transform.c, transform.f - bounds[3]]) / step
    last = np.array([bounds[2] - transform.c, transform.f - bounds[1]]) / step
    left, top = np.maximum(np.floor(first), 0).astype(int).tolist()
    width, height = (np.minimum(np.ceil(last), [columns, rows]).astype(int) - [left, top]).tolist()
    if min(width, height) < 2:
        raise TerrainError(f"The ground raster {path} does not cover the drive: give one that does.")
    if width * height > MAX_NODES:
        raise TerrainError(
            f"The ground raster {path} has {width * height:,} nodes around the drive, more than"
            f" {MAX_NODES:,}: give a coarser one, or split the drive."
        )
    with WarpedVRT(
        source,
        src_crs=flat.to_wkt(),
        crs=_UTM33,
        transform=transform,
        width=columns,
        height=rows,
        resampling=Resampling.bilinear,
    ) as warped:
        values = warped.read(1, window=Window(left, top, width, height), masked=True)
    heights = values.astype(np.float64).filled(np.nan)
    with np.errstate(invalid="ignore"):
        heights[(heights < _LOWEST_M) | (heights > _HIGHEST_M)] = np.nan
    west, south = transform.c + (left + 0.5) * step, transform.f - (top + height - 0.5) * step
    return float(west), float(south), step, heights[::-1].copy()


def _square_pixels(source: Any, flat: CRS) -> tuple[Any, int, int]:
    """Transform, columns and rows of the raster in EPSG:25833: its own if it is there already."""
    from rasterio.warp import calculate_default_transform

    own = source.transform
    if flat.to_epsg() == EPSG_UTM33 and np.isclose(own.a, -own.e) and own.b == own.d == 0.0:
        return own, source.width, source.height
    transform, columns, rows = calculate_default_transform(
        flat.to_wkt(), _UTM33, source.width, source.height, *source.bounds
    )
    return transform, columns, rows


def _ellipsoidal(path: Path, west: float, south: float, step: float, grid: FloatArray) -> FloatArray:
    """Turn NN2000 into ellipsoidal heights, a row at a time."""
    result = np.empty_like(grid)
    east = west + np.arange(grid.shape[1]) * step
    how = ""
    for row, values in enumerate(grid):
        lat, lon = geographic_from_utm33(east, south + row * step)
        result[row], sigma_m, how = ellipsoidal_from_nn2000(lat, lon, values)
        if np.isnan(sigma_m):
            raise TerrainError(f"The heights of {path} are NN2000. {how}")
    return result
