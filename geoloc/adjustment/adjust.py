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

from dataclasses import replace

import numpy as np

from geoloc.adjustment.clock import cannot_be, clock_of_the_rays, lasting_doubt_s, may_not_be
from geoloc.adjustment.clock_search import first_shift_s
from geoloc.adjustment.corrected_poses import corrected_poses
from geoloc.adjustment.doubts import doubted_clock, doubts_of, unchecked_clock, wrong_clock
from geoloc.adjustment.result import (
    Adjusted,
    Correction,
    OfTheTrack,
    adjusted_of,
    nothing_adjusted,
)
from geoloc.adjustment.task import WIDER, Solved, Task
from geoloc.arrays import FloatArray
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import LIKELY_READOUT_MS, ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.reasons import Reason
from geoloc.trajectory.interpolation import NANOSECONDS

POLE_RADIUS_M = 0.03
"""The ordinary sign pole in Norway is a steel tube of 60 mm."""
_DEFAULT_BUDGET = ErrorBudget()
# A clock that is not to be adjusted.
_HELD_MS = 1.0
# A base station's own place, an axis: the same for every drive with its corrections.
_BASE_M = 0.01
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
    # A receiver that is later than usual looks like a camera clock that is wrong.
    late_ms = 1e3 * observations.trajectory.late_sigma_s
    budget = replace(budget, time_ms=float(np.hypot(budget.time_ms, late_ms)))
    stated = budget if readout_ms is None else replace(budget, readout_ms=_STATED_READOUT_MS)
    readout_s = 1e-3 * (LIKELY_READOUT_MS if readout_ms is None else readout_ms)
    task = Task(observations, stated, size_px, readout_s, pole_radius_m, noise, terrain)
    objects = np.unique(observations.object_index[observations.object_index >= 0])
    seen = task.seen(0)
    if seen.scene.point.size == 0:
        return nothing_adjusted(objects, seen.rejected, seen.poses)
    camera = observations.sightings.camera
    shift_s = first_shift_s(observations.rig, camera, seen.placed, observations.trajectory)
    if shift_s:
        # The stated clock is seconds off: begin near the right one, where the rays say what it is.
        stated = replace(stated, time_ms=WIDER * 1e3 * abs(shift_s))
        seen = task.seen(round(shift_s * NANOSECONDS))
    at = task.settled(task.solved(seen, stated), stated)
    task, at = task.with_pose_sigmas(at, stated)
    held_s = 0.0
    if late_ms and not shift_s and (_tells_little(at, stated) or not task.tells_time(at, stated)):
        # What bearings seem to say of the clock is noise of the fixes: the stated one stays.
        held = replace(stated, time_ms=_HELD_MS)
        at, held_s = task.with_lenses(task.solved(task.seen(0), held), held), 1e-3 * stated.time_ms
    doubts = list(doubts_of(at.model, at.solution, terrain))
    rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    if shift_s and not cannot_be(rays, budget.time_ms):
        # The stated clock can be after all: it counts for what it was stated to.
        stated = task.budget
        at = task.settled(task.solved(at.seen, stated), stated)
        rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    unsure_s, is_wrong = 0.0, not held_s and cannot_be(rays, budget.time_ms)
    if held_s:
        rays = Correction(0.0, np.inf)
        doubts += unchecked_clock(budget, at)
    elif is_wrong:
        # The stated clock cannot be: let the rays say what it is.
        free = replace(stated, time_ms=WIDER * abs(rays.value))
        at, stated = task.settled(task.solved(at.seen, free), free), free
        rays = clock_of_the_rays(at.solution, at.found, stated.time_ms, at.shift_s)
    elif may_not_be(rays, budget.time_ms):
        unsure_s = 1e-3 * abs(rays.value)
        doubts.append(doubted_clock(rays, budget, at))
    seen = at.seen
    lasting_s = held_s or lasting_doubt_s(rays, stated.time_ms, seen.scene.body, is_poor=late_ms > 0.0)
    unsure_s = float(np.hypot(unsure_s, lasting_s))
    if is_wrong:
        doubts.append(wrong_clock(at, unsure_s))
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
            observations.trajectory.wander_m2ps,
        ),
        tuple(doubts),
        task.observations.trajectory.estimated,
        stated.time_ms,
    )


def _tells_little(at: Solved, priors: ErrorBudget) -> bool:
    """Whether the bearings know the clock less well than it is stated, and do not speak against that."""
    rays = clock_of_the_rays(at.solution, at.found, priors.time_ms, at.shift_s)
    return rays.sigma > priors.time_ms and not may_not_be(rays, priors.time_ms)
