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

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from geoloc.adjustment.build_model import Placed, model_of, on_terrain, scene_of
from geoloc.adjustment.corrected_poses import corrected_poses
from geoloc.adjustment.covariance import Spread, spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.result import Adjusted, AdjustmentDoubt, Correction, adjusted_of, nothing_adjusted
from geoloc.adjustment.scene import bodies_at, rays_of, sigma_px_of
from geoloc.adjustment.solve import Solution, solve
from geoloc.adjustment.unknowns import READOUT, TIME
from geoloc.arrays import FloatArray, TextArray
from geoloc.doubts import Doubt
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import LIKELY_READOUT_MS, ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind
from geoloc.reasons import Reason
from geoloc.trajectory.poses import Poses

POLE_RADIUS_M = 0.03
"""The ordinary sign pole in Norway is a steel tube of 60 mm."""
_DEFAULT_BUDGET = ErrorBudget()
# So many sigmas, of what the rays say and of what was stated together, and a stated clock is given up. Honest
# clocks reach 4.7 in 180 simulated drives: long bends with slip look like a clock that is late.
_CERTAIN, _WIDER = 6.0, 3.0
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
    trajectory, object_index = observations.trajectory, observations.object_index
    placed, rejected, poses = _placed(observations, budget, size_px)
    objects = np.unique(object_index[object_index >= 0])
    scene = scene_of(observations.rig, observations.sightings.camera, placed)
    rejected[np.setdiff1d(placed.row, scene.row)] = Reason.NO_CROSSING
    if scene.point.size == 0:
        return nothing_adjusted(objects, rejected, poses)
    stated = budget if readout_ms is None else replace(budget, readout_ms=_STATED_READOUT_MS)
    likely = LIKELY_READOUT_MS if readout_ms is None else readout_ms

    def solved(priors: ErrorBudget) -> tuple[Model, Solution, Spread]:
        model, prior = model_of(scene, trajectory, priors, 1e-3 * likely, pole_radius_m)
        if terrain is not None:
            model = on_terrain(model, terrain, budget)
        solution = solve(model, prior, noise)
        return model, solution, spread(model, solution)

    model, solution, found = solved(stated)
    doubts = list(_doubts(model, solution, terrain))
    clock = _clock_of_the_rays(solution, found, budget)
    if abs(clock.value) > _CERTAIN * np.hypot(clock.sigma, budget.time_ms):
        # The stated clock cannot be: let the rays say what it is.
        model, solution, found = solved(replace(stated, time_ms=_WIDER * abs(clock.value)))
        later = 1e3 * float(solution.x[TIME])
        doubts.append(
            Doubt(
                AdjustmentDoubt.CLOCK,
                f"The camera clock does not fit the track: {later:+.0f} ms were added to it. Do not trust the"
                " positions before camera_offset_ms is right, and frames and fixes are both UTC.",
            )
        )
    rejected[scene.row[~solution.inlier]] = Reason.OUTLIER
    corrected = corrected_poses(model, solution.x, poses)
    return adjusted_of(
        objects, rejected, corrected, model, solution, found, budget, track_sigma_m, tuple(doubts)
    )


def _clock_of_the_rays(solution: Solution, found: Spread, budget: ErrorBudget) -> Correction:
    """What the rays alone say of the camera clock, milliseconds: the solution without the clock's prior."""
    value, variance = 1e3 * float(solution.x[TIME]), 1e6 * float(found.shared[TIME, TIME])
    information = 1.0 / variance - 1.0 / budget.time_ms**2
    if information <= 0.0:
        return Correction(0.0, np.inf)
    return Correction(value / variance / information, float(np.sqrt(1.0 / information)))


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
    observations: Observations, budget: ErrorBudget, size_px: FloatArray | None
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
    rays = rays_of(observations.rig, observations.sightings)
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
