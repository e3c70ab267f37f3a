"""Stedfesting: where on the road network points lie."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nvdb.errors import RequestError
from nvdb.vegnett.polylinjer import FootPoints, Polylinjer
from nvdb.vegnett.retning import true_azimuth, wrap_deg

if TYPE_CHECKING:
    from nvdb.vegnett.nett import Vegnett

_T = TypeVar("_T", bound=np.generic)

POSITION_DECIMALS: Final = 8
"""NVDB's own: 0.1 mm on a veglenkesekvens of 10 km."""
ON_THE_LINE_M: Final = 0.001
"""A point this near to the centre line is on no side of it: NVDB's geometry is rounded to millimetres."""

NOT_FINITE: Final = "the position is not finite"
NOTHING_NEAR: Final = "no usable link within {:g} m"

_METERS = re.compile(r"([mM])\d+(?:-\d+)?(?=\D*$)")


@dataclass(frozen=True, slots=True, eq=False)
class Stedfestinger:
    """Where n points lie on the road network. Every array has length n.

    Attributes
    ----------
    found : bool
        Whether the point was placed. Where not, `reason` says why, ids are -1, numbers NaN, texts empty.
    reason : object (str)
    veglenke : int64
        Row in the :class:`Vegnett`.
    veglenkesekvensid : int64
    relativ_posisjon : float64
        0 to 1, rounded to NVDB's 8 decimals: linear in the link's 3-D length.
    distance_m : float64
        From the point to the centre line, in plan; not negative.
    right_m : float64
        Across the road: positive right of the *link's* direction, negative left of it.
    sideposisjon : object (str)
        ``H`` or ``V``: side of the road seen along the *metering*, as NVDB's code list 8762 defines it. Empty
        on the centre line, straight beyond the end of a road, and where the metering is unknown. What stands
        on a traffic island (M, MV, MH) or beside a side road (HT, VT) cannot be told from a centre line.
    east, north, height : float64
        The foot on the centre line, EPSG:25833; NN2000, NaN where unknown.
    link_azimuth_grid_deg : float64
        Direction of the link at the foot, clockwise from the grid north of EPSG:25833.
    retning : object (str)
        ``MED``: the link runs with the metering; ``MOT``: against it; empty: unknown.
    metering_azimuth_grid_deg : float64
        Direction of growing meter values at the foot, from grid north. See :meth:`metering_azimuth_deg`.
    meter : float64
        Meter value of the road reference at the foot.
    kortform : object (str)
        Road reference of the foot, ``EV18 S53D1 m2977``; that of the whole link where `meter` is unknown.
    """

    found: NDArray[np.bool_]
    reason: NDArray[np.object_]
    veglenke: NDArray[np.int64]
    veglenkesekvensid: NDArray[np.int64]
    relativ_posisjon: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    right_m: NDArray[np.float64]
    sideposisjon: NDArray[np.object_]
    east: NDArray[np.float64]
    north: NDArray[np.float64]
    height: NDArray[np.float64]
    link_azimuth_grid_deg: NDArray[np.float64]
    retning: NDArray[np.object_]
    metering_azimuth_grid_deg: NDArray[np.float64]
    meter: NDArray[np.float64]
    kortform: NDArray[np.object_]

    def __len__(self) -> int:
        return len(self.found)

    def metering_azimuth_deg(self) -> NDArray[np.float64]:
        """Direction of growing meter values at the feet, clockwise from *true* north; NaN where unknown."""
        return true_azimuth(self.metering_azimuth_grid_deg, self.east, self.north)

    def veglenkeposisjoner(self) -> list[str]:
        """NVDB's short form of each place, ``0.95432972@384192``; empty where not found."""
        places = zip(self.found, self.relativ_posisjon, self.veglenkesekvensid, strict=True)
        return [
            f"{position_text(position)}@{sekvens}" if found else "" for found, position, sekvens in places
        ]


class Stedfester:
    """An index over the links that points may be placed on (:meth:`Vegnett.stedfester` makes it).

    Parameters
    ----------
    vegnett : Vegnett
    rows : int64 array
        Rows of the usable links, ascending.
    """

    def __init__(self, vegnett: Vegnett, rows: NDArray[np.int64]) -> None:
        import shapely

        self._nett = vegnett
        self._rows = rows
        lines = vegnett.geometri[rows]
        self._tree = shapely.STRtree(lines)
        self._lines = Polylinjer(lines)

    def stedfest(self, east: ArrayLike, north: ArrayLike, *, max_distance_m: float = 50.0) -> Stedfestinger:
        """Place points on the nearest link, in plan.

        Where several links are equally near (at a node), the one with the lowest veglenkesekvensid, then the
        lowest position, is taken, whatever order the links came in.

        Parameters
        ----------
        east, north : array_like (n,)
            EPSG:25833, metres. A point that is not finite is not placed.
        max_distance_m : float
            Farther points are not placed.

        Raises
        ------
        RequestError
            Coordinates of unequal length, or a distance that is not above 0.
        """
        x, y = (np.atleast_1d(np.asarray(values, dtype=np.float64)) for values in (east, north))
        if x.shape != y.shape or x.ndim != 1:
            msg = f"stedfest got east of shape {x.shape} and north of shape {y.shape}: give two equal lists."
            raise RequestError(msg)
        if not 0 < max_distance_m < np.inf:
            msg = f"max_distance_m is {max_distance_m:g}: give a distance above 0 m."
            raise RequestError(msg)
        point, line = self._nearest_lines(x, y, max_distance_m)
        feet = self._lines.feet(line, x[point], y[point])
        finite = np.isfinite(x) & np.isfinite(y)
        reason = np.where(finite, NOTHING_NEAR.format(max_distance_m), NOT_FINITE).astype(np.object_)
        reason[point] = ""
        return self._places(len(x), point, self._rows[line], feet, reason)

    def _nearest_lines(
        self, x: NDArray[np.float64], y: NDArray[np.float64], max_distance_m: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Points that have a link near enough (ascending), and which: the lowest of equals."""
        import shapely

        finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        point, line = self._tree.query_nearest(
            shapely.points(x[finite], y[finite]), max_distance=max_distance_m, all_matches=True
        )
        order = np.lexsort((line, point))
        point, first = np.unique(point[order], return_index=True)
        return finite[point], line[order][first].astype(np.int64)

    def _places(
        self,
        n: int,
        point: NDArray[np.int64],
        row: NDArray[np.int64],
        feet: FootPoints,
        reason: NDArray[np.object_],
    ) -> Stedfestinger:
        """Spread what is known of the placed points over all n."""
        nett = self._nett
        retning = nett.retning[row]
        start, slutt = nett.startposisjon[row], nett.sluttposisjon[row]
        # Against the metering the link begins at its highest meter value.
        metered = np.where(retning < 0, 1.0 - feet.fraction, feet.fraction)
        meter = nett.fra_meter[row] + metered * (nett.til_meter[row] - nett.fra_meter[row])
        meter[retning == 0] = np.nan
        turn = np.select([retning > 0, retning < 0], [0.0, 180.0], np.nan)
        kortform = [meter_kortform(*pair) for pair in zip(nett.kortform[row], meter.tolist(), strict=True)]
        return Stedfestinger(
            found=reason == "",
            reason=reason,
            veglenke=_spread(n, point, row, -1),
            veglenkesekvensid=_spread(n, point, nett.veglenkesekvensid[row], -1),
            relativ_posisjon=_spread(
                n, point, np.round(start + feet.fraction * (slutt - start), POSITION_DECIMALS), np.nan
            ),
            distance_m=_spread(n, point, feet.distance_m, np.nan),
            right_m=_spread(n, point, feet.right_m, np.nan),
            sideposisjon=_spread(n, point, _side(feet.right_m * retning), ""),
            east=_spread(n, point, feet.east, np.nan),
            north=_spread(n, point, feet.north, np.nan),
            height=_spread(n, point, feet.height, np.nan),
            link_azimuth_grid_deg=_spread(n, point, feet.azimuth_deg, np.nan),
            retning=_spread(n, point, _RETNING_TEXT[retning], ""),
            metering_azimuth_grid_deg=_spread(n, point, wrap_deg(feet.azimuth_deg + turn), np.nan),
            meter=_spread(n, point, meter, np.nan),
            kortform=_spread(n, point, np.array(kortform, dtype=np.object_), ""),
        )


_RETNING_TEXT: Final = np.array(["", "MED", "MOT"], dtype=np.object_)
"""Text of 0, 1 and -1, in the order that NumPy counts them."""


def _side(right_m: NDArray[np.float64]) -> NDArray[np.object_]:
    sides = np.select([right_m > ON_THE_LINE_M, right_m < -ON_THE_LINE_M], ["H", "V"], "")
    return sides.astype(np.object_)


def _spread(n: int, point: NDArray[np.int64], values: NDArray[_T], missing: object) -> NDArray[_T]:
    column = np.full(n, missing, dtype=values.dtype)
    column[point] = values
    return column


def meter_kortform(kortform: str, meter: float) -> str:
    """Short form of one place on a stretch of road, rounded to whole metres as NVDB does.

    Parameters
    ----------
    kortform : str
        Of the stretch. One without meter values comes back as it is; so does any if `meter` is NaN.
    meter : float
        Of the place.

    >>> meter_kortform("EV18 S53D1 m3212 KD3 m24-560", 100.6)
    'EV18 S53D1 m3212 KD3 m101'
    """
    if meter != meter:  # noqa: PLR0124  (the cheapest test for NaN, and this runs for every point)
        return kortform
    return _METERS.sub(lambda match: f"{match.group(1)}{int(meter + 0.5)}", kortform)


def position_text(position: float) -> str:
    """Write a relative position as NVDB does: up to 8 decimals, at least one.

    >>> position_text(0.95432972), position_text(1.0)
    ('0.95432972', '1.0')
    """
    return np.format_float_positional(position, precision=POSITION_DECIMALS, trim="0")


def stedfester(
    nett: Vegnett,
    *,
    on_date: date | None = None,
    allow_konnektering: bool = False,
    allow_detaljert: bool = False,
    vegkategorier: Collection[str] | None = None,
    trafikantgruppe: str | None = None,
    type_veg: Collection[str] | None = None,
) -> Stedfester:
    """Index the links that points may be placed on; keep it to place points more than once.

    Parameters
    ----------
    nett : Vegnett
    on_date : date, optional
        Day on which the links have to be valid: the day of the drive. Today if left out.
    allow_konnektering, allow_detaljert : bool
        Also links that only connect, and links below the level of vegtrasé. NVDB refuses the first for
        most object types and places none on the second.
    vegkategorier : collection of str, optional
        Only roads of these: ``{"E", "R", "F", "K"}`` is what NVDB's own stedfesting takes if nothing
        else is asked. Links without a road reference do not pass.
    trafikantgruppe : str, optional
        ``K`` or ``G``. ``K`` keeps a sign beside a cycleway from being placed on the cycleway. Links
        without a road reference do not pass.
    type_veg : collection of str, optional
        SOSI names. API Skriv's own example for a Skiltpunkt takes :data:`BILVEG`.
    """
    usable = nett.valid(on_date)
    if not allow_konnektering:
        usable &= ~nett.konnektering
    if not allow_detaljert:
        usable &= ~nett.detaljert
    if vegkategorier is not None:
        usable &= np.isin(nett.vegkategori.astype(np.str_), sorted(vegkategorier))
    if trafikantgruppe is not None:
        usable &= nett.trafikantgruppe == trafikantgruppe
    if type_veg is not None:
        usable &= np.isin(nett.type_veg.astype(np.str_), sorted(type_veg))
    return Stedfester(nett, np.flatnonzero(usable))
