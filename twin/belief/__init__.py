"""How sure we are of each sign today: what all drives saw of it, over time.

:func:`believe` works out a :class:`Belief` of a matched store; :func:`roads_to_drive` says which roads a
drive would settle most of.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
