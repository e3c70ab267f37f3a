"""The mirror of NVDB in the store: signs, their history, and the road network.

:func:`sync_nvdb` brings it up to date and returns a :class:`SyncResult`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
