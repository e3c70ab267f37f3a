"""GNSS and INS epochs → pose and uncertainty of the rig at any epoch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.earth.geodesy import metres_per_degree
from geoloc.errors import TrajectoryError
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.trajectory.curves import PoseCurves, pose_curves
from geoloc.trajectory.fix_checks import (
    CODE_LASTS_S,
    check_positions,
    common_epochs,
    lateness_s,
    without_jumps,
)
from geoloc.trajectory.heading import course_over_ground, heading_against_course
from geoloc.trajectory.interpolation import NANOSECONDS, Bracket, apart_s, bracket, seconds, tangents
from geoloc.trajectory.motion_readings import followed_epochs
from geoloc.trajectory.pose_noise import PoseSigmas, with_estimated_sigmas
from geoloc.trajectory.poses import GnssFixes, LastingRoll, Poses, PoseTrack, without_headings
from geoloc.trajectory.rig_poses import fitted, raw_poses, rig_poses
from geoloc.trajectory.vehicle_motion import MotionFound, VehicleMotion

__all__ = [
    "GnssFixes",
    "PoseTrack",
    "Poses",
    "Trajectory",
    "course_over_ground",
    "trajectory_from_gnss",
    "trajectory_from_poses",
]

_Record = TypeVar("_Record", GnssFixes, PoseTrack)

MAX_GAP_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Where the rig was, at any epoch of a drive.

    Made by `trajectory_from_gnss` or `trajectory_from_poses`.

    Attributes
    ----------
    knots : Poses
        The rig's pose at each recorded epoch.
    fixes : Poses
        What the receiver said, for the paper's method: first antenna, no lever arm, heading of that fix.
    host_ns : int64 (n,)
        When the host received each of `fixes`.
    max_gap_s : float
        No pose is given between knots that are further apart.
    dropped : tuple of (count, reason)
        Recorded positions, and headings, that were left out.
    measured_at_m : float64 (3,)
        Where on the rig positions were measured: the middle of the antennas. A tilt that is wrong leaves that
        point where it is, and moves the rig's origin below it.
    lasting_roll : LastingRoll
        How much of the roll's sigma is an error that lasts.
    estimated : PoseSigmas or None
        Sigmas of recorded poses that were not stated but estimated (NaN: stated); None where all were.
    late_sigma_s : float
        One sigma of how late the positions may be against their epochs, all alike, beyond what is usual
        (`fix_checks.lateness_s`): that is taken off.
    lasts_s : float
        Correlation time of what its places are off.
    wander_m2ps : float
        By how much the variance of a place grows in a second that velocities alone bridge; infinite without.
    is_fitted : bool
        Whether poses were fitted to fixes, so that it is known how much of their errors lasts; else recorded.
    motion : MotionFound or None
        What was found of the car's own sensors, where there are any.
    """

    knots: Poses
    fixes: Poses
    host_ns: IntArray
    max_gap_s: float
    dropped: tuple[tuple[int, str], ...]
    measured_at_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    lasting_roll: LastingRoll = field(default_factory=LastingRoll)
    estimated: PoseSigmas | None = None
    late_sigma_s: float = 0.0
    lasts_s: float = CODE_LASTS_S
    wander_m2ps: float = np.inf
    is_fitted: bool = False
    motion: MotionFound | None = None
    _curves: list[PoseCurves] = field(default_factory=list, init=False, repr=False)

    @property
    def epoch_ns(self) -> IntArray:
        """UTC epochs of the knots, increasing."""
        return self.knots.epoch_ns

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last epoch."""
        return int(self.epoch_ns[0]), int(self.epoch_ns[-1])

    @property
    def interval_s(self) -> float:
        """Median time between two fixes."""
        return float(np.median(np.diff(self.fixes.epoch_ns)) / NANOSECONDS)

    def delay_ms(self) -> tuple[float, float]:
        """Median and 95th percentile of host stamp minus measurement: the link's delay."""
        delay = (self.host_ns - self.fixes.epoch_ns) / 1e6
        return float(np.median(delay)), float(np.percentile(delay, 95))

    def poses_at(self, epoch_ns: IntArray) -> Poses:
        """Give the rig's pose at any epochs.

        Positions follow a cubic through the knots (a straight line is 1.5 cm off at 5 Hz and 3 m/s²), angles
        turn the shorter way. Nothing is extrapolated.

        Parameters
        ----------
        epoch_ns : int64 (n,)

        Returns
        -------
        Poses
            Rows outside the recording, inside a gap of more than `max_gap_s`, or without a heading are NaN
            with a reason.
        """
        asked = np.asarray(epoch_ns, dtype=np.int64)
        if not self._curves:
            self._curves.append(pose_curves(self.knots, self.max_gap_s))
        columns, valid = self._curves[0].at(asked)
        bad = np.flatnonzero(~valid)
        reason = np.zeros(asked.size, dtype="U1" if valid.all() else REASON_TYPE)
        if bad.size:
            columns = {name: np.where(valid, column, np.nan) for name, column in columns.items()}
            reason[bad] = self._reasons(bracket(self.epoch_ns, asked[bad]))
        return Poses(epoch_ns=asked, **columns, valid=valid, reason=reason)

    def nearest_fix(self, host_ns: IntArray) -> Poses:
        """Give the fix whose *host* stamp is nearest, as the paper pairs frames with fixes.

        No interpolation, no lever arm, no correction of the link's delay. Of a track of poses: the nearest
        pose by epoch.

        Parameters
        ----------
        host_ns : int64 (n,)
            Host stamps of frames.

        Returns
        -------
        Poses
            `epoch_ns` is the asked stamp. Rows more than `max_gap_s` from every fix are NaN with a reason.
        """
        asked = np.asarray(host_ns, dtype=np.int64)
        order = np.argsort(self.host_ns, kind="stable")
        at = bracket(self.host_ns[order], asked)
        index = order[np.where(at.fraction > 0.5, at.right, at.left)]
        away_s = apart_s(self.host_ns[index], asked)
        near = away_s <= self.max_gap_s
        valid = near & self.fixes.valid[index]
        reason = np.where(near, self.fixes.reason[index], Reason.FIX_FAR_OFF)
        columns = {
            field.name: np.where(valid, getattr(self.fixes, field.name)[index], np.nan)
            for field in fields(Poses)
            if field.name not in {"epoch_ns", "valid", "reason"}
        }
        return Poses(epoch_ns=asked, **columns, valid=valid, reason=reason)

    def with_scaled_sigmas(self, factors: PoseSigmas) -> Trajectory:
        """Return the same poses with estimated sigmas times these factors; stated ones stay."""
        if self.estimated is None:
            return self
        taken = PoseSigmas(*(one * factor for one, factor in zip(self.estimated, factors, strict=True)))
        horizontal, up, tilt, heading = np.where(np.isnan(taken), 1.0, factors).tolist()
        knots = replace(
            self.knots,
            sigma_horizontal_m=horizontal * self.knots.sigma_horizontal_m,
            sigma_vertical_m=up * self.knots.sigma_vertical_m,
            sigma_roll_deg=tilt * self.knots.sigma_roll_deg,
            sigma_pitch_deg=tilt * self.knots.sigma_pitch_deg,
            sigma_heading_deg=heading * self.knots.sigma_heading_deg,
        )
        return replace(self, knots=knots, fixes=knots, estimated=taken)

    def line(self, step_m: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude of the drive for a map, thinned to about one point every `step_m`."""
        source = self.knots if self.knots.valid.any() else self.fixes
        known = np.isfinite(source.latitude_deg)
        lat, lon = source.latitude_deg[known], source.longitude_deg[known]
        if lat.size < 2:
            return lat, lon
        east, north = metres_per_degree(lat[1:])
        travelled = np.cumsum(np.hypot(np.diff(lon) * east, np.diff(lat) * north)) // step_m
        keep = np.concatenate([[True], np.diff(travelled, prepend=0.0) > 0])
        keep[-1] = True
        return lat[keep], lon[keep]

    def missing_s(self, epoch_ns: IntArray) -> FloatArray:
        """Seconds (n,) before the first epoch or after the last, else those of the gap about each epoch."""
        at = bracket(self.epoch_ns, np.asarray(epoch_ns, dtype=np.int64))
        outside_s = np.maximum(at.before_s, at.after_s)
        return np.where(outside_s > 0, outside_s, at.span_s)

    def _reasons(self, at: Bracket) -> TextArray:
        """Why each of these epochs has no pose."""
        left, right = self.knots.reason[at.left], self.knots.reason[at.right]
        return np.select(
            [at.before_s > 0, at.after_s > 0, at.in_gap(self.max_gap_s)],
            [Reason.BEFORE_FIRST_FIX, Reason.AFTER_LAST_FIX, Reason.IN_GAP],
            default=np.where(left == "", right, left),
        )


def trajectory_from_gnss(
    fixes: Sequence[GnssFixes],
    rig_antennas: Mapping[str, FloatArray],
    *,
    max_gap_s: float = MAX_GAP_S,
    motion: VehicleMotion | None = None,
) -> Trajectory:
    """Make a trajectory of the rig from the fixes of one or more antennas.

    All fixes are smoothed together (`smoother.plane`, `smoother.tilt`): the rear axle rolls where it
    points but for its slip, and the two antennas that are furthest apart (0.3 m or more) give the heading,
    also standing still. How far their lever arms are wrong is found where the car drives and kept where it
    stands. With one antenna the heading is held through standstill with a growing sigma; a track that comes
    back the way it went is taken for reversing. Headings and velocities that receivers have of themselves are
    used too (`smoother.receiver_motion`), but for headings that contradict the course
    (`heading.heading_against_course`). Pitch is the climb of the track (0 ± 2.5° if the car never
    moved), roll is 0 ± 1.2° but for what antennas side by side show. The pose is that of the rig's origin on
    the ground. What does not fit loses its weight. Lever arms that are all zero make the antenna, or the
    middle of several, the rig's origin; how several lie to the car is then found from the course.

    Parameters
    ----------
    fixes : sequence of GnssFixes
        One an antenna.
    rig_antennas : mapping antenna name → float64 (3,)
        Lever arms in the rig frame (FLU), metres.
    max_gap_s : float
        Longest time between fixes that is bridged.
    motion : VehicleMotion, optional
        What the car measured of its own motion. With speed and turning (turn rate or steering angle) there
        are poses where fixes are missing for up to `motion_readings.LONGEST_BRIDGE_S`, also before the first
        fix and after the last.

    Raises
    ------
    TrajectoryError
        No fixes, an antenna without a lever arm, antennas that stand elsewhere than the rig says, or fixes
        that make no track; motion in another unit, of another sign or by another clock.
    """
    if not fixes:
        raise TrajectoryError("There are no GNSS fixes: give the recording of at least one antenna.")
    unknown = sorted({f.antenna for f in fixes} - set(rig_antennas))
    if unknown:
        raise TrajectoryError(
            f"Antenna {', '.join(unknown)} has fixes but no lever arm; lever arms are known for "
            f"{', '.join(sorted(rig_antennas)) or 'none'}: give it one."
        )
    kept, dropped = _without_jumps(fixes)
    kept, refused = _without_wrong_headings(kept)
    levers = [np.asarray(rig_antennas[f.antenna], dtype=np.float64) for f in kept]
    late_s, late_sigma_s = lateness_s(kept)
    early = [replace(one, epoch_ns=one.epoch_ns - round(late_s * NANOSECONDS)) for one in kept]
    knot_ns = common_epochs([one.epoch_ns for one in early], max_gap_s)
    if motion is not None:
        knot_ns = followed_epochs(knot_ns, motion)
    fit = fitted(early, levers, knot_ns, max_gap_s, motion)
    return Trajectory(
        knots=rig_poses(knot_ns, fit),
        fixes=raw_poses(kept, levers, max_gap_s),
        host_ns=kept[0].host_ns,
        max_gap_s=max_gap_s,
        dropped=(*dropped, *refused),
        measured_at_m=np.mean(levers, axis=0),
        lasting_roll=fit.tilt.lasting_roll,
        late_sigma_s=late_sigma_s,
        lasts_s=fit.track.lasts_s,
        wander_m2ps=fit.track.wander_m2ps,
        is_fitted=True,
        motion=fit.motion,
    )


def trajectory_from_poses(track: PoseTrack, *, max_gap_s: float = MAX_GAP_S) -> Trajectory:
    """Make a trajectory of full poses of the rig's origin, as an INS or SLAM gives them.

    Where sigmas are NaN they are estimated from the track, and its noise from pose to pose is smoothed away
    (`pose_noise`).

    Raises
    ------
    TrajectoryError
        Fewer than two poses, not in strict time order, or NaN.
    """
    check_positions(track, "The track of poses")
    angles = track.roll_deg + track.pitch_deg + track.heading_deg
    if not np.isfinite(angles).all():
        raise TrajectoryError(
            f"The track of poses: {int((~np.isfinite(angles)).sum())} of {angles.size} attitudes are NaN: "
            "drop those poses."
        )
    keep = without_jumps(track)
    check_positions(kept := _rows(track, keep), "The track of poses, after impossible jumps were dropped")
    one, estimated = with_estimated_sigmas(kept)
    t_s = seconds(one.epoch_ns)
    east, north = metres_per_degree(one.latitude_deg, one.height_m)
    columns = {field.name: getattr(one, field.name) for field in fields(PoseTrack)}
    tilt_sigma = columns.pop("sigma_roll_pitch_deg")
    knots = Poses(
        **columns,
        sigma_roll_deg=tilt_sigma,
        sigma_pitch_deg=tilt_sigma,
        speed_mps=np.hypot(tangents(t_s, one.longitude_deg) * east, tangents(t_s, one.latitude_deg) * north),
        valid=np.ones(t_s.size, dtype=bool),
        reason=np.full(t_s.size, "", dtype="U1"),
    )
    dropped = _dropped(int((~keep).sum()), "the track of poses")
    return Trajectory(knots, knots, one.epoch_ns, max_gap_s, dropped, estimated=estimated)


def _without_jumps(fixes: Sequence[GnssFixes]) -> tuple[list[GnssFixes], tuple[tuple[int, str], ...]]:
    kept: list[GnssFixes] = []
    dropped: list[tuple[int, str]] = []
    for one in fixes:
        what = f"Antenna {one.antenna}"
        check_positions(one, what)
        keep = without_jumps(one)
        thinned = _rows(one, keep)
        check_positions(thinned, f"{what}, after impossible jumps were dropped")
        kept.append(thinned)
        dropped.extend(_dropped(int((~keep).sum()), f"antenna {one.antenna}"))
    return kept, tuple(dropped)


def _without_wrong_headings(
    fixes: Sequence[GnssFixes],
) -> tuple[list[GnssFixes], tuple[tuple[int, str], ...]]:
    kept: list[GnssFixes] = []
    dropped: list[tuple[int, str]] = []
    for one in fixes:
        wrong = heading_against_course(one).contradicts
        kept.append(without_headings(one) if wrong else one)
        if wrong:
            count = int(np.isfinite(one.heading_deg).sum())
            dropped.append((count, f"antenna {one.antenna}: headings that contradict the course"))
    return kept, tuple(dropped)


def _dropped(count: int, what: str) -> tuple[tuple[int, str], ...]:
    return ((count, f"{what}: reached only faster than 70 m/s"),) if count else ()


def _rows(record: _Record, keep: BoolArray) -> _Record:
    """Return the record's rows where `keep`."""
    arrays = {
        field.name: getattr(record, field.name)[keep] for field in fields(record) if field.name != "antenna"
    }
    return replace(record, **arrays)
