"""Clocks that step while a drive goes on: what they stamp is taken by the time that they had before.

Everything that arrives bears two times: when it arrived, by the host's clock, and when it was measured, by
the clock of the receiver, the camera or the sensor. What lies between them, its lateness, stays much the
same. So a step shows, and whose it was:

- the host's: the stamps of all that arrives jump, and the next fixes, which have a clock of their own, say
  that no time has passed. Until one has come half a second later, what follows the jump is held back: what
  a computer that stood still has to catch up with comes at once.
- another clock's: the lateness of one antenna, camera or quantity jumps alone, and stays. Nothing can be
  measured after it arrived: that is a step forwards at once, or a wrong stamp if the next ones are as before.
  To come later, or soon again, is what links and detectors do. Only what comes later by more than `LATE_S`
  (`SLOWEST_S` but for fixes: detectors have queues) and stays so for `SURE_S` is a step backwards.

It reads no clock: the same arrivals give the same answer.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median

from geoloc.trajectory.interpolation import NANOSECONDS
from twin.live.car_state import Clock, ClockStep
from twin.live.events import Arrival, Fix, Frame

STEP_S = 0.5
"""What is less passes for jitter, or for an error of the clocks that the engine estimates."""
LATE_S, SLOWEST_S = 5.0, 60.0
SURE_S = 2.0
_SILENCE_S = 1.5
"""A jump of all stamps by more may be silence, or a step."""
_AFTER_S, _WAIT_S = 0.5, 3.0
_MOST_HELD = 600
_EQUAL_S = 0.25
_RECENT = 32
_AT_LEAST = 3
_LEAK = 1.0 / 256.0
_MOST_STREAMS = 64


@dataclass(slots=True)
class _Stream:
    """One antenna, camera or quantity.

    Attributes
    ----------
    clock : Clock
    name : str
    shift_s : float
        Its epochs are later than in the time that it had first.
    least_s : float
        Its smallest lateness, which slowly follows a larger one.
    recent_s : deque of float
        Its last latenesses that were usual.
    perhaps_s : float
        A step of the host's clock that may be its own as well; 0 for none.
    held : list of (Arrival, float)
        What may have stepped, with its lateness.
    """

    clock: Clock
    name: str
    shift_s: float = 0.0
    least_s: float = float("nan")
    recent_s: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    perhaps_s: float = 0.0
    held: list[tuple[Arrival, float]] = field(default_factory=list)

    def lateness_s(self, at_ns: int, epoch_ns: int) -> float:
        return (at_ns - epoch_ns) / NANOSECONDS + self.shift_s

    @property
    def latest_s(self) -> float:
        """How much later than usual passes for a slow link, or a detector with a queue."""
        return LATE_S if self.clock is Clock.GNSS else SLOWEST_S

    def cannot_be(self, late_s: float, off_s: float) -> bool:
        """Whether it was measured after it arrived; of clocks that never agreed, more so than ever before."""
        agreed = abs(self.least_s) <= SLOWEST_S
        return off_s < -STEP_S and (late_s < -STEP_S or not agreed)

    def usual(self, late_s: float) -> None:
        if not self.recent_s or late_s < self.least_s:
            self.least_s = late_s
        else:
            self.least_s += _LEAK * (late_s - self.least_s)
        self.recent_s.append(late_s)

    def moved(self, arrival: Arrival) -> Arrival:
        if not self.shift_s:
            return arrival
        epoch_ns = arrival.what.epoch_ns - round(self.shift_s * NANOSECONDS)
        return Arrival(arrival.at_ns, arrival.what._replace(epoch_ns=epoch_ns))

    def released(self) -> list[Arrival]:
        held, self.held = [self.moved(one) for one, _ in self.held], []
        return held


class Clocks:
    """Steadies what arrives.

    Attributes
    ----------
    steps : int
        How often a clock has stepped.
    last : ClockStep or None
    wrong : int
        Arrivals left out, whose time was that of no others.
    """

    def __init__(self) -> None:
        self.steps = self.wrong = 0
        self.last: ClockStep | None = None
        self._host_s = 0.0
        self._at_ns: int | None = None
        self._waiting: list[Arrival] = []
        self._jump_s = 0.0
        self._streams: dict[tuple[Clock, str], _Stream] = {}

    def steadied(self, arrival: Arrival) -> Iterator[Arrival]:
        """Take what has arrived; hand on what can be now, by the time that clocks had before they stepped."""
        arrival = arrival._replace(at_ns=arrival.at_ns - round(self._host_s * NANOSECONDS))
        if not self._waiting:
            jump_s = 0.0 if self._at_ns is None else (arrival.at_ns - self._at_ns) / NANOSECONDS
            if -STEP_S <= jump_s <= _SILENCE_S:
                yield from self._in_time(arrival)
                return
            self._jump_s = jump_s
        self._waiting.append(arrival)
        step_s = self._host_step_s(arrival)
        if step_s is not None:
            yield from self._after(step_s)

    def rest(self) -> Iterator[Arrival]:
        """Hand on what is held back: nothing more arrives."""
        if self._waiting:
            yield from self._after(min(self._jump_s, 0.0))
        for stream in self._streams.values():
            yield from stream.released()

    def _host_step_s(self, arrival: Arrival) -> float | None:
        """By how much the host's clock has stepped; None where that is not known yet."""
        what = arrival.what
        stream = self._stream(arrival)
        since_s = (arrival.at_ns - self._waiting[0].at_ns) / NANOSECONDS
        if isinstance(what, Fix) and stream is not None and stream.recent_s and since_s >= _AFTER_S:
            step_s = stream.lateness_s(arrival.at_ns, what.epoch_ns) - median(stream.recent_s)
            return step_s if abs(step_s) > STEP_S and abs(step_s - self._jump_s) < _WAIT_S else 0.0
        if abs(since_s) > _WAIT_S or len(self._waiting) >= _MOST_HELD:
            # No fix tells. Time that goes back has stepped for sure; time that went on may have passed.
            return min(self._jump_s, 0.0)
        return None

    def _after(self, step_s: float) -> Iterator[Arrival]:
        waiting, self._waiting = self._waiting, []
        if step_s:
            self._host_s += step_s
            self._stepped(Clock.HOST, "", step_s)
            for stream in self._streams.values():
                stream.perhaps_s = 0.0 if stream.clock is Clock.GNSS else step_s
        for one in waiting:
            yield from self._in_time(one._replace(at_ns=one.at_ns - round(step_s * NANOSECONDS)))

    def _in_time(self, arrival: Arrival) -> Iterator[Arrival]:
        """Hand on an arrival whose own stamp is right."""
        self._at_ns = arrival.at_ns if self._at_ns is None else max(self._at_ns, arrival.at_ns)
        stream = self._stream(arrival)
        if stream is None:
            yield arrival
            return
        late_s = stream.lateness_s(arrival.at_ns, arrival.what.epoch_ns)
        if stream.perhaps_s:
            usual_s = median(stream.recent_s) if stream.recent_s else late_s
            if abs(late_s + stream.perhaps_s - usual_s) < abs(late_s - usual_s):
                stream.shift_s += stream.perhaps_s
                late_s += stream.perhaps_s
            stream.perhaps_s = 0.0
        off_s = late_s - stream.least_s if stream.recent_s else 0.0
        if not stream.cannot_be(late_s, off_s) and off_s <= stream.latest_s:
            yield from self._usual(stream, arrival, late_s, off_s)
        else:
            yield from self._held(stream, arrival, late_s)

    def _usual(self, stream: _Stream, arrival: Arrival, late_s: float, off_s: float) -> Iterator[Arrival]:
        if stream.held:
            # Others are as before: what came too late was late, what came too early was wrong.
            early = [late for _, late in stream.held if late < stream.least_s]
            self.wrong += len(early)
            stream.held = [one for one in stream.held if one[1] >= stream.least_s]
            yield from stream.released()
        if off_s <= STEP_S:
            stream.usual(late_s)
        else:
            stream.least_s += _LEAK * off_s
        yield stream.moved(arrival)

    def _held(self, stream: _Stream, arrival: Arrival, late_s: float) -> Iterator[Arrival]:
        last_s = stream.held[-1][1] if stream.held else late_s
        if late_s >= stream.least_s and late_s < last_s - _EQUAL_S:
            # It catches up.
            yield from stream.released()
            yield stream.moved(arrival)
            return
        if abs(late_s - last_s) > _EQUAL_S:
            self.wrong += sum(late < stream.least_s for _, late in stream.held)
            stream.held = [one for one in stream.held if one[1] >= stream.least_s]
        stream.held.append((arrival, late_s))
        held_s = (arrival.at_ns - stream.held[0][0].at_ns) / NANOSECONDS
        is_early = late_s < stream.least_s
        if len(stream.held) >= _AT_LEAST and (is_early or held_s >= SURE_S):
            step_s = median(stream.recent_s) - median(late for _, late in stream.held)
            stream.shift_s += step_s
            self._stepped(stream.clock, stream.name, step_s)
            yield from stream.released()
        elif len(stream.held) >= _MOST_HELD:
            yield from stream.released()

    def _stepped(self, clock: Clock, name: str, step_s: float) -> None:
        self.steps += 1
        self.last = ClockStep(clock, name, step_s)

    def _stream(self, arrival: Arrival) -> _Stream | None:
        """The stream of an arrival; None where there are too many to follow."""
        what = arrival.what
        if isinstance(what, Fix):
            clock, name = Clock.GNSS, what.antenna
        elif isinstance(what, Frame):
            clock, name = Clock.CAMERA, what.camera
        else:
            clock, name = Clock.MOTION, what.quantity.value
        found = self._streams.get((clock, name))
        if found is None and len(self._streams) < _MOST_STREAMS:
            found = self._streams[clock, name] = _Stream(clock, name)
        return found
