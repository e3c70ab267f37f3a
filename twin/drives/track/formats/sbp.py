"""SwiftNav SBP recordings → fixes of an antenna, or full poses of an INS.

Velocities and headings (VEL_NED, BASELINE_HEADING) belong to the position of the same time of week.

Positions carry the time of the GPS week only; the week is that of GPS_TIME, and UTC follows from the messages
UTC_TIME of the same recording, else from the table of leap seconds. Heights are ellipsoidal.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple, Self

from geoloc.trajectory.fix_checks import HEADING_SIGMA_DEG, MAX_SPEED_MPS
from twin.drives.epochs import (
    GPS_EPOCH_NS,
    WEEK_NS,
    after_rollovers,
    nearest_week,
    rollover_warning,
    utc_from_gps,
)
from twin.drives.track.attitudes import (
    Attitudes,
    attitudes_from_rows,
    poses_of_fixes,
    rpy_deg_from_quaternion,
)
from twin.drives.track.fixes import (
    Fix,
    FixesRead,
    LeftOutError,
    PosesRead,
    check_epoch,
    check_position,
    fixes_read,
    sigma_or_nan,
)
from twin.drives.track.formats import sbp_messages as sbp
from twin.drives.track.formats.sbp_messages import Message

ANTENNA_FIRST = (sbp.POS_LLH_COV_GNSS, sbp.POS_LLH_GNSS, sbp.POS_LLH_COV, sbp.POS_LLH)
"""Which positions are those of an antenna: where an INS is at work, the ones before it came in."""
FUSED_FIRST = (sbp.POS_LLH_COV, sbp.POS_LLH, sbp.POS_LLH_COV_GNSS, sbp.POS_LLH_GNSS)
"""Which positions belong to an attitude: those of the INS."""

_GGA_QUALITY = {1: 1, 2: 2, 3: 5, 4: 4, 5: 6, 6: 2}
"""Swift's fix mode as GGA writes it: single, DGNSS, float, fixed, dead reckoning, SBAS."""
_VELOCITY_KINDS = {
    sbp.POS_LLH: (sbp.VEL_NED_COV, sbp.VEL_NED),
    sbp.POS_LLH_COV: (sbp.VEL_NED_COV, sbp.VEL_NED),
    sbp.POS_LLH_GNSS: (sbp.VEL_NED_COV_GNSS, sbp.VEL_NED_GNSS),
    sbp.POS_LLH_COV_GNSS: (sbp.VEL_NED_COV_GNSS, sbp.VEL_NED_GNSS),
}
"""Which velocities are those of a position's point, the better ones first."""
_HEADING_SIGMA_DEG = {4: HEADING_SIGMA_DEG, 3: 3.0}
"""By fix mode: fixed, and float, where a decimetre is open over a metre or two."""
_MS_NS = 1_000_000
_VELOCITIES = frozenset(kind for kinds in _VELOCITY_KINDS.values() for kind in kinds)
_NAMES = {
    sbp.POS_LLH: "POS_LLH",
    sbp.POS_LLH_COV: "POS_LLH_COV",
    sbp.POS_LLH_GNSS: "POS_LLH_GNSS",
    sbp.POS_LLH_COV_GNSS: "POS_LLH_COV_GNSS",
}
_NOT_MEASURED_THEN = 0b10_0000
_WITH_INS = 0b1_1000
_QUATERNION_UNIT = 2.0**-31


def read_sbp(content: bytes, antenna: str, where: str) -> FixesRead:
    """Read the positions of an antenna.

    Of the four kinds of position messages the first of `ANTENNA_FIRST` that holds usable ones is read, of the
    sender with the most of them. Fix mode 0 is left out, the others become GGA qualities. Velocities and
    headings are those of the same sender at the same time of week.

    Raises
    ------
    DriveError
        If no position can be used.
    """
    return _fixes(Log.of(content), antenna, where, ANTENNA_FIRST)


def read_sbp_poses(content: bytes, where: str) -> PosesRead:
    """Read positions and attitudes of an INS: ORIENT_QUAT, else ORIENT_EULER, at the epochs of the positions.

    Swift's body frame is forward, right, down, and its angles turn north, east, down into it: yaw is the
    heading, pitch counts nose up and is turned to nose down.

    Raises
    ------
    DriveError
        If no position, or no attitude, can be used.
    """
    log = Log.of(content)
    fixes = _fixes(log, "", where, FUSED_FIRST)
    faults: Counter[str] = Counter()
    return poses_of_fixes(fixes, _attitudes(log, where, faults), where, faults)


def clock_of(content: bytes) -> Clock | None:
    """Clock of a recording, which turns times of the week into UTC; None without a sound time message."""
    return Log.of(content).clock()


class Clock(NamedTuple):
    """What turns times of the week into UTC."""

    gps_ns: int
    """Of one sound GPS_TIME or UTC_TIME message, since the GPS epoch."""
    ahead_s: int | None
    """GPS time minus UTC as the receiver says; None where it does not."""
    residual_ns: dict[float, int]
    """What GPS_TIME adds to a whole millisecond, by time of week."""
    moved: int
    """How many weeks had run over."""

    def utc_ns(self, tow_ms: float) -> int:
        """UTC of a time of week."""
        if not 0 <= tow_ms <= WEEK_NS // _MS_NS:
            raise LeftOutError("time of week outside the week")
        time_ns = round(tow_ms) * _MS_NS + self.residual_ns.get(tow_ms, 0)
        epoch_ns = utc_from_gps(nearest_week(time_ns, self.gps_ns), self.ahead_s)
        check_epoch(epoch_ns)
        return epoch_ns


class _Position(NamedTuple):
    """A position message, before its week is known."""

    tow_ms: float
    flags: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_horizontal_m: float
    sigma_vertical_m: float


class _Motion(NamedTuple):
    """Velocities and headings of one sender, by time of week."""

    velocities: dict[int, dict[float, tuple[tuple[float, float, float], tuple[float, float]]]]
    """By message type: east, north, up, and the sigmas of a horizontal axis and the vertical one, m/s."""
    headings: dict[float, tuple[float, float]]
    """Degrees clockwise from true north, and one sigma."""


class _Attitude(NamedTuple):
    """An attitude message, before its week is known; angles as `attitudes_from_rows` takes them."""

    tow_ms: float
    flags: int
    angles_deg: tuple[float, ...]


class Log:
    """What is kept of a recording's messages, or of those of one epoch of a stream."""

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        self.positions: dict[int, dict[int, list[_Position]]] = {kind: {} for kind in _NAMES}
        """By message type and sender."""
        self.attitudes: dict[int, list[_Attitude]] = {sbp.ORIENT_QUAT: [], sbp.ORIENT_EULER: []}
        self.wrong_attitudes: Counter[str] = Counter()
        self.motions: dict[int, _Motion] = {}
        """By sender."""
        self._gps_ns: int | None = None
        self._utc_ns: int | None = None
        self._residual_ns: dict[float, int] = {}
        self._ahead_s: Counter[int] = Counter()
        self._moved = 0

    @classmethod
    def of(cls, content: bytes) -> Self:
        """Keep what a whole recording says."""
        log = cls()
        for message in sbp.iter_messages(content, log.faults):
            log.take(message)
        return log

    def clock(self) -> Clock | None:
        """Clock of the recording; None where it has no sound time message."""
        # Without GPS_TIME the week is that of UTC: leap seconds are few against half a week.
        near_ns = self._utc_ns if self._gps_ns is None else self._gps_ns
        if near_ns is None:
            return None
        ahead = self._ahead_s.most_common(1)
        return Clock(near_ns, ahead[0][0] if ahead else None, self._residual_ns, self._moved)

    def take(self, message: Message) -> None:
        """Keep what a message says."""
        kind, sender, field = message
        if kind in self.positions:
            self.positions[kind].setdefault(sender, []).append(_position(field))
        elif kind in self.attitudes:
            angles = _of_quaternion if kind == sbp.ORIENT_QUAT else _of_euler
            try:
                self.attitudes[kind].append(_Attitude(field["tow"], int(field["flags"]), angles(field)))
            except LeftOutError as reason:
                self.wrong_attitudes[str(reason)] += 1
        elif kind == sbp.BASELINE_HEADING:
            sigma_deg = _HEADING_SIGMA_DEG.get(int(field["flags"]) & 0b111)
            if sigma_deg is None:
                self.faults["heading without an RTK solution"] += 1
            else:
                self._motion(sender).headings[field["tow"]] = field["heading"] / 1000 % 360.0, sigma_deg
        elif kind in _VELOCITIES:
            if int(field["flags"]) & 0b111 and (velocity := _velocity(field)) is not None:
                self._motion(sender).velocities[kind][field["tow"]] = velocity
        elif int(field["flags"]) & 0b111:  # else the receiver calls its time invalid
            self._take_time(kind, field)

    def forget(self) -> None:
        """Drop all that is said of places and motions; what is known of the clock stays."""
        for by_sender in self.positions.values():
            by_sender.clear()
        for attitudes in self.attitudes.values():
            attitudes.clear()
        self.motions.clear()
        self._residual_ns.clear()
        self.faults.clear()
        self.wrong_attitudes.clear()

    def _motion(self, sender: int) -> _Motion:
        return self.motions.setdefault(sender, _Motion({kind: {} for kind in _VELOCITIES}, {}))

    def _take_time(self, kind: int, field: Mapping[str, float]) -> None:
        tow_ns = round(field["tow"]) * _MS_NS
        if kind == sbp.GPS_TIME and 0 <= field["wn"] < 2**16:
            stated = int(field["wn"]) * WEEK_NS + tow_ns
            sound = after_rollovers(stated + GPS_EPOCH_NS) - GPS_EPOCH_NS
            self._moved += sound != stated
            self._gps_ns = sound if self._gps_ns is None else self._gps_ns
            if field["ns_residual"]:
                self._residual_ns[field["tow"]] = int(field["ns_residual"])
        elif kind == sbp.UTC_TIME and (utc_ns := _stated_utc_ns(field)) is not None:
            self._utc_ns = utc_ns if self._utc_ns is None else self._utc_ns
            if int(field["flags"]) >> 3 & 0b11:  # 0: leap seconds as the receiver left the factory
                self._ahead_s[round((nearest_week(tow_ns, utc_ns) - utc_ns) / 1e9)] += 1


def _fixes(log: Log, antenna: str, where: str, order: Sequence[int]) -> FixesRead:
    clock, faults = log.clock(), log.faults
    rows: list[Fix] = []
    warnings: list[str] = []
    for kind in order:
        by_sender = sorted(log.positions[kind].items(), key=lambda item: len(item[1]))
        if not by_sender:
            continue
        faults["position of another sender"] += sum(len(positions) for _, positions in by_sender[:-1])
        sender, positions = by_sender[-1]
        rows = rows_of(positions, said_of(log.motions.get(sender), kind), clock, faults)
        if rows:
            warnings = _warnings(positions, kind, where)
            break
    if clock is not None and clock.moved:
        warnings.append(rollover_warning(where, clock.moved))
    return fixes_read(rows, antenna, where, faults=faults, cure=_cure(log, clock), warnings=warnings)


def _position(field: Mapping[str, float]) -> _Position:
    if "cov_n_n" in field:
        horizontal = math.sqrt(max(field["cov_n_n"] + field["cov_e_e"], 0.0) / 2)
        vertical = math.sqrt(max(field["cov_d_d"], 0.0))
    else:
        horizontal, vertical = field["h_accuracy"] / 1000, field["v_accuracy"] / 1000  # mm
    return _Position(
        tow_ms=field["tow"],
        flags=int(field["flags"]),
        latitude_deg=float(field["lat"]),
        longitude_deg=float(field["lon"]),
        height_m=float(field["height"]),
        sigma_horizontal_m=sigma_or_nan(horizontal),
        sigma_vertical_m=sigma_or_nan(vertical),
    )


def _velocity(
    field: Mapping[str, float],
) -> tuple[tuple[float, float, float], tuple[float, float]] | None:
    """East, north, up and two sigmas, m/s; None for what no car does."""
    north, east, down = (field[axis] / 1000 for axis in "ned")  # mm/s
    if math.hypot(north, east, down) > MAX_SPEED_MPS:
        return None
    if "cov_n_n" in field:
        horizontal = math.sqrt(max(field["cov_n_n"] + field["cov_e_e"], 0.0) / 2)
        vertical = math.sqrt(max(field["cov_d_d"], 0.0))
    else:
        horizontal, vertical = field["h_accuracy"] / 1000, field["v_accuracy"] / 1000
    return (east, north, -down), (sigma_or_nan(horizontal), sigma_or_nan(vertical))


def said_of(motion: _Motion | None, kind: int) -> Callable[[float], dict[str, Any]]:
    """What is said of heading and velocity at the time of week of a position, as arguments of a `Fix`."""
    if motion is None:
        return lambda _: {}
    velocities = next((v for k in _VELOCITY_KINDS[kind] if (v := motion.velocities[k])), {})

    def said(tow_ms: float) -> dict[str, Any]:
        found: dict[str, Any] = {}
        if tow_ms in velocities:
            found["velocity_mps"], found["velocity_sigma_mps"] = velocities[tow_ms]
        if tow_ms in motion.headings:
            found["heading_deg"], found["heading_sigma_deg"] = motion.headings[tow_ms]
        return found

    return said


def rows_of(
    positions: Sequence[_Position],
    said: Callable[[float], dict[str, Any]],
    clock: Clock | None,
    faults: Counter[str],
) -> list[Fix]:
    """Return the positions that are usable, with what is said of them; the others are counted."""
    rows = []
    for position in positions:
        try:
            rows.append(_fix(position, clock)._replace(**said(position.tow_ms)))
        except LeftOutError as reason:
            faults[str(reason)] += 1
    return rows


def _fix(position: _Position, clock: Clock | None) -> Fix:
    quality = _GGA_QUALITY.get(position.flags & 0b111)
    if quality is None:
        raise LeftOutError("fix mode 0 or unknown")
    if clock is None:
        raise LeftOutError("no date: neither GPS_TIME nor UTC_TIME")
    place, sigmas = position[2:5], position[5:]
    check_position(*place)
    epoch_ns = clock.utc_ns(position.tow_ms)
    return Fix(epoch_ns, epoch_ns, *place, quality, *sigmas)


def _stated_utc_ns(field: Mapping[str, float]) -> int | None:
    """Nanoseconds of UTC since the GPS epoch of a UTC_TIME message."""
    parts = ("year", "month", "day", "hours", "minutes")
    try:
        minute = datetime(*(int(field[name]) for name in parts), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except (ValueError, OverflowError):
        return None
    epoch_ns = (int(minute.timestamp()) + int(field["seconds"])) * 1_000_000_000 + int(field["ns"])
    return after_rollovers(epoch_ns) - GPS_EPOCH_NS


def _warnings(positions: Sequence[_Position], kind: int, where: str) -> list[str]:
    warnings = []
    loose = sum(bool(position.flags & _NOT_MEASURED_THEN) for position in positions)
    if loose:
        warnings.append(
            f"{loose} positions of {where} say that their time is not that of the measurement: on the move"
            " they may be off by the delay."
        )
    fused = sum(bool(position.flags & _WITH_INS) for position in positions)
    if fused and kind in (sbp.POS_LLH, sbp.POS_LLH_COV):
        warnings.append(
            f"{fused} positions of {where} ({_NAMES[kind]}) are those of the receiver's INS: the lever arm"
            " must be that of the point that was set up in it."
        )
    return warnings


def _cure(log: Log, clock: Clock | None) -> str:
    if not any(log.positions.values()):
        return "switch the messages POS_LLH and GPS_TIME on in the receiver"
    if clock is None:
        return "switch the message GPS_TIME on in the receiver"
    return "check that it is the SBP recording of this drive"


def _attitudes(log: Log, where: str, faults: Counter[str]) -> Attitudes:
    clock = log.clock()
    faults += log.wrong_attitudes
    rows: list[tuple[int, tuple[float, ...]]] = []
    for kind in (sbp.ORIENT_QUAT, sbp.ORIENT_EULER):
        for attitude in log.attitudes[kind] if not rows else ():
            if clock is None or not attitude.flags & 0b111:
                faults["attitude that the receiver calls invalid"] += 1
                continue
            try:
                rows.append((clock.utc_ns(attitude.tow_ms), attitude.angles_deg))
            except LeftOutError as reason:
                faults[str(reason)] += 1
    return attitudes_from_rows(
        rows, where, faults, cure="switch ORIENT_QUAT on in the receiver, or name the file under [gnss]"
    )


def _of_quaternion(field: Mapping[str, float]) -> tuple[float, ...]:
    """Roll, pitch and heading, ISO 8855, and their sigmas, in degrees."""
    parts = (field[name] * _QUATERNION_UNIT for name in "wxyz")
    roll, nose_up, yaw = rpy_deg_from_quaternion(*parts)
    # A small rotation is twice its quaternion's vector.
    sigma = [2 * math.degrees(abs(field[f"{name}_accuracy"])) for name in "xyz"]
    return roll, -nose_up, yaw, max(sigma[0], sigma[1]), sigma[2]


def _of_euler(field: Mapping[str, float]) -> tuple[float, ...]:
    """The same of Euler angles, which are in millionths of a degree."""
    roll, nose_up, yaw = (field[name] * 1e-6 for name in ("roll", "pitch", "yaw"))
    tilt_sigma = max(abs(field["roll_accuracy"]), abs(field["pitch_accuracy"]))
    return roll, -nose_up, yaw, tilt_sigma, abs(field["yaw_accuracy"])
