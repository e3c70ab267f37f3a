"""Whether a sign stands, from what drives saw and did not see of it over the years: exact and recursive.

A place is in one of three states: the sign stands and can be seen, it stands and is hidden from every drive
(a hedge), or it is gone. It is taken down, put up and grown over at constant rates, a pass of a drive is a
measurement, and what is left is the probability of each state given all passes.

With nothing ever put up again this is the persistence filter of Rosen, Mason and Leonard (2016, "Towards
lifelong feature-based mapping in semi-static environments", doi:10.1109/ICRA.2016.7487237) with an
exponential survival time; with nothing ever taken down it is the emergence filter of Saavedra-Ruiz et al.
(2025, "Perpetua", arXiv:2507.18808). Otherwise it is both, chained without bound.

Arrays alone: nothing here knows of NVDB, of a store or of geometry. Times are years from any instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from geoloc.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Rates:
    """How often things happen to places, each float64 (n,), per year.

    Attributes
    ----------
    down : signs that stand are taken down.
    up : a sign is put up where one is gone.
    grown_over : a sign that can be seen is hidden from every drive from then on.
    closed : the register closes what is gone. That it has not yet done so is a measurement at every instant.
    """

    down: FloatArray
    up: FloatArray
    grown_over: FloatArray
    closed: FloatArray


def closing_rate(down: ArrayLike, up: ArrayLike, p_gone: float) -> FloatArray:
    """Return the rate at which a register has to close what is gone for `p_gone` of its signs to be gone.

    Of what it lists, that share is then gone at any time: what is taken down makes up for what is closed.
    """
    if not 0.0 < p_gone < 1.0:
        return np.zeros_like(np.asarray(down, dtype=np.float64))
    return np.maximum(np.asarray(down) / p_gone - np.asarray(up) / (1.0 - p_gone), 0.0)


class Places:
    """Probabilities of the states of n places, each as of its own instant.

    Parameters
    ----------
    stands : float64 (n,)
        Probability that the sign stands when a drive first passes.
    rates : Rates
    p_hidden : float
        Chance that a sign is hidden from every drive when it is first passed, or put up.
    p_false : float64 (n,)
        Chance that a drive sees this sign where none stands, above 0.
    listed_until : float
        Time until which the register is known to list the places.
    """

    def __init__(
        self, stands: FloatArray, rates: Rates, *, p_hidden: float, p_false: FloatArray, listed_until: float
    ) -> None:
        self._rates, self._p_hidden, self._p_false, self._listed = rates, p_hidden, p_false, listed_until
        self._visible = stands * (1.0 - p_hidden)
        self._hidden = stands * p_hidden
        self._gone = 1.0 - stands
        self._at = np.full(len(stands), np.nan)
        self.log_evidence = np.zeros(len(stands))
        """Natural log of the probability of all measurements so far (n,)."""

    @property
    def stands(self) -> FloatArray:
        """Probability that the sign stands (n,)."""
        return self._visible + self._hidden

    @property
    def visible(self) -> FloatArray:
        """Probability that the sign stands and can be seen (n,)."""
        return self._visible.copy()

    def wait(self, rows: IntArray, until: float) -> None:
        """Let time pass at some places; before the first measurement none does."""
        some = rows[self._at[rows] < until]
        for end, closes in ((min(until, self._listed), True), (until, False)):
            years = np.maximum(end - self._at[some], 0.0)
            self._drift(some, years, closes=closes)
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
        stands = np.where(seen, p_seen, 1.0 - p_seen)
        other = np.where(seen, self._p_false[rows], 1.0 - self._p_false[rows])
        visible, hidden = self._visible[rows] * stands, self._hidden[rows] * other
        # A mark on what is hidden is as false as one on what is gone.
        self._settle(rows, visible, hidden, self._gone[rows] * other)

    def _drift(self, rows: IntArray, years: FloatArray, *, closes: bool) -> None:
        down, up, over = (one[rows] for one in (self._rates.down, self._rates.up, self._rates.grown_over))
        closed = self._rates.closed[rows] if closes else np.zeros(rows.size)
        visible, hidden, gone = self._visible[rows], self._hidden[rows], self._gone[rows]
        # d stands = up gone - down stands, d gone = down stands - (up + closed) gone, by the exponential of
        # that 2 x 2 matrix: two roots about a mean. What is closed drops out: the sum falls below 1.
        mean = -(down + up + closed) / 2
        half = np.sqrt(np.maximum(mean**2 - down * closed, 0.0))
        odd = _gained(mean + half, mean - half, years)
        even = np.exp((mean + half) * years) - half * odd
        gain = down * (visible + hidden) - (up + closed + mean) * gone
        stands = even * (visible + hidden) + odd * (up * gone - (down + mean) * (visible + hidden))
        # Of what was put up since, a share was hidden at once, and the rest as much as had time to be.
        leaves = down + over
        slope = gain / np.where(half > 0, 2 * half, 1.0)  # roots are equal only where nothing is put up
        came = (gone / 2 + slope) * _gained(mean + half, -leaves, years)
        came += (gone / 2 - slope) * _gained(mean - half, -leaves, years)
        seen = visible * np.exp(-leaves * years) + (1 - self._p_hidden) * up * came
        self._settle(rows, seen, np.maximum(stands - seen, 0.0), even * gone + odd * gain)

    def _settle(self, rows: IntArray, visible: FloatArray, hidden: FloatArray, gone: FloatArray) -> None:
        total = visible + hidden + gone
        self.log_evidence[rows] += np.log(total)
        self._visible[rows], self._hidden[rows], self._gone[rows] = (
            visible / total,
            hidden / total,
            gone / total,
        )


def _gained(one: FloatArray, other: FloatArray, years: FloatArray) -> FloatArray:
    """Integrate exp(one u + other (years - u)) over u from 0 to `years`."""
    apart = np.abs(one - other) * years
    near = apart < 1e-12
    share = np.where(near, 1.0, -np.expm1(-apart) / np.where(near, 1.0, apart))
    return np.asarray(years * np.exp(np.maximum(one, other) * years) * share)


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
