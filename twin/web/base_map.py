"""Kartverket's topographic map in grey: its terms (CC BY 4.0) ask for the credit wherever it is shown."""

from __future__ import annotations

import msgspec

HOST = "https://cache.kartverket.no"
TILES = f"{HOST}/v1/wmts/1.0.0/topograatone/default/webmercator/{{z}}/{{y}}/{{x}}.png"
"""Address of a tile, with the names that MapLibre and QGIS fill in."""
CREDIT = "© Kartverket"


class BaseMap(msgspec.Struct, frozen=True):
    """Tiles of another host, which the user has asked for."""

    url: str
    attribution: str


BASE_MAP = BaseMap(TILES, CREDIT)
