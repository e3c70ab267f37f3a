"""Cholesky's factor of normal equations whose rows touch few unknowns at a time, in dense blocks.

Unknowns are eliminated in the order in which they stand, some dozens at a time. Such a block, what came
before that is still tied to it, and the later unknowns that its rows touch are a *front*: one small dense
matrix, made of the front's own rows and of what the front before left over. Where the order is that of time a
front stays narrow, and the work grows with the number of fronts. (A multifrontal factorisation whose tree is
a path: Liu 1992, "The multifrontal method for sparse matrix solution", SIAM Review 34(1).)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray

# Larger blocks hold more zeros, smaller ones are more of them.
_BLOCK = 48


@dataclass(frozen=True, slots=True)
class Front:
    """Unknowns that are eliminated together.

    Attributes
    ----------
    first, last : int
        The unknowns from `first` to before `last` are eliminated.
    column : int64 (c,)
        These and the later ones that they are tied to, ascending.
    left_over : int64 (e,)
        Where in `column` those stand that the front before left over.
    height : int
        Number of rows that the front takes.
    rows : sequence of int64 (k,)
        Which these are, of each kind of rows.
    entry : sequence of int64 (k, j)
        Where their derivatives stand in a dense matrix ``(height, c)``.
    fixed_entry, fixed : int64 (f,), float64 (f,)
        What rows that never change add to the front's matrix ``(c, c)``.
    """

    first: int
    last: int
    column: IntArray
    left_over: IntArray
    height: int
    rows: Sequence[IntArray]
    entry: Sequence[IntArray]
    fixed_entry: IntArray
    fixed: FloatArray


class _Eliminated(NamedTuple):
    """A front's part of the factor L: its unknowns, and the later ones that they are tied to.

    Of L it has the inverse of the block on the diagonal, and (transposed) the block below.
    """

    own: slice
    later: IntArray
    inverse: FloatArray
    tied: FloatArray


@dataclass(frozen=True, slots=True)
class Factor:
    """A factorised normal matrix N; its last unknowns are shared by all, the others are local.

    Parameters
    ----------
    local : sequence of _Eliminated
    shared : _Eliminated
    """

    local: Sequence[_Eliminated]
    shared: _Eliminated

    def solve(self, right: FloatArray) -> FloatArray:
        """``N⁻¹ right``, of ``(u,)`` or ``(u, k)``."""
        x = self._forward(right)
        own, inverse = self.shared.own, self.shared.inverse
        x[own] = inverse.T @ (inverse @ x[own])
        return self._backward(x)

    def solve_local(self, right: FloatArray) -> FloatArray:
        """``A⁻¹ right`` (l, k), where A is N without the shared unknowns."""
        own = self.shared.own
        x = self._forward(np.concatenate([right, np.zeros((own.stop - own.start, right.shape[1]))]))
        x[own] = 0.0
        return self._backward(x)[: own.start]

    def answer_to_shared(self) -> FloatArray:
        """``-A⁻¹ B`` (l, s): how the local unknowns follow the shared ones, where B ties them in N."""
        local, size = self.shared.own.start, self.shared.own.stop
        x = np.zeros((size, size - local))
        x[local:] = np.eye(size - local)
        return self._backward(x)[:local]

    def shared_covariance(self) -> FloatArray:
        """The block (s, s) of ``N⁻¹`` that belongs to the shared unknowns."""
        return np.asarray(self.shared.inverse.T @ self.shared.inverse)

    def _forward(self, right: FloatArray) -> FloatArray:
        x = right.copy()
        for own, later, inverse, tied in self.local:
            x[own] = inverse @ x[own]
            x[later] -= tied.T @ x[own]
        return x

    def _backward(self, x: FloatArray) -> FloatArray:
        for own, later, inverse, tied in reversed(self.local):
            x[own] = inverse.T @ (x[own] - tied @ x[later])
        return x


class Fronts:
    """The fronts of normal equations.

    Parameters
    ----------
    columns : sequence of int64 (k, j)
        Which unknowns each row touches, for each kind of rows that change.
    fixed : sparse (m, u)
        Rows that do not.
    shared : int
        From here on unknowns are shared by all.
    """

    def __init__(self, columns: Sequence[IntArray], fixed: Any, shared: int) -> None:
        self._columns = columns
        self._fixed_diagonal = fixed.power(2).sum(axis=0)
        starts = np.append(np.arange(0, shared, _BLOCK), [shared, fixed.shape[1]])
        self._fronts = list(_fronts(columns, (fixed.T @ fixed).tocoo(), starts))

    def factorised(self, parts: Sequence[FloatArray], damping: float = 0.0) -> Factor:
        """Factorise the normal matrix, with so much of its diagonal added to it.

        Parameters
        ----------
        parts : sequence of float64 (k, j)
            Derivatives of each kind of rows.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the matrix is not positive definite.
        """
        from scipy.linalg.lapack import dpotrf, dtrtri

        more = damping * self._diagonal(parts) if damping else None
        # Reused: the machine hands out new memory as slowly as it multiplies.
        dense_space = np.empty(max(front.height * front.column.size for front in self._fronts))
        space = np.empty(max(front.column.size for front in self._fronts) ** 2)
        eliminated: list[_Eliminated] = []
        left_over = np.empty((0, 0))
        for front in self._fronts:
            width, own = front.column.size, front.last - front.first
            dense = dense_space[: front.height * width].reshape(front.height, width)
            dense.fill(0.0)
            for part, rows, entry in zip(parts, front.rows, front.entry, strict=True):
                dense.put(entry, part.take(rows, axis=0))
            flat = space[: width * width]
            normal = flat.reshape(width, width)
            np.matmul(dense.T, dense, out=normal)
            flat[front.fixed_entry] += front.fixed
            normal[front.left_over[:, None], front.left_over] += left_over
            if more is not None:
                flat[: own * width : width + 1] += more[front.first : front.last]
            lower, failed = dpotrf(normal[:own, :own], lower=1)
            if failed:
                raise np.linalg.LinAlgError
            inverse, _ = dtrtri(lower, lower=1)
            tied = inverse @ normal[:own, own:]
            left_over = normal[own:, own:] - tied.T @ tied
            eliminated.append(_Eliminated(slice(front.first, front.last), front.column[own:], inverse, tied))
        *local, shared = eliminated
        return Factor(local, shared)

    def _diagonal(self, parts: Sequence[FloatArray]) -> FloatArray:
        diagonal = self._fixed_diagonal.copy()
        for part, column in zip(parts, self._columns, strict=True):
            diagonal += np.bincount(column.ravel(), part.ravel() ** 2, diagonal.size)
        return np.asarray(diagonal)


def _fronts(columns: Sequence[IntArray], normal: Any, starts: IntArray) -> Iterator[Front]:
    taken = [_by_front(starts, column.min(axis=1)) for column in columns]
    entries = _by_front(starts, np.minimum(normal.row, normal.col))
    is_tied = np.zeros(starts[-1], dtype=np.bool_)
    place = np.empty(starts[-1], dtype=np.int64)
    for number, (first, last) in enumerate(pairwise(starts.tolist())):
        left_over = np.flatnonzero(is_tied)
        rows, fixed = [of[number] for of in taken], entries[number]
        touched = [part[some] for part, some in zip(columns, rows, strict=True)]
        row, column = normal.row[fixed], normal.col[fixed]
        for unknowns in (*touched, row, column, slice(first, last)):
            is_tied[unknowns] = True
        tied = np.flatnonzero(is_tied)
        is_tied[first:last] = False
        place[tied] = np.arange(tied.size)
        ends = np.cumsum([0, *map(len, rows)])
        yield Front(
            first,
            last,
            tied,
            place[left_over],
            int(ends[-1]),
            rows,
            [
                place[part] + tied.size * np.arange(start, end)[:, None]
                for part, (start, end) in zip(touched, pairwise(ends), strict=True)
            ],
            place[row] * tied.size + place[column],
            normal.data[fixed],
        )


def _by_front(starts: IntArray, first: IntArray) -> list[IntArray]:
    """Rows by the front in which the first unknown that they touch is eliminated."""
    order = np.argsort(first, kind="stable")
    return np.split(order, np.searchsorted(first[order], starts[1:-1]))
