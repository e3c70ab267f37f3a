"""The Norwegian road database: client, objects, mirror and a replay server.

Knows the road database and nothing of cameras. Only :mod:`nvdb.client` opens a socket to an API;
:mod:`nvdb.replay` serves recorded pages on loopback.

The names below are loaded when they are first used, so that ``import nvdb`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nvdb.area import Area
    from nvdb.client.client import NvdbClient
    from nvdb.client.paging import iter_pages
    from nvdb.errors import NvdbError
    from nvdb.mirror.les_v4 import LesV4Source
    from nvdb.mirror.source import Source
    from nvdb.mirror.sync import MirrorStore, SyncReport, sync
    from nvdb.mirror.uberiket import UberiketSource
    from nvdb.objects.geometri import Position
    from nvdb.objects.skilt import Skiltplate, Skiltpunkt
    from nvdb.objects.vegobjekt import Vegobjekt, vegobjekt_from_les_v4
    from nvdb.replay.server import ReplayServer
    from nvdb.vegnett import Vegnett, facing_azimuth, hent_vegnett

__all__ = [
    "Area",
    "LesV4Source",
    "MirrorStore",
    "NvdbClient",
    "NvdbError",
    "Position",
    "ReplayServer",
    "Skiltplate",
    "Skiltpunkt",
    "Source",
    "SyncReport",
    "UberiketSource",
    "Vegnett",
    "Vegobjekt",
    "facing_azimuth",
    "hent_vegnett",
    "iter_pages",
    "sync",
    "vegobjekt_from_les_v4",
]

_HOME = {
    "Area": "area",
    "LesV4Source": "les_v4",
    "MirrorStore": "mirror",
    "NvdbClient": "client",
    "NvdbError": "errors",
    "Position": "geometri",
    "ReplayServer": "replay",
    "Skiltplate": "skilt",
    "Skiltpunkt": "skilt",
    "Source": "sources",
    "SyncReport": "mirror",
    "UberiketSource": "uberiket",
    "Vegnett": "vegnett",
    "Vegobjekt": "vegobjekt",
    "facing_azimuth": "vegnett",
    "hent_vegnett": "vegnett",
    "iter_pages": "paging",
    "sync": "mirror",
    "vegobjekt_from_les_v4": "vegobjekt",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
