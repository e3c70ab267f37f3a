"""A server on loopback that answers as NVDB does, from recorded pages: demo, tests, faults."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
