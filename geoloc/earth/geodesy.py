"""Points and directions on the ellipsoid: what turns metres on the road into coordinates.

Everything is vectorised: arguments broadcast against each other and results have the broadcast shape. NaN in
gives NaN out, never an infinity. Latitude and longitude are degrees on GRS80 (EUREF89), azimuths degrees
clockwise from *true* north, UTM is EPSG:25833.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Geod, Proj, Transformer

from geoloc.arrays import FloatArray

GRS80_SEMI_MAJOR_AXIS_M = 6_378_137.0
GRS80_E2 = 0.006_694_380_022_90
PAPER_EARTH_RADIUS_M = 6_371_000.0

_RADIANS = np.pi / 180.0

# Within these the local form of the geodesic is good to a thousandth of a millimetre.
_LOCAL_M = 100.0
_LOCAL_MAX_LATITUDE_DEG = 80.0


@cache
def _geod() -> Geod:
    return Geod(ellps="GRS80")


@cache
def _utm33_transformer() -> Transformer:
    return Transformer.from_crs("EPSG:4258", "EPSG:25833", always_xy=True)


@cache
def _utm33_projection() -> Proj:
    return Proj("EPSG:25833")


def _broadcast(*values: ArrayLike) -> list[FloatArray]:
    """Contiguous float64 copies of one shape: PROJ writes into its arguments."""
    arrays = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values))
    return [np.array(array, dtype=np.float64, order="C") for array in arrays]


def _finite(values: object, shape: tuple[int, ...]) -> FloatArray:
    """PROJ's answer with its infinities ("outside") turned into NaN."""
    array = np.asarray(values, dtype=np.float64).reshape(shape)
    return np.where(np.isfinite(array), array, np.nan)


def direct(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, azimuth_deg: ArrayLike, distance_m: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Solve the direct geodesic problem on GRS80.

    Parameters
    ----------
    latitude_deg, longitude_deg : array_like (...)
        Start.
    azimuth_deg : array_like (...)
        Clockwise from true north at the start.
    distance_m : array_like (...)
        Along the geodesic.

    Returns
    -------
    latitude_deg, longitude_deg : float64 (...)
        End. NaN where an argument is NaN.

    Notes
    -----
    Karney (2013), "Algorithms for geodesics", doi:10.1007/s00190-012-0578-z, as PROJ has it.
    """
    lat, lon, azimuth, distance = _broadcast(latitude_deg, longitude_deg, azimuth_deg, distance_m)
    shape = lat.shape
    lon2, lat2, _ = _geod().fwd(lon.ravel(), lat.ravel(), azimuth.ravel(), distance.ravel())
    # A NaN longitude alone would leave the latitude standing: half an answer.
    bad = np.isnan(lat + lon + azimuth + distance)
    return np.where(bad, np.nan, _finite(lat2, shape)), np.where(bad, np.nan, _finite(lon2, shape))


def inverse(
    latitude1_deg: ArrayLike, longitude1_deg: ArrayLike, latitude2_deg: ArrayLike, longitude2_deg: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Solve the inverse geodesic problem on GRS80.

    Returns
    -------
    azimuth_deg : float64 (...)
        From the first point to the second, clockwise from true north at the first, in [0, 360). Where both
        points coincide it is defined but means nothing.
    distance_m : float64 (...)

    Notes
    -----
    Karney (2013), doi:10.1007/s00190-012-0578-z.
    """
    lat1, lon1, lat2, lon2 = _broadcast(latitude1_deg, longitude1_deg, latitude2_deg, longitude2_deg)
    azimuth, _, distance = _geod().inv(lon1.ravel(), lat1.ravel(), lon2.ravel(), lat2.ravel())
    shape = lat1.shape
    bad = np.isnan(lat1 + lon1 + lat2 + lon2)
    return (
        np.where(bad, np.nan, _finite(azimuth, shape) % 360.0),
        np.where(bad, np.nan, _finite(distance, shape)),
    )


def inverse_haversine(
    latitude_deg: ArrayLike,
    longitude_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    distance_m: ArrayLike,
    radius_m: float = PAPER_EARTH_RADIUS_M,
) -> tuple[FloatArray, FloatArray]:
    """Solve the direct problem on a *sphere*: equations 2 and 3 of the paper, to the letter.

    Kept as the baseline that better methods are compared with: on a sphere of 6371 km a distance comes out
    0.25 % too long north-south and 0.38 % too long east-west at 63.4°N.

    Returns
    -------
    latitude_deg, longitude_deg : float64 (...)

    Notes
    -----
    Shami, Kiss, Haakonsen and Lindseth (2024), arXiv:2401.07582, equations 2 and 3.
    """
    lat, lon, azimuth, distance = _broadcast(latitude_deg, longitude_deg, azimuth_deg, distance_m)
    phi, lam, theta, delta = np.radians(lat), np.radians(lon), np.radians(azimuth), distance / radius_m
    phi2 = np.arcsin(np.sin(phi) * np.cos(delta) + np.cos(phi) * np.sin(delta) * np.cos(theta))
    lam2 = lam + np.arctan2(
        np.sin(theta) * np.sin(delta) * np.cos(phi), np.cos(delta) - np.sin(phi) * np.sin(phi2)
    )
    bad = np.isnan(lam2)
    return np.where(bad, np.nan, np.degrees(phi2)), np.degrees(lam2)


def utm33_from_geographic(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """EUREF89 degrees (EPSG:4258) to EPSG:25833: east and north in metres."""
    lat, lon = _broadcast(latitude_deg, longitude_deg)
    east, north = _utm33_transformer().transform(lon.ravel(), lat.ravel())
    return _finite(east, lat.shape), _finite(north, lat.shape)


def geographic_from_utm33(east_m: ArrayLike, north_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """EPSG:25833 metres to EUREF89 degrees (EPSG:4258): latitude and longitude."""
    east, north = _broadcast(east_m, north_m)
    lon, lat = _utm33_transformer().transform(east.ravel(), north.ravel(), direction="INVERSE")
    return _finite(lat, east.shape), _finite(lon, east.shape)


def grid_convergence_deg(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
    """Azimuth of grid north (UTM33), clockwise from true north: -4.1° in Trondheim, 0 at 15°E.

    ``grid azimuth = true azimuth - convergence``.
    """
    lat, lon = _broadcast(latitude_deg, longitude_deg)
    if not lat.size:  # PROJ refuses to work on nothing
        return lat.copy()
    factors = _utm33_projection().get_factors(lon.ravel(), lat.ravel())
    return _finite(factors.meridian_convergence, lat.shape)


def utm33_scale(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
    """Metres on the UTM33 grid a metre on the ellipsoid: 0.9996 at 15°E, 1.0002 in Trondheim."""
    lat, lon = _broadcast(latitude_deg, longitude_deg)
    if not lat.size:
        return lat.copy()
    factors = _utm33_projection().get_factors(lon.ravel(), lat.ravel())
    return _finite(factors.meridional_scale, lat.shape)


def utm33_covariance_from_enu(
    covariance_m2: ArrayLike, latitude_deg: ArrayLike, longitude_deg: ArrayLike
) -> FloatArray:
    """Turn covariances from east and *true* north to east and north of the UTM33 grid.

    Parameters
    ----------
    covariance_m2 : array_like (..., 2, 2)
        East, true north.
    latitude_deg, longitude_deg : array_like (...)
        Where.

    Returns
    -------
    float64 (..., 2, 2)
        Grid east, grid north, in square metres on the grid.
    """
    gamma = np.radians(grid_convergence_deg(latitude_deg, longitude_deg))
    scale = utm33_scale(latitude_deg, longitude_deg)
    cos, sin = scale * np.cos(gamma), scale * np.sin(gamma)
    grid_R_enu = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    covariance = np.asarray(covariance_m2, dtype=np.float64)
    return np.asarray(grid_R_enu @ covariance @ np.swapaxes(grid_R_enu, -1, -2))


def enu_offset(
    latitude0_deg: ArrayLike, longitude0_deg: ArrayLike, latitude_deg: ArrayLike, longitude_deg: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Metres east and true north of a point as seen from an origin, on the ellipsoid.

    The geodesic's length, split along its azimuth at the origin: heights do not enter. Within 10 km of the
    origin distances between two such points differ from the ellipsoid's by less than 1 cm.

    Returns
    -------
    east_m, north_m : float64 (...)

    Notes
    -----
    Nearby points by the local form (see `geographic_from_enu`) turned round, the others by Karney's inverse.
    """
    points = _broadcast(latitude0_deg, longitude0_deg, latitude_deg, longitude_deg)
    lat0, lon0, lat, lon = (values.ravel() for values in points)
    east, north = _local_offset(lat0, lon0, lat, lon)
    far = _beyond_local(lat0, east, north)
    if far.any():
        azimuth, distance = inverse(lat0[far], lon0[far], lat[far], lon[far])
        east[far] = distance * np.sin(np.radians(azimuth))
        north[far] = distance * np.cos(np.radians(azimuth))
    return east.reshape(points[0].shape), north.reshape(points[0].shape)


def geographic_from_enu(
    latitude0_deg: ArrayLike, longitude0_deg: ArrayLike, east_m: ArrayLike, north_m: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Undo `enu_offset`: latitude and longitude of a point given in metres east and true north.

    Returns
    -------
    latitude_deg, longitude_deg : float64 (...)
        NaN where an argument is NaN.

    Notes
    -----
    Within 100 m by Legendre's series of the geodesic in its length (Torge and Müller, "Geodesy", 4th ed.,
    6.2), with M and N the radii of curvature in the meridian and the prime vertical, ``t = tan φ`` and
    ``η² = e'² cos² φ``::

        Δφ = (n - t (e² + 3 η² n²) / 2N) / M        Δλ = e (1 + t n / N) / (N cos φ)

    The third order that is left out is less than 0.1 µm at 60 m in Norway. Farther points, and those near
    the poles, by Karney's direct solution.
    """
    points = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (latitude0_deg, longitude0_deg, east_m, north_m))
    )
    lat0, lon0, east, north = (values.ravel() for values in points)
    lat, lon = _local_geographic(lat0, lon0, east, north)
    far = _beyond_local(lat0, east, north)
    if far.any():
        azimuth = np.degrees(np.arctan2(east[far], north[far]))
        lat[far], lon[far] = direct(lat0[far], lon0[far], azimuth, np.hypot(east[far], north[far]))
    return lat.reshape(points[0].shape), lon.reshape(points[0].shape)


class _Curvature(NamedTuple):
    """The ellipsoid at some latitudes: what the local form of the geodesic needs."""

    east: FloatArray
    """Radians of longitude a metre, 1 / (N cos φ)."""
    north: FloatArray
    """Radians of latitude a metre, 1 / M."""
    bend: FloatArray
    """How meridians converge, tan φ / N, a metre."""
    eta2: FloatArray
    """3 η²: how M changes."""


def _curvature(latitude_deg: FloatArray) -> _Curvature:
    """By the tangent alone: ``1 - e² sin² φ = (1 + (1 - e²) t²) / (1 + t²)``."""
    tan = np.tan(_RADIANS * latitude_deg)
    square = tan * tan
    cos2 = 1.0 / (1.0 + square)
    east2 = 1.0 + (1.0 - GRS80_E2) * square
    w2 = east2 * cos2
    w = np.sqrt(w2)
    a = GRS80_SEMI_MAJOR_AXIS_M
    return _Curvature(
        east=np.sqrt(east2) * (1.0 / a),
        north=w * w2 * (1.0 / (a * (1.0 - GRS80_E2))),
        bend=tan * w * (1.0 / a),
        eta2=(3.0 * GRS80_E2 / (1.0 - GRS80_E2)) * cos2,
    )


def _local_geographic(
    lat0: FloatArray, lon0: FloatArray, east: FloatArray, north: FloatArray
) -> tuple[FloatArray, FloatArray]:
    at = _curvature(lat0)
    lat = (north - 0.5 * at.bend * (east * east + at.eta2 * north * north)) * at.north
    lon = (1.0 + at.bend * north) * east * at.east
    lat *= 1.0 / _RADIANS
    lon *= 1.0 / _RADIANS
    lat += lat0
    lon += lon0
    # A NaN longitude alone would leave the latitude standing: half an answer.
    lat += 0.0 * lon0
    return lat, lon


def _local_offset(
    lat0: FloatArray, lon0: FloatArray, lat: FloatArray, lon: FloatArray
) -> tuple[FloatArray, FloatArray]:
    at = _curvature(lat0)
    dlon = lon - lon0
    dlon = dlon - 360.0 * np.rint(dlon / 360.0)
    east1, north1 = _RADIANS * dlon / at.east, _RADIANS * (lat - lat0) / at.north
    east, north = east1, north1
    # Each second-order term is read off the other's first-order value, and once more off the result.
    for _ in range(2):
        north = north1 + 0.5 * at.bend * (east * east + at.eta2 * north * north)
        east = east1 / (1.0 + at.bend * north)
    return east, north


def _beyond_local(lat0: FloatArray, east: FloatArray, north: FloatArray) -> NDArray[np.bool_]:
    """Rows for which the local form is not good enough; NaN is not among them."""
    far = east * east + north * north > _LOCAL_M**2
    return np.asarray(far | (np.abs(lat0) > _LOCAL_MAX_LATITUDE_DEG))


def rotation_enu_from_rig(heading_deg: ArrayLike, pitch_deg: ArrayLike, roll_deg: ArrayLike) -> FloatArray:
    """Rotation from the rig (FLU) to east, true north, up: ``Rz(90° - heading) Ry(pitch) Rx(roll)``.

    Parameters
    ----------
    heading_deg : array_like (...)
        Clockwise from true north.
    pitch_deg : array_like (...)
        Positive nose *down* (ISO 8855).
    roll_deg : array_like (...)
        Positive right side down.

    Returns
    -------
    float64 (..., 3, 3)
    """
    heading, pitch, roll = _broadcast(heading_deg, pitch_deg, roll_deg)
    return rotation_from_rpy(roll, pitch, 90.0 - heading)


def rotation_from_rpy(roll_deg: ArrayLike, pitch_deg: ArrayLike, yaw_deg: ArrayLike) -> FloatArray:
    """Rotation ``Rz(yaw) Ry(pitch) Rx(roll)`` from a body (FLU) to the frame of its angles (ISO 8855).

    Returns
    -------
    float64 (..., 3, 3)
    """
    roll, pitch, yaw = (np.radians(angle) for angle in _broadcast(roll_deg, pitch_deg, yaw_deg))
    cr, sr, cp, sp, cy, sy = (
        np.cos(roll),
        np.sin(roll),
        np.cos(pitch),
        np.sin(pitch),
        np.cos(yaw),
        np.sin(yaw),
    )
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rpy_from_rotation(rotation: FloatArray) -> list[float]:
    """Roll, pitch and yaw in degrees of ``Rz(yaw) Ry(pitch) Rx(roll)``; the inverse of `rotation_from_rpy`.

    Straight up or down (pitch ±90°), where only roll and yaw together are defined, the roll is 0.
    """
    R = np.asarray(rotation, dtype=np.float64)
    level = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = np.arctan2(-R[2, 0], level)
    if level < 1e-12:
        roll, yaw = 0.0, np.arctan2(-R[0, 1], R[1, 1])
    else:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    return [float(np.degrees(angle)) for angle in (roll, pitch, yaw)]


def wrap_deg(angle_deg: ArrayLike) -> FloatArray:
    """Angle in [-180, 180)."""
    return (np.asarray(angle_deg, dtype=np.float64) + 180.0) % 360.0 - 180.0


def metres_per_degree(latitude_deg: ArrayLike, height_m: ArrayLike = 0.0) -> tuple[FloatArray, FloatArray]:
    """Metres a degree of longitude (east) and of latitude (north) on GRS80.

    The radii of curvature in the prime vertical and in the meridian, times cos(latitude) for the first.
    Exact for slopes; over 100 m the error of a difference is below 1 mm.
    """
    phi = np.radians(np.asarray(latitude_deg, dtype=np.float64))
    w2 = 1.0 - GRS80_E2 * np.sin(phi) ** 2
    prime_vertical = GRS80_SEMI_MAJOR_AXIS_M / np.sqrt(w2)
    meridian = GRS80_SEMI_MAJOR_AXIS_M * (1.0 - GRS80_E2) / w2**1.5
    height = np.asarray(height_m, dtype=np.float64)
    east = np.radians((prime_vertical + height) * np.cos(phi))
    return np.asarray(east), np.asarray(np.radians(meridian + height))
