"""Intrinsics with covariance from corners of printed boards, and compared camera models.

:func:`calibrate_intrinsics` takes a `View` a picture and returns `Intrinsics`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
