"""Covariances of the points from the inverse of the normal matrix, split by source."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from geoloc.adjustment.equations import epochs_of_unknowns
from geoloc.adjustment.fronts import Factor
from geoloc.adjustment.model import Model
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.unknowns import BESIDE_ROAD, TIME
from geoloc.arrays import FloatArray, IntArray

# What correlates points other than what all share fades with the attitude's processes, the slowest in 8 s on
# the clock of `Model.node_age_s`.
_APART_S = 60.0
# Groups of points that are solved for at once: many are no faster, and take more memory.
_AT_ONCE = 16


@dataclass(frozen=True, slots=True)
class Spread:
    """Covariances of the points, and where they come from.

    Attributes
    ----------
    covariance_m2 : float64 (m, 3, 3)
    by_source : mapping source → float64 (m, 3, 3)
        They add up to `covariance_m2`.
    shared : float64 (g, g)
        Covariance of the unknowns that all points share: time, readout, cameras.
    with_clock : float64 (m, 3)
        Covariance of the points with the clock's offset, metres times seconds.
    """

    covariance_m2: FloatArray
    by_source: dict[str, FloatArray]
    shared: FloatArray
    with_clock: FloatArray


def spread(model: Model, solution: Solution) -> Spread:
    """Covariances of the points, split by source.

    The estimate is a linear function ``-N⁻¹ Jᵀ r`` of independent residuals r of unit variance, so that the
    part of the covariance that comes from the rows g of J is ``N⁻¹ J_gᵀ J_g N⁻¹``. What the priors and the
    ground leave is the pixels' part.

    With A the part of N that belongs to one time, B its border and C what is shared, a column of ``N⁻¹`` for
    a point is ``y + S Σ Sᵀ e`` and ``Σ Sᵀ e``, where ``y = A⁻¹ e``, ``S = -A⁻¹ B`` and Σ is the inverse of
    ``C - Bᵀ A⁻¹ B``. The y fade within seconds of driving: points that are a minute of it apart,
    and belong to different objects, are solved for in one column. (An object that is seen on two passes ties
    their points together a little: the shares of the sources are then good to a per cent.)
    """
    layout, equations = model.layout, solution.equations
    n_shared = layout.first_point
    local = layout.size - n_shared
    factor = solution.system.factor
    to_local, shared = factor.answer_to_shared(), factor.shared_covariance()
    quadratic = {source: _quadratic(part, to_local) for source, part in _parts(solution).items()}
    places = equations.place[layout.point(np.arange(layout.n_points))]
    # How each point answers to what is shared (m, 3, g), and that times the shared covariance.
    response = to_local[places]
    through = response @ shared
    covariance = through @ np.swapaxes(response, 1, 2)
    by_source = {
        source: through @ part.shared @ np.swapaxes(through, 1, 2) for source, part in quadratic.items()
    }
    when = np.sort(epochs_of_unknowns(model))[:local]
    for points, y in _columns(factor, _far_apart(model), places, local):
        covariance[points] += y[places[points]]
        edges = np.searchsorted(when, _between(model, points))
        for source, part in quadratic.items():
            if part.local is None:
                continue
            weighed = part.local @ y
            for point, (low, high) in zip(points, pairwise(edges), strict=True):
                mine = y[low:high]
                cross = mine.T @ part.mixed[low:high] @ through[point].T
                by_source[source][point] += mine.T @ weighed[low:high] + cross + cross.T
    rest = covariance - np.sum(list(by_source.values()), axis=0)
    return Spread(covariance, {"pixels": rest, **by_source}, shared, through[:, :, TIME])


def spread_at_once(model: Model, solution: Solution) -> Spread:
    """The same of a few seconds of a drive, all of it as one source: that of the pixels."""
    layout, place, system = model.layout, solution.equations.place, solution.system
    points = place[layout.point(np.arange(layout.n_points))]
    shared = place[: layout.first_point]
    columns = np.zeros((layout.size, points.size + shared.size))
    columns[np.concatenate([points.ravel(), shared]), np.arange(columns.shape[1])] = 1.0
    inverse = system.factor.solve(columns)
    own = inverse[points][:, :, : points.size].reshape(layout.n_points, 3, layout.n_points, 3)
    covariance = own[np.arange(layout.n_points), :, np.arange(layout.n_points)]
    of_shared = inverse[:, points.size :]
    nothing = np.zeros_like(covariance)
    by_source = {"pixels": covariance, "ground": nothing, BESIDE_ROAD: nothing}
    return Spread(covariance, by_source, of_shared[shared], of_shared[points][:, :, TIME])


def _columns(
    factor: Factor, groups: list[IntArray], places: IntArray, local: int
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Each group of points, and their columns (l, 3) of ``A⁻¹``, of all points in one."""
    for first in range(0, len(groups), _AT_ONCE):
        some = groups[first : first + _AT_ONCE]
        right = np.zeros((local, 3 * len(some)))
        for number, points in enumerate(some):
            right[places[points], 3 * number + np.arange(3)] = 1.0
        solved = factor.solve_local(right)
        for number, points in enumerate(some):
            yield points, np.ascontiguousarray(solved[:, 3 * number : 3 * number + 3])


class _Quadratic(NamedTuple):
    """``Jᵀ J`` of one source's residuals: of the local unknowns, between these and the shared, of the shared.

    `mixed` and `shared` already follow the local unknowns' answer to the shared ones.
    """

    local: Any
    mixed: FloatArray
    shared: FloatArray


def _quadratic(part: Any, to_local: FloatArray) -> _Quadratic:
    local = to_local.shape[0]
    of_local, of_shared = part[:, :local], part[:, local:].toarray()
    rows = of_local @ to_local + of_shared
    touches = of_local.nnz > 0
    return _Quadratic(of_local.T @ of_local if touches else None, of_local.T @ rows, rows.T @ rows)


def _parts(solution: Solution) -> dict[str, Any]:
    """Derivatives of the residuals of each source but the pixels."""
    from scipy.sparse import vstack

    equations = solution.equations
    fixed = equations.fixed.tocsr()
    sources = equations.prior.source
    parts = {str(source): fixed[np.flatnonzero(sources == source)] for source in np.unique(sources)}
    return {**parts, "ground": vstack(equations.ground(solution.x)).tocsr()}


def _spans(model: Model, at_nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and last of what the nodes say (m,), by each point's sightings and its ground."""
    first, last = np.full(model.layout.n_points, np.inf), np.full(model.layout.n_points, -np.inf)
    ground = model.ground
    for point, left in ((model.scene.point, model.left), (ground.point, ground.left)):
        np.minimum.at(first, point, at_nodes[left])
        np.maximum.at(last, point, at_nodes[left + 1])
    return first, last


def _far_apart(model: Model) -> list[IntArray]:
    """Sort points into groups, each in the order of time and with a minute of driving between its points."""
    first, last = _spans(model, model.node_age_s)
    number = model.scene.object
    groups: list[list[int]] = []
    for point in np.argsort(first, kind="stable").tolist():
        for group in groups:
            # The foot and the face of one object are tied together however far apart they were seen.
            apart = first[point] - last[group].max() > _APART_S
            if apart and number[point] not in number[group]:
                group.append(point)
                break
        else:
            groups.append([point])
    return [np.array(group, dtype=np.int64) for group in groups]


def _between(model: Model, points: IntArray) -> FloatArray:
    """Times half-way between neighbouring points of a group, with both ends open."""
    first, last = _spans(model, model.node_ns.astype(np.float64))
    middle = 0.5 * (last[points[:-1]] + first[points[1:]])
    return np.concatenate([[-np.inf], middle, [np.inf]])
