"""Heights above the geoid: NN2000, Norway's height system, from ellipsoidal heights, and back.

Needs Kartverket's geoid model HREF2018B as a PROJ grid (``docs/datum-and-heights.md``). Without it a height
in NN2000 is unknown: PROJ itself would hand the ellipsoidal height through, 18 to 48 m wrong in Norway.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pyproj import Transformer
from pyproj.exceptions import ProjError

from geoloc.arrays import FloatArray

GEOID_GRID = "no_kv_HREF2018B_NN2000_EUREF89.tif"

# The grid is named, so that nothing else can take its place. PROJ's vgridshift adds the grid's heights of the
# geoid; +inv takes them away: from the ellipsoid to NN2000.
_NN2000_FROM_ELLIPSOIDAL = (
    "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
    f"+step +inv +proj=vgridshift +grids={GEOID_GRID} +multiplier=1 "
    "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
)
_GEOID_SIGMA_M = 0.02
_LOWEST_GEOID_M = 15.0
"""The geoid lies 17 m or more above the ellipsoid everywhere in Norway: less is no geoid model at work."""


class Heights(NamedTuple):
    """Heights in another system; NaN where they are unknown."""

    height_m: FloatArray
    sigma_m: float
    """What the geoid model adds, one sigma; NaN where it is not installed."""
    how: str
    """What was done, or why nothing is known, one sentence."""


def nn2000_from_ellipsoidal(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
) -> Heights:
    """Bring ellipsoidal heights (EUREF89) to NN2000.

    Parameters
    ----------
    latitude_deg, longitude_deg : array_like (...)
        EUREF89.
    height_m : array_like (...)
        Above the GRS80 ellipsoid.

    Returns
    -------
    Heights
        ``height_m`` float64 (...): NaN where an argument is NaN, outside the model, and everywhere if the
        model is not installed.

    Notes
    -----
    HREF2018B of Kartverket, EPSG:9485 (ETRS89 to NN2000 height); 2 cm as EPSG states it.
    """
    return _shifted(latitude_deg, longitude_deg, height_m, "FORWARD")


def ellipsoidal_from_nn2000(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike
) -> Heights:
    """Undo `nn2000_from_ellipsoidal`: heights above the GRS80 ellipsoid from heights in NN2000."""
    return _shifted(latitude_deg, longitude_deg, height_m, "INVERSE")


def _shifted(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, height_m: ArrayLike, direction: str
) -> Heights:
    given = (latitude_deg, longitude_deg, height_m)
    lat, lon, height = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in given))
    unknown = np.full(lat.shape, np.nan)
    try:
        # Not cached: a grid may be installed while a program runs.
        transformer = Transformer.from_pipeline(_NN2000_FROM_ELLIPSOIDAL)
    except ProjError:
        how = "NN2000 heights are unknown: the geoid model HREF2018B is not installed"
        return Heights(unknown, float("nan"), f"{how} (`twin help datum-and-heights`).")
    x, y, z = (np.array(column, dtype=np.float64).ravel() for column in (lon, lat, height))
    shifted = np.asarray(transformer.transform(x, y, z, direction=direction)[2]).reshape(lat.shape)
    with np.errstate(invalid="ignore"):
        plausible = np.isfinite(shifted) & (np.abs(shifted - height) > _LOWEST_GEOID_M)
    return Heights(
        np.where(plausible, shifted, unknown), _GEOID_SIGMA_M, "NN2000 by the geoid model HREF2018B."
    )
