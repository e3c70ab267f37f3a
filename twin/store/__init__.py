"""What the twin keeps: one SQLite file, its tables, its snapshots, and files that are whole or not there.

:class:`Store` is that file, open.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
