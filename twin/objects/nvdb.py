"""NVDB's objects of any type, with their geometry: from a file, or from API Les."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvdb import Area
from nvdb.client.paging import RawObject, iter_pages
from twin.errors import FileError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from nvdb.client.client import NvdbClient

EPSG_UTM33 = 25833
_UTM33 = ("5973", "25833", "UTM33")
_IDS = ("nvdb_id", "nvdbid", "vegobjektid", "objektid", "lokalid", "id")
"""Columns of a file that may hold an object's id, whatever their case."""
_MARGIN_M = 30.0
_PAGE = 1000


@dataclass(frozen=True, slots=True)
class NvdbObject:
    """One object of NVDB.

    Attributes
    ----------
    nvdb_id : str
    nvdb_type : int
        Vegobjekttype.
    geometry : shapely geometry
        EPSG:25833, in plan.
    """

    nvdb_id: str
    nvdb_type: int
    geometry: BaseGeometry


@dataclass(frozen=True, slots=True)
class NvdbObjects:
    """Objects of one type.

    Attributes
    ----------
    nvdb_type : int
    objects : tuple of NvdbObject
    left_out : int
        Those without a geometry of their own: NVDB has them on the road's centre line, which says along the
        road where they are, and nothing across it.
    """

    nvdb_type: int
    objects: tuple[NvdbObject, ...]
    left_out: int = 0


def read_nvdb_objects(path: Path, nvdb_type: int) -> NvdbObjects:
    """Read objects of one type from a file: whatever GDAL reads as vectors, or an answer of API Les as JSON.

    Raises
    ------
    FileError
        It cannot be read, says no coordinate system, or holds no geometry.
    """
    try:
        document = json.loads(path.read_bytes()) if path.suffix.lower() == ".json" else None
    except (OSError, ValueError) as error:
        raise FileError(f"{path} cannot be read ({error}): give a file of NVDB's objects.") from error
    if isinstance(document, dict) and isinstance(document.get("objekter"), list):
        return _from_les(document["objekter"], nvdb_type, str(path))
    return _from_layers(path, nvdb_type)


def fetch_nvdb_objects(
    client: NvdbClient, nvdb_type: int, bounds_m: tuple[float, float, float, float]
) -> NvdbObjects:
    """Ask API Les for the objects of one type in a box of EPSG:25833, and a little around it.

    Raises
    ------
    NvdbError
        As :func:`nvdb.client.paging.iter_pages`.
    FileError
        An object cannot be read.
    """
    west, south, east, north = bounds_m
    box = Area(bbox=(west - _MARGIN_M, south - _MARGIN_M, east + _MARGIN_M, north + _MARGIN_M))
    params: dict[str, str | int] = {"inkluder": "geometri", "srid": "5973", "antall": _PAGE, **box.params()}
    pages = iter_pages(client, f"/vegobjekter/{nvdb_type}", params)
    return _from_les([one for page in pages for one in page.objects], nvdb_type, "NVDB's answer")


def _from_les(objects: Iterable[RawObject], nvdb_type: int, where: str) -> NvdbObjects:
    import shapely

    found, left_out = [], 0
    for one in objects:
        geometry: Any = one.get("geometri") or {}
        if not geometry.get("wkt") or geometry.get("egengeometri") is False:
            left_out += 1
            continue
        try:
            shape = shapely.force_2d(shapely.from_wkt(geometry["wkt"]))
        except (shapely.errors.GEOSException, TypeError) as error:
            raise FileError(f"{where} has a geometry that is no WKT ({error}): fetch it again.") from error
        if str(geometry.get("srid")) not in _UTM33:
            raise FileError(
                f"{where} has geometries in srid {geometry.get('srid')}: ask for them with srid=5973 (UTM33)."
            )
        found.append(NvdbObject(str(one.get("id", "")), nvdb_type, shape))
    return NvdbObjects(nvdb_type, tuple(found), left_out)


def _from_layers(path: Path, nvdb_type: int) -> NvdbObjects:
    import geopandas as gpd
    import shapely
    from pyogrio.errors import DataLayerError, DataSourceError

    try:
        frame = gpd.read_file(path, engine="pyogrio")
    except (OSError, DataSourceError, DataLayerError) as error:
        raise FileError(
            f"{path} cannot be read ({error}): give GeoJSON or a GeoPackage of NVDB's objects."
        ) from error
    if not isinstance(frame, gpd.GeoDataFrame) or not len(frame):
        raise FileError(f"{path} holds no geometry: give GeoJSON or a GeoPackage of NVDB's objects.")
    if frame.crs is None:
        raise FileError(f"{path} does not say its coordinate system: write it with one, such as EPSG:25833.")
    column = next((name for wanted in _IDS for name in frame.columns if str(name).lower() == wanted), None)
    ids = [str(k + 1) for k in range(len(frame))] if column is None else frame[column].astype(str).tolist()
    shapes = shapely.force_2d(frame.to_crs(EPSG_UTM33).geometry.to_numpy())
    known = [
        NvdbObject(nvdb_id, nvdb_type, shape)
        for nvdb_id, shape in zip(ids, shapes.tolist(), strict=True)
        if shape is not None and not shape.is_empty
    ]
    return NvdbObjects(nvdb_type, tuple(known), len(frame) - len(known))
