"""Every sighting of every object in every camera of a drive → positions, by one robust least squares.

One frame and flat ground cannot place a sign beyond 15 m to half a metre: a tenth of a degree of pitch is a
metre there. But a car that passes a sign sees it from many places, and bearings that cross say where it
stands. `adjust` finds the positions of all objects together with what all sightings share: the boresight of
each camera, the offset of the camera clock, the rolling shutter, the trajectory's error in roll, pitch and
heading second by second, and the bounce of the body in each frame. Everything that is unknown has a prior, so
that one frame, one camera or a car that stands still is solved as well as it can be, and its covariance says
how well that is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.build_model import Placed, model_of, on_terrain, scene_of
from geoloc.adjustment.clock import about, cannot_be, clock_of_the_rays, lasting_doubt_s, may_not_be
from geoloc.adjustment.clock_search import first_shift_s
from geoloc.adjustment.corrected_poses import corrected_poses
from geoloc.adjustment.covariance import Spread, spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.pose_variances import factors_of_poses, is_settled
from geoloc.adjustment.result import (
    Adjusted,
    AdjustmentDoubt,
    Correction,
    OfTheTrack,
    adjusted_of,
    nothing_adjusted,
)
from geoloc.adjustment.scene import Scene, bodies_at, rays_of, sigma_px_of
from geoloc.adjustment.solve import Solution, solve
from geoloc.adjustment.unknowns import READOUT, TIME
from geoloc.arrays import FloatArray, TextArray
from geoloc.cameras.nominal import moves_at
from geoloc.doubts import Doubt
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import LIKELY_READOUT_MS, ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind
from geoloc.reasons import Reason
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import Poses

POLE_RADIUS_M = 0.03
"""The ordinary sign pole in Norway is a steel tube of 60 mm."""
_DEFAULT_BUDGET = ErrorBudget()
_WIDER = 3.0
# Speed and turning of a car are the same for so long: in 0.03 s braking moves it by 2 mm.
_SAME_MOTION_S, _MOST_ROUNDS = 0.03, 8
_POSE_ROUNDS = 2
# Lenses are taken as linear about what is known of them: that is good to this.
_SAME_LENS_PX, _LENS_ROUNDS = 1.0, 4
_NO_LENS: Mapping[str, FloatArray] = MappingProxyType({})
# Begun so far from the clock that was found, an adjustment comes back to it if the drive tells the time.
# Where fixes of metres make yaw rates and speeds tremble, it stays wherever it begins.
_ASIDE_S, _BACK, _NEARER, _BACK_ROUNDS = 1.0, 0.3, 0.8, 4
# A clock that is not to be adjusted.
_HELD_MS = 1.0
# A base station's own place, an axis: the same for every drive with its corrections.
_BASE_M = 0.01
# Slower than this no clock moves anything.
_SLOW_MPS = 2.0
# Outside this the rolling shutter takes up something else.
_READOUTS_MS = (-15.0, 50.0)
# A data sheet's readout, and how exposure and line time differ from it.
_STATED_READOUT_MS = 1.0


def adjust(
    observations: Observations,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    size_px: FloatArray | None = None,
    readout_ms: float | None = None,
    pole_radius_m: float = POLE_RADIUS_M,
    noise: float | None = None,
    track_sigma_m: float = 0.0,
    terrain: Terrain | None = None,
) -> Adjusted:
    """Adjust a drive.

    Parameters
    ----------
    observations : Observations (n,)
    budget : ErrorBudget
        Priors: one sigma of each source.
    size_px : float64 (n,), optional
        Height of the box that a sighting is the middle of; NaN for points.
    readout_ms : float or None
        Rolling shutter's readout from the first to the last row, good to 1 ms. None: unknown.
    pole_radius_m : float
        What annotators mark as the foot is the front of the pole; its middle stands this much behind it.
    noise : float, optional
        Factor on every sigma of a pixel. Default: what the residuals ask for.
    track_sigma_m : float
        One sigma a horizontal axis that the whole track is off beyond what its poses say (a change of datum).
    terrain : Terrain, optional
        Measured ground to use instead of the plane of the road, where it has heights.

    Returns
    -------
    Adjusted

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras.
    """
    # A receiver that is late looks like a camera clock that is wrong.
    late_ms = 1e3 * observations.trajectory.late_sigma_s
    budget = replace(budget, time_ms=float(np.hypot(budget.time_ms, late_ms)))
    stated = budget if readout_ms is None else replace(budget, readout_ms=_STATED_READOUT_MS)
    readout_s = 1e-3 * (LIKELY_READOUT_MS if readout_ms is None else readout_ms)
    task = _Task(observations, stated, size_px, readout_s, pole_radius_m, noise, terrain)
    objects = np.unique(observations.object_index[observations.object_index >= 0])
    seen = task.seen(0)
    if seen.scene.point.size == 0:
        return nothing_adjusted(objects, seen.rejected, seen.poses)
    camera = observations.sightings.camera
    shift_s = first_shift_s(observations.rig, camera, seen.placed, observations.trajectory)
    if shift_s:
        # The stated clock is seconds off: begin near the right one, where the rays say what it is.
        stated = replace(stated, time_ms=_WIDER * 1e3 * abs(shift_s))
        seen = task.seen(round(shift_s * NANOSECONDS))
    at = task.settled(task.solved(seen, stated), stated)
    task, at = task.with_pose_sigmas(at, stated)
    held_s = 0.0
    if late_ms and not shift_s and not task.tells_time(at, stated):
        # What bearings seem to say of the clock is noise of the fixes: the stated one stays.
        held = replace(stated, time_ms=_HELD_MS)
        at, held_s = task.with_lenses(task.solved(task.seen(0), held), held), 1e-3 * stated.time_ms
    doubts = list(_doubts(at.model, at.solution, terrain))
    rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    if shift_s and not cannot_be(rays, budget.time_ms):
        # The stated clock can be after all: it counts for what it was stated to.
        stated = task.budget
        at = task.settled(task.solved(at.seen, stated), stated)
        rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    unsure_s, is_wrong = 0.0, not held_s and cannot_be(rays, budget.time_ms)
    if held_s:
        rays = Correction(0.0, np.inf)
        doubts += _unchecked_clock(budget, at)
    elif is_wrong:
        # The stated clock cannot be: let the rays say what it is.
        free = replace(stated, time_ms=_WIDER * abs(rays.value))
        at, stated = task.settled(task.solved(at.seen, free), free), free
        rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    elif may_not_be(rays, budget.time_ms):
        unsure_s = 1e-3 * abs(rays.value)
        doubts.append(_doubted_clock(rays, budget, at))
    seen = at.seen
    lasting_s = held_s or lasting_doubt_s(rays, stated.time_ms, seen.scene.body, is_poor=late_ms > 0.0)
    unsure_s = float(np.hypot(unsure_s, lasting_s))
    if is_wrong:
        doubts.append(_wrong_clock(at, unsure_s))
    seen.rejected[seen.scene.row[~at.solution.inlier]] = Reason.OUTLIER
    corrected = corrected_poses(at.model, at.solution.x, seen.poses)
    return adjusted_of(
        objects,
        seen.rejected,
        corrected,
        at.model,
        at.solution,
        at.found,
        OfTheTrack(
            observations.trajectory.is_fitted,
            budget.lever_arm_m,
            track_sigma_m,
            0.0 if late_ms else _BASE_M,
            at.shift_s,
            unsure_s,
        ),
        tuple(doubts),
        task.observations.trajectory.estimated,
        stated.time_ms,
    )


class _Seen(NamedTuple):
    """The sightings of a drive where the car was when they were made, with so much added to their epochs."""

    shift_ns: int
    placed: Placed
    scene: Scene
    rejected: TextArray
    poses: Poses
    lens: Mapping[str, FloatArray]
    """Errors of lenses (5,) that are taken off the pixels already, by camera."""


class _Solved(NamedTuple):
    """A solution, and what it is of."""

    seen: _Seen
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
class _Task:
    """What `adjust` was asked."""

    observations: Observations
    budget: ErrorBudget
    size_px: FloatArray | None
    readout_s: float
    pole_radius_m: float
    noise: float | None
    terrain: Terrain | None

    def seen(self, shift_ns: int, lens: Mapping[str, FloatArray] = _NO_LENS) -> _Seen:
        """Find out where the car was at each sighting, and give every point its first guess."""
        asked = self.observations
        later = replace(asked, epoch_ns=asked.epoch_ns + shift_ns)
        placed, rejected, poses = _placed(later, self.budget, self.size_px, lens)
        scene = scene_of(asked.rig, asked.sightings.camera, placed, self.budget, lens)
        rejected[np.setdiff1d(placed.row, scene.row)] = Reason.NO_CROSSING
        return _Seen(shift_ns, placed, scene, rejected, poses, lens)

    def solved(self, seen: _Seen, priors: ErrorBudget, start: FloatArray | None = None) -> _Solved:
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
        return _Solved(seen, final, solution, spread(final, solution))

    def _solution(self, scene: Scene, seen: _Seen, priors: ErrorBudget, start: FloatArray | None) -> Solution:
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

    def with_pose_sigmas(self, at: _Solved, priors: ErrorBudget) -> tuple[_Task, _Solved]:
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

    def settled(self, at: _Solved, priors: ErrorBudget) -> _Solved:
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

    def with_lenses(self, at: _Solved, priors: ErrorBudget) -> _Solved:
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

    def _with_lens(self, seen: _Seen, lens: Mapping[str, FloatArray]) -> _Seen | None:
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

    def tells_time(self, at: _Solved, priors: ErrorBudget) -> bool:
        """Whether the bearings find the same clock from a second earlier and a second later."""
        free = replace(priors, time_ms=_WIDER * 1e3 * _ASIDE_S)
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
    def _by_rays_s(at: _Solved, priors: ErrorBudget) -> float:
        return 1e-3 * clock_of_the_rays(at.solution, at.found, priors.time_ms, at.shift_s).value


def _lens_noise_px(scene: Scene) -> FloatArray | None:
    """What lenses may move each pixel by (n,), one sigma of an axis; None where all are exact."""
    away, half = scene.lens_away_px, scene.lens_half_px
    if away is None or half is None or scene.lens_sigma is None:
        return None
    moved = moves_at(away, half) * scene.lens_sigma[scene.camera][:, None, :]
    return np.asarray(np.sqrt(0.5 * np.sum(moved**2, axis=(1, 2))))


def _unchecked_clock(budget: ErrorBudget, at: _Solved) -> Iterator[Doubt]:
    """Say that this drive cannot show whether its stamps are right."""
    speed_mps = float(np.median(np.hypot(*at.seen.scene.body.velocity_mps[:, :2].T)))
    if speed_mps < _SLOW_MPS:
        return
    yield Doubt(
        AdjustmentDoubt.CLOCK_UNCHECKED,
        "The camera clock cannot be checked: with fixes without corrections this drive does not tell the"
        f" time. Clock and receiver are taken as good to {budget.time_ms:.0f} ms together; each 0.1 s beyond"
        f" that moves all positions by {0.1 * speed_mps:.1f} m along the road. State [errors] time_ms if the"
        " stamps are not that good; corrections (RTK) would show it.",
    )


def _wrong_clock(at: _Solved, unsure_s: float) -> Doubt:
    later, sigma = 1e3 * at.clock_s, 1e3 * float(np.hypot(np.sqrt(at.found.shared[TIME, TIME]), unsure_s))
    return Doubt(
        AdjustmentDoubt.CLOCK,
        f"The camera clock does not fit the track: {later:+.0f} ± {sigma:.0f} ms were added to it. Do not"
        " trust the positions before the cause is found: a start, a time zone, frames that are missing. If"
        " nothing else tells the time, state [errors] time_ms = 1000; copying this number would count the"
        " drive twice.",
    )


def _doubted_clock(rays: Correction, budget: ErrorBudget, at: _Solved) -> Doubt:
    return Doubt(
        AdjustmentDoubt.CLOCK_DOUBTED,
        f"The camera clock is doubted: the bearings ask for {rays.value:+.0f} ± {rays.sigma:.0f} ms, and it"
        f" was stated to {budget.time_ms:.0f} ms. {1e3 * at.clock_s:+.0f} ms were added to it, and the"
        " ellipses were made longer along the road by what the bearings ask for: check camera_offset_ms and"
        " the frame stamps.",
    )


def _doubts(model: Model, solution: Solution, terrain: Terrain | None) -> Iterator[Doubt]:
    """What a person should know of a solution."""
    readout_ms = 1e3 * (model.readout_s + float(solution.x[READOUT]))
    if not _READOUTS_MS[0] < readout_ms < _READOUTS_MS[1]:
        yield Doubt(
            AdjustmentDoubt.SHUTTER,
            f"The rolling shutter that fits best would take {readout_ms:.0f} ms, which no camera does: check"
            " camera_offset_ms, the frame stamps and the calibration.",
        )
    if terrain is None:
        return
    feet, used = int(model.scene.is_foot.sum()), 0 if model.terrain is None else model.terrain.point.size
    if used < feet:
        yield Doubt(
            AdjustmentDoubt.TERRAIN_UNUSED,
            f"The terrain was used for {used} of {feet} feet: elsewhere it has no height, or lies more than"
            " 2 m from the car's own, and the plane of the road was used.",
        )


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
