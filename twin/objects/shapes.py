"""Outlines → geometries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from twin.objects.locate import GroundObject

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


def plane_geometry(one: GroundObject) -> BaseGeometry:
    """Point, lines or polygon of an object in EPSG:25833, in plan."""
    outline = one.outline
    corners = np.stack(utm33_from_geographic(outline.latitude_deg, outline.longitude_deg), axis=1)
    return geometry_of(one, corners)


def geometry_of(one: GroundObject, corners: FloatArray) -> BaseGeometry:
    """Point, lines or polygon of an object through given corners (k, 2) or (k, 3)."""
    import shapely

    if one.kind == "point":
        return shapely.Point(corners[0])
    if one.kind == "area":
        return shapely.Polygon(corners)
    parts = [corners[one.outline.part == number] for number in np.unique(one.outline.part)]
    return shapely.MultiLineString([part.tolist() for part in parts])
