"""Where a live drive's data come from: one address, one source.

- :func:`open_source`: an address → a `twin.live.ports.Source`
- :class:`Gives`: what an address is asked for, fixes or detections
- :func:`antennas_of`: whose fixes the addresses give
"""

from twin.live.sources.open import Gives, antennas_of, open_source

__all__ = ["Gives", "antennas_of", "open_source"]
