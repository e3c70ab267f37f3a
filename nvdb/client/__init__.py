"""HTTP to NVDB: one GET with retries, a rate limit and a deadline, and the one paging loop."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
