"""How good unstated poses are, by what the bearings make of them: variance components."""

from __future__ import annotations

import numpy as np

from geoloc.adjustment.model import Model
from geoloc.adjustment.solve import Solution
from geoloc.trajectory.pose_noise import PoseSigmas

_PROBES = 16
# What the track itself says counts as much as this many residuals against what the bearings say.
_STATED_WEIGHT = 10.0
# A place that is off all the way shows in no bearing: that its changes are small makes it no better.
_LIMITS_PLACE, _LIMITS_ANGLE = (1.0, 3.0), (0.5, 3.0)
_SETTLED = 0.1
# A node's unknowns: roll, pitch, heading, east, north, up.
_AXES = (
    ((3, 4), _LIMITS_PLACE),
    ((5,), _LIMITS_PLACE),
    ((0, 1), _LIMITS_ANGLE),
    ((2,), _LIMITS_ANGLE),
)


def factors_of_poses(model: Model, solution: Solution) -> PoseSigmas:
    """Factors on the sigmas of poses that their corrections ask for.

    Helmert's estimate of variance components, in the form of Förstner: the squared residuals of each group of
    priors over their redundancy, ``n - tr(N⁻¹ J_gᵀ J_g)``; that trace by Hutchinson's estimator. What no
    bearing can tell has no redundancy, and stays as it was.

    Returns
    -------
    PoseSigmas
        Of factors.

    Notes
    -----
    Förstner (1979), "Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten", AVN 86.
    """
    equations, layout = solution.equations, model.layout
    axis = np.full(layout.size, -1)
    nodes = layout.node(np.arange(layout.n_nodes))[:, :6]
    axis[nodes] = np.arange(6)
    prior = equations.prior
    of_row = np.full(prior.constant.size, -1)
    of_row[prior.row] = axis[prior.column]
    residual = equations.prior_residual(solution.x)
    probes = np.random.default_rng(0).choice([-1.0, 1.0], size=(layout.size, _PROBES))
    fixed = equations.fixed.tocsr()

    def factor(axes: tuple[int, ...], limits: tuple[float, float]) -> float:
        rows = np.flatnonzero(np.isin(of_row, axes))
        part = fixed[rows]
        taken_up = float(np.sum(probes * solution.system.factor.solve(part.T @ (part @ probes)))) / _PROBES
        redundancy = max(rows.size - taken_up, 0.0)
        square = float(np.sum(residual[rows] ** 2))
        ratio = (square + _STATED_WEIGHT) / (redundancy + _STATED_WEIGHT)
        return float(np.clip(np.sqrt(ratio), *limits))

    return PoseSigmas(*(factor(axes, limits) for axes, limits in _AXES))


def is_settled(factors: PoseSigmas) -> bool:
    """Whether they change nothing that matters."""
    return bool(np.abs(np.log(factors)).max() < _SETTLED)
