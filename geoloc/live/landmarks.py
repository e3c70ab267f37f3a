"""Positions of objects while a car drives past them: the adjustment of a recorded drive, over a window.

Unknowns and equations are those of `geoloc.adjustment`. A window of a few seconds is solved again and again
from where it stood; what leaves it is carried on (`carried`), and what all sightings share, mounting and
clock, wanders slowly from window to window.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.build_model import Place, model_of
from geoloc.adjustment.clock import clock_of_the_rays, lasting_doubt_s
from geoloc.adjustment.covariance import Spread, spread_at_once
from geoloc.adjustment.model import Model
from geoloc.adjustment.result import Adjusted, OfTheTrack, adjusted_of
from geoloc.adjustment.scene import Bodies, Scene
from geoloc.adjustment.solve import Solution, noise_at, solve, solve_near
from geoloc.adjustment.task import Task
from geoloc.adjustment.unknowns import FIRST_CAMERA, LEAN, PER_CAMERA, ROLL, TIME, Prior
from geoloc.arrays import FloatArray, IntArray
from geoloc.live.carried import LEARNED, Carried, Key, left_behind, places_of
from geoloc.locate.error_budget import LIKELY_READOUT_MS, ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Sightings
from geoloc.reasons import Reason
from geoloc.rig.rig import Rig
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.trajectory import Trajectory

_SECOND_NS = 1_000_000_000
_DEFAULT_BUDGET = ErrorBudget()
# As in `geoloc.adjustment.adjust`.
_HELD_MS, _STATED_READOUT_MS, _BASE_M = 1.0, 1.0, 0.01
# Speed and turning of a car are the same for so long.
_SAME_MOTION_S = 0.03
# Mountings and clocks are other ones after so long: they warm up, and screws settle.
_WANDERS_S = 7200.0
# Sightings of which turning and heading are remembered, for what the clock may be off.
_REMEMBERED = 3000
# A window's estimate of the noise counts for so much against those before.
_NOISE_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class LandmarkSettings:
    """How objects are followed.

    Attributes
    ----------
    window_s : float
        Sightings of so long are solved anew each time.
    every_s : float
        Of one object in one camera, sightings closer together than this count as one.
    most : int
        With more sightings than this in a window, they are taken further apart.
    noise_every : int
        The noise of pixels is estimated anew every so many solutions.
    """

    window_s: float = 4.0
    every_s: float = 0.09
    most: int = 600
    noise_every: int = 8


class Sighting(NamedTuple):
    """One object in one frame.

    Attributes
    ----------
    object : int
        Number of the object, one for each time that it is passed.
    camera : str
    epoch_ns : int
        UTC of the exposure of the frame's middle row.
    pixel_px : (float, float)
    kind : str
        A `geoloc.locate.records.Kind`.
    size_px : float
        Height of the box that the pixel is the middle of; NaN for points.
    """

    object: int
    camera: str
    epoch_ns: int
    pixel_px: tuple[float, float]
    kind: str
    size_px: float = float("nan")


class Landmark(NamedTuple):
    """What is known of an object.

    Attributes
    ----------
    object : int
    place : Place
    covariance_m2 : float64 (2, 2)
        East and true north.
    sigma_height_m : float
    """

    object: int
    place: Place
    covariance_m2: FloatArray
    sigma_height_m: float


Solving = Generator[None, None, list[Landmark]]
"""A window that is being solved."""


class Landmarks:
    """All objects that are in view, or were a moment ago.

    Parameters
    ----------
    rig : Rig
    budget : ErrorBudget
        Priors: one sigma of each source.
    readout_ms : float or None
        Rolling shutter's readout; None: unknown.
    pole_radius_m : float
    track_sigma_m : float
        One sigma a horizontal axis that the whole track is off beyond what its poses say.
    settings : LandmarkSettings
    """

    def __init__(
        self,
        rig: Rig,
        budget: ErrorBudget = _DEFAULT_BUDGET,
        *,
        readout_ms: float | None = None,
        pole_radius_m: float = 0.03,
        track_sigma_m: float = 0.0,
        settings: LandmarkSettings | None = None,
    ) -> None:
        self.rig, self.settings = rig, settings or LandmarkSettings()
        self.noise = 1.0
        """Factor on every sigma of a pixel, by the last estimate."""
        self._budget = budget if readout_ms is None else replace(budget, readout_ms=_STATED_READOUT_MS)
        self._readout_s = 1e-3 * (LIKELY_READOUT_MS if readout_ms is None else readout_ms)
        self._radius_m, self._track_sigma_m = pole_radius_m, track_sigma_m
        self._cameras = tuple(sorted(rig.cameras))
        self._rows: list[Sighting] = []
        self._last: dict[tuple[int, str, str], int] = {}
        self._places: dict[tuple[int, bool], Place] = {}
        self._shared = np.zeros(0)
        self._carried: Carried | None = None
        self._cut_ns: int | None = None
        self._shift_ns = 0
        self._taken: dict[int, float] = {}
        self._solutions = 0
        self._last_model: Model | None = None
        self._last_x = np.zeros(0)
        self._turning, self._heading = np.zeros(0), np.zeros(0)

    @property
    def shift_ns(self) -> int:
        """What was added to the clock of the cameras, beyond what an adjustment takes for small."""
        return self._shift_ns

    def add(self, sighting: Sighting) -> None:
        """Take a sighting, unless it comes too soon after the one before, or too late."""
        if self._cut_ns is not None and sighting.epoch_ns < self._cut_ns:
            return
        key = sighting.object, sighting.camera, sighting.kind
        last_ns = self._last.get(key)
        apart_s = max(self.settings.every_s, len(self._last) * self.settings.window_s / self.settings.most)
        if last_ns is not None and abs(sighting.epoch_ns - last_ns) < apart_s * NANOSECONDS:
            return
        self._last[key] = sighting.epoch_ns
        self._rows.append(sighting)

    def begin_track(self) -> None:
        """Take note that the trajectory has begun anew: what it takes its lasting roll for is another's."""
        if self._carried is not None:
            self._carried = self._carried.without(LEARNED)

    def last_seen(self) -> dict[int, int]:
        """Epoch at which each object of the window was seen last."""
        last: dict[int, int] = {}
        for row in self._rows:
            last[row.object] = max(row.epoch_ns, last.get(row.object, 0))
        return last

    def leaving(self, now_ns: int) -> set[int]:
        """Objects that the next solution is the last one of."""
        cut_ns = self._next_cut_ns(now_ns)
        return {number for number, at_ns in self.last_seen().items() if at_ns < cut_ns}

    def forget(self, now_ns: int) -> None:
        """Let go of sightings that leave the window unsolved, as where there is no trajectory."""
        cut_ns = self._next_cut_ns(now_ns)
        self._rows = [row for row in self._rows if row.epoch_ns >= cut_ns]
        self._last = {key: at_ns for key, at_ns in self._last.items() if at_ns >= cut_ns}

    def solve(self, trajectory: Trajectory, now_ns: int) -> list[Landmark]:
        """Solve the window at once; as `solving`."""
        return run(self.solving(trajectory, now_ns))

    def solving(self, trajectory: Trajectory, now_ns: int) -> Solving:
        """Solve the window, in parts that take about as long: a frame can be taken between two of them.

        Parameters
        ----------
        trajectory : Trajectory
        now_ns : int
            What was seen more than a window before it leaves.

        Returns
        -------
        generator
            Its end has the objects; those without a position, as before a second ray crosses, are left out.
        """
        if not self._rows:
            return []
        budget = self._priors(trajectory)
        task, objects = self._task(trajectory, budget)
        seen = task.seen(self._shift_ns)
        if not seen.scene.point.size:
            self.forget(now_ns)
            return []
        yield
        model, prior, start = self._window(seen.scene, trajectory, budget)
        yield
        solution = self._solution(model, prior, start)
        yield
        found = spread_at_once(solution.equations.model, solution)
        adjusted = adjusted_of(
            objects,
            np.where(
                np.isin(np.arange(seen.rejected.size), _outliers(solution)), Reason.OUTLIER, seen.rejected
            ),
            seen.poses,
            solution.equations.model,
            solution,
            found,
            self._of_the_track(trajectory, solution, found, budget),
            (),
            None,
            budget.time_ms,
        )
        self._move_on(solution, now_ns)
        return _landmarks(adjusted)

    def _of_the_track(
        self, trajectory: Trajectory, solution: Solution, found: Spread, budget: ErrorBudget
    ) -> OfTheTrack:
        """What no sighting shows; of the clock, what the drive so far leaves open."""
        shift_s, body = self._shift_ns / NANOSECONDS, solution.equations.model.scene.body
        self._remember(body)
        if trajectory.late_sigma_s > 0.0:
            late_ms = 1e3 * trajectory.late_sigma_s
            unsure_s, base_m = 1e-3 * float(np.hypot(self._budget.time_ms, late_ms)), 0.0
        else:
            heading = np.repeat(self._heading[:, None], 3, axis=1)
            so_far = body._replace(yaw_rate_radps=self._turning, sigma_rad=heading)
            rays = clock_of_the_rays(solution, found, budget.time_ms, shift_s)
            unsure_s, base_m = lasting_doubt_s(rays, budget.time_ms, so_far, is_poor=False), _BASE_M
        return OfTheTrack(
            trajectory.is_fitted, budget.lever_arm_m, self._track_sigma_m, base_m, shift_s, unsure_s
        )

    def _priors(self, trajectory: Trajectory) -> ErrorBudget:
        if trajectory.late_sigma_s > 0.0:
            # What bearings seem to say of the clock is noise of such fixes: the stated one stays.
            return replace(self._budget, time_ms=_HELD_MS)
        return self._budget

    def _task(self, trajectory: Trajectory, budget: ErrorBudget) -> tuple[Task, IntArray]:
        rows = self._rows
        number = np.array([row.object for row in rows], dtype=np.int64)
        observations = Observations(
            self.rig,
            Sightings(
                np.array([row.camera for row in rows], dtype=np.str_),
                np.array([row.pixel_px for row in rows]).reshape(-1, 2),
            ),
            np.array([row.kind for row in rows], dtype=np.str_),
            number,
            np.array([row.epoch_ns for row in rows], dtype=np.int64),
            trajectory,
        )
        size_px = np.array([row.size_px for row in rows])
        task = Task(
            observations,
            budget,
            size_px,
            self._readout_s,
            self._radius_m,
            noise=None,
            terrain=None,
            cameras=self._cameras,
            places=self._places,
        )
        return task, np.unique(number)

    def _window(
        self, scene: Scene, trajectory: Trajectory, budget: ErrorBudget
    ) -> tuple[Model, Prior, FloatArray]:
        """Lay out the unknowns, what is known of them, and where to begin."""
        roll = trajectory.lasting_roll
        self._taken = {
            TIME: self._shift_ns / NANOSECONDS,
            ROLL: float(np.radians(roll.deg)),
            LEAN: float(np.radians(roll.deg_per_mps2)),
        }
        model, prior = model_of(scene, trajectory, budget, self._readout_s, self._radius_m, self._cut_ns)
        if self._carried is not None:
            prior = self._carried.added_to(prior, model, self._taken)
        start = np.zeros(model.layout.size)
        if self._shared.size == model.layout.first_point:
            start[: self._shared.size] = self._shared
            for place, value in self._taken.items():
                start[place] -= value
        self._warm(start, model)
        return model, prior, start

    def _solution(self, model: Model, prior: Prior, start: FloatArray) -> Solution:
        self._solutions += 1
        if self._solutions == 1:
            solution = solve(model, prior)
            self.noise = solution.noise
            return solution
        solution = solve_near(model, prior, start, self.noise)
        if self._solutions % self.settings.noise_every == 0:
            more = noise_at(solution) ** 2 - self.noise**2
            self.noise = float(np.sqrt(self.noise**2 + _NOISE_SHARE * more))
        return solution

    def _warm(self, start: FloatArray, model: Model) -> None:
        """Begin the trajectory's corrections and the body's bounces where they were last."""
        if self._last_model is None:
            return
        old, layout = self._last_model.layout, model.layout
        for epoch_ns, was_ns, places, were in (
            (model.node_ns, self._last_model.node_ns, layout.node, old.node),
            (model.scene.instant_ns, self._last_model.scene.instant_ns, layout.bounce, old.bounce),
        ):
            _, here, there = np.intersect1d(epoch_ns, was_ns, return_indices=True)
            start[places(here)] = self._last_x[were(there)]

    def _remember(self, body: Bodies) -> None:
        every = slice(None, None, 8)
        self._turning = np.concatenate([self._turning, body.yaw_rate_radps[every]])[-_REMEMBERED:]
        self._heading = np.concatenate([self._heading, body.sigma_rad[every, 2]])[-_REMEMBERED:]

    def _move_on(self, solution: Solution, now_ns: int) -> None:
        """Keep what was found, and let go of what leaves the window."""
        model = solution.equations.model
        layout = model.layout
        self._shared = solution.x[: layout.first_point].copy()
        for place, value in self._taken.items():
            self._shared[place] += value
        self._last_model, self._last_x = model, solution.x
        self._places = places_of(model, solution.x)
        cut_ns, first_ns = self._next_cut_ns(now_ns), int(model.scene.epoch_ns.min())
        if first_ns < cut_ns:
            carried = left_behind(model, solution, cut_ns, self._taken)
            since_s = (cut_ns - (self._cut_ns or first_ns)) / NANOSECONDS
            self._carried = carried.loosened(self._wandering(since_s))
            self._cut_ns = cut_ns
            self.forget(now_ns)
        if abs(solution.x[TIME]) > _SAME_MOTION_S:
            self._shift_ns += round(float(solution.x[TIME]) * NANOSECONDS)

    def _next_cut_ns(self, now_ns: int) -> int:
        """The whole second before which everything leaves the window."""
        cut_ns = (now_ns - round(self.settings.window_s * NANOSECONDS)) // _SECOND_NS * _SECOND_NS
        return cut_ns if self._cut_ns is None else max(cut_ns, self._cut_ns)

    def _wandering(self, since_s: float) -> dict[Key, float]:
        """Variance that clock and boresights win in a time."""
        share = 2.0 * since_s / _WANDERS_S
        variance = {Key("shared", 0, False, TIME): share * (1e-3 * self._budget.time_ms) ** 2}
        boresight = share * float(np.radians(self._budget.boresight_deg)) ** 2
        for camera in range(len(self._cameras)):
            first = FIRST_CAMERA + camera * self._per_camera
            variance |= {Key("shared", 0, False, first + axis): boresight for axis in range(3)}
        return variance

    @property
    def _per_camera(self) -> int:
        cameras = len(self._cameras)
        return (self._shared.size - FIRST_CAMERA) // cameras if self._shared.size else PER_CAMERA


def solving_nothing() -> Solving:
    """Return a window without anything in it."""
    yield from ()
    return []


def run(solving: Solving) -> list[Landmark]:
    """Take all parts that are left."""
    while True:
        try:
            next(solving)
        except StopIteration as end:
            found: list[Landmark] = end.value
            return found


def _outliers(solution: Solution) -> IntArray:
    return np.asarray(solution.equations.model.scene.row[~solution.inlier])


def _landmarks(adjusted: Adjusted) -> list[Landmark]:
    return [
        Landmark(
            int(adjusted.object[i]),
            Place(
                float(adjusted.latitude_deg[i]), float(adjusted.longitude_deg[i]), float(adjusted.height_m[i])
            ),
            adjusted.covariance_m2[i],
            float(adjusted.sigma_height_m[i]),
        )
        for i in np.flatnonzero(adjusted.reason == "")
    ]
