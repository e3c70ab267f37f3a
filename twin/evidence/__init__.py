"""Pictures of findings: small crops of a drive's own pictures, masked before they are written.

- :func:`make_evidence` cuts, masks and keeps the crops of every finding → :class:`EvidenceReport`
- :func:`crops_of`, :func:`gaps_of`: what a finding has, and why it has no more → :class:`Crop`, :class:`Gap`
- :func:`exportable_crops`: masked ones alone, for whatever leaves the machine
- :func:`crop_file`: the WebP file of a crop; :func:`forget` deletes crops and says what

What is masked, and why that is enough, is written in ``docs/evidence.md``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
