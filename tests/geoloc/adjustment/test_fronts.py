"""Factor of normal equations in blocks against the dense matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from geoloc.adjustment.fronts import Fronts

LOCAL, SHARED = 400, 7


def in_time(rng: np.random.Generator, rows: int, width: int, reach: int) -> np.ndarray:
    """Unknowns that rows touch: some near one another, and the last two are shared."""
    near = np.argsort(rng.random((rows, reach)), axis=1)[:, : width - 2]
    shared = np.argsort(rng.random((rows, SHARED)), axis=1)[:, :2]
    return np.concatenate([rng.integers(0, LOCAL - reach, (rows, 1)) + near, LOCAL + shared], axis=1)


@pytest.mark.parametrize("reach", [9, 150, LOCAL - 1])
def test_factor_solves_as_the_dense_matrix_does(reach: int) -> None:
    """Unknowns, local ones alone, the shared ones' covariance and damping, however far apart rows reach."""
    rng = np.random.default_rng(reach)
    columns = [in_time(rng, 900, 6, reach), in_time(rng, 5, 8, reach), np.empty((0, 3), dtype=np.int64)]
    parts = [rng.normal(size=column.shape) for column in columns]
    size = LOCAL + SHARED
    # Neighbours in time are tied by rows that never change.
    fixed = np.eye(size) - 0.9 * np.diag(np.ones(size - 1), -1)
    dense = [fixed]
    for part, column in zip(parts, columns, strict=True):
        dense.append(np.zeros((len(part), size)))
        np.put_along_axis(dense[-1], column, part, axis=1)
    normal = np.concatenate(dense).T @ np.concatenate(dense)
    fronts = Fronts(columns, csr_array(fixed), LOCAL)
    factor, right = fronts.factorised(parts), rng.normal(size=(size, 3))

    def same(one: np.ndarray, other: np.ndarray) -> None:
        np.testing.assert_allclose(one, other, atol=1e-10 * np.abs(other).max())

    same(factor.solve(right), np.linalg.solve(normal, right))
    same(factor.solve(right[:, 0]), np.linalg.solve(normal, right[:, 0]))
    local, tied = normal[:LOCAL, :LOCAL], normal[:LOCAL, LOCAL:]
    same(factor.solve_local(right[:LOCAL]), np.linalg.solve(local, right[:LOCAL]))
    same(factor.answer_to_shared(), -np.linalg.solve(local, tied))
    same(factor.shared_covariance(), np.linalg.inv(normal)[LOCAL:, LOCAL:])
    damped = normal + 0.3 * np.diag(np.diag(normal))
    same(fronts.factorised(parts, 0.3).solve(right), np.linalg.solve(damped, right))


def test_matrix_that_is_not_positive_is_refused() -> None:
    """An unknown of which nothing is known is told, not solved for."""
    nothing = csr_array((1, LOCAL + SHARED))
    with pytest.raises(np.linalg.LinAlgError):
        Fronts([np.empty((0, 3), dtype=np.int64)], nothing, LOCAL).factorised([np.empty((0, 3))])
