"""The paper's tables and figures, from drives of one's own or from simulated ones.

- :func:`reproduce` recorded trips against a survey, :func:`reproduce_simulated` the paper's four experiments
  in the simulator → :class:`Reproduction`, its tables as records
- :func:`figure`: error against distance of one :class:`Experiment`, as the paper draws it
- :func:`write_reproduction`: tables as CSV, figures as PNG and PDF
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
