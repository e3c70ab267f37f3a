"""Objects on the ground → GeoPackage in UTM33 for QGIS, GeoJSON in WGS84."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.locate.combine import ellipse, ring95_m
from twin.errors import ExportRefusedError
from twin.objects.against_nvdb import Compared, Comparison
from twin.objects.locate import DriveObjects, GroundObject
from twin.objects.nvdb import EPSG_UTM33
from twin.objects.rows import ComparedRow, ObjectRow, rounded
from twin.objects.shapes import geometry_of
from twin.store.atomic_files import replacing

if TYPE_CHECKING:
    import geopandas as gpd

GEOPACKAGE = "objects_utm33.gpkg"
GEOJSON = "objects.geojson"
CORNERS = "corners.geojson"
EPSG_WGS84 = 4326
_LAYERS = {"point": "points", "line": "lines", "area": "areas"}
_GPKG_TYPES = {"points": "Point", "lines": "MultiLineString", "areas": "Polygon"}
_CORNERS = 64
"""Of an ellipse's polygon."""
_DEGREES, _METRES = 9, 3


def write_objects(found: DriveObjects, folder: Path, comparison: Comparison | None = None) -> list[Path]:
    """Write `GEOPACKAGE`, and in WGS84 `GEOJSON` and `CORNERS`: all of them or none.

    Parameters
    ----------
    found : DriveObjects
    folder : Path
        Made if it does not exist; files of an earlier call are replaced.
    comparison : Comparison, optional
        Adds the layers ``compared_points``, ``compared_lines`` and ``compared_areas``.

    Raises
    ------
    ExportRefusedError
        A file cannot be written, or is open in QGIS: what was there is as it was.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    layers = _layers(found.objects)
    if comparison is not None:
        layers |= _compared_layers(comparison.rows)
    try:
        with replacing(folder, (GEOPACKAGE, GEOJSON, CORNERS)) as staging:
            for number, (name, frame) in enumerate(layers.items()):
                pyogrio.write_dataframe(
                    frame,
                    staging / GEOPACKAGE,
                    layer=name,
                    driver="GPKG",
                    geometry_type=_geometry_type(name),
                    # QGIS 3.22 and GDAL 3.6, still in use, only half support 1.4.
                    dataset_options={"VERSION": "1.3"} if number == 0 else None,
                    layer_options={"GEOMETRY_NAME": "geom", "FID": "fid", "SPATIAL_INDEX": "YES"},
                )
            text = json.dumps(_geojson(found.objects), ensure_ascii=False, allow_nan=False, indent=1)
            (staging / GEOJSON).write_text(text + "\n", encoding="utf-8", newline="\n")
            pyogrio.write_dataframe(
                layers["corners"].to_crs(EPSG_WGS84),
                staging / CORNERS,
                driver="GeoJSON",
                layer_options={"RFC7946": "YES", "COORDINATE_PRECISION": str(_DEGREES)},
            )
    except (OSError, DataSourceError, DataLayerError) as error:
        why = getattr(error, "strerror", None) or "a file could not be written in full"
        raise ExportRefusedError(
            f"cannot write to {folder} ({why}): free space on the disk or name a folder that can be written"
        ) from error
    return [folder / name for name in (GEOPACKAGE, GEOJSON, CORNERS)]


def _geometry_type(name: str) -> str:
    if name in _GPKG_TYPES:
        return f"{_GPKG_TYPES[name]} Z"
    if name == "corners":
        return "Point Z"
    return {"points": "Point", "lines": "MultiLineString", "areas": "MultiPolygon"}.get(
        name.removeprefix("compared_"), "Polygon"
    )


def _grid(one: GroundObject) -> FloatArray:
    """Corners in EPSG:25833 with ellipsoidal heights, (k, 3)."""
    outline = one.outline
    east, north = utm33_from_geographic(outline.latitude_deg, outline.longitude_deg)
    return np.stack([east, north, outline.height_m], axis=1)


def _layers(objects: Sequence[GroundObject]) -> dict[str, gpd.GeoDataFrame]:
    """Every layer, the one below on the map last."""
    import geopandas as gpd

    layers = {}
    for kind, name in _LAYERS.items():
        own = [one for one in objects if one.kind == kind]
        rows = [asdict(ObjectRow.of(one)) for one in own]
        if rows:
            shapes = [geometry_of(one, _grid(one)) for one in own]
            layers[name] = gpd.GeoDataFrame(rows, geometry=shapes, crs=EPSG_UTM33).astype(
                {"nvdb_type": "Int64"}
            )
    corners, ellipses = _corners(objects)
    return {**layers, "corners": corners, "ellipses": ellipses}


def _corners(objects: Sequence[GroundObject]) -> tuple[gpd.GeoDataFrame, gpd.GeoDataFrame]:
    """Return corners with their errors, and the ellipses that hold them with 95 % probability."""
    import geopandas as gpd
    import shapely

    rows, points, rings = [], [], []
    for one in objects:
        outline, grid = one.outline, _grid(one)
        total = utm33_covariance_from_enu(outline.corner_m2, outline.latitude_deg, outline.longitude_deg)
        own = np.sqrt(np.trace(outline.own_m2, axis1=1, axis2=2) / 2.0)
        following = outline.correlation()
        major, minor, azimuth = ellipse(total)
        for k, covariance in enumerate(total):
            east, north = np.sqrt(np.diag(covariance))
            rows.append(
                {
                    "object": one.object,
                    "label": one.label,
                    "number": k + 1,
                    "part": int(outline.part[k]) + 1,
                    "height_m": rounded(outline.height_m[k]),
                    "sigma_height_m": rounded(outline.sigma_height_m[k]),
                    "sigma_east_m": rounded(east),
                    "sigma_north_m": rounded(north),
                    "correlation_east_north": rounded(covariance[0, 1] / (east * north)),
                    "sigma_major_m": rounded(major[k]),
                    "sigma_minor_m": rounded(minor[k]),
                    "grid_azimuth_deg": rounded(azimuth[k]),
                    "own_sigma_m": rounded(own[k]),
                    "correlation_next": rounded(following[k]),
                    "range_m": rounded(outline.range_m[k]),
                }
            )
            points.append(shapely.Point(grid[k]))
            rings.append(shapely.Polygon(ring95_m(covariance, _CORNERS) + grid[k, :2]))
    corners = gpd.GeoDataFrame(rows, geometry=points, crs=EPSG_UTM33)
    named = corners[["object", "label", "number", "sigma_major_m", "sigma_minor_m"]]
    return corners, gpd.GeoDataFrame(named, geometry=rings, crs=EPSG_UTM33)


def _compared_layers(rows: Sequence[Compared]) -> dict[str, gpd.GeoDataFrame]:
    import geopandas as gpd
    import shapely

    kinds: Mapping[str, tuple[int, type]] = {
        "compared_points": (0, shapely.MultiPoint),
        "compared_lines": (1, shapely.MultiLineString),
        "compared_areas": (2, shapely.MultiPolygon),
    }
    layers = {}
    for name, (dimensions, several) in kinds.items():
        own = [one for one in rows if shapely.get_dimensions(one.geometry) == dimensions]
        if not own:
            continue
        shapes = [
            one.geometry if hasattr(one.geometry, "geoms") or not dimensions else several([one.geometry])
            for one in own
        ]
        layers[name] = gpd.GeoDataFrame(
            [asdict(ComparedRow.of(one)) for one in own], geometry=shapes, crs=EPSG_UTM33
        )
    return layers


def _geojson(objects: Sequence[GroundObject]) -> dict[str, Any]:
    """RFC 7946: longitude, latitude and ellipsoidal height."""
    import shapely

    features = []
    for number, one in enumerate(objects):
        outline = one.outline
        place = np.round(np.stack([outline.longitude_deg, outline.latitude_deg], axis=1), _DEGREES)
        corners = np.column_stack([place, np.round(outline.height_m, _METRES)])
        shape = geometry_of(one, corners)
        if isinstance(shape, shapely.Polygon):
            shape = shapely.geometry.polygon.orient(shape)  # right-hand rule, section 3.1.6
        features.append(
            {
                "type": "Feature",
                "id": number + 1,
                "geometry": shapely.geometry.mapping(shape),
                "properties": asdict(ObjectRow.of(one)),
            }
        )
    return {"type": "FeatureCollection", "name": "objects", "features": features}
