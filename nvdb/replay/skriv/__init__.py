"""API Skriv on loopback: takes, checks and carries out change sets as NVDB does."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
