"""Whether a sign stands, from what drives saw and did not see of it over the years: exact and recursive.

A place is in one of a few states: the sign stands and can be seen, it stands and is hidden from every drive
(a hedge), or it is gone, and the register will find out soon or late. It is taken down, put up and grown over
at constant rates, a pass of a drive is a measurement, and what is left is the probability of each state given
all passes.

With nothing ever put up again this is the persistence filter of Rosen, Mason and Leonard (2016, "Towards
lifelong feature-based mapping in semi-static environments", doi:10.1109/ICRA.2016.7487237) with an
exponential survival time; with nothing ever taken down it is the emergence filter of Saavedra-Ruiz et al.
(2025, "Perpetua", arXiv:2507.18808). Otherwise it is both, chained without bound.

Arrays alone: nothing here knows of NVDB, of a store or of geometry. Times are years from any instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from geoloc.arrays import BoolArray, FloatArray, IntArray

VISIBLE, HIDDEN, GONE, GONE_LATE = range(4)
"""States: it stands; it stands where no drive can see it; it is gone, to be closed soon; closed late."""


@dataclass(frozen=True, slots=True)
class Life:
    """How often things happen to a sign, per year.

    Attributes
    ----------
    down : float
        A sign that stands is taken down.
    up : float
        A sign is put up where one is gone.
    grown_over : float
        A sign that can be seen is hidden from every drive from then on.
    p_hidden : float
        Chance that a sign is hidden when it is first passed, or put up.
    closed, closed_late : float
        The register closes what is gone. That it has not yet done so is a measurement at every instant.
    late : float
        Share of what is taken down that is closed late.
    """

    down: float
    up: float = 0.0
    grown_over: float = 0.0
    p_hidden: float = 0.0
    closed: float = 0.0
    closed_late: float = 0.0
    late: float = 0.0

    def start(self, stands: float, late: float = 0.0) -> FloatArray:
        """Return the states of a sign that stands with a probability; `late`: of what is gone."""
        gone = 1.0 - stands
        return np.array(
            [stands * (1 - self.p_hidden), stands * self.p_hidden, gone * (1 - late), gone * late]
        )

    def generator(self, *, listed: bool) -> FloatArray:
        """Return the rates of change of the states (4, 4), from column to row; what is closed drops out."""
        to_visible, to_hidden = self.up * (1 - self.p_hidden), self.up * self.p_hidden
        to_soon, to_late = self.down * (1 - self.late), self.down * self.late
        soon, late = (self.closed, self.closed_late) if listed else (0.0, 0.0)
        return np.array(
            [
                [-self.down - self.grown_over, 0.0, to_visible, to_visible],
                [self.grown_over, -self.down, to_hidden, to_hidden],
                [to_soon, to_soon, -self.up - soon, 0.0],
                [to_late, to_late, 0.0, -self.up - late],
            ]
        )


def life_in_register(seen: Life, p_gone: float, *, closed_late: float, share_late: float) -> Life:
    """Return the life of signs in a register of which a share is gone at any time.

    Parameters
    ----------
    seen : Life
        Of signs that no register knows.
    p_gone : float
        Share of the signs in the register that are gone.
    closed_late : float
        Rate at which the register closes what it is slow about.
    share_late : float
        Share of that among what is gone.

    Notes
    -----
    Rates follow from both shares staying as they are while the register loses what it closes. Where fewer
    signs are taken down than that needs, the share of those that are gone falls with time.
    """
    down, up = seen.down, seen.up
    if not 0.0 < p_gone < 1.0 or down <= 0.0:
        return seen
    lost = max(down - up * p_gone / (1 - p_gone), 0.0)
    # What is closed more slowly than the register renews itself would fill it.
    slow = max(closed_late, lost - up)
    soon = max(lost - slow * p_gone * share_late, 0.0) / (p_gone * (1 - share_late))
    late = min((up + slow - lost) * p_gone * share_late / (down * (1 - p_gone)), 1.0)
    return replace(seen, closed=soon, closed_late=slow, late=late)


class Places:
    """Probabilities of the states of n places, each as of its own instant.

    Parameters
    ----------
    start : float64 (n, 4)
        Probabilities of the states when a drive first passes.
    lives : sequence of Life
    life : int64 (n,)
        Which of them each place has.
    p_false : float64 (n,)
        Chance that a drive sees this sign where none is to be seen, above 0.
    listed_until : float
        Time until which the register is known to list the places.
    """

    def __init__(
        self,
        start: FloatArray,
        lives: Sequence[Life],
        life: IntArray,
        *,
        p_false: FloatArray,
        listed_until: float,
    ) -> None:
        self._state, self._life, self._p_false, self._listed = start.copy(), life, p_false, listed_until
        self._generators = [np.array([one.generator(listed=on) for one in lives]) for on in (True, False)]
        self._at = np.full(len(start), np.nan)
        self.log_evidence = np.zeros(len(start))
        """Natural log of the probability of all measurements so far (n,)."""

    @property
    def stands(self) -> FloatArray:
        """Probability that the sign stands (n,)."""
        return np.asarray(self._state[:, VISIBLE] + self._state[:, HIDDEN])

    @property
    def visible(self) -> FloatArray:
        """Probability that the sign stands and can be seen (n,)."""
        return self._state[:, VISIBLE].copy()

    def wait(self, rows: IntArray, until: float) -> None:
        """Let time pass at some places; before the first measurement none does."""
        some = rows[self._at[rows] < until]
        for end, generators in zip((min(until, self._listed), until), self._generators, strict=True):
            self._drift(some, np.maximum(end - self._at[some], 0.0), generators)
            self._at[some] = np.maximum(self._at[some], end)
        self._at[rows] = np.fmax(self._at[rows], until)

    def measure(self, rows: IntArray, seen: BoolArray, p_seen: FloatArray) -> None:
        """Take in what a drive saw, and did not see, at places that it passed.

        Parameters
        ----------
        rows : int64 (k,)
        seen : bool (k,)
        p_seen : float64 (k,)
            Chance that the drive sees a sign that stands there and is not hidden.
        """
        p_false = self._p_false[rows]
        chance = np.repeat(np.where(seen, p_false, 1.0 - p_false)[:, None], 4, axis=1)
        chance[:, VISIBLE] = np.where(seen, p_seen, 1.0 - p_seen)
        self._settle(rows, self._state[rows] * chance)

    def _drift(self, rows: IntArray, years: FloatArray, generators: FloatArray) -> None:
        from scipy.linalg import expm

        if not years.any():
            return
        # Places were last passed by few drives, and live few lives.
        key = np.stack([self._life[rows].astype(np.float64), years], axis=1)
        each, number = np.unique(key, axis=0, return_inverse=True)
        step = expm(generators[each[:, 0].astype(np.int64)] * each[:, 1, None, None])
        moved = np.einsum("kij,kj->ki", step[number.ravel()], self._state[rows])
        self._settle(rows, np.maximum(moved, 0.0))

    def _settle(self, rows: IntArray, state: FloatArray) -> None:
        total = state.sum(axis=1)
        self.log_evidence[rows] += np.log(total)
        self._state[rows] = state / total[:, None]


def entropy_bits(p: ArrayLike) -> FloatArray:
    """Return how unsure a probability leaves one: 1 bit at a half, 0 at certainty."""
    p = np.clip(np.asarray(p, dtype=np.float64), 1e-15, 1 - 1e-15)
    return np.asarray(-(p * np.log2(p) + (1 - p) * np.log2(1 - p)))


def settled_bits(visible: FloatArray, stands: FloatArray, p_seen: float, p_false: float) -> FloatArray:
    """Return by how many bits one more pass is expected to make each place surer (n,).

    Parameters
    ----------
    visible, stands : float64 (n,)
        Probability that the sign stands and can be seen; that it stands.
    p_seen : float
        Chance that the drive sees a sign which can be seen.
    p_false : float
        Chance that it sees one where none is to be seen.
    """
    seen_there = visible * p_seen + (stands - visible) * p_false
    seen = seen_there + (1 - stands) * p_false
    unseen_there = stands - seen_there
    after = seen * entropy_bits(seen_there / np.maximum(seen, 1e-300))
    after += (1 - seen) * entropy_bits(unseen_there / np.maximum(1 - seen, 1e-300))
    return np.asarray(np.maximum(entropy_bits(stands) - after, 0.0))
