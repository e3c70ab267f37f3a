"""A recorded drive → estimates in the store.

:func:`ingest_drive` reads a drive, locates what was annotated and keeps it: an :class:`IngestReport`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
