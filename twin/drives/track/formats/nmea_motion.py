"""Headings, speeds and courses of NMEA sentences: HDT, THS, VTG and RMC.

HDT, THS and VTG carry no time. They belong to the epoch of the sentence with a time that stands before them,
or after them where host stamps say that that one is nearer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from geoloc.trajectory.fix_checks import HEADING_SIGMA_DEG, MAX_SPEED_MPS
from twin.drives.track.fixes import LeftOutError

HEADINGS = ("HDT", "THS")
MAGNETIC_COMPASS = "HC"
"""Talker whose heading is that of a compass: degrees off in a car of steel."""
_VALID_THS = ("A", "E")
_KNOT_MPS, _KMH_MPS = 1852.0 / 3600.0, 1.0 / 3.6
FILTERED_SIGMA_MPS = 0.15
"""Of a speed over ground an axis: receivers filter what they write into RMC and VTG."""
# Slower than this a course is noise, or an old one.
_CREEPING_MPS = 0.5

_Velocity = tuple[float, float, float]
"""East, north, and one sigma of each, m/s."""


class _Moment(NamedTuple):
    time_ns: int
    """Of the day."""
    host_ns: int | None


class _Untimed(NamedTuple):
    value: float | _Velocity
    host_ns: int | None
    before: _Moment | None


@dataclass(slots=True)
class Motion:
    """Headings and velocities of a recording, by time of day."""

    headings_deg: dict[int, float] = field(default_factory=dict)
    velocities: dict[int, _Velocity] = field(default_factory=dict)
    """Those of RMC, else of VTG."""
    _last: _Moment | None = None
    _waiting: list[_Untimed] = field(default_factory=list)

    @property
    def time_ns(self) -> int | None:
        """Time of day of the last sentence that has one."""
        return None if self._last is None else self._last.time_ns

    def pass_time(self, time_ns: int, host_ns: int | None) -> None:
        """Take note of a sentence with a time."""
        moment = _Moment(time_ns, host_ns)
        for one in self._waiting:
            self._settle(one, moment)
        self._waiting.clear()
        self._last = moment

    def take_rmc(self, time_ns: int, fields: Mapping[str, str]) -> None:
        """Keep the velocity of an RMC sentence."""
        if (speed := _number(fields.get("spd_over_grnd", ""))) is not None:
            velocity = velocity_of(speed * _KNOT_MPS, _number(fields.get("true_course", "")))
            if velocity is not None:
                self.velocities[time_ns] = velocity

    def take_untimed(self, kind: str, fields: Mapping[str, str], host_ns: int | None) -> None:
        """Keep a heading or a velocity of a sentence without a time.

        Raises
        ------
        LeftOutError
            If a heading is none.
        """
        value = _heading_deg(kind, fields) if kind in HEADINGS else _velocity_of_vtg(fields)
        if value is not None:
            self._waiting.append(_Untimed(value, host_ns, self._last))

    def finish(self) -> None:
        """Settle what stands behind the last sentence with a time."""
        for one in self._waiting:
            self._settle(one, None)
        self._waiting.clear()

    def forget(self, but_ns: int | None) -> None:
        """Drop what is said at any time of day but one."""
        self.headings_deg = {at: value for at, value in self.headings_deg.items() if at == but_ns}
        self.velocities = {at: value for at, value in self.velocities.items() if at == but_ns}

    def at(self, time_ns: int) -> dict[str, Any]:
        """What is said at a time of day, as arguments of a `Fix`."""
        found: dict[str, Any] = {}
        if time_ns in self.velocities:
            east, north, sigma = self.velocities[time_ns]
            found["velocity_mps"] = east, north, math.nan
            found["velocity_sigma_mps"] = sigma, math.nan
        if time_ns in self.headings_deg:
            found["heading_deg"] = self.headings_deg[time_ns]
            found["heading_sigma_deg"] = HEADING_SIGMA_DEG
        return found

    def _settle(self, one: _Untimed, after: _Moment | None) -> None:
        moment = _nearer(one, after)
        if moment is None:
            return
        if isinstance(one.value, float):
            self.headings_deg[moment.time_ns] = one.value
        else:
            self.velocities.setdefault(moment.time_ns, one.value)


def _nearer(one: _Untimed, after: _Moment | None) -> _Moment | None:
    before = one.before
    if before is None or after is None:
        return before or after
    if one.host_ns is None or before.host_ns is None or after.host_ns is None:
        return before
    return after if abs(after.host_ns - one.host_ns) < abs(one.host_ns - before.host_ns) else before


def _heading_deg(kind: str, fields: Mapping[str, str]) -> float:
    heading = _number(fields.get("heading", ""))
    if heading is None or heading > 360.0 or (kind == "THS" and fields.get("mode") not in _VALID_THS):
        raise LeftOutError("heading that the receiver calls invalid")
    return heading % 360.0


def _velocity_of_vtg(fields: Mapping[str, str]) -> _Velocity | None:
    kmh = _number(fields.get("spd_over_grnd_kmph", ""))
    return None if kmh is None else velocity_of(kmh * _KMH_MPS, _number(fields.get("true_track", "")))


def velocity_of(speed_mps: float, course_deg: float | None) -> _Velocity | None:
    """East, north and one sigma of each: 0, as good as the speed, where the car creeps.

    None without a course, or beyond any car.
    """
    if speed_mps < _CREEPING_MPS:
        return 0.0, 0.0, math.hypot(FILTERED_SIGMA_MPS, speed_mps)
    if course_deg is None or speed_mps > MAX_SPEED_MPS:
        return None
    course = math.radians(course_deg)
    return speed_mps * math.sin(course), speed_mps * math.cos(course), FILTERED_SIGMA_MPS


def _number(text: str) -> float | None:
    """A number of at least 0; None for what is none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0.0 else None
