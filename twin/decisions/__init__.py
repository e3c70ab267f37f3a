"""What people decide about findings: a log that only grows, selection in bulk, and what changed since.

A decision holds for the evidence that it was made on (:mod:`twin.decisions.evidence`). Where a later match
finds other evidence, the finding is open again and says what changed (:mod:`twin.decisions.reopen`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
