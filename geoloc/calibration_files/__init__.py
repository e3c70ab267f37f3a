"""Calibration files of other tools → camera models, and back.

:func:`read_cameras` tells the format by the content. One module a format, each of which takes the bytes of
one file; most can write their own format too. A new format is a module and a line in :mod:`.read`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
