"""What the store holds, for people: one estimate explained, errors against a truth, the state of all.

- :func:`explain_estimate` → :class:`EstimateExplained`; :func:`draw_estimate` makes a picture of it
- :func:`evaluate` against what :func:`read_truth` reads → :class:`Evaluation`
- :func:`status`: what the store holds → :class:`Status`
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
