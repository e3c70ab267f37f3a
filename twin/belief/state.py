"""How sure we are that a sign stands, for people."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """Bands of the probability that a sign stands; `NOT_PASSED` where no drive says anything of it."""

    STANDS = "stands"
    PROBABLY = "probably_stands"
    UNSURE = "unsure"
    GONE = "gone"
    NOT_PASSED = "not_passed"

    @classmethod
    def of(cls, p_stands: float, *, passed: bool) -> State:
        """Return the band that a probability lies in: 95, 80 and 20 % part them."""
        if not passed:
            return cls.NOT_PASSED
        bands = ((0.95, cls.STANDS), (0.8, cls.PROBABLY), (0.2, cls.UNSURE))
        return next((state for least, state in bands if p_stands >= least), cls.GONE)
