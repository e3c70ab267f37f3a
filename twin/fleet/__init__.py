"""Many drives by many processes on one machine or many: a queue in the store, and workers that empty it.

:class:`Queue` takes drives into a store's queue; :func:`work` takes them out, has each located by an
:class:`Executor` (:class:`LocalProcesses`, :class:`DaskCluster`) and saves it whole, once, or not at all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
