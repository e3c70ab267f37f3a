"""The engine of a drive that goes on: what arrives goes in, estimates come out.

It has no clock of its own. When the trajectory and the window of landmarks are solved follows from when
things arrived, so that a recorded drive gives the same estimates however fast it is played; where nothing
arrives any more, who runs it lets time pass. Of the two solutions at most one is worked out for one arrival,
so that no frame waits for both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.build_model import Place
from geoloc.arrays import FloatArray
from geoloc.live.causal import CausalTrajectory, Following
from geoloc.live.first import placed_by_one_frame
from geoloc.live.followed import NOWHERE, Followed
from geoloc.live.landmarks import (
    Landmark,
    Landmarks,
    Sighting,
    Solving,
    run,
    solving_nothing,
)
from geoloc.live.samples import Fix, Lag, MotionSample, Quantity
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.rig.rig import Rig
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.trajectory import Trajectory
from twin.live.estimates import Estimate, State
from twin.live.events import Arrival, Detection, Frame

_TRACK_EVERY_S = _LANDMARKS_EVERY_S = 0.5
"""How often each is solved, by the time of arrivals."""
_BLIND_S = 3.0
"""Frames may arrive so late. With none for longer objects leave the window all the same, as where a camera is
lost."""
_NOWHERE = Place(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True, slots=True)
class LiveCar:
    """A car: what does not change while it drives.

    Attributes
    ----------
    rig : Rig
    antennas : tuple of str
        Those that deliver fixes.
    budget : ErrorBudget
        One sigma of each source, and prior of what is estimated.
    lags : mapping quantity → Lag
        Of the car's own motion.
    wheelbase_m : float or None
    readout_ms : float or None
        Rolling shutter; None: unknown.
    pole_radius_m : float
    track_sigma_m : float
        One sigma a horizontal axis that the whole track is off beyond its fixes (a change of datum).
    """

    rig: Rig
    antennas: tuple[str, ...]
    budget: ErrorBudget = field(default_factory=ErrorBudget)
    lags: Mapping[Quantity, Lag] = field(default_factory=dict)
    wheelbase_m: float | None = None
    readout_ms: float | None = None
    pole_radius_m: float = 0.03
    track_sigma_m: float = 0.0


@dataclass(slots=True)
class _Passed:
    """One object, each time that it is passed."""

    number: int
    name: str
    id: str
    object: str | None
    label: str = ""
    skiltnummer: str = ""
    text: str = ""
    sightings: int = 0
    cameras: set[str] = field(default_factory=set)
    first_ns: int = 0
    last_ns: int = 0
    estimate: Estimate | None = None

    def take(self, seen: Detection, camera: str, epoch_ns: int) -> None:
        self.label, self.skiltnummer = self.label or seen.label, self.skiltnummer or seen.skiltnummer
        self.text = self.text or seen.text
        self.first_ns = min(self.first_ns, epoch_ns) if self.sightings else epoch_ns
        self.last_ns = max(self.last_ns, epoch_ns)
        self.sightings += 1
        self.cameras.add(camera)


class _Job(NamedTuple):
    """A window that is being solved, and the objects whose last solution it is."""

    solving: Solving
    leaving: set[int]


class LiveEngine:
    """Fixes, frames and motion in, in the order in which they arrive; estimates out.

    Parameters
    ----------
    car : LiveCar

    Attributes
    ----------
    frames, sightings : int
        Taken so far.
    unfollowed : int
        Detections without an id where the car had no pose, or outside the camera's picture.
    shown : tuple of (str, str)
        What the last frame showed: each object by its estimates' id, and as what.
    """

    def __init__(self, car: LiveCar) -> None:
        self.car = car
        self.frames = self.sightings = self.unfollowed = 0
        self.shown: tuple[tuple[str, str], ...] = ()
        self._track = CausalTrajectory(
            {name: car.rig.antennas[name].rig_t_antenna_m for name in car.antennas},
            lags=car.lags,
            wheelbase_m=car.wheelbase_m,
        )
        self._landmarks = Landmarks(
            car.rig,
            car.budget,
            readout_ms=car.readout_ms,
            pole_radius_m=car.pole_radius_m,
            track_sigma_m=car.track_sigma_m,
        )
        self._open: dict[int, _Passed] = {}
        self._by_name: dict[str, int] = {}
        self._followed = Followed()
        # 0 is that of an object without one.
        self._labels = {"": 0}
        self._times: dict[str, int] = {}
        self._count = 0
        self._now_ns = self._track_ns = self._landmarks_ns = self._seen_ns = 0
        self._fresh = False
        self._job: _Job | None = None

    @property
    def trajectory(self) -> Trajectory | None:
        """Where the car was, is, and will be for a moment; None where nothing can be said."""
        return self._track.trajectory

    @property
    def following(self) -> Following:
        """How well the car is followed now."""
        return self._track.following(self._now_ns)

    @property
    def without_place(self) -> list[tuple[int, int]]:
        """When each object in the window that has no estimate yet was seen, first and last."""
        return [(one.first_ns, one.last_ns) for one in self._open.values() if one.estimate is None]

    def pose(self, epoch_ns: int) -> Poses | None:
        """Pose of the rig at an epoch, up to a moment ahead of now; None where nothing can be said."""
        known = self._track.trajectory
        return None if known is None else known.poses_at(np.array([epoch_ns], dtype=np.int64))

    def feed(self, arrival: Arrival) -> list[Estimate]:
        """Take what has arrived; return the estimates that are new or have changed."""
        at_ns, what = arrival
        self._now_ns = max(self._now_ns, at_ns)
        found: list[Estimate] = []
        if isinstance(what, Fix):
            self._track.add_fix(what)
            self._fresh = True
        elif isinstance(what, MotionSample):
            self._track.add_motion(what)
        else:
            found = self._frame(what)
        return found + self._due()

    def let_pass(self, now_ns: int) -> list[Estimate]:
        """Take that it is so late, and nothing has arrived; return the estimates that have changed."""
        self._now_ns = max(self._now_ns, now_ns)
        found = self._due()
        while self._job is not None:
            # No frame waits.
            found += self._next_part(self._job)
        return found

    def finish(self) -> list[Estimate]:
        """End the drive: what is known of all objects that are open becomes final."""
        found = self._done(run(self._job.solving), self._job) if self._job is not None else []
        self._solve_track()
        job = self._begun(self._seen_ns + round((self._landmarks.settings.window_s + 2.0) * NANOSECONDS))
        return found + self._done(run(job.solving), job)

    def _due(self) -> list[Estimate]:
        """Work out what is due, one thing at a time: a part of the window, or the trajectory."""
        if self._job is not None:
            return self._next_part(self._job)
        if self._now_ns - self._track_ns >= _TRACK_EVERY_S * NANOSECONDS and (
            self._fresh or self._runs_out()
        ):
            self._solve_track()
        elif self._open and (self._now_ns - self._landmarks_ns >= _LANDMARKS_EVERY_S * NANOSECONDS):
            self._landmarks_ns = self._now_ns
            blind_ns = self._now_ns - round(_BLIND_S * NANOSECONDS)
            self._job = self._begun(max(self._seen_ns, blind_ns))
            return self._next_part(self._job)
        return []

    def _begun(self, until_ns: int) -> _Job:
        """Begin to solve the window; what was seen more than its length before becomes final."""
        leaving = self._landmarks.leaving(until_ns) | self._unseen(until_ns)
        trajectory = self._track.trajectory
        if trajectory is None:
            self._landmarks.forget(until_ns)
            return _Job(solving_nothing(), leaving)
        return _Job(self._landmarks.solving(trajectory, until_ns), leaving)

    def _next_part(self, job: _Job) -> list[Estimate]:
        try:
            next(job.solving)
        except StopIteration as end:
            return self._done(end.value, job)
        return []

    def _done(self, landmarks: Iterable[Landmark], job: _Job) -> list[Estimate]:
        self._job = None
        found = [
            self._refined(one, is_last=one.object in job.leaving)
            for one in landmarks
            if one.object in self._open
        ]
        return found + self._closed(job.leaving)

    def _runs_out(self) -> bool:
        """Whether the trajectory ends soon, without a fix to make it longer."""
        known = self._track.trajectory
        return known is not None and known.span_ns[1] < self._now_ns + round(_TRACK_EVERY_S * NANOSECONDS)

    def _solve_track(self) -> None:
        before = self._track.restarts
        self._track.solve(self._now_ns)
        if self._track.restarts > before:
            self._landmarks.begin_track()
        self._track_ns, self._fresh = self._now_ns, False

    def _frame(self, frame: Frame) -> list[Estimate]:
        self.frames += 1
        self._seen_ns = max(self._seen_ns, frame.epoch_ns)
        new: list[tuple[_Passed, Detection]] = []
        shown: list[tuple[str, str]] = []
        for seen, name in zip(frame.detections, self._names(frame), strict=True):
            if name is None:
                self.unfollowed += 1
                continue
            passed = self._passed(seen, name)
            passed.take(seen, frame.camera, frame.epoch_ns)
            self.sightings += 1
            shown.append((passed.id, seen.kind))
            self._landmarks.add(
                Sighting(passed.number, frame.camera, frame.epoch_ns, seen.pixel_px, seen.kind, seen.size_px)
            )
            if passed.estimate is None and seen.kind == Kind.FOOT:
                new.append((passed, seen))
        self.shown = tuple(shown)
        return self._first(frame, new) if new else []

    def _names(self, frame: Frame) -> list[str | None]:
        """What each detection's object is called: by its source, else ``live-1`` and so on; None: nothing."""
        names = [seen.object for seen in frame.detections]
        rows = [i for i, name in enumerate(names) if name is None]
        trajectory = self._track.trajectory
        if not rows or trajectory is None:
            return names
        seen = [frame.detections[i] for i in rows]
        label = [self._labels.setdefault(one.skiltnummer or one.label, len(self._labels)) for one in seen]
        picture = Observations(
            self.car.rig,
            Sightings(np.full(len(rows), frame.camera), np.array([one.pixel_px for one in seen])),
            np.array([one.kind for one in seen]),
            np.full(len(rows), -1),
            np.full(len(rows), frame.epoch_ns + self._landmarks.shift_ns, dtype=np.int64),
            trajectory,
        )
        numbers = self._followed.join(picture, np.array(label, dtype=np.int64))
        for i, number in zip(rows, numbers.tolist(), strict=True):
            names[i] = None if number == NOWHERE else f"live-{number + 1}"
        return names

    def _passed(self, seen: Detection, name: str) -> _Passed:
        """Which object a detection shows: one that is open, else a new one."""
        number = self._by_name.get(name)
        if number is not None:
            return self._open[number]
        self._count += 1
        times = self._times[name] = self._times.get(name, 0) + 1
        passed = _Passed(self._count, name, name if times == 1 else f"{name}#{times}", seen.object)
        self._open[self._count] = passed
        self._by_name[name] = self._count
        return passed

    def _first(self, frame: Frame, new: Iterable[tuple[_Passed, Detection]]) -> list[Estimate]:
        """Place objects from this frame alone."""
        trajectory = self._track.trajectory
        if trajectory is None:
            return []
        epoch_ns = np.array([frame.epoch_ns + self._landmarks.shift_ns], dtype=np.int64)
        pose = trajectory.poses_at(epoch_ns)
        found = []
        for passed, seen in new:
            one = placed_by_one_frame(self.car.rig, frame.camera, seen.pixel_px, pose, self.car.budget)
            if one is not None:
                shared_m2 = self.car.track_sigma_m**2 * np.eye(2)
                found.append(self._said(passed, State.FIRST, one[0], one[1] + shared_m2))
        return found

    def _unseen(self, until_ns: int) -> set[int]:
        """Objects of which no sighting is in the window, as where all came too late."""
        since_ns = until_ns - round((self._landmarks.settings.window_s + 1.0) * NANOSECONDS)
        return {number for number, one in self._open.items() if one.last_ns < since_ns}

    def _refined(self, one: Landmark, *, is_last: bool) -> Estimate:
        state = State.FINAL if is_last else State.REFINED
        return self._said(self._open[one.object], state, one.place, one.covariance_m2, one.sigma_height_m)

    def _closed(self, leaving: Iterable[int]) -> list[Estimate]:
        """Close objects; those that no solution placed end with what one frame said, or lost."""
        ended = []
        for number in sorted(leaving):
            passed = self._open.pop(number, None)
            if passed is None:
                continue
            del self._by_name[passed.name]
            last = passed.estimate
            if last is None:
                ended.append(self._said(passed, State.LOST, _NOWHERE, np.full((2, 2), np.nan)))
            elif last.state is not State.FINAL:
                ended.append(last._replace(state=State.FINAL, at_ns=self._now_ns, sightings=passed.sightings))
        return ended

    def _said(
        self,
        passed: _Passed,
        state: State,
        place: Place,
        covariance_m2: FloatArray,
        sigma_height_m: float = float("nan"),
    ) -> Estimate:
        passed.estimate = Estimate(
            id=passed.id,
            object=passed.object,
            label=passed.label,
            skiltnummer=passed.skiltnummer,
            text=passed.text,
            state=state,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            height_m=place.height_m,
            covariance_m2=covariance_m2,
            sigma_height_m=sigma_height_m,
            sightings=passed.sightings,
            cameras=tuple(sorted(passed.cameras)),
            first_seen_ns=passed.first_ns,
            last_seen_ns=passed.last_ns,
            at_ns=self._now_ns,
        )
        return passed.estimate
