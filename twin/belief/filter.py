"""Whether a sign stands, from what drives saw and did not see of it over the years: exact and recursive.

A place is in one of three states: the sign stands and can be seen, it stands and is hidden from every drive
(a hedge), or it is gone. It is taken down and put up at constant rates, a pass of a drive is a measurement,
and what is left is the probability of each state given all passes. With nothing ever put up again this is
the persistence filter of Rosen, Mason and Leonard (2016, "Towards lifelong feature-based mapping in
semi-static environments", doi:10.1109/ICRA.2016.7487237) with an exponential survival time; with nothing
ever taken down it is the emergence filter of Saavedra-Ruiz et al. (2025, "Perpetua", arXiv:2507.18808); both
chained without bound otherwise.

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
    closed : the register closes what is gone. That it has not yet done so is a measurement at every instant.
    """

    down: FloatArray
    up: FloatArray
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
        Chance that a sign which stands is hidden from every drive; drawn anew after each sighting, since
        what was seen is hidden only if something has grown before it since.
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
        # A mark on what is hidden is as false as one on what is gone; a true one shows that it was not.
        self._settle(rows, visible, hidden, self._gone[rows] * other)
        fresh = np.where(seen, self._visible[rows], 0.0) * self._p_hidden
        self._visible[rows] -= fresh
        self._hidden[rows] += fresh

    def _drift(self, rows: IntArray, years: FloatArray, *, closes: bool) -> None:
        down, up = self._rates.down[rows], self._rates.up[rows]
        closed = self._rates.closed[rows] if closes else np.zeros(rows.size)
        stood = self._visible[rows] + self._hidden[rows]
        stands, gone = _after(stood, self._gone[rows], down, up, closed, years)
        # What has stood all the while is hidden as before, what was put up since as a new sign is.
        stayed = np.exp(-down * years)
        put_up = stands - stayed * stood
        hidden = stayed * self._hidden[rows] + self._p_hidden * np.maximum(put_up, 0.0)
        self._settle(rows, stands - hidden, hidden, gone)

    def _settle(self, rows: IntArray, visible: FloatArray, hidden: FloatArray, gone: FloatArray) -> None:
        total = visible + hidden + gone
        self.log_evidence[rows] += np.log(total)
        self._visible[rows], self._hidden[rows], self._gone[rows] = (
            visible / total,
            hidden / total,
            gone / total,
        )


def _after(
    stands: FloatArray,
    gone: FloatArray,
    down: FloatArray,
    up: FloatArray,
    closed: FloatArray,
    years: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Solve d stands = up gone - down stands, d gone = down stands - (up + closed) gone.

    By the exponential of a 2 x 2 matrix; what is closed drops out, so that the sum falls below 1.
    """
    mean = -(down + up + closed) / 2
    half = np.sqrt(np.maximum(mean**2 - down * closed, 0.0))
    grow = np.exp((mean + half) * years)
    shrink = np.exp((mean - half) * years)
    even = (grow + shrink) / 2
    # (grow - shrink) / (2 half), which is years times exp(mean years) where both roots are one.
    wide = half * years > 1e-6
    odd = np.where(wide, (grow - shrink) / np.where(wide, 2 * half, 1.0), years * even)
    return (
        even * stands + odd * (up * gone - (down + mean) * stands),
        even * gone + odd * (down * stands - (up + closed + mean) * gone),
    )


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
