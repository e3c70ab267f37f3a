"""What sightings that have left the window tell of what is in it still: a normal distribution.

Every unknown that only they touch is eliminated from their equations (the Schur complement), so that later
windows go on as if all sightings were there, linearised where they were last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.build_model import Place
from geoloc.adjustment.equations import epochs_of_unknowns
from geoloc.adjustment.model import Model
from geoloc.adjustment.scene import Scene
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.unknowns import LEAN, PER_NODE, ROLL, Layout, Prior
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu

BEFORE = "before"
"""Source of what was seen before the window."""
# Directions of which less is known than this, in units of the best known of each unknown, count as unknown.
_NOTHING = 1e-10
LEARNED = frozenset({ROLL, LEAN})
"""What the trajectory learns itself, of its fixes: how well it knows these by now it says each time."""


class Key(NamedTuple):
    """Which unknown: of a point (object, is it a foot, axis), of a node (its epoch, axis) or a shared one."""

    kind: str
    owner: int
    of: bool
    axis: int


class Carried(NamedTuple):
    """A quadratic cost ``½ δᵀ Λ δ + ηᵀ δ`` of what unknowns differ from `at`.

    Attributes
    ----------
    keys : sequence of Key (k,)
    information : float64 (k, k)
    gradient : float64 (k,)
    at : float64 (k,)
        Values of shared unknowns, with what was taken off before (`left_behind`), and of nodes; 0 for points.
    places : mapping (object, is foot) → Place
        Where points are for `at`.
    first_node_ns : int
        The node that follows from those that have gone: what is known of nodes holds where it is the first.
    """

    keys: Sequence[Key]
    information: FloatArray
    gradient: FloatArray
    at: FloatArray
    places: Mapping[tuple[int, bool], Place]
    first_node_ns: int

    def only(self, keys: BoolArray) -> Carried:
        """Eliminate the others."""
        if keys.all():
            return self
        information, gradient = eliminated(self.information, self.gradient, keys)
        kept = [key for key, keep in zip(self.keys, keys.tolist(), strict=True) if keep]
        return self._replace(keys=kept, information=information, gradient=gradient, at=self.at[keys])

    def without(self, shared: Set[int]) -> Carried:
        """Eliminate these of what all sightings share."""
        return self.only(np.array([not (key.kind == "shared" and key.axis in shared) for key in self.keys]))

    def loosened(self, variance: Mapping[Key, float]) -> Carried:
        """Let these unknowns wander by so much."""
        rows = np.array([i for i, key in enumerate(self.keys) if key in variance], dtype=np.int64)
        if not rows.size:
            return self
        spread = np.diag([1.0 / variance[self.keys[i]] for i in rows])
        inner = np.linalg.inv(self.information[np.ix_(rows, rows)] + spread)
        taken = self.information[:, rows] @ inner
        return self._replace(
            information=self.information - taken @ self.information[rows],
            gradient=self.gradient - taken @ self.gradient[rows],
        )

    def added_to(self, prior: Prior, model: Model, taken: Mapping[int, float]) -> Prior:
        """Return what is known beforehand of a window, with this in place of what it says of the same."""
        layout = model.layout
        column = columns_of(self.keys, model)
        if model.node_ns[0] != self.first_node_ns:
            column = np.where([key.kind == "node" for key in self.keys], -1, column)
        known = self.only(column >= 0)
        column = column[column >= 0]
        matrix, constant = known.rows()
        off = _zeros(known, model, taken) - known.at
        kept = _not_known_twice(prior, layout, set(column.tolist()) - LEARNED)
        k, j = matrix.shape
        return Prior(
            np.concatenate([kept.row, kept.constant.size + np.repeat(np.arange(k), j)]),
            np.concatenate([kept.column, np.tile(column, k)]),
            np.concatenate([kept.value, matrix.ravel()]),
            np.concatenate([kept.constant, constant + matrix @ off]),
            np.concatenate([kept.source, np.full(k, BEFORE)]),
        )

    def rows(self) -> tuple[FloatArray, FloatArray]:
        """Residuals of unit variance: matrix (m, k) and constant (m,)."""
        unit = np.sqrt(np.maximum(np.diag(self.information), 1e-30))
        size, axes = np.linalg.eigh(self.information / np.outer(unit, unit))
        keep = size > _NOTHING * max(float(size[-1]), 1e-30)
        root = np.sqrt(size[keep])
        return (axes[:, keep] * root).T * unit, (axes[:, keep] / root).T @ (self.gradient / unit)


def eliminated(
    information: FloatArray, gradient: FloatArray, keep: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Information and gradient of some unknowns, the others left to be what fits best."""
    rest = ~keep
    border = information[np.ix_(keep, rest)]
    inner = information[np.ix_(rest, rest)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-30))
    # What nothing is known of says nothing.
    solved = np.linalg.solve(
        inner / np.outer(scale, scale) + 1e-12 * np.eye(scale.size),
        np.column_stack([border.T, gradient[rest]]) / scale[:, None],
    )
    solved /= scale[:, None]
    left = information[np.ix_(keep, keep)] - border @ solved[:, :-1]
    return 0.5 * (left + left.T), gradient[keep] - border @ solved[:, -1]


def points_of(model: Model) -> dict[tuple[int, bool], int]:
    """Number of each point by its object and whether it is a foot."""
    scene = model.scene
    pairs = zip(scene.object.tolist(), scene.is_foot.tolist(), strict=True)
    return {(number, foot): i for i, (number, foot) in enumerate(pairs)}


def columns_of(keys: Sequence[Key], model: Model) -> IntArray:
    """Where unknowns stand in a window (k,); -1 for those that it does not have."""
    layout, points = model.layout, points_of(model)
    nodes = {int(epoch): i for i, epoch in enumerate(model.node_ns)}
    column = np.full(len(keys), -1)
    for i, key in enumerate(keys):
        if key.kind == "shared":
            column[i] = key.axis
        elif key.kind == "node" and key.owner in nodes:
            column[i] = layout.first_node + PER_NODE * nodes[key.owner] + key.axis
        elif key.kind == "point" and (key.owner, key.of) in points:
            column[i] = layout.first_point + 3 * points[key.owner, key.of] + key.axis
    return column


def left_behind(model: Model, solution: Solution, cut_ns: int, taken: Mapping[int, float]) -> Carried:
    """What all that was seen before an epoch, the beginning of a second, tells of what stays.

    Parameters
    ----------
    model, solution
        Of the window.
    cut_ns : int
    taken : mapping shared unknown → float
        What was taken off it before the window was solved: what was added to the clock, and what the
        trajectory takes its lasting roll for.
    """
    layout, equations, system = model.layout, solution.equations, solution.system
    when = epochs_of_unknowns(model)
    nodes = layout.node(np.arange(layout.n_nodes))
    when[nodes] = np.repeat(model.node_ns, PER_NODE).reshape(-1, PER_NODE)
    gone = when < cut_ns
    old = model.scene.epoch_ns < cut_ns
    both = np.sqrt(np.repeat(solution.weight, 2))
    rays_old = np.flatnonzero(np.repeat(old, 2))
    seen = (model.ray_residuals(solution.x).ravel() * both)[rays_old]
    matrices, residuals = [system.jacobian[rays_old]], [seen]
    rows = _prior_rows(equations.prior, layout, gone)
    matrices.append(equations.fixed[rows])
    residuals.append(equations.prior_residual(solution.x)[rows])
    for part in (model.heights(solution.x), model.terrain_heights(solution.x)):
        if part is not None:
            mine = np.flatnonzero(gone[part.column[:, 0]])
            matrices.append(equations.matrix(part)[mine])
            residuals.append(part.residual[mine])
    from scipy.sparse import vstack

    jacobian = vstack(matrices, format="csc")
    touched = np.flatnonzero(np.diff(jacobian.indptr))
    dense = jacobian[:, touched].toarray()
    unknown = np.argsort(equations.place)[touched]
    keep = ~gone[unknown]
    pull = equations.pull_of_bounces(solution.x, np.where(old, solution.weight, 0.0))
    gradient = dense.T @ np.concatenate(residuals) + pull[touched]
    information, gradient = eliminated(dense.T @ dense, gradient, keep)
    return _carried(model, solution, unknown[keep], information, gradient, cut_ns, taken)


def _zeros(known: Carried, model: Model, taken: Mapping[int, float]) -> FloatArray:
    """What these unknowns are, on the scale of `Carried.at`, where the window's are 0."""
    zero, points = np.zeros(len(known.keys)), points_of(model)
    starts = {
        one: start_from(place, model.scene, points[one])
        for one, place in known.places.items()
        if one in points
    }
    for i, key in enumerate(known.keys):
        if key.kind == "shared":
            zero[i] = taken.get(key.axis, 0.0)
        elif key.kind == "point" and (key.owner, key.of) in starts:
            zero[i] = starts[key.owner, key.of][key.axis]
    return zero


def _carried(
    model: Model,
    solution: Solution,
    unknown: IntArray,
    information: FloatArray,
    gradient: FloatArray,
    cut_ns: int,
    taken: Mapping[int, float],
) -> Carried:
    """Name the unknowns, and say where they are."""
    layout, scene, every = model.layout, model.scene, places_of(model, solution.x)
    keys, at, places = [], solution.x[unknown].copy(), {}
    for i, one in enumerate(unknown.tolist()):
        if one < layout.first_point:
            keys.append(Key("shared", 0, False, one))
            at[i] += taken.get(one, 0.0)
        elif one < layout.first_node:
            point, axis = divmod(one - layout.first_point, 3)
            owner, foot = int(scene.object[point]), bool(scene.is_foot[point])
            keys.append(Key("point", owner, foot, axis))
            places[owner, foot] = every[owner, foot]
            at[i] = 0.0
        else:
            node, axis = divmod(one - layout.first_node, PER_NODE)
            keys.append(Key("node", int(model.node_ns[node]), False, axis))
    stays = model.node_ns[model.node_ns >= cut_ns]
    return Carried(keys, information, gradient, at, places, int(stays[0]) if stays.size else 0)


def _prior_rows(prior: Prior, layout: Layout, gone: BoolArray) -> IntArray:
    """Rows of what was known beforehand that go with what has gone."""
    k = prior.constant.size
    touches, of_instants, of_all = np.zeros(k, bool), np.zeros(k, bool), np.ones(k, bool)
    np.logical_or.at(touches, prior.row, gone[prior.column])
    # The bounce begins anew where the window does: it lasts for a tenth of a second.
    stays = (prior.column >= layout.first_instant) & ~gone[prior.column]
    np.logical_or.at(of_instants, prior.row, stays)
    np.logical_and.at(of_all, prior.row, prior.column < layout.first_point)
    learned = np.zeros(k, bool)
    learned[prior.row[np.isin(prior.column, list(LEARNED))]] = True
    mine = (touches & ~of_instants) | of_all
    return np.flatnonzero((mine & ~learned) | (prior.source == BEFORE))


def _not_known_twice(prior: Prior, layout: Layout, columns: set[int]) -> Prior:
    """Leave out what is said by itself of unknowns that more is known of."""
    k = prior.constant.size
    known = np.isin(prior.column, list(columns))
    # A point's "anywhere" is not carried on, and says nothing.
    known &= (prior.column < layout.first_point) | (prior.column >= layout.first_node)
    alone = np.bincount(prior.row, minlength=k) == 1
    drop = np.zeros(k, bool)
    drop[prior.row[known]] = True
    drop &= alone
    keep_row = ~drop
    number = np.cumsum(keep_row) - 1
    entry = keep_row[prior.row]
    return Prior(
        number[prior.row[entry]],
        prior.column[entry],
        prior.value[entry],
        prior.constant[keep_row],
        prior.source[keep_row],
    )


def start_from(place: Place, scene: Scene, point: int) -> FloatArray:
    """How far a point of a window starts from a place: east, north, up."""
    east, north = enu_offset(*place[:2], *scene.anchor_deg[point].tolist())
    return np.asarray(scene.start_m[point] + [float(east), float(north), -place.height_m])


def places_of(model: Model, x: FloatArray) -> dict[tuple[int, bool], Place]:
    """Where the points of a window are, by object and whether it is a foot."""
    scene, points = model.scene, model.points_m(x)
    latitude, longitude = geographic_from_enu(*scene.anchor_deg.T, *points[:, :2].T)
    rows = zip(latitude.tolist(), longitude.tolist(), points[:, 2].tolist(), strict=True)
    return dict(zip(points_of(model), (Place(*row) for row in rows), strict=True))
