"""A recorded drive → estimates in the store.

:func:`ingest_drive` reads a drive, locates what was annotated and keeps it: an :class:`IngestReport`. It is
two steps in a row, which may run on two machines: :func:`locate_drive` gives everything that a store gets, a
:class:`LocatedDrive`, and knows no store; :func:`save_drive` writes it in one transaction.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
