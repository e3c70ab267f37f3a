"""How API Les V4 shows an object: which parts (``inkluder``) and in which system (``srid``)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from nvdb.objects.geometri import UNKNOWN_HEIGHT, point_from_wkt
from nvdb.objects.vegobjekt import RawObject

if TYPE_CHECKING:
    import pyproj

PARTS: Final = ("metadata", "egenskaper", "relasjoner", "lokasjon", "vegsegmenter", "geometri")

_SYSTEMS: Final = {
    "5972": (25832, 5972),
    "UTM32": (25832, 5972),
    "5973": (25833, 5973),
    "UTM33": (25833, 5973),
    "5975": (25835, 5975),
    "UTM35": (25835, 5975),
    "4326": (4326, 4326),
    "WGS84": (4326, 4326),
}
"""``srid`` as asked → EPSG code in plan, and ``srid`` as shown."""


def shown(raw: RawObject, query: Mapping[str, str], href: str) -> dict[str, Any]:
    """An object as V4 shows it: id and href, the parts asked for, ``geometri`` in the system asked for.

    The geometry *property* stays in UTM33 whatever is asked, as in V4's own answers.

    Raises
    ------
    ValueError
        An ``inkluder`` or ``srid`` that V4 does not know.
    """
    wanted = _parts(query.get("inkluder", "minimum"))
    srid = query.get("srid", "5973")
    if srid not in _SYSTEMS:
        msg = f"srid: '{srid}' er ikke en gyldig verdi"
        raise ValueError(msg)
    found: dict[str, Any] = {"id": raw.get("id"), "href": raw.get("href", href)}
    found.update((part, raw[part]) for part in PARTS if part in wanted and part in raw)
    epsg, srid_shown = _SYSTEMS[srid]
    if isinstance(found.get("geometri"), Mapping) and epsg != 25833:
        found["geometri"] = _in_system(found["geometri"], epsg, srid_shown)
    return found


def _parts(text: str) -> set[str]:
    asked = {part.strip() for part in text.split(",")}
    unknown = asked - {*PARTS, "alle", "minimum"}
    if unknown:
        msg = f"inkluder: '{min(unknown)}' er ikke en gyldig verdi"
        raise ValueError(msg)
    return set(PARTS) if "alle" in asked else asked


def _in_system(geometri: Mapping[str, Any], epsg: int, srid: int) -> dict[str, Any]:
    """``geometri`` converted from UTM33; what is not a point in UTM33 stays as it is."""
    wkt = str(geometri.get("wkt"))
    try:
        east, north, height = point_from_wkt(wkt)
    except ValueError:
        return dict(geometri)
    if str(geometri.get("srid")) not in {"5973", "25833", "UTM33"}:
        return dict(geometri)
    x, y = _transformer(epsg).transform(east, north)
    # V4 writes latitude first, 8 decimals in degrees and 3 in metres, without trailing zeros.
    numbers = [_decimals(y, 8), _decimals(x, 8)] if epsg == 4326 else [_decimals(x, 3), _decimals(y, 3)]
    if height is None and "Z" not in wkt.upper():
        return {**geometri, "wkt": f"POINT({' '.join(numbers)})", "srid": srid}
    numbers.append(_decimals(UNKNOWN_HEIGHT if height is None else height, 8))
    return {**geometri, "wkt": f"POINT Z ({' '.join(numbers)})", "srid": srid}


def _decimals(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".rstrip("0").rstrip(".")


@cache
def _transformer(epsg: int) -> pyproj.Transformer:
    import pyproj

    return pyproj.Transformer.from_crs(25833, epsg, always_xy=True)
