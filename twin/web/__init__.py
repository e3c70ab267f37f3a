"""A small server on loopback for the pages in which people review and annotate.

:func:`web_app` puts a page's own routes behind the guard (:mod:`twin.web.guard`), :func:`serve` runs it until
Ctrl-C. What a stranger's page, another machine or a guessed address asks for is refused before any route is
asked.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
