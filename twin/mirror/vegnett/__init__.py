"""NVDB's road network in the store, and which way the mirrored plates face.

>>> from twin.mirror.vegnett import facing, load_vegnett, sync_vegnett
>>> sync_vegnett(store, Area(kommuner=(5001,)), client=client)      # doctest: +SKIP
>>> stedfester(load_vegnett(store)).stedfest(east, north)                       # doctest: +SKIP

The page ``docs/vegnett.md`` explains what is kept and how a direction is worked out.
"""

from twin.mirror.vegnett.facing import facing
from twin.mirror.vegnett.fetch import sync_vegnett
from twin.mirror.vegnett.network import load_vegnett

__all__ = ["facing", "load_vegnett", "sync_vegnett"]
