"""Normal equations of a drive, in an order of the unknowns in which they factorise in linear time."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoloc.adjustment.fronts import Factor, Fronts
from geoloc.adjustment.model import Linear, Model
from geoloc.adjustment.unknowns import NODE_STEP_NS, PER_NODE, PITCHING, Prior
from geoloc.arrays import FloatArray, IntArray

_PROBES = 16
# The body of a car that stands does not bounce.
_STANDS_MPS = 1.0


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations, factorised; rows and columns in the order of `Equations.place`.

    Attributes
    ----------
    factor : Factor
        Of the normal matrix.
    gradient : float64 (u,)
    jacobian : sparse (2n, u)
        Derivatives of the rays' residuals, weighed.
    fronts, derivatives : Fronts, list of float64 (k, j)
        What was factorised.
    """

    factor: Factor
    gradient: FloatArray
    jacobian: Any
    fronts: Fronts
    derivatives: list[FloatArray]

    def damped(self, damping: float) -> Factor:
        """Factorise anew, with so much of its diagonal added to the normal matrix."""
        return self.fronts.factorised(self.derivatives, damping)

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
        start = np.zeros(when.size)
        rows = (model.rays(start), *self._ground(start))
        self._touched = [self.place[part.column] for part in rows]
        self._fronts = Fronts(self._touched, self.fixed, model.layout.size - model.layout.first_point)

    def with_model(self, model: Model) -> Equations:
        """The same for a model in which the same sightings depend on the same unknowns."""
        other = copy(self)
        other.model = model
        return other

    def squares(self, x: FloatArray) -> FloatArray:
        """Squared normalised residual (n,) of each sighting."""
        return np.asarray((self.model.ray_residuals(x) ** 2).sum(axis=1))

    def other_cost(self, x: FloatArray) -> float:
        """Sum of squares of everything but the sightings."""
        cost = float(np.sum(self.prior_residual(x) ** 2))
        return cost + sum(float(np.sum(part.residual**2)) for part in self._ground(x))

    def system(self, x: FloatArray, weight: FloatArray) -> System:
        """Normal equations at `x`, with sightings weighed by `weight` (n,)."""
        rays, ground = self.model.rays(x), self._ground(x)
        both = np.sqrt(np.repeat(weight, 2))
        derivatives = [rays.derivative * both[:, None], *(part.derivative for part in ground)]
        jacobian, *others = map(self._matrix, derivatives, self._touched)
        gradient = jacobian.T @ (both * rays.residual) + self.fixed.T @ self.prior_residual(x)
        for rows, part in zip(others, ground, strict=True):
            gradient += rows.T @ part.residual
        factor = self._fronts.factorised(derivatives)
        return System(factor, gradient, jacobian, self._fronts, derivatives)

    def pull_of_bounces(self, x: FloatArray, weight: FloatArray) -> FloatArray:
        """What to add to the gradient (u,), so that bounces of the body bias nothing but themselves.

        Where the cost is least over all unknowns at once, the others are biased: each instant's bounce takes
        up a little of what all share, always to the same side, and the more instants the further (Neyman and
        Scott 1948). 20 minutes in town would roll all cameras by 0.13 degrees, and the car against them. All
        but bounces is therefore told by residuals as they would answer to it if the driving car's body did
        not bounce: such sums are nought in the mean at the truth, however large bounces are (Liang and Zeger
        1986). About which axis the car pitches is what bounces alone can tell.
        """
        scene, layout = self.model.scene, self.model.layout
        speed_mps = np.hypot(scene.body.velocity_mps[:, 0], scene.body.velocity_mps[:, 1])
        still = x.copy()
        still[layout.bounce(scene.instant[speed_mps > _STANDS_MPS])] = 0.0
        rays = self.model.rays(x)
        more = self.model.rays(still).derivative - rays.derivative
        each = more * (np.repeat(weight, 2) * rays.residual)[:, None]
        pull = np.bincount(self._touched[0].ravel(), each.ravel(), x.size)
        pull[self.place[layout.first_instant :]] = 0.0
        pull[self.place[PITCHING]] = 0.0
        return np.asarray(pull)

    def ground(self, x: FloatArray) -> list[Any]:
        """Sparse derivatives of what is known of the ground."""
        return [
            self._matrix(part.derivative, touched)
            for part, touched in zip(self._ground(x), self._touched[1:], strict=True)
        ]

    def prior_residual(self, x: FloatArray) -> FloatArray:
        """Residuals of the priors, of unit variance (k,)."""
        permuted = np.empty_like(x)
        permuted[self.place] = x
        return np.asarray(self.fixed @ permuted + self.prior.constant)

    def _ground(self, x: FloatArray) -> list[Linear]:
        return [part for part in (self.model.heights(x), self.model.terrain_heights(x)) if part is not None]

    def matrix(self, part: Linear) -> Any:
        """Return derivatives as a sparse matrix, columns in the order of `place`."""
        return self._matrix(part.derivative, self.place[part.column])

    def _matrix(self, derivative: FloatArray, touched: IntArray) -> Any:
        from scipy.sparse import csr_array

        k, j = touched.shape
        pointers = np.arange(k + 1) * j
        return csr_array((derivative.ravel(), touched.ravel(), pointers), shape=(k, self.place.size))


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
