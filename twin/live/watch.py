"""Whether what feeds a car still comes: a state from what has arrived when, by the time of arrivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geoloc.trajectory.interpolation import NANOSECONDS
from twin.live.car_state import CarState, Health, SourceState, Where
from twin.live.engine import LiveEngine
from twin.live.events import Arrival, Fix, Frame
from twin.live.ports import Trouble, TroubleKind

SILENT_S = 2.5
"""What delivers nothing for so long is lost: fixes come once a second at least, frames oftener."""
_RANK = {4: 0, 5: 1, 2: 2, 1: 3}
"""How good a fix is by its kind, the best first: RTK, float, differential, single; others are worse."""
_WORST = 4
_MOST_NAMES = 64
"""Sources name cameras: garbage may name many."""


@dataclass(slots=True)
class _Antenna:
    at_ns: int
    rank: int
    best: int

    def take(self, at_ns: int, rank: int) -> None:
        self.at_ns, self.rank, self.best = at_ns, rank, min(self.best, rank)


@dataclass(slots=True)
class Watch:
    """What has arrived when.

    Attributes
    ----------
    antennas : sequence of str
        That the car has.
    refused : int
        Frames and detections that the car cannot have made.
    """

    antennas: Sequence[str]
    refused: int = 0
    _antennas: dict[str, _Antenna] = field(default_factory=dict)
    _frames_ns: dict[str, int] = field(default_factory=dict)
    _sources: dict[str, SourceState] = field(default_factory=dict)

    def take(self, arrival: Arrival) -> None:
        """Note what has arrived."""
        at_ns, what = arrival
        if isinstance(what, Fix) and what.quality > 0:
            rank = _RANK.get(what.quality, _WORST)
            if not self._antennas:
                # From now on the others are waited for too.
                self._antennas = {name: _Antenna(at_ns, _WORST, _WORST) for name in self.antennas}
            self._antennas.setdefault(what.antenna, _Antenna(at_ns, rank, rank)).take(at_ns, rank)
        elif isinstance(what, Frame):
            self._frames_ns[what.camera] = at_ns

    def frames_dropped(self, since_ns: int, now_ns: int) -> None:
        """Note that frames have come since, and were left out: no camera is lost by that, or back."""
        for name, at_ns in self._frames_ns.items():
            if not _is_silent(at_ns, since_ns):
                self._frames_ns[name] = now_ns

    def trouble(self, trouble: Trouble) -> None:
        """Note what a source says of itself."""
        name = trouble.source
        if name not in self._sources and len(self._sources) >= _MOST_NAMES:
            return
        one = self._sources.get(name, SourceState(name))
        if trouble.kind is not TroubleKind.GARBAGE:
            one = one._replace(why=trouble.detail)
        match trouble.kind:
            case TroubleKind.ENDED:
                one = one._replace(lost=True, ended=True)
            case TroubleKind.LOST | TroubleKind.BACK:
                one = one._replace(lost=trouble.kind is TroubleKind.LOST)
            case TroubleKind.GARBAGE:
                one = one._replace(garbage=one.garbage + trouble.count, spoilt=trouble.detail)
            case TroubleKind.REFUSED:
                self.refused += trouble.count
                one = one._replace(refused=(*one.refused, trouble.detail)[:_MOST_NAMES])
                one = one._replace(refused=tuple(dict.fromkeys(one.refused)))
            case TroubleKind.DROPPED:
                one = one._replace(dropped=one.dropped + trouble.count)
            case TroubleKind.CLOCK:
                one = one._replace(clock=one.clock + 1)
        self._sources[name] = one

    def state(self, now_ns: int, engine: LiveEngine) -> CarState:
        """Say how things are; what waits and what was lost is for others to add."""
        return CarState(
            at_ns=now_ns,
            where=_where(engine, now_ns),
            position=engine.following,
            gnss=self._gnss(now_ns),
            cameras=tuple(
                (name, Health.LOST if _is_silent(at_ns, now_ns) else Health.FINE)
                for name, at_ns in sorted(self._frames_ns.items())
            ),
            sources=tuple(self._sources.values()),
            refused=self.refused,
        )

    def _gnss(self, now_ns: int) -> Health:
        if not self._antennas:
            return Health.WAITING
        heard = [one for one in self._antennas.values() if not _is_silent(one.at_ns, now_ns)]
        if not heard:
            return Health.LOST
        # All of them may fall silent one after the other.
        silent = any(_is_silent(one.at_ns, now_ns, 2.0) for one in self._antennas.values())
        return Health.DEGRADED if silent or any(one.rank > one.best for one in heard) else Health.FINE


def _is_silent(at_ns: int, now_ns: int, times: float = 1.0) -> bool:
    return now_ns - at_ns > times * SILENT_S * NANOSECONDS


def _where(engine: LiveEngine, now_ns: int) -> Where:
    poses = engine.pose(now_ns)
    if poses is None or not poses.valid[0]:
        return Where()
    columns = (
        poses.latitude_deg,
        poses.longitude_deg,
        poses.height_m,
        poses.heading_deg,
        poses.speed_mps,
        poses.sigma_horizontal_m,
        poses.sigma_heading_deg,
    )
    return Where(*(float(np.ravel(column)[0]) for column in columns))
