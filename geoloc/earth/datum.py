"""Positions of a moving frame (ITRF) brought to EUREF89, Norway's fixed frame, at the epoch of each.

Every pipeline is spelled out with the grids that it needs. Asking PROJ for "ITRF to EUREF89" would pick
whatever is installed: where the grids are absent, that is a silent null or another country's realisation.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pyproj import Transformer
from pyproj.exceptions import ProjError

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import inverse
from geoloc.errors import GeolocError

VELOCITY_GRID = "eur_nkg_nkgrf17vel.tif"
CORRECTION_GRID = "no_kv_NKGETRF14_EPSG7922_2000.tif"

_GEOCENTRIC = "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=GRS80 "
_GEOGRAPHIC = "+step +inv +proj=cart +ellps=GRS80 +step +proj=unitconvert +xy_in=rad +xy_out=deg"

# EUREF Technical Note 1; EPSG:8405 and EPSG:10586.
_ETRF2000: Mapping[str, str] = MappingProxyType(
    {
        "ITRF2014": (
            "+step +proj=helmert +x=0.0547 +y=0.0522 +z=-0.0741 +rx=0.001701 +ry=0.01029 +rz=-0.016632 "
            "+s=0.00212 +dx=0.0001 +dy=0.0001 +dz=-0.0019 +drx=8.1e-05 +dry=0.00049 +drz=-0.000792 "
            "+ds=0.00011 +t_epoch=2010 +convention=position_vector "
        ),
        "ITRF2020": (
            "+step +proj=helmert +x=0.0538 +y=0.0518 +z=-0.0822 +rx=0.002106 +ry=0.01274 +rz=-0.020592 "
            "+s=0.00225 +dx=0.0001 +dy=0 +dz=-0.0017 +drx=8.1e-05 +dry=0.00049 +drz=-0.000792 "
            "+ds=0.00011 +t_epoch=2015 +convention=position_vector "
        ),
    }
)
# Häkli et al. (2023): ITRF2014 → ETRF2014 at the epoch, back to 2000.0 by the velocities of the land, from
# there to ETRF93 by Kartverket's grid of shifts, and on to 1995.0, the epoch of EUREF89.
_NKG2020 = (
    "+step +proj=helmert +x=0 +y=0 +z=0 +rx=0 +ry=0 +rz=0 +s=0 +dx=0 +dy=0 +dz=0 "
    "+drx=8.5e-05 +dry=0.000531 +drz=-0.00077 +ds=0 +t_epoch=1989 +convention=position_vector "
    f"+step +inv +proj=deformation +t_epoch=2000.0 +grids={VELOCITY_GRID} +ellps=GRS80 "
    f"+step +proj=xyzgridshift +grids={CORRECTION_GRID} +ellps=GRS80 "
    f"+step +proj=deformation +dt=-5 +grids={VELOCITY_GRID} +ellps=GRS80 "
)
# EPSG:9991, the other way round.
_ITRF2014_FROM_ITRF2020 = (
    "+step +inv +proj=helmert +x=0.0014 +y=0.0009 +z=-0.0014 +rx=0 +ry=0 +rz=0 +s=0.00042 "
    "+dx=0 +dy=0.0001 +dz=-0.0002 +drx=0 +dry=0 +drz=0 +ds=0 +t_epoch=2015 +convention=position_vector "
)
_NKG_PIPELINES = {"ITRF2014": _NKG2020, "ITRF2020": _ITRF2014_FROM_ITRF2020 + _NKG2020}

DATUMS = tuple(_ETRF2000)
"""Frames that can be brought to EUREF89. WGS84 is none: its realisations differ by decimetres to metres."""

_GRID_SIGMA_M = 0.02
_GRIDLESS_SIGMA_M = 0.045
_GRIDLESS_SIGMA_UP_M = 0.12
_SHIFT_BOUNDS_M = (0.1, 2.0)


class Euref89(NamedTuple):
    """Positions in EUREF89, and what the change of datum adds to their uncertainty."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    """Ellipsoidal."""
    extra_sigma_m: float
    """One sigma a horizontal axis, systematic for a whole region: add it in quadrature."""
    extra_sigma_up_m: float
    """One sigma of the height, systematic as well."""
    how: str
    """Which transformation was used, one sentence."""


@cache
def _gridless(datum: str) -> Transformer:
    return Transformer.from_pipeline(_GEOCENTRIC + _ETRF2000[datum] + _GEOGRAPHIC)


def _by_grids(datum: str) -> Transformer | None:
    """The official transformation; None where a grid is not installed: PROJ refuses such a pipeline."""
    try:
        return Transformer.from_pipeline(_GEOCENTRIC + _NKG_PIPELINES[datum] + _GEOGRAPHIC)
    except ProjError:
        return None


def euref89_from_itrf(
    datum: str,
    latitude_deg: ArrayLike,
    longitude_deg: ArrayLike,
    height_m: ArrayLike,
    epoch_year: ArrayLike,
) -> Euref89:
    """Bring positions from ITRF at their epoch to EUREF89, Norway's fixed frame.

    Satellite positions without Norwegian corrections (PPP, Galileo HAS) drift with the continent, 2.7 cm a
    year in Norway: 0.85 m away from EUREF89 in 2027. All rows go the same way, so that no seam runs through
    a drive: by the NKG grids if they are installed and cover every row, else without grids.

    Parameters
    ----------
    datum : {"ITRF2014", "ITRF2020"}
    latitude_deg, longitude_deg : array_like (...)
        On GRS80, in that frame.
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
        If the frame is not one of `DATUMS`, or a horizontal shift is not between 0.1 and 2 m: outside
        Europe, or an epoch that cannot be right.

    Notes
    -----
    With grids: NKG2020, Kartverket's official transformation (Häkli et al. 2023, "The NKG2020
    transformation", doi:10.1515/jogs-2022-0155), 1 to 2 cm. Without: ETRF2000 by the 14 parameters of EUREF
    Technical Note 1, in Norway within 4.5 cm horizontally and 15 cm vertically of the official one in 2027.
    """
    if datum not in _ETRF2000:
        raise GeolocError(
            f"There is no way from {datum} to EUREF89: the datum is one of {', '.join(DATUMS)}."
        )
    columns = np.broadcast_arrays(
        *(
            np.asarray(value, dtype=np.float64)
            for value in (latitude_deg, longitude_deg, height_m, epoch_year)
        )
    )
    lat, lon, _, epoch = columns
    known = np.asarray(np.isfinite(columns).all(axis=0))
    moved, official = None, _by_grids(datum)
    if official is not None:
        moved = _transformed(official, columns, known)
    if moved is not None and np.isfinite(moved[0][known]).all():
        sigma, sigma_up, how = _GRID_SIGMA_M, _GRID_SIGMA_M, "by the NKG2020 grids"
    else:
        why = "the NKG2020 grids are not installed" if moved is None else "outside the NKG2020 grids"
        moved = _transformed(_gridless(datum), columns, known)
        sigma, sigma_up = _GRIDLESS_SIGMA_M, _GRIDLESS_SIGMA_UP_M
        how = f"without grids, which adds 4.5 cm ({why}: `twin help datum-and-heights`)"
    _check_shift(datum, inverse(lat, lon, moved[0], moved[1])[1][known], epoch[known])
    return Euref89(*moved, sigma, sigma_up, f"Positions brought from {datum} to EUREF89 {how}.")


def _transformed(
    transformer: Transformer, columns: tuple[FloatArray, ...], known: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude and height in the new frame; NaN in rows that are not known or not covered."""
    lat, lon, height, epoch = (np.array(column, dtype=np.float64).ravel() for column in columns)
    lon2, lat2, height2, _ = transformer.transform(lon, lat, height, epoch)
    moved = [np.asarray(values, dtype=np.float64).reshape(known.shape) for values in (lat2, lon2, height2)]
    good = known & np.isfinite(moved).all(axis=0)
    lat3, lon3, height3 = (np.where(good, values, np.nan) for values in moved)
    return lat3, lon3, height3


def _check_shift(datum: str, shift_m: FloatArray, epoch_year: FloatArray) -> None:
    low, high = _SHIFT_BOUNDS_M
    wrong = ~((shift_m >= low) & (shift_m <= high))
    if not wrong.any():
        return
    raise GeolocError(
        f"{datum} to EUREF89 moves {wrong.sum()} of {wrong.size} positions by an impossible distance "
        f"(first: {shift_m[wrong][0]:.2f} m at epoch {epoch_year[wrong][0]:.2f}, expected {low} to {high} m)"
        f": check that the drive is in Europe, that its datum is {datum} and that its dates are right."
    )
