"""Directions: which way a sign faces, and from grid to true north."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nvdb.datakatalog.ids import Ansiktsside

_AGAINST_METERING: Final = 180.0

_TURN: Final = {
    # The face looks towards the traffic it is for: against that traffic's direction of travel.
    Ansiktsside.MED_METRERINGSRETNING: _AGAINST_METERING,
    Ansiktsside.MOT_METRERINGSRETNING: 0.0,
    Ansiktsside.TOSIDIG: _AGAINST_METERING,
}
"""Degrees from the metering direction to the (first) face, where the side of the road does not matter."""

_TURN_TO_ROAD: Final = {"H": -90.0, "V": 90.0}
"""Degrees from the metering direction to the road, seen from its right (H) and left (V) side."""


def facing_azimuth(
    ansiktsside: ArrayLike, metering_azimuth_deg: ArrayLike, sideposisjon: ArrayLike = ""
) -> NDArray[np.float64]:
    """Azimuth that a plate's face looks towards, from property 1894 *Ansiktsside, rettet mot*.

    The catalogue defines the property as "what the face of the plate, that is the motive, is directed
    towards", and its values name the traffic or the road:

    ====  ===========================  ===========================================================
    2714  Trafikk i metreringsretning  read by those who drive with the metering: looks against it
    2717  Trafikk mot metreringsretning  read by those who drive against it: looks along it
    2837  Parallelt mot veg            plate along the road, motive towards the road
    2838  Parallelt fra veg            plate along the road, motive away from the road
    3698  Tosidig                      both: against the metering first, along it second
    ====  ===========================  ===========================================================

    For the two parallel ones the side of the road has to be known. A plate that stands obliquely has the
    nearest of these values, so the result is good to some tens of degrees and no better.

    Parameters
    ----------
    ansiktsside : array_like of int (...)
        Enum ids of :class:`nvdb.datakatalog.ids.Ansiktsside`. Anything else (0, unknown ids) gives NaN.
    metering_azimuth_deg : array_like (...)
        Direction of growing meter values where the sign stands, clockwise from grid or true north.
    sideposisjon : array_like of str (...)
        ``H`` or ``V``: side of the road, seen along the metering. Only the parallel values need it.

    Returns
    -------
    (..., 2) array, degrees, [0, 360)
        In the frame of `metering_azimuth_deg`: grid in, grid out; true in, true out. The second column is
        the other face of a two-sided plate, NaN for every other. NaN where the direction is unknown.
    """
    enum, metering, side = np.broadcast_arrays(
        np.asarray(ansiktsside, dtype=np.int64),
        np.asarray(metering_azimuth_deg, dtype=np.float64),
        np.asarray(sideposisjon, dtype=np.str_),
    )
    turn = np.full(enum.shape, np.nan)
    for value, degrees in _TURN.items():
        turn[enum == value] = degrees
    for code, degrees in _TURN_TO_ROAD.items():
        turn[(enum == Ansiktsside.PARALLELT_MOT_VEG) & (side == code)] = degrees
        turn[(enum == Ansiktsside.PARALLELT_FRA_VEG) & (side == code)] = degrees + 180.0
    second = np.where(enum == Ansiktsside.TOSIDIG, 0.0, np.nan)
    return wrap_deg(metering[..., np.newaxis] + np.stack([turn, second], axis=-1))


def true_azimuth(azimuth_grid_deg: ArrayLike, east: ArrayLike, north: ArrayLike) -> NDArray[np.float64]:
    """Azimuth from true north, of an azimuth from the grid north of EPSG:25833 at a place.

    True is grid plus meridian convergence, which PROJ computes (``Proj.get_factors``). It is -4.1° at
    10.4°E, 63.4°N and +15° at Vardø: far too much to leave out.

    Parameters
    ----------
    azimuth_grid_deg, east, north : array_like (n,)
        Degrees clockwise, and EPSG:25833 metres.

    Returns
    -------
    (n,) array, degrees, [0, 360)
        NaN where any input is NaN.
    """
    azimuth, x, y = np.broadcast_arrays(
        *(np.asarray(values, dtype=np.float64) for values in (azimuth_grid_deg, east, north))
    )
    known = np.isfinite(azimuth) & np.isfinite(x) & np.isfinite(y)
    result = np.full(azimuth.shape, np.nan)
    if known.any():
        import pyproj

        utm33 = pyproj.Proj("EPSG:25833")
        lon, lat = utm33(x[known], y[known], inverse=True)
        result[known] = wrap_deg(azimuth[known] + utm33.get_factors(lon, lat).meridian_convergence)
    return result


def wrap_deg(azimuth_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bring azimuths into [0, 360)."""
    wrapped = np.mod(azimuth_deg, 360.0)
    # mod of a tiny negative number rounds up to 360 itself.
    return np.where(wrapped == 360.0, 0.0, wrapped)
