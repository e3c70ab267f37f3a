"""The segmented road network of a replayed world, as API Les V4 filters it and cuts it into pages.

Filters: ``kommune``, ``fylke``, ``kontraktsomrade``, ``kartutsnitt`` (by the bounds of a segment),
``tidspunkt`` and ``historisk``. How V4 writes the cursor of this address is not documented: here it is the
last segment's ``referanse``, and the end is an empty page that repeats it, as V4's recorded pages of
vegobjekter end.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

from nvdb.objects.vegobjekt import RawObject
from nvdb.replay.pages import PLACES, Places, QueryError, places_of, read_box, read_page_size, read_places

_UTM33: Final = frozenset({"5973", "UTM33"})
_CURSOR: Final = re.compile(r"\d{1,18}(?:[-:]\d{1,9}){0,2}")
_NUMBER: Final = re.compile(r"\d+")
_COORDINATES: Final = re.compile(r"(-?\d[\d.]*)\s+(-?\d[\d.]*)(?:\s+-?\d[\d.]*)?\s*(?=[,)])")

Key = tuple[int, ...]
Bounds = tuple[float, float, float, float]


def select_segments(links: Sequence[RawObject], query: Mapping[str, str], today: str) -> list[RawObject]:
    """Segments that pass the filters, ordered by veglenkesekvens, number and segment.

    Parameters
    ----------
    links : sequence
        Segments in V4's form.
    query : mapping
    today : str
        ISO date on which a segment has to be valid if the query names no other.

    Raises
    ------
    QueryError
        A filter that cannot be read, or an ``srid`` other than UTM33: segments are kept in that alone.
    """
    if query.get("srid", "5973") not in _UTM33:
        msg = f"srid: bare 5973 kan spilles av, ikke '{query['srid']}'"
        raise QueryError(msg)
    found = list(links)
    if query.get("historisk", "").lower() != "true":
        found = [link for link in found if _valid(link, query.get("tidspunkt", today))]
    for name in PLACES.keys() & query.keys():
        places = read_places(name, query[name])
        found = [link for link in found if places & _places(link)]
    if "kartutsnitt" in query:
        box = read_box(query["kartutsnitt"])
        found = [link for link in found if _touches(link, box)]
    return sorted(found, key=_key)


def cut_segments(
    links: Sequence[RawObject], query: Mapping[str, str], limit: int | None
) -> tuple[list[RawObject], int, str | None]:
    """Cut one page: its segments, the size that was asked for, and the cursor of the next page."""
    size, start = read_page_size(query), query.get("start")
    if start is not None:
        if _CURSOR.fullmatch(start) is None:
            msg = f"start: '{start}' er ikke et gyldig startpunkt"
            raise QueryError(msg)
        after = _numbers(start)
        links = [link for link in links if _key(link) > after]
    page = list(links[: min(size, limit or size)])
    return page, size, "-".join(map(str, _key(page[-1]))) if page else start


def _key(link: RawObject) -> Key:
    """Sekvens, number and segment, which are what ``referanse`` is made of."""
    names = ("veglenkesekvensid", "veglenkenummer", "segmentnummer")
    return tuple(value if isinstance(value := link.get(name), int) else 0 for name in names)


def _numbers(text: str) -> Key:
    return tuple(int(number) for number in _NUMBER.findall(text))


def _places(link: RawObject) -> Places:
    """A segment has one kommune and one fylke, but a list of kontraktsområder."""
    lists = {PLACES[name]: [link.get(name)] for name in ("kommune", "fylke")}
    return places_of({**lists, PLACES["kontraktsomrade"]: link.get(PLACES["kontraktsomrade"])})


def _valid(link: RawObject, day: str) -> bool:
    period: Any = link.get("metadata")
    dates = period if isinstance(period, Mapping) else {}
    return str(dates.get("startdato", "")) <= day < str(dates.get("sluttdato") or "9999")


def _touches(link: RawObject, box: Sequence[float]) -> bool:
    geometri: Any = link.get("geometri")
    bounds = _bounds(str(geometri.get("wkt"))) if isinstance(geometri, Mapping) else None
    if bounds is None:
        return False
    west, south, east, north = bounds
    return west <= box[2] and east >= box[0] and south <= box[3] and north >= box[1]


@lru_cache(maxsize=1 << 17)
def _bounds(wkt: str) -> Bounds | None:
    """West, south, east and north of a line; None where nothing can be read."""
    corners = [(float(x), float(y)) for x, y in _COORDINATES.findall(wkt)]
    if not corners:
        return None
    easts, norths = zip(*corners, strict=True)
    return min(easts), min(norths), max(easts), max(norths)
