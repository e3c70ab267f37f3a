"""Robust least squares on sparse normal equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.drifting_labels import repeated_share
from geoloc.adjustment.equations import Equations, System
from geoloc.adjustment.model import Model
from geoloc.adjustment.unknowns import Prior
from geoloc.arrays import BoolArray, FloatArray, IntArray

# χ² with two degrees of freedom, 99.9 %; with one.
_GATE = -2.0 * np.log(0.001)
_GROUND_GATE = 10.83
# Scale of the robust weights, in sigmas, round by round: wide while mounting errors of several pixels are
# still unknown, then as narrow as noise allows.
_ANNEALING = (30.0, 10.0, 5.0, 3.0)
_STEPS_A_SCALE = 3
# A camera that nobody calibrated was not mounted by a calibration either.
_WIDEST = (100.0,)
_SETTLED_M = 0.02
_FINAL_ROUNDS = 8
_TRIES, _LEAST_DAMPING = 8, 1e-4
_CONVERGED_M = 5e-4
# A point may move by this part of its distance in one round: bearings are nonlinear in depth.
_LARGEST_STEP = 0.5
# The stated noise counts as much as this many residuals against what the residuals say.
_STATED_WEIGHT = 40.0
_NOISE_LIMITS = (0.3, 8.0)


@dataclass(frozen=True, slots=True)
class Solution:
    """Where the unknowns came to rest.

    Attributes
    ----------
    x : float64 (u,)
    inlier : bool (n,)
        Sightings that took part in the end.
    weight : float64 (n,)
        How much each counted, over the square of `noise`.
    noise : float
        Factor on every sigma of a pixel that the residuals ask for, by their size and by how alike they are.
    residual_px : float64 (n, 2)
        Expected minus seen.
    equations : Equations
    system : System
        The normal equations there.
    """

    x: FloatArray
    inlier: BoolArray
    weight: FloatArray
    noise: float
    residual_px: FloatArray
    equations: Equations
    system: System


class _Taken(NamedTuple):
    """Which sightings take part, which of them are of points that they agree on, and how much each counts."""

    inlier: BoolArray
    agreeing: BoolArray
    share: FloatArray


class _At(NamedTuple):
    """Where the iteration stands: unknowns, squared residuals of the sightings, damping, last step."""

    x: FloatArray
    square: FloatArray
    damping: float
    moved_m: float


def solve(
    model: Model, prior: Prior, stated_noise: float | None = None, start: FloatArray | None = None
) -> Solution:
    """Find the unknowns that fit all sightings best, whatever some of them say.

    First every sighting weighs by a Cauchy function whose scale shrinks from round to round; then those
    beyond the 99.9 % limit are left out (never more than half of a point's) and the rest count in full, so
    that the normal matrix is that of the sightings used. Points whose better half contradicts itself, as of
    an id that marks three signs, count for so little that they draw nothing along. What is known of the
    ground under a foot is weighed as sightings are: rays that cross well place a foot on a wall, and the road
    beside says nothing of it.

    Last, all but the bounces of the body moves to where these do not bias it (`Equations.pull_of_bounces`).

    Parameters
    ----------
    stated_noise : float, optional
        Factor on every sigma of a pixel. Default: estimated from the residuals.
    start : float64 (u,), optional
        Where to begin: near the solution. Default: at the first guesses.
    """
    equations = Equations(model, prior)
    x = np.zeros(model.layout.size) if start is None else start.copy()
    at = _At(x, equations.squares(x), 0.0, 0.0)
    wide = _WIDEST if model.layout.has_lenses else ()
    for scale in (*wide, *_ANNEALING) if start is None else _ANNEALING[-2:]:
        for _ in range(_STEPS_A_SCALE):
            equations = _on_likely_ground(equations, at.x, scale)
            at = _step(equations, at, _cauchy(at.square, scale))
            if at.moved_m < _SETTLED_M:
                break
    model = equations.model.with_expected_pixels(at.x)
    equations, scene = equations.with_model(model), model.scene
    at = at._replace(square=equations.squares(at.x))
    noise, before = stated_noise or _first_noise(at.square), np.zeros(scene.point.size, dtype=bool)
    for _ in range(_FINAL_ROUNDS):
        taken = _taken(at.square / noise**2, scene.point)
        equations = _on_sure_ground(equations, at.x)
        system = equations.system(at.x, taken.share / noise**2)
        redundancy = 0.0 if stated_noise else 2.0 * taken.agreeing.sum() - system.taken_up()
        at = _step(equations, at, taken.share / noise**2, system)
        noise = stated_noise or _noise(at.square[taken.agreeing].sum(), redundancy)
        if at.moved_m < _CONVERGED_M and np.array_equal(before, taken.inlier):
            break
        before = taken.inlier
    last = equations.system(at.x, taken.share / noise**2)
    repeated = repeated_share(scene, last, model.ray_residuals(at.x), taken.agreeing)
    noise *= float(np.sqrt(max(repeated, 1.0)))
    weight = taken.share / noise**2
    pull = equations.pull_of_bounces(at.x, weight)
    for _ in range(_FINAL_ROUNDS):
        at = _step(equations, at, weight, pull=pull)
        if at.moved_m < _CONVERGED_M:
            break
    last = equations.system(at.x, weight)
    residual = model.ray_residuals(at.x) * scene.sigma_px[:, None]
    return Solution(at.x, taken.inlier, weight, noise, residual, equations, last)


def _cauchy(square: FloatArray, scale: float) -> FloatArray:
    return 1.0 / (1.0 + square / scale**2)


def _on_likely_ground(equations: Equations, x: FloatArray, scale: float) -> Equations:
    return equations.with_model(equations.model.with_ground_weighed(x, lambda square: _cauchy(square, scale)))


def _on_sure_ground(equations: Equations, x: FloatArray) -> Equations:
    """Leave out what is known of the ground under feet that rays place elsewhere."""
    return equations.with_model(
        equations.model.with_ground_weighed(x, lambda square: (square <= _GROUND_GATE).astype(np.float64))
    )


def solve_near(model: Model, prior: Prior, start: FloatArray, noise: float) -> Solution:
    """Find the unknowns from `start`, which is near them, in two steps and by a known noise.

    What a window of a drive asks again and again, and goes on from the next time. In the first step all
    sightings weigh by a Cauchy function: a body's bounce that is not known yet does not cost them their say.
    The normal equations of the solution are those of the second step, from where that began.
    """
    equations = Equations(model.with_expected_pixels(start), prior)
    at = _At(start, equations.squares(start), 0.0, 0.0)
    equations = _on_likely_ground(equations, at.x, _ANNEALING[-2])
    at = _step(equations, at, _cauchy(at.square, noise * _ANNEALING[-2]) / noise**2)
    equations = _on_sure_ground(equations, at.x)
    taken = _taken(at.square / noise**2, model.scene.point)
    weight = taken.share / noise**2
    last = equations.system(at.x, weight)
    at = _step(equations, at, weight, last, equations.pull_of_bounces(at.x, weight))
    residual = equations.model.ray_residuals(at.x) * model.scene.sigma_px[:, None]
    return Solution(at.x, taken.inlier, weight, noise, residual, equations, last)


def noise_at(solution: Solution) -> float:
    """Return the factor on every sigma of a pixel that a solution's residuals ask for, as `solve` does."""
    equations = solution.equations
    residual, scene = equations.model.ray_residuals(solution.x), equations.model.scene
    agreeing = solution.inlier & (solution.weight * solution.noise**2 > 0.999)
    redundancy = 2.0 * agreeing.sum() - solution.system.taken_up()
    noise = _noise(float((residual[agreeing] ** 2).sum()), redundancy)
    repeated = repeated_share(scene, solution.system, residual, agreeing)
    return noise * float(np.sqrt(max(repeated, 1.0)))


def _step(
    equations: Equations,
    at: _At,
    weight: FloatArray,
    system: System | None = None,
    pull: FloatArray | None = None,
) -> _At:
    """One step of Levenberg and Marquardt, with a `pull` (u,) added to the gradient.

    Undamped as long as every step lowers the cost, which is what bearings with parallax give.
    """
    system, place = system or equations.system(at.x, weight), equations.place
    pull = np.zeros_like(at.x) if pull is None else pull
    cost = float(weight @ at.square) + equations.other_cost(at.x)
    damping = at.damping
    for _ in range(_TRIES):
        factor = system.damped(damping) if damping > 0.0 else system.factor
        step = -factor.solve(system.gradient + pull)[place]
        x, moved = _limited(equations.model, at.x, step)
        square = equations.squares(x)
        rises = 2.0 * float(pull[place] @ (x - at.x))
        if float(weight @ square) + equations.other_cost(x) + rises <= cost * (1.0 + 1e-9):
            return _At(x, square, 0.0 if damping < _LEAST_DAMPING else damping / 10.0, moved)
        damping = max(10.0 * damping, _LEAST_DAMPING)
    return _At(at.x, at.square, 0.0, 0.0)


def _limited(model: Model, x: FloatArray, step: FloatArray) -> tuple[FloatArray, float]:
    """Take a step, shortened for points that would leap."""
    places = model.layout.point(np.arange(model.layout.n_points))
    far = np.full(model.layout.n_points, np.inf)
    scene = model.scene
    away = np.linalg.norm((scene.start_m + x[places])[scene.point] - model.origin_m, axis=1)
    np.minimum.at(far, scene.point, away)
    length = np.linalg.norm(step[places], axis=1)
    shorter = np.minimum(1.0, _LARGEST_STEP * np.maximum(far, 1.0) / np.maximum(length, 1e-12))
    limited = step.copy()
    limited[places] *= shorter[:, None]
    return x + limited, float((length * shorter).max(initial=0.0))


def _taken(square: FloatArray, point: IntArray) -> _Taken:
    """Choose the sightings that take part, by their squared residuals in units of the noise.

    What is kept of a point beyond the gate, because it is the better half, counts as if the noise of that
    point were so large that it passes. Where that is most of all sightings the noise is not known yet.
    """
    inlier = _inliers(square, point)
    worst = np.ones(int(point.max(initial=-1)) + 1)
    np.maximum.at(worst, point[inlier], square[inlier] / _GATE)
    agreeing = inlier & (worst[point] <= 1.0)
    if 2 * agreeing.sum() < inlier.sum():
        return _Taken(inlier, inlier, inlier.astype(np.float64))
    return _Taken(inlier, agreeing, inlier / worst[point])


def _inliers(square: FloatArray, point: IntArray) -> BoolArray:
    """Sightings within the gate, and at least the better half of each point's."""
    order = np.lexsort((square, point))
    size = np.bincount(point)
    first = np.cumsum(size) - size
    rank = np.arange(point.size) - first[point[order]]
    half = np.zeros(point.size, dtype=bool)
    half[order] = rank < (size[point[order]] + 1) // 2
    return np.asarray((square <= _GATE) | half)


def _first_noise(square: FloatArray) -> float:
    """Noise factor from the median of the squared residuals, which wrong pixels cannot move."""
    stated = 2.0 * np.log(2.0)
    weight = square.size / (square.size + _STATED_WEIGHT)
    ratio = max(float(np.median(square)), 1e-3) / stated
    return float(np.clip(ratio ** (0.5 * weight), 1.0, _NOISE_LIMITS[1]))


def _noise(square_sum: float, redundancy: float) -> float:
    """Noise factor from the inliers' residuals, drawn towards what was stated."""
    # Cutting at the gate takes the tail's share of the variance with it.
    full = square_sum / (1.0 - (1.0 + _GATE / 2.0) * np.exp(-_GATE / 2.0))
    factor = np.sqrt((full + _STATED_WEIGHT) / (max(redundancy, 0.0) + _STATED_WEIGHT))
    return float(np.clip(factor, *_NOISE_LIMITS))
