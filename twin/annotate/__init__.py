"""The annotation page: click a sign's foot once or twice, and its place is proposed in all other pictures.

:func:`annotate_app` is the page's server without a port; ``twin annotate`` runs it. What goes over the wire
is declared in :mod:`twin.annotate.records`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
