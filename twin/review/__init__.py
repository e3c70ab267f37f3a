"""The review page: what was found, one finding a screen, and one key to settle it.

:func:`review_app` is the page's server without a port; ``twin review`` runs it. What goes over the wire is
declared in :mod:`twin.review.records`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
