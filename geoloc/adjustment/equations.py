"""Normal equations of a drive, in an order of the unknowns in which they factorise in linear time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geoloc.adjustment.model import Linear, Model
from geoloc.adjustment.unknowns import NODE_STEP_NS, PER_NODE, Prior
from geoloc.arrays import FloatArray, IntArray

_PROBES = 16


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations, factorised; rows and columns in the order of `Equations.place`.

    Attributes
    ----------
    factor : SuperLU
        Of the normal matrix.
    normal : sparse (u, u)
    gradient : float64 (u,)
    jacobian : sparse (2n, u)
        Derivatives of the rays' residuals, weighed.
    """

    factor: Any
    normal: Any
    gradient: FloatArray
    jacobian: Any

    def taken_up(self) -> float:
        """Degrees of freedom of the rays that the unknowns take up: the trace of the hat matrix.

        Of many unknowns by Hutchinson's estimator: the mean of ``zᵀ J N⁻¹ Jᵀ z`` over random signs z, one a
        residual. (One an unknown would scatter by how unlike their units are.)
        """
        size = self.gradient.size
        if size <= 20 * _PROBES:
            every = np.eye(size)
            return float(np.sum(every * self.factor.solve(self.jacobian.T @ (self.jacobian @ every))))
        probes = np.random.default_rng(0).choice([-1.0, 1.0], size=(self.jacobian.shape[0], _PROBES))
        seen = self.jacobian.T @ probes
        return float(np.sum(seen * self.factor.solve(seen)) / _PROBES)


class Equations:
    """The equations of a model.

    Unknowns are eliminated in the order of time, and what all sightings share last: the body's bounce at an
    instant touches its neighbours in time alone, so that eliminating it fills in next to nothing. The factor
    then grows with the length of the drive, not with its square.

    Attributes
    ----------
    model : Model
    prior : Prior
    place : int64 (u,)
        Row of each unknown in the equations.
    fixed : sparse (k, u)
        Derivatives of the priors, columns in that order.
    """

    def __init__(self, model: Model, prior: Prior) -> None:
        from scipy.sparse import csr_array

        self.model, self.prior = model, prior
        when = epochs_of_unknowns(model)
        self.place = np.empty(when.size, dtype=np.int64)
        self.place[np.argsort(when, kind="stable")] = np.arange(when.size)
        shape = (prior.constant.size, when.size)
        self.fixed = csr_array((prior.value, (prior.row, self.place[prior.column])), shape=shape)

    def squares(self, x: FloatArray) -> FloatArray:
        """Squared normalised residual (n,) of each sighting."""
        return np.asarray((self.model.ray_residuals(x) ** 2).sum(axis=1))

    def other_cost(self, x: FloatArray) -> float:
        """Sum of squares of everything but the sightings."""
        cost = float(np.sum(self.prior_residual(x) ** 2))
        return cost + sum(float(np.sum(part.residual**2)) for part in self._ground(x))

    def system(self, x: FloatArray, weight: FloatArray) -> System:
        """Normal equations at `x`, with sightings weighed by `weight` (n,)."""
        from scipy.sparse import vstack

        rays = self.model.rays(x)
        both = np.sqrt(np.repeat(weight, 2))
        jacobian = self.matrix(Linear(rays.residual * both, rays.derivative * both[:, None], rays.column))
        ground = self._ground(x)
        # One product of all rows: sums of products of each kind would cost as much again.
        rows = vstack([jacobian, self.fixed, *map(self.matrix, ground)], format="csr")
        residual = [both * rays.residual, self.prior_residual(x), *(part.residual for part in ground)]
        normal = rows.T @ rows
        return System(factorised(normal), normal, rows.T @ np.concatenate(residual), jacobian)

    def ground(self, x: FloatArray) -> list[Any]:
        """Sparse derivatives of what is known of the ground."""
        return [self.matrix(part) for part in self._ground(x)]

    def prior_residual(self, x: FloatArray) -> FloatArray:
        """Residuals of the priors, of unit variance (k,)."""
        permuted = np.empty_like(x)
        permuted[self.place] = x
        return np.asarray(self.fixed @ permuted + self.prior.constant)

    def _ground(self, x: FloatArray) -> list[Linear]:
        return [part for part in (self.model.heights(x), self.model.terrain_heights(x)) if part is not None]

    def matrix(self, part: Linear) -> Any:
        """Return derivatives as a sparse matrix, columns in the order of `place`."""
        from scipy.sparse import csr_array

        k, j = part.column.shape
        pointers = np.arange(k + 1) * j
        columns = self.place[part.column].ravel()
        return csr_array((part.derivative.ravel(), columns, pointers), shape=(k, self.place.size))


def factorised(normal: Any) -> Any:
    """Factorise a symmetric positive matrix in the order in which it stands."""
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    return splu(normal.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)


def epochs_of_unknowns(model: Model) -> IntArray:
    """When each unknown (u,) has been seen for the last time; what is shared by all never has."""
    layout, scene = model.layout, model.scene
    when = np.full(layout.size, np.iinfo(np.int64).max)
    nodes, points = np.arange(layout.n_nodes), np.arange(layout.n_points)
    # A node corrects what lies up to a second after it: later than that nothing touches it.
    when[layout.node(nodes)] = np.repeat(model.node_ns + NODE_STEP_NS, PER_NODE).reshape(-1, PER_NODE)
    last = np.full(layout.n_points, np.iinfo(np.int64).min)
    np.maximum.at(last, scene.point, scene.epoch_ns)
    when[layout.point(points)] = np.repeat(last, 3).reshape(-1, 3)
    instants = np.arange(layout.n_instants)
    when[layout.bounce(instants)] = np.repeat(scene.instant_ns, 3).reshape(-1, 3)
    return when
