"""A flat working frame for a simulated world, tied to the ellipsoid through geocentric coordinates.

Deliberately not the route that the estimator takes (geodesic azimuth and distance on the ellipsoid): an
error in one of the two shows as a difference between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pyproj

from geoloc.arrays import FloatArray

ETRS89_GEOGRAPHIC_3D = "EPSG:4937"
ETRS89_GEOCENTRIC = "EPSG:4936"


@cache
def _transformer(source: str, target: str) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(source, target, always_xy=True)


def _xyz(transformer: pyproj.Transformer, x: Any, y: Any, z: Any) -> FloatArray:
    x, y, z = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float), np.asarray(z, float))
    return np.stack([np.asarray(part, dtype=float) for part in transformer.transform(x, y, z)], axis=-1)


def rotation_geocentric_from_enu(latitude_deg: FloatArray, longitude_deg: FloatArray) -> FloatArray:
    """East, north and up of a place as columns in geocentric axes, ``(..., 3, 3)``."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    zero = np.zeros_like(lat)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    north = np.stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    return np.stack([east, north, up], axis=-1)


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """East, north, up in metres on the plane that touches the ellipsoid at one place (EUREF89).

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float
        Origin; `height_m` ellipsoidal.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float

    def geographic_from_enu(self, enu_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Latitude and longitude in degrees and ellipsoidal height of points ``(..., 3)``."""
        to_geocentric = _transformer(ETRS89_GEOGRAPHIC_3D, ETRS89_GEOCENTRIC)
        origin = _xyz(to_geocentric, self.longitude_deg, self.latitude_deg, self.height_m)
        geocentric = origin + enu_m @ self._axes().T
        back = _transformer(ETRS89_GEOCENTRIC, ETRS89_GEOGRAPHIC_3D)
        lon_lat_h = _xyz(back, geocentric[..., 0], geocentric[..., 1], geocentric[..., 2])
        return lon_lat_h[..., 1], lon_lat_h[..., 0], lon_lat_h[..., 2]

    def enu_from_geographic(
        self, latitude_deg: FloatArray, longitude_deg: FloatArray, height_m: FloatArray
    ) -> FloatArray:
        """Points ``(..., 3)`` of this frame from latitude, longitude and ellipsoidal height."""
        to_geocentric = _transformer(ETRS89_GEOGRAPHIC_3D, ETRS89_GEOCENTRIC)
        origin = _xyz(to_geocentric, self.longitude_deg, self.latitude_deg, self.height_m)
        offset = _xyz(to_geocentric, longitude_deg, latitude_deg, height_m) - origin
        return np.asarray(offset @ self._axes())

    def rotation_local_from_frame(self, latitude_deg: FloatArray, longitude_deg: FloatArray) -> FloatArray:
        """Turn this frame's axes into east, north, up at another place, ``(..., 3, 3)``.

        Meridians converge: 500 m east at 63.4 N true north has turned by 0.009 degrees.
        """
        there = rotation_geocentric_from_enu(np.asarray(latitude_deg), np.asarray(longitude_deg))
        return np.asarray(np.swapaxes(there, -1, -2) @ self._axes())

    def _axes(self) -> FloatArray:
        return rotation_geocentric_from_enu(np.asarray(self.latitude_deg), np.asarray(self.longitude_deg))
