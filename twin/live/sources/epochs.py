"""Times that cannot be: those that stand, and a clock of the host that is not on UTC.

Clocks that step are the matter of whoever runs the sources: it sees what all of them say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from geoloc.live.samples import Fix
from twin.drives.epochs import HOST_DELAY_LIMIT_S
from twin.live.events import Arrival, Frame
from twin.live.ports import Trouble, TroubleKind

_STANDS_NS, _LOOKED_NS = 2_000_000_000, 5_000_000_000
_SLOWEST_DETECTOR_S = 10.0
_NS = 1e9


@dataclass(slots=True)
class _Stream:
    """One antenna or camera."""

    began_ns: int
    epoch_ns: int = 0
    since_ns: int = 0
    repeated: int = 0
    is_told: bool = False
    least_late_ns: int | None = None
    is_looked_at: bool = False


class Epochs:
    """Looks at the times of what one source gives; what repeats a time is left out.

    Parameters
    ----------
    name : str
        The source's.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._streams: dict[str, _Stream] = {}

    def checked(self, arrival: Arrival) -> Iterator[Arrival | Trouble]:
        """Hand an arrival on, with what is wrong with its time."""
        at_ns, what = arrival
        name = what.antenna if isinstance(what, Fix) else what.camera if isinstance(what, Frame) else ""
        stream = self._streams.setdefault(name, _Stream(at_ns))
        if what.epoch_ns == stream.epoch_ns:
            yield from self._repeated(stream, name, at_ns)
            return
        if stream.is_told:
            stream.is_told = False
            yield self._trouble(at_ns, f"the time of {name} goes on", stream.repeated)
        stream.epoch_ns, stream.since_ns, stream.repeated = what.epoch_ns, at_ns, 0
        yield from self._late(stream, name, arrival)
        yield arrival

    def _repeated(self, stream: _Stream, name: str, at_ns: int) -> Iterator[Trouble]:
        stream.repeated += 1
        if not stream.is_told and at_ns - stream.since_ns > _STANDS_NS:
            stream.is_told = True
            yield self._trouble(at_ns, f"the time of {name} stands: it is not used", stream.repeated)

    def _late(self, stream: _Stream, name: str, arrival: Arrival) -> Iterator[Trouble]:
        """Hold the host's clock against UTC, by what came soonest in the first seconds."""
        if stream.is_looked_at:
            return
        late_ns = arrival.at_ns - arrival.what.epoch_ns
        stream.least_late_ns = min(late_ns, late_ns if stream.least_late_ns is None else stream.least_late_ns)
        if abs(arrival.at_ns - stream.began_ns) < _LOOKED_NS:
            return
        stream.is_looked_at = True
        late_s = stream.least_late_ns / _NS
        is_fix = isinstance(arrival.what, Fix)
        if not -HOST_DELAY_LIMIT_S <= late_s <= (HOST_DELAY_LIMIT_S if is_fix else _SLOWEST_DETECTOR_S):
            what = "fixes" if is_fix else "frames"
            yield self._trouble(
                arrival.at_ns,
                f"the host's clock shows {late_s:+.1f} s against the times of the {what} of {name}: set both"
                " by UTC (chrony or NTP)",
            )

    def _trouble(self, at_ns: int, detail: str, count: int = 1) -> Trouble:
        return Trouble(at_ns, self._name, TroubleKind.CLOCK, count, detail)
