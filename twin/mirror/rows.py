"""A sign as a row of the mirror's tables: made by hand, since a country has 1.7 million."""

from __future__ import annotations

from typing import Any

import msgspec

from nvdb.objects import Skiltplate, Skiltpunkt
from twin.mirror.raw import packed

_NOWHERE = (None, None, None)
_ENCODER = msgspec.json.Encoder()


def mirror_row(skilt: Skiltpunkt | Skiltplate, now: str) -> tuple[Any, ...]:
    """A sign as a row, in the order of its table's columns; `now` is when it was fetched."""
    position = skilt.position
    shared = (
        skilt.nvdb_id,
        skilt.version,
        skilt.start_date,
        skilt.end_date,
        skilt.last_modified,
        *((position.east_m, position.north_m, position.height_m) if position else _NOWHERE),
        skilt.own_geometry,
        skilt.accuracy_cm,
        skilt.capture_method,
        skilt.road_reference,
        _to_json(skilt.kommuner),
        _to_json(skilt.stedfesting),
        _to_json(skilt.problems),
        packed(skilt.raw),
        now,
    )
    if isinstance(skilt, Skiltpunkt):
        return (*shared, _to_json(skilt.plate_ids))
    return (
        *shared,
        skilt.point_id,
        skilt.skiltnummer,
        skilt.skiltnummer_text,
        skilt.enum_id,
        skilt.ansiktsside,
        skilt.text,
        skilt.plasseringskode,
    )


def _to_json(value: object) -> str:
    return _ENCODER.encode(value).decode()
