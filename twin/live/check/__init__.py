"""What a car sees, held against NVDB while it drives.

- :class:`LiveCheck`: what arrived and the estimates that came of it in → verdicts as soon as they hold
- :class:`MirrorAhead`: the mirror's signs about the car, a few square kilometres at a time
- :class:`Verdict`: what is said of one sign; it may change, and then says what it was
"""

from twin.live.check.ahead import MirrorAhead, SignsAhead
from twin.live.check.check import LiveCheck
from twin.live.check.verdict import Standing, Verdict

__all__ = ["LiveCheck", "MirrorAhead", "SignsAhead", "Standing", "Verdict"]
