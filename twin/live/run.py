"""A drive that goes on: sources feed one engine through one bounded queue, sinks and a file get what it says.

Each source and each sink has its own thread, and one thread runs the engine, so that nothing that blocks
holds up the rest. The engine and all that is said follow from the stamps of what arrives, and where nothing
arrives from the time that passes. A recorded drive goes the same way, with two differences: it has no time
but that of its stamps, and it waits where a queue is full, so that nothing of it is left out and its
estimates are the same however fast it is played.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from threading import Event, Lock, Thread

from geoloc.trajectory.interpolation import NANOSECONDS
from twin.errors import TwinError
from twin.live.car_state import CarState
from twin.live.clocks import Clocks
from twin.live.engine import LiveEngine
from twin.live.estimates import Estimate, State
from twin.live.events import Arrival, Frame, MotionSample
from twin.live.keep import Keeper
from twin.live.lanes import Lanes
from twin.live.notices import Notice, NoticeKind, Quieted, notices
from twin.live.outlets import Outlet
from twin.live.ports import LiveCheck, Recording, Said, Sink, Source, Trouble, TroubleKind
from twin.live.watch import Watch

_TICK_S = 0.25
_AGAIN_S = 1.0
"""So long after a source has failed by a fault of twin it is asked again."""
_TOLD_S = 0.5
_BACKLOG_S = 2.0
"""How long what waits is still worked out after the end was asked for."""
_FLUSH_S = 2.0
"""How long sinks may then take for what waits for them."""
_FIXES, _MOTION, _FRAMES = range(3)
_FAULTS_LOGGED = 20
_log = logging.getLogger("twin.live")
_log.addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class RunSettings:
    """How a drive is run.

    Attributes
    ----------
    waits : bool
        Of a recorded drive: it waits where a queue is full, and time is that of its stamps alone.
    queue : int
        What waits for the engine at most: 400 are four seconds of three cameras at 30 frames, and fixes.
    lines : int
        What waits for a sink at most.
    state_every_s : float
        The car's state is said so often, and at once when it changes.
    """

    waits: bool = False
    queue: int = 400
    lines: int = 2000
    state_every_s: float = 1.0


class LiveRun:
    """One drive, from its first arrival until its sources end or it is stopped.

    Parameters
    ----------
    engine : LiveEngine
    sources : sequence of Source
    sinks : sequence of Sink
    keeper : Keeper, optional
        Gets what is final.
    check : LiveCheck, optional
    recording : Recording, optional
        What sources write to, where it fails.
    tell : callable, optional
        Gets what has happened, in a thread of its own: standard error may block too.
    settings : RunSettings
    clock : callable
        Seconds that pass where nothing arrives.

    Attributes
    ----------
    final, lost : int
        Objects so far that got a position, and that did not.
    last : CarState
        How things were when that was last looked at.
    whole : bool
        Whether all that was final went into the file; True without one.
    """

    def __init__(
        self,
        engine: LiveEngine,
        sources: Sequence[Source],
        sinks: Sequence[Sink],
        *,
        keeper: Keeper | None = None,
        check: LiveCheck | None = None,
        recording: Recording | None = None,
        tell: Callable[[Notice], None] | None = None,
        settings: RunSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.engine, self.settings = engine, settings or RunSettings()
        self.final = self.lost = 0
        self.whole = True
        self.last = CarState(0)
        self._sources, self._keeper, self._check = sources, keeper, check
        self._tell = tell or (lambda _notice: None)
        self._told: Lanes[Notice] = Lanes(1, self.settings.lines)
        self._teller = Thread(target=self._tell_all, name="notices", daemon=True)
        self._recording = recording
        self._queue: Lanes[Arrival | Trouble] = Lanes(3, self.settings.queue)
        waits, lines = self.settings.waits, self.settings.lines
        self._outlets = [Outlet(sink, waits=waits, most=lines) for sink in sinks]
        self._watch, self._clocks, self._quieted = Watch(engine.car.antennas), Clocks(), Quieted()
        self._now_ns = self._looked_ns = self._said_ns = 0
        self._clock, self._now_s = clock, 0.0
        self._faults, self._unchecked = 0, ""
        self._feeding = len(sources)
        self._lock = Lock()
        self._ended = Event()
        self._stop_s: float | None = None
        self._error: BaseException | None = None

    @property
    def errors(self) -> list[Exception]:
        """What sinks have ended of."""
        return [outlet.error for outlet in self._outlets if outlet.error is not None]

    @property
    def is_unheard(self) -> bool:
        """Whether there are sinks, and all have ended."""
        return bool(self._outlets) and len(self.errors) == len(self._outlets)

    def start(self) -> None:
        """Begin, each source and the engine in a thread of its own."""
        for source in self._sources:
            Thread(target=self._feed, args=(source,), name=f"source {source.name}", daemon=True).start()
        if not self._sources:
            self._queue.close()
        self._teller.start()
        Thread(target=self._work, name="engine", daemon=True).start()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until all has ended; return whether it has.

        Raises
        ------
        BaseException
            What the engine's thread died of: a fault in twin.
        """
        ended = self._ended.wait(timeout_s)
        if ended and self._error is not None:
            raise self._error
        return ended

    def stop(self) -> None:
        """Ask for the end: what is open becomes final, is written and handed on, within five seconds."""
        if self._stop_s is not None:
            return
        self._stop_s = time.monotonic() + _BACKLOG_S
        for outlet in self._outlets:
            outlet.hurry()
        # Of a recorded drive the rest is as far away as its end.
        self._queue.close(forget=self.settings.waits)
        for source in self._sources:
            source.close()

    def _feed(self, source: Source) -> None:
        while not self._fed(source):
            self._ended.wait(_AGAIN_S)
        with self._lock:
            self._feeding -= 1
            if not self._feeding:
                self._queue.close()

    def _fed(self, source: Source) -> bool:
        """Put what a source gives into the queue; False where it has failed and is to be asked again."""
        try:
            for one in source.arrivals():
                if not self._queue.put(one, _lane(one), waits=self.settings.waits):
                    break
        except Exception as error:
            if self.settings.waits:
                # Of a recorded drive that cannot be read on, which ends here.
                self._error = error
                return True
            _log.exception("%s", source.name)
            lost = Trouble(time.time_ns(), source.name, TroubleKind.LOST, detail=type(error).__name__)
            return not self._queue.put(lost, _FIXES)
        return True

    def _work(self) -> None:
        try:
            self._take_all()
            self._finish()
        except BaseException as error:
            # The thread that waits raises it.
            self._error = error
        finally:
            self._close()
            self._ended.set()

    def _take_all(self) -> None:
        # A recorded drive has no time but that of its stamps.
        tick_s = None if self.settings.waits else _TICK_S
        while self._stop_s is None or time.monotonic() < self._stop_s:
            one = self._queue.get(tick_s)
            if one is None:
                if self._queue.is_closed:
                    return
                self._let_pass()
            elif isinstance(one, Trouble):
                self._watch.trouble(one)
                self._let_pass()
                self._look(self._now_ns or one.at_ns)
            else:
                for arrival in self._clocks.steadied(one):
                    self._take(arrival)
                # What has arrived may be held back until its clock is known.
                self._let_pass()

    def _take(self, arrival: Arrival) -> None:
        """Hand on one arrival, and look how things are where it is time."""
        self._now_ns = max(self._now_ns, arrival.at_ns)
        possible = self._possible(arrival)
        if possible is not None:
            self._feed_engine(possible)
            self._watch.take(possible)
        if self._now_ns - self._looked_ns >= _TICK_S * NANOSECONDS:
            self._look(self._now_ns)
        self._now_s = self._clock()

    def _let_pass(self) -> None:
        """Let the time pass that has gone by since something was taken, where that is worth a look."""
        now_s = self._clock()
        if self.settings.waits or not self._now_ns or now_s - self._now_s < _TICK_S:
            return
        self._now_ns += round((now_s - self._now_s) * NANOSECONDS)
        self._now_s = now_s
        self._feed_engine(None)
        self._look(self._now_ns)

    def _feed_engine(self, arrival: Arrival | None) -> None:
        """Hand on what may be, or that time has passed; a fault of twin costs this arrival, not the drive."""
        now_ns = self._now_ns
        try:
            if arrival is None:
                estimates = self.engine.let_pass(now_ns)
                self._say_all(estimates)
                self._verdicts(lambda check: check.let_pass(now_ns, estimates))
            else:
                estimates = self.engine.feed(arrival)
                self._say_all(estimates)
                self._verdicts(lambda check: check.take(arrival, estimates))
        except Exception:
            self._faults += 1
            if self._faults <= _FAULTS_LOGGED:
                _log.exception("%s", "silence" if arrival is None else type(arrival.what).__name__)

    def _verdicts(self, asked: Callable[[LiveCheck], Iterable[Said]]) -> None:
        """Ask the check, which may lose its store: estimates go on without."""
        if self._check is None:
            return
        try:
            self._say_all(asked(self._check))
        except TwinError as error:
            self._check, self._unchecked = None, str(error)

    def _possible(self, arrival: Arrival) -> Arrival | None:
        """Leave out frames of a camera that the car does not have, and detections without a pixel."""
        frame = arrival.what
        if not isinstance(frame, Frame):
            return arrival
        if frame.camera not in self.engine.car.rig.cameras:
            self._watch.refused += 1
            return None
        found = tuple(one for one in frame.detections if all(map(math.isfinite, one.pixel_px)))
        if len(found) == len(frame.detections):
            return arrival
        self._watch.refused += len(frame.detections) - len(found)
        return arrival._replace(what=frame._replace(detections=found))

    def _say_all(self, said: Iterable[Said]) -> None:
        for one in said:
            if isinstance(one, Estimate) and one.lasts:
                self.final += one.state is State.FINAL
                self.lost += one.state is State.LOST
            if one.lasts and self._keeper is not None:
                self._keeper.keep(one)
            for outlet in self._outlets:
                outlet.say(one)

    def _look(self, now_ns: int, *, is_last: bool = False) -> None:
        """Say the car's state where it has changed, was not said for a while, or is the last."""
        if self._queue.lost[_FRAMES] > self.last.frames_dropped:
            self._watch.frames_dropped(self._looked_ns, now_ns)
        now = self._state(now_ns)
        found = list(self._quieted.let_through(notices(self.last, now), now_ns))
        for notice in found:
            # Of the last one that has ended its error is told, at the end.
            if not (notice.kind is NoticeKind.SINK_ENDED and self.is_unheard):
                self._told.put(notice, 0)
        since_ns = abs(now_ns - self._said_ns)
        every_ns = 1 if is_last else self.settings.state_every_s * NANOSECONDS
        if found or since_ns >= every_ns:
            self._said_ns = now_ns
            self._say_all([now])
        self.last, self._looked_ns = now, now_ns

    def _state(self, now_ns: int) -> CarState:
        return self._watch.state(now_ns, self.engine)._replace(
            queue=len(self._queue),
            frames_dropped=self._queue.lost[_FRAMES],
            others_dropped=self._queue.lost[_MOTION] + self._queue.lost[_FIXES],
            sinks=tuple(outlet.state for outlet in self._outlets),
            keep=None if self._keeper is None else self._keeper.state,
            steps=self._clocks.steps,
            last_step=self._clocks.last,
            not_recorded="" if self._recording is None else self._recording.failure,
            unchecked=self._unchecked,
            faults=self._faults,
        )

    def _finish(self) -> None:
        """End the drive: all that is open becomes final."""
        for arrival in self._clocks.rest():
            self._take(arrival)
        self._let_pass()
        estimates = self.engine.finish()
        self._say_all(estimates)
        if self._now_ns:
            self._verdicts(lambda check: check.finish(estimates))
            self._look(self._now_ns, is_last=True)

    def _close(self) -> None:
        """Write what waits, and let sinks have what waits for them."""
        until_s = time.monotonic() + _FLUSH_S
        if self._keeper is not None:
            self.whole = self._keeper.close(_FLUSH_S)
        for outlet in self._outlets:
            outlet.close(None if outlet.waits else max(until_s - time.monotonic(), 0.1))
        self.last = self._state(self._now_ns)
        self._told.close()
        self._teller.join(_TOLD_S)

    def _tell_all(self) -> None:
        while (notice := self._told.get()) is not None:
            self._tell(notice)


def _lane(one: Arrival | Trouble) -> int:
    if isinstance(one, Trouble):
        return _FIXES
    if isinstance(one.what, Frame):
        return _FRAMES
    return _MOTION if isinstance(one.what, MotionSample) else _FIXES
