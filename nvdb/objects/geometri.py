"""From NVDB's WKT to one stored form: EPSG:25833 east and north, height NN2000.

What has to be known (seen in answers of API Les V4): with ``srid=4326`` the order is latitude, longitude;
an unknown height is the number -999999; the geometry *property* is always UTM33 and says so nowhere;
``POINT(…)``, ``POINT Z (…)`` and ``POINT Z(…)`` all occur. Answers in 4326 differ from PROJ's conversion
by up to a few cm, so UTM33 is the form to ask for and to keep. Heights pass unchanged: they are NN2000 in
every srid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Final

UNKNOWN_HEIGHT: Final = -999999.0
"""What NVDB writes for a height that nobody measured."""

NORWAY_UTM33: Final = (-120_000.0, 6_400_000.0, 1_150_000.0, 7_990_000.0)
"""Mainland Norway in EPSG:25833 with a margin: min east, min north, max east, max north."""

HEIGHT_RANGE_M: Final = (-1000.0, 3000.0)
"""Below the deepest subsea tunnel (about -400 m) and above the highest road."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PLAIN = r"(-?[0-9]{1,9}(?:\.[0-9]+)?)"
_USUAL_POINT = re.compile(rf"POINT Z ?\({_PLAIN} {_PLAIN} {_PLAIN}\)")
"""What nearly every answer has; `_POINT` reads all that is allowed."""
_POINT = re.compile(rf"\s*POINT\s*(ZM|Z|M)?\s*\(\s*({_NUMBER}(?:\s+{_NUMBER}){{1,3}})\s*\)\s*", re.IGNORECASE)

_EPSG_OF_SRID: Final = {
    "5973": 25833, "25833": 25833, "UTM33": 25833,
    "5972": 25832, "25832": 25832, "UTM32": 25832,
    "5975": 25835, "25835": 25835, "UTM35": 25835,
    "4326": 4326, "WGS84": 4326,
}  # fmt: skip


class PositionFault(StrEnum):
    """Why a geometry gives no position."""

    UNREADABLE = "unreadable"
    NOT_A_POINT = "not_a_point"
    UNKNOWN_SRID = "unknown_srid"
    OUTSIDE_NORWAY = "outside_norway"


class PositionError(ValueError):
    """A geometry that gives no position: `kind`, and a clause that fits after "the geometry"."""

    def __init__(self, kind: PositionFault, clause: str) -> None:
        super().__init__(clause)
        self.kind = kind


@dataclass(frozen=True, slots=True)
class Position:
    """A point in EPSG:25833, metres; `height_m` is NN2000, None where NVDB does not know it."""

    east_m: float
    north_m: float
    height_m: float | None = None


def point_from_wkt(wkt: str) -> tuple[float, float, float | None]:
    """Read a WKT point as it stands.

    Returns
    -------
    x, y, z
        In the order of the text. z is None if there is none, or if it is -999999.

    Raises
    ------
    PositionError
        Anything but one finite point.
    """
    usual = _USUAL_POINT.fullmatch(wkt)
    if usual is not None:
        x, y, z = map(float, usual.groups())
        return x, y, z if z != UNKNOWN_HEIGHT else None
    match = _POINT.fullmatch(wkt)
    if match is None:
        raise _no_point(wkt)
    dimensions = (match.group(1) or "").upper()
    numbers = [float(text) for text in match.group(2).split()]
    if dimensions and len(numbers) != 2 + len(dimensions):
        raise PositionError(PositionFault.UNREADABLE, f"has {len(numbers)} numbers in a POINT {dimensions}")
    if not all(map(math.isfinite, numbers)):
        raise PositionError(PositionFault.UNREADABLE, "has a coordinate beyond float64")
    has_height = len(numbers) > 2 and dimensions != "M"
    height = numbers[2] if has_height and numbers[2] != UNKNOWN_HEIGHT else None
    return numbers[0], numbers[1], height


def _no_point(wkt: str) -> PositionError:
    text = " ".join(wkt.upper().split())
    if not text or text.endswith("EMPTY"):
        return PositionError(PositionFault.UNREADABLE, "is empty")
    if "NAN" in text or "INF" in text:
        return PositionError(PositionFault.UNREADABLE, "has NaN or infinite coordinates")
    shape = re.match(r"[A-Z]+", text)
    if shape and shape.group() not in {"POINT", "POINTZ", "POINTM", "POINTZM"}:
        return PositionError(PositionFault.NOT_A_POINT, f"is a {shape.group()[:20]}, not a point")
    return PositionError(PositionFault.UNREADABLE, f"is not readable WKT ({text[:40]!r})")


def position_from_wkt(wkt: str, srid: str | int | None) -> tuple[Position, tuple[str, ...]]:
    """Read a WKT point and bring it to EPSG:25833.

    Parameters
    ----------
    wkt : str
        In NVDB's axis order: east north [height] for UTM, latitude longitude [height] for 4326.
    srid : str or int or None
        As NVDB writes it: 5972, 5973, 5975, 4326, UTM32, UTM33, UTM35, WGS84.

    Returns
    -------
    position, problems
        `problems` is about the height, which is None then.

    Raises
    ------
    PositionError
        No point, an unknown srid, or a point that is not in Norway.
    """
    name = str(srid)
    epsg = _EPSG_OF_SRID.get(name) or _EPSG_OF_SRID.get(name.upper().removeprefix("EPSG:"))
    if epsg is None:
        clause = f"has the unknown srid {srid}" if srid is not None else "has no srid"
        raise PositionError(PositionFault.UNKNOWN_SRID, clause)
    x, y, height = point_from_wkt(wkt)
    east, north = (x, y) if epsg == 25833 else _utm33(epsg)(x, y)
    if not in_norway(east, north):
        swapped = in_norway(*_utm33(epsg)(y, x))
        clause = f"lies outside Norway ({wkt.strip()[:60]}{'; its axes look swapped' if swapped else ''})"
        raise PositionError(PositionFault.OUTSIDE_NORWAY, clause)
    if height is None or HEIGHT_RANGE_M[0] <= height <= HEIGHT_RANGE_M[1]:
        return Position(east, north, height), ()
    return Position(east, north, None), (f"the height {height:g} m is impossible",)


def in_norway(east_m: float, north_m: float) -> bool:
    """Whether a point lies in `NORWAY_UTM33`; False for NaN."""
    min_east, min_north, max_east, max_north = NORWAY_UTM33
    return min_east <= east_m <= max_east and min_north <= north_m <= max_north


@cache
def _utm33(epsg: int) -> Callable[[float, float], tuple[float, float]]:
    """Converter from NVDB's axis order in `epsg` to EPSG:25833 east, north; impossible input gives inf."""
    if epsg == 25833:
        return lambda x, y: (x, y)
    import pyproj

    transformer = pyproj.Transformer.from_crs(epsg, 25833, always_xy=True)
    if epsg == 4326:
        # EUREF89 and WGS84 are taken as equal, as NVDB itself does.
        return lambda lat, lon: transformer.transform(lon, lat)
    return transformer.transform
