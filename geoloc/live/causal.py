"""A trajectory that follows a drive: the smoother of recorded drives over the last seconds, again and again.

The equations are those of `geoloc.trajectory.smoother`. What differs is where they begin: with what all knots
that have left the window tell of its first one (`chain.Known`), so that nothing is forgotten and nothing
counts twice; and where they end: with knots after the last fix, at which nothing is measured, so that the
same links say where the car is now, and how surely. What is late or out of order takes its place in the
window, and the next solution has it.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import enu_offset
from geoloc.errors import TrajectoryError
from geoloc.live.samples import Fix, Lag, MotionBuffer, MotionSample, Quantity, gnss_fixes
from geoloc.trajectory.fix_checks import common_epochs, lateness_s, without_jumps
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.motion_readings import LONGEST_BRIDGE_S, MotionReadings, followed_epochs
from geoloc.trajectory.poses import GnssFixes, LastingRoll, Poses, part
from geoloc.trajectory.rig_poses import Fitted, fitted, rig_poses
from geoloc.trajectory.smoother.chain import Known, Window
from geoloc.trajectory.smoother.knot_fixes import KnotFixes, knot_fixes
from geoloc.trajectory.smoother.plane_track import PlaneTrack
from geoloc.trajectory.smoother.state import ACCELERATION, POSITION, VELOCITY, YAW, YAW_RATE
from geoloc.trajectory.smoother.tilt import TiltTrack
from geoloc.trajectory.track_and_tilt import Windows, of_one_antenna, track_and_tilt
from geoloc.trajectory.trajectory import MAX_GAP_S, Trajectory
from geoloc.trajectory.vehicle_motion import VehicleMotion

_STEP_S = 0.2
_ITERATIONS, _ITERATIONS_ALONE = 4, 3
# A lag that is found differs from the stated one, and integrals begin before the first knot.
_MOTION_MARGIN_S = 2.0
_RECENT = 20
"""Fixes before a new one that tell what receiver it comes from."""
_by_epoch = attrgetter("epoch_ns")


class Following(StrEnum):
    """How well a car is followed."""

    WAITING = "waiting"
    """There are too few fixes yet, or the car's heading does not show."""
    FIXED = "fixed"
    PREDICTED = "predicted"
    """The last fix lies longer back than fixes are apart: poses are less and less sure."""
    LOST = "lost"
    """No fix for too long: there is no pose."""


@dataclass(frozen=True, slots=True)
class CausalSettings:
    """How a drive is followed.

    Attributes
    ----------
    lag_s : float
        How long after its epoch a pose may still change.
    ahead_s : float
        How far beyond the asked epoch a solution predicts.
    first_s : float
        Fixes of so long a time are waited for before the first solution.
    predicted_s : float
        Without a fix for longer than this there is no pose, unless the car measures its own motion
        (`motion_readings.LONGEST_BRIDGE_S`).
    history_s : float
        Poses that change no more are kept for so long.
    """

    lag_s: float = 4.0
    ahead_s: float = 1.0
    first_s: float = 2.0
    predicted_s: float = 10.0
    history_s: float = 60.0


class _Solved(NamedTuple):
    """The last solution: its knots, and what the window after it begins with."""

    knot_ns: IntArray
    fit: Fitted
    begin_ns: int
    before: tuple[Known, Known] | None
    place_deg: tuple[float, float]
    """Latitude and longitude of the first of `before`'s means."""


class CausalTrajectory:
    """Where the rig is, from fixes as they arrive.

    Parameters
    ----------
    rig_antennas : mapping antenna name → float64 (3,)
        Lever arms of the antennas that deliver fixes.
    lags : mapping quantity → Lag
        Of the car's own motion.
    wheelbase_m : float or None
    settings : CausalSettings
    """

    def __init__(
        self,
        rig_antennas: Mapping[str, FloatArray],
        *,
        lags: Mapping[Quantity, Lag] | None = None,
        wheelbase_m: float | None = None,
        settings: CausalSettings | None = None,
    ) -> None:
        self.settings = settings or CausalSettings()
        self.too_late = 0
        """Fixes that arrived when the window had left their epoch."""
        self.refused = 0
        """Fixes of antennas without a lever arm, or that are no positions."""
        self.restarts = 0
        """Times that it began anew: after an outage, or a jump of all fixes."""
        self.trajectory: Trajectory | None = None
        self._arms = {name: np.asarray(arm, dtype=np.float64) for name, arm in rig_antennas.items()}
        self._fixes: dict[str, list[Fix]] = {name: [] for name in rig_antennas}
        self._motion = MotionBuffer(lags or {}, wheelbase_m)
        self._solved: _Solved | None = None
        self._history: list[Poses] = []
        self._newest_ns = 0

    @property
    def newest_fix_ns(self) -> int:
        """Epoch of the newest fix; 0 before the first."""
        return self._newest_ns

    @property
    def settled_ns(self) -> int:
        """Poses up to this epoch change no more; 0 before the first solution."""
        return 0 if self._solved is None else self._solved.begin_ns

    def add_fix(self, fix: Fix) -> None:
        """Take a fix, in any order; the next `solve` has it."""
        held = self._fixes.get(fix.antenna)
        place = (fix.latitude_deg, fix.longitude_deg, fix.height_m)
        if held is None or fix.quality <= 0 or not np.isfinite(place).all() or abs(fix.latitude_deg) > 90.0:
            self.refused += 1
            return
        late_s, _ = lateness_s([gnss_fixes(fix.antenna, [*held[-_RECENT:], fix])])
        fix = fix._replace(epoch_ns=fix.epoch_ns - round(late_s * NANOSECONDS))
        if self._solved is not None and fix.epoch_ns < self._solved.begin_ns:
            self.too_late += 1
        elif all(one.epoch_ns != fix.epoch_ns for one in reversed(held)):
            insort(held, fix, key=_by_epoch)
            self._newest_ns = max(self._newest_ns, fix.epoch_ns)

    def add_motion(self, sample: MotionSample) -> None:
        """Take a sample of the car's own motion, in any order."""
        if np.isfinite(sample.value):
            self._motion.add(sample)

    def following(self, now_ns: int) -> Following:
        """How well the car is followed at an epoch."""
        if self.trajectory is None:
            return Following.WAITING if not self._newest_ns or not self.restarts else Following.LOST
        since_s = (now_ns - self._newest_ns) / NANOSECONDS
        return Following.FIXED if since_s <= MAX_GAP_S else Following.PREDICTED

    def solve(self, now_ns: int) -> None:
        """Bring the trajectory up to an epoch, with all that has arrived.

        `trajectory` is None afterwards where nothing can be said.
        """
        motion = self._motion.motion()
        self._restart_if_lost(now_ns, motion)
        kept = self._without_jumps()
        names = [name for name, held in kept.items() if held]
        # Without a solution there must be fixes to begin with; with one, an antenna may be silent.
        if not self._ready(kept):
            self.trajectory = None
            return
        fixes = [gnss_fixes(name, kept[name]) for name in names]
        try:
            if self._solved is None:
                self._begin(fixes, now_ns, motion)
            else:
                self._go_on(fixes, now_ns, motion, self._solved)
        except (TrajectoryError, np.linalg.LinAlgError):
            self._restart()
            return

    def _ready(self, kept: Mapping[str, list[Fix]]) -> bool:
        if self._solved is not None:
            return any(kept.values())
        longest = max(kept.values(), key=len, default=[])
        if len(longest) < 3:
            return False
        span_s = (longest[-1].epoch_ns - longest[0].epoch_ns) / NANOSECONDS
        # An antenna that delivers nothing at first is waited for, but not for ever.
        silent = any(len(held) < 3 for held in kept.values())
        return span_s >= self.settings.first_s * (2.0 if silent else 1.0)

    def _without_jumps(self) -> dict[str, list[Fix]]:
        kept = {}
        for name, held in self._fixes.items():
            if len(held) < 2:
                kept[name] = held
                continue
            mask = without_jumps(gnss_fixes(name, held))
            if self._solved is not None and not mask[: len(held) // 2].any():
                # All that is new lies elsewhere: what was known of the place was wrong.
                self._restart()
            kept[name] = [one for one, keep in zip(held, mask, strict=True) if keep]
        return kept

    def _restart_if_lost(self, now_ns: int, motion: VehicleMotion | None) -> None:
        if self._solved is None or not self._newest_ns:
            return
        longest_s = self.settings.predicted_s if motion is None else LONGEST_BRIDGE_S
        if (now_ns - self._newest_ns) / NANOSECONDS > longest_s:
            self._restart()
            for held in self._fixes.values():
                held.clear()

    def _restart(self) -> None:
        self.restarts += self._solved is not None
        self._solved, self.trajectory = None, None
        self._history.clear()
        since_ns = self._newest_ns - round((self.settings.lag_s + self.settings.first_s) * NANOSECONDS)
        self._forget(since_ns)

    def _forget(self, before_ns: int) -> None:
        for held in self._fixes.values():
            while held and held[0].epoch_ns < before_ns:
                del held[0]
        self._motion.forget(before_ns - round(_MOTION_MARGIN_S * NANOSECONDS))

    def _begin(self, fixes: list[GnssFixes], now_ns: int, motion: VehicleMotion | None) -> None:
        """Fit the first fixes as a recorded drive of their length is."""
        fixes = [one for one in fixes if one.epoch_ns.size >= 3]
        levers = [self._arms[one.antenna] for one in fixes]
        knot_ns = self._knots(fixes, now_ns, motion, None)
        fit = fitted(fixes, levers, knot_ns, MAX_GAP_S, motion)
        self._finish(fixes, knot_ns, fit, None)

    def _go_on(
        self, fixes: list[GnssFixes], now_ns: int, motion: VehicleMotion | None, last: _Solved
    ) -> None:
        knot_ns = self._knots(fixes, now_ns, motion, last.begin_ns)
        names = [one.antenna for one in fixes]
        if len(names) != len(last.fit.car.arms_m):
            raise TrajectoryError(f"Antennas have come or gone: {', '.join(names)} deliver fixes now.")
        knots = knot_fixes(fixes, knot_ns, MAX_GAP_S)
        track, tilt = _continued(last, knots, knot_ns)
        readings = None if motion is None else MotionReadings.of(motion, int(knot_ns[0]))
        car = last.fit.car._replace(readings=readings)
        before = None if last.before is None else _placed(last, knots)
        self._finish(fixes, knot_ns, Fitted(knots, car, track, tilt, last.fit.pair), before)

    def _finish(
        self, fixes: list[GnssFixes], knot_ns: IntArray, fit: Fitted, before: tuple[Known, Known] | None
    ) -> None:
        """Take one more pass over the window, which leaves what comes before its next beginning."""
        knots, car, track, tilt, pair, _ = fit
        alone = [of_one_antenna(knots, i, _ITERATIONS_ALONE) for i in range(knots.seen.shape[1])]
        leave = self._leave(knot_ns)
        windows = None
        if leave or before is not None:
            first, second = before or (None, None)
            windows = Windows(Window(first, leave), Window(second, leave))
        track, tilt = track_and_tilt(
            knots, car, car.drift_mps(knots, alone), track, tilt, _ITERATIONS, windows
        )
        if not np.isfinite(track.state).all():
            raise TrajectoryError("The fixes of the last seconds fit no motion of a car.")
        fit = Fitted(knots, car, track, tilt, pair)
        onward, place = None, (float("nan"), float("nan"))
        if track.onward is not None and tilt.onward is not None:
            onward = track.onward, tilt.onward
            off = np.zeros((knot_ns.size, 2))
            off[leave] = track.onward.mean[POSITION] - knots.path_m[leave]
            latitude, longitude = knots.geographic(knots.path_m + off)
            place = float(latitude[leave]), float(longitude[leave])
        poses = rig_poses(knot_ns, fit)
        self._solved = _Solved(knot_ns, fit, int(knot_ns[leave]), onward, place)
        self.trajectory = self._trajectory(poses, fixes, tilt.lasting_roll)
        self._keep(part(poses, slice(0, leave)))
        self._forget(self._solved.begin_ns)

    def _leave(self, knot_ns: IntArray) -> int:
        """Number of the knot at which the next window begins."""
        settled_ns = self._newest_ns - round(self.settings.lag_s * NANOSECONDS)
        # In an outage the last fix stays, since the path is laid through fixes.
        return max(int(np.searchsorted(knot_ns, settled_ns, side="right")) - 1, 0)

    def _knots(
        self, fixes: list[GnssFixes], now_ns: int, motion: VehicleMotion | None, begin_ns: int | None
    ) -> IntArray:
        """Epochs of fixes; more where there are none for a while, and up to a little after now."""
        longest = [one.epoch_ns for one in fixes if one.epoch_ns.size > 1] or [one.epoch_ns for one in fixes]
        knot_ns = common_epochs(longest, MAX_GAP_S) if longest[0].size > 1 else np.unique(longest[0])
        if begin_ns is not None:
            knot_ns = np.union1d(knot_ns[knot_ns > begin_ns], [begin_ns])
        if motion is not None and knot_ns.size > 1:
            ahead_ns = now_ns + round(self.settings.ahead_s * NANOSECONDS)
            followed = followed_epochs(knot_ns, motion)
            knot_ns = followed[(followed >= knot_ns[0]) & (followed <= ahead_ns)]
        last_ns = max(int(knot_ns[-1]), now_ns + round(self.settings.ahead_s * NANOSECONDS))
        ends = np.append(knot_ns, last_ns)
        step_ns = round(_STEP_S * NANOSECONDS)
        wide = np.flatnonzero(np.diff(ends) > 1.5 * step_ns)
        wide = wide[(np.diff(ends)[wide] > MAX_GAP_S * NANOSECONDS) | (wide == knot_ns.size - 1)]
        between = [np.arange(ends[i] + step_ns, ends[i + 1] + 1, step_ns) for i in wide]
        return np.asarray(np.unique(np.concatenate([knot_ns, *between])), dtype=np.int64)

    def _trajectory(self, poses: Poses, fixes: list[GnssFixes], roll: LastingRoll) -> Trajectory:
        knots = joined([*self._history, poses])
        arms = [self._arms[one.antenna] for one in fixes]
        return Trajectory(
            knots=knots,
            fixes=knots,
            host_ns=knots.epoch_ns,
            max_gap_s=MAX_GAP_S,
            dropped=(),
            measured_at_m=np.mean(arms, axis=0),
            lasting_roll=roll,
            late_sigma_s=lateness_s(fixes)[1],
            is_fitted=True,
        )

    def _keep(self, poses: Poses) -> None:
        """Keep poses that change no more, for a while."""
        if not poses.epoch_ns.size:
            return
        self._history.append(poses)
        since_ns = int(poses.epoch_ns[-1]) - round(self.settings.history_s * NANOSECONDS)
        while self._history[0].epoch_ns[-1] < since_ns:
            del self._history[0]


def joined(parts: list[Poses]) -> Poses:
    """Poses of one part after the other."""
    columns = {one.name: np.concatenate([getattr(p, one.name) for p in parts]) for one in fields(Poses)}
    return Poses(**columns)


def _placed(last: _Solved, knots: KnotFixes) -> tuple[Known, Known]:
    """What is known of the first knot, in the plane coordinates of these knots."""
    if last.before is None:
        raise TrajectoryError("Nothing is known of the first knot.")
    track, tilt = last.before
    mean = track.mean.copy()
    east, north = enu_offset(knots.latitude_deg[0], knots.longitude_deg[0], *last.place_deg)
    mean[POSITION] = knots.path_m[0] + [float(east), float(north)]
    return Known(mean, track.information), tilt


def _continued(last: _Solved, knots: KnotFixes, knot_ns: IntArray) -> tuple[PlaneTrack, TiltTrack]:
    """The last solution at the knots of this window, each moved on from the one before it."""
    old, track, tilt = last.fit.knots, last.fit.track, last.fit.tilt
    row = np.clip(np.searchsorted(last.knot_ns, knot_ns, side="right") - 1, 0, last.knot_ns.size - 1)
    since_s = ((knot_ns - last.knot_ns[row]) / NANOSECONDS)[:, None]
    latitude, longitude = (column[row] for column in old.geographic(track.position_m))
    moved = np.stack(enu_offset(knots.latitude_deg, knots.longitude_deg, latitude, longitude), axis=1)
    state = track.state[row].copy()
    velocity, acceleration = state[:, VELOCITY], state[:, ACCELERATION]
    state[:, POSITION] = knots.path_m + moved + since_s * velocity + 0.5 * since_s**2 * acceleration
    state[:, VELOCITY] += since_s * acceleration
    state[:, YAW] += since_s[:, 0] * state[:, YAW_RATE]
    weight = np.where(since_s == 0.0, track.weight[row], 1.0)
    # A fix that has arrived since has no weight yet; one that stays keeps what it had.
    weight = np.where(knots.seen, np.where(old.seen[row], weight, 1.0), 0.0)
    level = {name: getattr(tilt, name)[row] for name in _OF_KNOTS}
    return (
        PlaneTrack(state, track.covariance[row], track.constants, track.constants_covariance, weight),
        TiltTrack(**level, lasting_roll=tilt.lasting_roll),
    )


_OF_KNOTS = ("height_m", "height_sigma_m", "pitch_deg", "pitch_sigma_deg", "roll_deg", "roll_sigma_deg")
