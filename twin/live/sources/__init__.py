"""Where a live drive's data come from: one address, one source.

- :func:`open_source`: an address → a `twin.live.ports.Source`
- :class:`Gives`: what an address is asked for, fixes or detections
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
