"""Points, directions and datums on the ellipsoid: what turns metres on the road into coordinates.

Everything is vectorised: arguments broadcast against each other and results have the broadcast shape. NaN in
gives NaN out, never an infinity. Latitude and longitude are degrees on GRS80 (EUREF89 unless the name says
otherwise), azimuths degrees clockwise from *true* north, UTM is EPSG:25833.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Geod, Proj, Transformer

from geoloc.errors import GeolocError

FloatArray = NDArray[np.float64]

GRS80_SEMI_MAJOR_AXIS_M = 6_378_137.0
PAPER_EARTH_RADIUS_M = 6_371_000.0

# ITRF2020 → ETRF2000 as EPSG:10586 and EUREF Technical Note 1 give it. Spelled out, because asking PROJ for
# "ITRF to EUREF89" returns a silent null where grids are absent, and older PROJ databases lack ITRF2020.
_ETRF2000_FROM_ITRF2020 = (
    "+proj=pipeline "
    "+step +proj=unitconvert +xy_in=deg +xy_out=rad "
    "+step +proj=cart +ellps=GRS80 "
    "+step +proj=helmert +x=0.0538 +y=0.0518 +z=-0.0822 +rx=0.002106 +ry=0.01274 +rz=-0.020592 +s=0.00225 "
    "+dx=0.0001 +dy=0 +dz=-0.0017 +drx=8.1e-05 +dry=0.00049 +drz=-0.000792 +ds=0.00011 "
    "+t_epoch=2015 +convention=position_vector "
    "+step +inv +proj=cart +ellps=GRS80 "
    "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
)
# Without the NKG deformation grids the result is up to 4.5 cm from the official one in Norway, horizontally.
_GRIDLESS_SIGMA_M = 0.05
_SHIFT_BOUNDS_M = (0.1, 2.0)


class Euref89(NamedTuple):
    """A position in EUREF89, and what the change of datum adds to its uncertainty."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    """Ellipsoidal."""
    extra_sigma_m: float
    """One sigma a horizontal axis, systematic for a whole region: add it in quadrature."""


@cache
def _geod() -> Geod:
    return Geod(ellps="GRS80")


@cache
def _utm33_transformer() -> Transformer:
    return Transformer.from_crs("EPSG:4258", "EPSG:25833", always_xy=True)


@cache
def _utm33_projection() -> Proj:
    return Proj("EPSG:25833")


@cache
def _etrf2000_transformer() -> Transformer:
    return Transformer.from_pipeline(_ETRF2000_FROM_ITRF2020)


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
    """
    azimuth, distance = inverse(latitude0_deg, longitude0_deg, latitude_deg, longitude_deg)
    return distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))


def geographic_from_enu(
    latitude0_deg: ArrayLike, longitude0_deg: ArrayLike, east_m: ArrayLike, north_m: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Undo `enu_offset`: latitude and longitude of a point given in metres east and true north."""
    east, north = _broadcast(east_m, north_m)
    azimuth = np.degrees(np.arctan2(east, north))
    return direct(latitude0_deg, longitude0_deg, azimuth, np.hypot(east, north))


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


def euref89_from_itrf2020(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike, epoch_year: ArrayLike
) -> Euref89:
    """Bring positions from ITRF2020 at their epoch to EUREF89, Norway's fixed frame.

    Satellite positions without Norwegian corrections (PPP, Galileo HAS, WGS84) drift with the continent,
    2.7 cm a year in Norway: 0.85 m away from EUREF89 in 2027.

    Parameters
    ----------
    latitude_deg, longitude_deg : array_like (...)
        ITRF2020, GRS80.
    height_m : array_like (...)
        Ellipsoidal.
    epoch_year : array_like (...)
        Decimal year of the measurement, e.g. 2026.9.

    Returns
    -------
    Euref89
        Rows with a NaN in any argument are NaN.

    Raises
    ------
    GeolocError
        If a horizontal shift is not between 0.1 and 2 m: outside Europe, or an epoch that cannot be right.

    Notes
    -----
    By ETRF2000 (EPSG:7931), the 14-parameter transformation of EUREF Technical Note 1, without deformation
    grids: within 4.5 cm horizontally and 12 cm vertically of Kartverket's official one in Norway.
    """
    lat, lon, height, epoch = _broadcast(latitude_deg, longitude_deg, height_m, epoch_year)
    shape = lat.shape
    lon2, lat2, height2, _ = _etrf2000_transformer().transform(
        lon.ravel(), lat.ravel(), height.ravel(), epoch.ravel()
    )
    known = np.isfinite(lat) & np.isfinite(lon) & np.isfinite(height) & np.isfinite(epoch)
    moved = [np.where(known, _finite(values, shape), np.nan) for values in (lat2, lon2, height2)]
    _check_shift(inverse(lat, lon, moved[0], moved[1])[1][known], epoch[known])
    return Euref89(moved[0], moved[1], moved[2], _GRIDLESS_SIGMA_M)


def _check_shift(shift_m: FloatArray, epoch_year: FloatArray) -> None:
    low, high = _SHIFT_BOUNDS_M
    wrong = ~((shift_m >= low) & (shift_m <= high))
    if not wrong.any():
        return
    raise GeolocError(
        f"ITRF2020 to EUREF89 moves {wrong.sum()} of {wrong.size} positions by an impossible distance "
        f"(first: {shift_m[wrong][0]:.2f} m at epoch {epoch_year[wrong][0]:.2f}, expected {low} to {high} m)"
        ": check that the drive is in Europe, that its datum is ITRF2020 and that its dates are right."
    )
