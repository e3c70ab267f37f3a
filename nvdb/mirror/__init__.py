"""A mirror that follows NVDB: everything once, then only the changes, over a `MirrorStore`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
