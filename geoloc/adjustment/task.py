"""One drive to adjust: solved from where the car was, again until clock, lenses and sigmas of poses stay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.build_model import Place, Placed, model_of, on_terrain, scene_of
from geoloc.adjustment.clock import about, clock_of_the_rays
from geoloc.adjustment.covariance import Spread, spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.pose_variances import factors_of_poses, is_settled
from geoloc.adjustment.scene import Scene, bodies_at, rays_of, sigma_px_of
from geoloc.adjustment.solve import Solution, solve
from geoloc.adjustment.unknowns import TIME
from geoloc.arrays import FloatArray, TextArray
from geoloc.cameras.nominal import moves_at
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind
from geoloc.reasons import Reason
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import Poses

WIDER = 3.0
"""A prior that lets the clock go, in units of what it seems to be off."""
# Speed and turning of a car are the same for so long: in 0.03 s braking moves it by 2 mm.
_SAME_MOTION_S, _MOST_ROUNDS = 0.03, 8
_POSE_ROUNDS = 2
# Lenses are taken as linear about what is known of them: that is good to this.
_SAME_LENS_PX, _LENS_ROUNDS = 1.0, 4
_NO_LENS: Mapping[str, FloatArray] = MappingProxyType({})
# Begun so far from the clock that was found, an adjustment comes back to it if the drive tells the time.
# Where fixes of metres make yaw rates and speeds tremble, it stays wherever it begins.
_ASIDE_S, _BACK, _NEARER, _BACK_ROUNDS = 1.0, 0.3, 0.8, 4


class Seen(NamedTuple):
    """The sightings of a drive where the car was when they were made, with so much added to their epochs."""

    shift_ns: int
    placed: Placed
    scene: Scene
    rejected: TextArray
    poses: Poses
    lens: Mapping[str, FloatArray]
    """Errors of lenses (5,) that are taken off the pixels already, by camera."""


class Solved(NamedTuple):
    """A solution, and what it is of."""

    seen: Seen
    model: Model
    solution: Solution
    found: Spread

    @property
    def shift_s(self) -> float:
        """What had been added to the clock before; `solution` has the rest."""
        return self.seen.shift_ns / NANOSECONDS

    @property
    def clock_s(self) -> float:
        """All that was added to the clock."""
        return self.shift_s + float(self.solution.x[TIME])


@dataclass(frozen=True, slots=True)
class Task:
    """What `adjust` was asked."""

    observations: Observations
    budget: ErrorBudget
    size_px: FloatArray | None
    readout_s: float
    pole_radius_m: float
    noise: float | None
    terrain: Terrain | None
    cameras: tuple[str, ...] = ()
    """These have unknowns, whether they have sightings or not."""
    places: Mapping[tuple[int, bool], Place] = field(default_factory=dict)
    """Where points are known to be, by object and whether it is the foot."""

    def seen(self, shift_ns: int, lens: Mapping[str, FloatArray] = _NO_LENS) -> Seen:
        """Find out where the car was at each sighting, and give every point its first guess."""
        asked = self.observations
        later = replace(asked, epoch_ns=asked.epoch_ns + shift_ns)
        placed, rejected, poses = _placed(later, self.budget, self.size_px, lens)
        scene = scene_of(
            asked.rig, asked.sightings.camera, placed, self.budget, lens, self.cameras, self.places
        )
        rejected[np.setdiff1d(placed.row, scene.row)] = Reason.NO_CROSSING
        return Seen(shift_ns, placed, scene, rejected, poses, lens)

    def solved(self, seen: Seen, priors: ErrorBudget, start: FloatArray | None = None) -> Solved:
        """Solve by these priors; from `start`, which is near, or from the first guesses.

        Lenses that nobody calibrated are taken as exact at first, with what they may be off among the pixels'
        noise: from first guesses a focal length runs away with wrong distances.
        """
        sigma_px = _lens_noise_px(seen.scene) if start is None else None
        if sigma_px is not None and seen.scene.lens_sigma is not None:
            held = replace(
                seen.scene,
                sigma_px=np.hypot(seen.scene.sigma_px, sigma_px),
                lens_sigma=np.zeros_like(seen.scene.lens_sigma),
            )
            start = self._solution(held, seen, priors, None).x
        solution = self._solution(seen.scene, seen, priors, start)
        final = solution.equations.model
        return Solved(seen, final, solution, spread(final, solution))

    def _solution(self, scene: Scene, seen: Seen, priors: ErrorBudget, start: FloatArray | None) -> Solution:
        model, prior = model_of(
            scene, self.observations.trajectory, priors, self.readout_s, self.pole_radius_m
        )
        if self.terrain is not None:
            model = on_terrain(model, self.terrain, self.budget)
        taken = {TIME: seen.shift_ns / NANOSECONDS}
        if model.layout.has_lenses and scene.lens_known is not None:
            places = model.layout.lens(np.arange(model.layout.n_cameras)).ravel().tolist()
            taken |= dict(zip(places, scene.lens_known.ravel().tolist(), strict=True))
        return solve(model, about(prior, taken), self.noise, start)

    def with_pose_sigmas(self, at: Solved, priors: ErrorBudget) -> tuple[Task, Solved]:
        """Scale sigmas of poses that nobody stated by what the bearings make of them, and solve anew."""
        task = self
        for _ in range(_POSE_ROUNDS):
            trajectory = task.observations.trajectory
            if trajectory.estimated is None:
                break
            factors = factors_of_poses(at.model, at.solution)
            if is_settled(factors):
                break
            scaled = replace(task.observations, trajectory=trajectory.with_scaled_sigmas(factors))
            task = replace(task, observations=scaled)
            at = task.solved(task.seen(at.seen.shift_ns, at.seen.lens), priors)
        return task, at

    def settled(self, at: Solved, priors: ErrorBudget) -> Solved:
        """Solve anew from where the car was by the clock that was found, until that stays the same.

        The adjustment takes the car's speed and turning as constant over what the clock is off, and lenses as
        linear over what they are off.
        """
        at = self.with_lenses(at, priors)
        first = at
        for _ in range(_MOST_ROUNDS):
            if abs(at.solution.x[TIME]) <= _SAME_MOTION_S:
                return at
            seen = self.seen(round(at.clock_s * NANOSECONDS), at.seen.lens)
            if seen.scene.point.size < first.seen.scene.point.size:
                break
            at = self.solved(seen, priors)
        # It runs away from the drive, as where fixes are so poor that none of it tells the time.
        return first

    def with_lenses(self, at: Solved, priors: ErrorBudget) -> Solved:
        """Solve anew with the lenses that were found, until they stay the same."""
        for _ in range(_LENS_ROUNDS):
            scene, layout = at.model.scene, at.model.layout
            if at.model.lens_moves is None or scene.lens_known is None:
                return at
            more = at.solution.x[layout.lens(np.arange(layout.n_cameras))]
            moved = at.model.lens_moves @ more[scene.camera][:, :, None]
            if not moved.size or np.abs(moved).max() < _SAME_LENS_PX:
                return at
            seen = self._with_lens(at.seen, dict(zip(scene.cameras, scene.lens_known + more, strict=True)))
            if seen is None:
                return at
            start = at.solution.x.copy()
            start[layout.lens(np.arange(layout.n_cameras))] = 0.0
            at = self.solved(seen, priors, start)
        return at

    def _with_lens(self, seen: Seen, lens: Mapping[str, FloatArray]) -> Seen | None:
        """The same sightings with these errors of lenses taken off; None where a pixel then has no ray."""
        asked, scene = self.observations, seen.scene
        rays = rays_of(asked.rig, asked.sightings, lens)
        if np.any(rays.rejected[scene.row] == Reason.OUTSIDE_CAMERA):
            return None
        known = np.array([lens[name] for name in scene.cameras])
        new = replace(
            scene,
            ray=rays.ray[scene.row],
            pixel_from_ray=rays.pixel_from_ray[scene.row],
            lens_known=known,
        )
        return seen._replace(scene=new, lens=lens)

    def tells_time(self, at: Solved, priors: ErrorBudget) -> bool:
        """Whether the bearings find the same clock from a second earlier and a second later."""
        free = replace(priors, time_ms=WIDER * 1e3 * _ASIDE_S)
        found_s = self._by_rays_s(at, priors)
        lens = at.seen.lens
        return all(self._comes_back(found_s, aside_s, free, lens) for aside_s in (_ASIDE_S, -_ASIDE_S))

    def _comes_back(
        self, found_s: float, aside_s: float, priors: ErrorBudget, lens: Mapping[str, FloatArray]
    ) -> bool:
        begin_s, off_s = found_s + aside_s, abs(aside_s)
        for _ in range(_BACK_ROUNDS):
            seen = self.seen(round(begin_s * NANOSECONDS), lens)
            if not seen.scene.point.size:
                return False
            at = self.solved(seen, priors)
            begin_s, before_s = self._by_rays_s(at, priors), off_s
            off_s = abs(begin_s - found_s)
            if off_s < _BACK * abs(aside_s):
                return True
            if off_s > _NEARER * before_s:
                break
        return False

    @staticmethod
    def _by_rays_s(at: Solved, priors: ErrorBudget) -> float:
        return 1e-3 * clock_of_the_rays(at.solution, at.found, priors.time_ms, at.shift_s).value


def _lens_noise_px(scene: Scene) -> FloatArray | None:
    """What lenses may move each pixel by (n,), one sigma of an axis; None where all are exact."""
    away, half = scene.lens_away_px, scene.lens_half_px
    if away is None or half is None or scene.lens_sigma is None:
        return None
    moved = moves_at(away, half) * scene.lens_sigma[scene.camera][:, None, :]
    return np.asarray(np.sqrt(0.5 * np.sum(moved**2, axis=(1, 2))))


def _placed(
    observations: Observations,
    budget: ErrorBudget,
    size_px: FloatArray | None,
    lens: Mapping[str, FloatArray],
) -> tuple[Placed, TextArray, Poses]:
    """Cast the rays of an object's sightings from where the car was.

    Returns
    -------
    placed : Placed
        Sightings that can take part, and the point, a foot or a face, that each is of.
    rejected : str (n,)
        Why each of the others cannot.
    poses : Poses (n,)
    """
    object_index = observations.object_index
    rays = rays_of(observations.rig, observations.sightings, lens)
    bodies, poses = bodies_at(observations.trajectory, observations.epoch_ns)
    rejected = np.where(rays.rejected != "", rays.rejected, poses.reason)
    rejected[(rejected == "") & ~poses.valid] = Reason.NO_POSE
    rejected[(rejected == "") & (object_index < 0)] = Reason.NO_OBJECT
    rows = np.flatnonzero(rejected == "")
    is_foot = np.asarray(observations.kind == Kind.FOOT)
    points, point = np.unique(2 * object_index[rows] + ~is_foot[rows], return_inverse=True)
    sizes_px = np.full(object_index.size, np.nan) if size_px is None else size_px
    placed = Placed(
        rows,
        point,
        points // 2,
        points % 2 == 0,
        observations.epoch_ns,
        bodies,
        rays,
        sigma_px_of(budget, sizes_px),
    )
    return placed, rejected, poses
