"""Estimates and the mirror → findings: gate, assign one-to-one, judge.

:func:`match` compares a store's estimates with its mirror, by the settings of a :class:`MatchConfig`, and
returns a :class:`MatchReport`. Poles are matched to Skiltpunkt by position, plates to Skiltplate on the
matched pole by sign code. "No match" is a hypothesis of its own that competes with every pair.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
