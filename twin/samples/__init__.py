"""Simulated drives as folders, and the sample that the demo runs on.

- :func:`simulate`: a drive of a simulated road as a folder → :class:`SimulateReport`
- :func:`make_sample`: the sample's files, the same each time
- :func:`run_demo`: the whole job on the sample → :class:`DemoReport`
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
