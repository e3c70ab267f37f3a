"""Least squares for a chain of states, each tied to the next, that share a few constants.

The normal matrix is block tridiagonal with a border for the constants. It is factored as one band, so that an
hour of epochs costs a second, and the diagonal blocks of its inverse, which are the covariances, follow from
the factor by the recursion of a Rauch–Tung–Striebel smoother.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray

MEDIAN_1D, MEDIAN_2D = 0.674, 1.177
"""Median of the size of a unit normal, and of the distance of two."""
_GATE = 3.0


def robust_weight(off: FloatArray, median: float, power: int) -> tuple[FloatArray, float]:
    """Weigh residuals by their size, and tell by what factor they scatter more than they should.

    Parameters
    ----------
    off : float64 (n,)
        Sizes of residuals in sigmas.
    median : float
        Of `off`, were the sigmas right: `MEDIAN_1D` or `MEDIAN_2D`.
    power : int
        1 for Huber's weights, 2 for their square.

    Returns
    -------
    weight : float64 (n,)
        1 up to three sigma of what they really scatter.
    scale : float
        1 or more.
    """
    scale = max(1.0, float(np.median(off)) / median)
    gate = _GATE * scale
    return np.minimum(1.0, gate / np.maximum(off, gate)) ** power, scale


class Known(NamedTuple):
    """What is known of one knot's state and of the constants together: a normal distribution.

    Attributes
    ----------
    mean : float64 (size + constants,)
    information : float64 (size + constants, size + constants)
        Inverse of the covariance.
    """

    mean: FloatArray
    information: FloatArray


class Window(NamedTuple):
    """Where a part of a drive begins and what of it is left behind: for a smoother that follows a drive.

    Attributes
    ----------
    before : Known or None
        What all knots before the first tell of it; None where the drive begins with it.
    leave : int
        `Known` is worked out for this knot from all before it: the next window begins there.
    """

    before: Known | None
    leave: int


class Links:
    """What ties each state to the next: ``by_here @ here - by_next @ next`` is 0 but for noise.

    Parameters
    ----------
    by_here, by_next : float64 (n - 1, q, size)
    information : float64 (n - 1, q, q)
        Inverse of the noise's covariance.
    """

    def __init__(self, by_here: FloatArray, by_next: FloatArray, information: FloatArray) -> None:
        self.by_here, self.by_next = by_here, by_next
        self.by_here_weighted, self.by_next_weighted = information @ by_here, information @ by_next
        self.here = by_here.swapaxes(1, 2) @ self.by_here_weighted
        self.there = by_next.swapaxes(1, 2) @ self.by_next_weighted
        self.across = -by_here.swapaxes(1, 2) @ self.by_next_weighted


class Chain:
    """Normal equations of `knots` states of `size` unknowns and of `constants` shared unknowns.

    With `until`, only what is observed before that knot counts, and links that lead to it.
    """

    def __init__(self, knots: int, size: int, constants: int, until: int | None = None) -> None:
        self._until = until
        self._diagonal = np.zeros((knots, size, size))
        self._next = np.zeros((max(knots - 1, 0), size, size))
        self._border = np.zeros((knots, size, constants))
        self._corner = np.zeros((constants, constants))
        self._right = np.zeros((knots, size))
        self._right_constants = np.zeros(constants)
        self._factor = np.zeros((0, 0))

    def observe(
        self, jacobian: FloatArray, residual: FloatArray, weight: FloatArray, by_constants: FloatArray | None
    ) -> None:
        """Add observations at the knots: ``residual = observed - expected``.

        Parameters
        ----------
        jacobian : float64 (n, q, size)
            Of the expected value, by the state.
        residual, weight : float64 (n, q)
            `weight` is one over the variance; 0 leaves an observation out.
        by_constants : float64 (n, q, constants), optional
        """
        if self._until is not None:
            weight = np.where(np.arange(len(weight))[:, None] < self._until, weight, 0.0)
        weighted = jacobian.swapaxes(1, 2) * weight[:, None, :]
        self._diagonal += weighted @ jacobian
        self._right += (weighted @ residual[:, :, None])[:, :, 0]
        if by_constants is not None:
            self._border += weighted @ by_constants
            self._corner += np.einsum("nqi,nq,nqj->ij", by_constants, weight, by_constants)
            self._right_constants += np.einsum("nqi,nq,nq->i", by_constants, weight, residual)

    def tie(self, links: Links, state: FloatArray) -> None:
        """Add the links between neighbours, at a state ``(n, size)``."""
        residual = np.einsum("nij,nj->ni", links.by_here, state[:-1])
        residual -= np.einsum("nij,nj->ni", links.by_next, state[1:])
        some = slice(self._until)
        self._diagonal[:-1][some] += links.here[some]
        self._diagonal[1:][some] += links.there[some]
        self._next[some] += links.across[some]
        self._right[:-1][some] -= np.einsum("nij,ni->nj", links.by_here_weighted, residual)[some]
        self._right[1:][some] += np.einsum("nij,ni->nj", links.by_next_weighted, residual)[some]

    def across(
        self,
        by_here: FloatArray,
        by_next: FloatArray,
        by_constants: FloatArray,
        residual: FloatArray,
        weight: FloatArray,
    ) -> None:
        """Add one observation of each two neighbours: ``residual = observed - expected``.

        Parameters
        ----------
        by_here, by_next : float64 (n - 1, size)
            Jacobians of the expected value, by a state and by the next.
        by_constants : float64 (n - 1, constants)
        residual, weight : float64 (n - 1,)
            As in `observe`.
        """
        if self._until is not None:
            weight = np.where(np.arange(len(weight)) < self._until, weight, 0.0)
        here, there = weight[:, None] * by_here, weight[:, None] * by_next
        self._diagonal[:-1] += here[:, :, None] * by_here[:, None, :]
        self._diagonal[1:] += there[:, :, None] * by_next[:, None, :]
        self._next += here[:, :, None] * by_next[:, None, :]
        self._right[:-1] += here * residual[:, None]
        self._right[1:] += there * residual[:, None]
        self._border[:-1] += here[:, :, None] * by_constants[:, None, :]
        self._border[1:] += there[:, :, None] * by_constants[:, None, :]
        weighted = weight[:, None] * by_constants
        self._corner += weighted.T @ by_constants
        self._right_constants += weighted.T @ residual

    def expect_constants(self, residual: FloatArray, sigma: FloatArray) -> None:
        """Add what is known beforehand of the constants."""
        self._corner += np.diag(sigma**-2.0)
        self._right_constants += residual / sigma**2

    def expect_first(self, residual: FloatArray, information: FloatArray) -> None:
        """Add what is known beforehand of the first state and of the constants together, in that order."""
        size, right = self._right.shape[1], information @ residual
        self._diagonal[0] += information[:size, :size]
        self._border[0] += information[:size, size:]
        self._corner += information[size:, size:]
        self._right[0] += right[:size]
        self._right_constants += right[size:]

    def known_at(self, knot: int, state: FloatArray, constants: FloatArray) -> Known:
        """What all before tells of a knot and of the constants, at the state ``(n, size)`` of the equations.

        Of a chain that counts until that knot.
        """
        block, border, right = self._diagonal[0], self._border[0], self._right[0]
        corner, right_constants = self._corner.copy(), self._right_constants.copy()
        for k in range(knot):
            onward = self._next[k]
            solved = np.linalg.solve(block, np.column_stack([onward, border, right]))
            by_next, by_constants, plain = np.split(solved, [len(onward), solved.shape[1] - 1], axis=1)
            corner -= border.T @ by_constants
            right_constants -= border.T @ plain[:, 0]
            block = self._diagonal[k + 1] - onward.T @ by_next
            border = self._border[k + 1] - onward.T @ by_constants
            right = self._right[k + 1] - onward.T @ plain[:, 0]
        information = np.block([[block, border], [border.T, corner]])
        information = 0.5 * (information + information.T)
        step = np.linalg.solve(information, np.concatenate([right, right_constants]))
        return Known(np.concatenate([state[knot], constants]) + step, information)

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Return the corrections of the states ``(n, size)`` and of the constants."""
        from scipy.linalg import cho_solve_banded, cholesky_banded

        n, size, constants = self._border.shape
        self._factor = cholesky_banded(self._band(), lower=True, overwrite_ab=True)
        flat = np.concatenate([self._right[:, :, None], self._border], axis=2).reshape(n * size, -1)
        solved = cho_solve_banded((self._factor, True), flat).reshape(n, size, -1)
        plain, self._by_constants = solved[:, :, 0], solved[:, :, 1:]
        self._schur = self._corner - np.einsum("nic,nid->cd", self._border, self._by_constants)
        rest = self._right_constants - np.einsum("nic,ni->c", self._border, plain)
        step = np.linalg.solve(self._schur, rest) if constants else rest
        return plain - self._by_constants @ step, step

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariances of the states ``(n, size, size)`` and of the constants, after `solve`."""
        n = len(self._border)
        here, below = self._blocks()
        inverse = np.linalg.inv(here)
        result = inverse.swapaxes(1, 2) @ inverse
        gain = below @ inverse[:-1]
        gain_t = np.ascontiguousarray(gain.swapaxes(1, 2))
        for k in range(n - 2, -1, -1):
            result[k] += gain_t[k] @ result[k + 1] @ gain[k]
        shared = np.linalg.inv(self._schur)
        return result + self._by_constants @ shared @ self._by_constants.swapaxes(1, 2), shared

    def by_constants(self) -> FloatArray:
        """How each state moves with the constants ``(n, size, constants)``, after `solve`."""
        return -self._by_constants

    def _band(self) -> FloatArray:
        """The normal matrix as lower bands: row i - j, column j (Fortran order, as LAPACK wants it)."""
        n, size, _ = self._diagonal.shape
        below = np.zeros((n, size, size))
        below[:-1] = self._next.swapaxes(1, 2)
        column = np.concatenate([self._diagonal, below], axis=1).transpose(0, 2, 1)
        band = np.zeros((n, size, 2 * size))
        for j in range(size):
            band[:, j, : 2 * size - j] = column[:, j, j:]
        return band.reshape(n * size, 2 * size).T

    def _blocks(self) -> tuple[FloatArray, FloatArray]:
        """The factor's blocks on the diagonal and below it."""
        n, size, _ = self._diagonal.shape
        band = self._factor.T.reshape(n, size, 2 * size)
        column = np.zeros((n, size, 2 * size))
        for j in range(size):
            column[:, j, j:] = band[:, j, : 2 * size - j]
        return column[:, :, :size].swapaxes(1, 2), column[:-1, :, size:].swapaxes(1, 2)
