"""NVDB's road network in the store, and which way the mirrored plates face.

>>> from twin.vegnett import facing, load_vegnett, sync_vegnett
>>> sync_vegnett(store, Area(kommuner=(5001,)), client=client)      # doctest: +SKIP
>>> stedfester(load_vegnett(store)).stedfest(east, north)                       # doctest: +SKIP

The page ``docs/vegnett.md`` explains what is kept and how a direction is worked out.
"""

from twin.vegnett.fetch import sync_vegnett
from twin.vegnett.network import load_vegnett
from twin.vegnett.plates import facing

__all__ = ["facing", "load_vegnett", "sync_vegnett"]
