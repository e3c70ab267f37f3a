"""What Uberiket V1 would say of an object that is kept in V4's form, and how it would cut objects into pages.

Source: the OpenAPI document of Uberiket V1 (June 2026) and recorded answers of other types.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final
from urllib.parse import urlencode

from nvdb.objects.vegobjekt import RawObject
from nvdb.replay.pages import MAX_PAGE, QueryError, Record

PARTS: Final = ("gyldighetsperiode", "egenskaper", "stedfesting", "barn")
DEFAULT_SRID: Final = 5973
"""System of a V4 geometry property, which does not say it."""

_KINDS: Final[Mapping[str, str]] = {
    "Binær": "BinaerEgenskap",
    "Boolsk": "BoolskEgenskap",
    "Dato": "DatoEgenskap",
    "Flyttall": "FlyttallEgenskap",
    "Heltall": "HeltallEgenskap",
    "Kortdato": "KortDatoEgenskap",
    "Tekst": "TekstEgenskap",
    "Tid": "TidEgenskap",
}
_ASCII: Final[Mapping[str, str]] = {
    "nøyaktighet": "noyaktighet",
    "nøyaktighetHøyde": "noyaktighetHoyde",
    "datafangstmetodeHøyde": "datafangstmetodeHoyde",
}
_CURSOR = re.compile(r"(\d{1,18})-(\d{1,9})")


def uberiket_from_les_v4(raw: RawObject, type_id: int) -> dict[str, Any]:
    """Turn an object from V4's form into Uberiket's: all parts.

    What Uberiket does not have (texts of enums, derived geometry, kommuner, road references, parents) is left
    out, as there. A part that breaks V4's form is left out too.
    """
    metadata = _mapping(raw.get("metadata"))
    relasjoner, lokasjon = _mapping(raw.get("relasjoner")), _mapping(raw.get("lokasjon"))
    period = {name: metadata[name] for name in ("startdato", "sluttdato") if name in metadata}
    made: dict[str, Any] = {
        "id": raw.get("id"),
        "versjon": metadata.get("versjon", 1),
        "typeId": type_id,
        "gyldighetsperiode": period or {"startdato": "1950-01-01"},
        "egenskaper": {
            str(item.get("id")): egenskap
            for item in _mappings(raw.get("egenskaper"))
            if (egenskap := _egenskap(item)) is not None
        },
        "barn": {
            str(item.get("listeid", item.get("id"))): list(item.get("vegobjekter") or ())
            for item in _mappings(relasjoner.get("barn"))
        },
        "sistEndret": metadata.get("sist_modifisert", "2020-01-01T00:00:00Z"),
    }
    points = [
        _point(item) for item in _mappings(lokasjon.get("stedfestinger")) if item.get("type") == "Punkt"
    ]
    if points:
        made["stedfesting"] = {"type": "StedfestingPunkter", "punkter": points}
    return made


def _egenskap(item: RawObject) -> dict[str, Any] | None:
    kind, value = str(item.get("egenskapstype")), item.get("verdi")
    if "enum_id" in item:
        return {"type": "EnumEgenskap", "verdi": item["enum_id"]}
    if kind == "Geometri":
        geometry: dict[str, Any] = {"wkt": value, "srid": item.get("srid", DEFAULT_SRID)}
        if "datafangstdato" in item:
            geometry["datafangstdato"] = item["datafangstdato"]
        if "kvalitet" in item:
            kvalitet = _mapping(item["kvalitet"])
            geometry["kvalitet"] = {_ASCII.get(name, name): number for name, number in kvalitet.items()}
        return {"type": "GeometriEgenskap", "verdi": geometry}
    return {"type": _KINDS[kind], "verdi": value} if kind in _KINDS else None


def _point(item: RawObject) -> dict[str, Any]:
    names = {
        "id": "veglenkesekvensid",
        "posisjon": "relativPosisjon",
        "retning": "retning",
        "sideposisjon": "sideposisjon",
    }
    made = {name: item[source] for name, source in names.items() if source in item}
    return {**made, "kjorefelt": list(item.get("kjørefelt") or ())}


def shown_parts(made: Mapping[str, Any], query: Mapping[str, str]) -> dict[str, Any]:
    """Drop the parts that ``inkluder`` does not ask for; QueryError for one that is not known."""
    asked = {part.strip() for part in query.get("inkluder", "minimum").split(",")}
    unknown = asked - {*PARTS, "alle", "minimum"}
    if unknown:
        msg = f"inkluder: '{min(unknown)}' er ikke en gyldig verdi"
        raise QueryError(msg)
    hidden = set() if "alle" in asked else set(PARTS) - asked
    return {name: value for name, value in made.items() if name not in hidden}


def select_versions(versions: Iterable[Record], query: Mapping[str, str]) -> list[Record]:
    """Versions that pass ``ider``, ``dato`` and ``polygon``; of a polygon its bounding box is taken."""
    if "ider" in query and "polygon" in query:
        msg = "Ulike filter kan ikke kombineres: ider, polygon"
        raise QueryError(msg)
    found = list(versions)
    if "ider" in query:
        ids = set(numbers(query["ider"], "ider"))
        found = [record for record in found if record.id in ids]
    if "polygon" in query:
        west, south, east, north = _bounds(query["polygon"])
        found = [
            record
            for record in found
            if (at := record.position) is not None
            and west <= at.east_m <= east
            and south <= at.north_m <= north
        ]
    if "dato" in query:
        found = [record for record in found if _valid(record.raw, query["dato"])]
    return found


def cut(
    versions: Sequence[Record], query: Mapping[str, str], limit: int | None
) -> tuple[list[Record], str | None]:
    """Cut one page: its versions, and the cursor of the next (None on the last)."""
    size = page_size(query)
    start = query.get("start")
    if start is not None:
        match = _CURSOR.fullmatch(start)
        if match is None:
            msg = f"start: '{start}' er ikke på formen [vegobjektId]-[versjon]"
            raise QueryError(msg)
        after = int(match.group(1)), int(match.group(2))
        versions = [record for record in versions if (record.id, record.versjon) > after]
    page = list(versions[: min(size, limit or size)])
    more = len(page) < len(versions)
    return page, f"{page[-1].id}-{page[-1].versjon}" if page and more else None


def page_document(
    name: str, items: Sequence[object], size: int, cursor: str | None, url: str, query: Mapping[str, str]
) -> dict[str, Any]:
    """Uberiket's page: a list under `name`, and metadata whose ``neste`` is left out on the last page."""
    metadata: dict[str, Any] = {"returnert": len(items), "sidestorrelse": size}
    if cursor is not None:
        href = f"{url}?{urlencode({**query, 'start': cursor}, safe=':,')}"
        metadata["neste"] = {"start": cursor, "href": href}
    return {name: list(items), "metadata": metadata}


def page_size(query: Mapping[str, str]) -> int:
    """``antall``, which Uberiket refuses outside 1 to 1000."""
    text = query.get("antall", str(MAX_PAGE))
    if not (text.isascii() and text.isdigit()) or not 1 <= int(text) <= MAX_PAGE:
        msg = f"antall: '{text}' er ikke et heltall mellom 1 og {MAX_PAGE}"
        raise QueryError(msg)
    return int(text)


def numbers(text: str, name: str) -> list[int]:
    """Read a list of whole numbers with commas between; QueryError if it is none."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        msg = f"{name}: '{text}' er ikke en liste av heltall"
        raise QueryError(msg) from None


def _valid(raw: RawObject, day: str) -> bool:
    metadata = _mapping(raw.get("metadata"))
    return str(metadata.get("startdato", "")) <= day < str(metadata.get("sluttdato", "9999"))


def _bounds(text: str) -> tuple[float, float, float, float]:
    try:
        corners = [tuple(float(part) for part in corner.split()) for corner in text.split(",")]
        east, north = zip(*corners, strict=True)
    except ValueError:
        msg = f"polygon: '{text}' er ikke en liste av punkter"
        raise QueryError(msg) from None
    return min(east), min(north), max(east), max(north)


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _mappings(value: object) -> list[Mapping[str, Any]]:
    return [item for item in value if isinstance(item, Mapping)] if isinstance(value, list) else []
