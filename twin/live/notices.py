"""What has changed in a car's state, one sentence each for people; nothing decides by the sentences."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

from geoloc.live.causal import Following
from twin.live.car_state import CarState, Clock, Health, SourceState


class NoticeKind(StrEnum):
    """What has happened."""

    GNSS_LOST = "gnss_lost"
    GNSS_DEGRADED = "gnss_degraded"
    GNSS_BACK = "gnss_back"
    POSITION_LOST = "position_lost"
    POSITION_BACK = "position_back"
    CAMERA_LOST = "camera_lost"
    CAMERA_BACK = "camera_back"
    CLOCK_STEPPED = "clock_stepped"
    FRAMES_DROPPED = "frames_dropped"
    OTHERS_DROPPED = "others_dropped"
    SOURCE_LOST = "source_lost"
    SOURCE_ENDED = "source_ended"
    SOURCE_CLOCK = "source_clock"
    SOURCE_DROPPED = "source_dropped"
    SOURCE_BACK = "source_back"
    GARBAGE = "garbage"
    REFUSED = "refused"
    UNKNOWN_CAMERA = "unknown_camera"
    SINK_BLOCKED = "sink_blocked"
    SINK_BACK = "sink_back"
    SINK_ENDED = "sink_ended"
    KEEP_FAILING = "keep_failing"
    KEEP_BACK = "keep_back"
    NOT_RECORDED = "not_recorded"
    CHECK_ENDED = "check_ended"
    FAULT = "fault"


_SENTENCES = {
    NoticeKind.GNSS_LOST: "No GNSS fixes come any more: positions go on by the car's motion, less surely.",
    NoticeKind.GNSS_DEGRADED: "GNSS fixes are worse than before, or some antennas silent: ellipses grow.",
    NoticeKind.GNSS_BACK: "GNSS fixes come again as before.",
    NoticeKind.POSITION_LOST: "The car has no position, too long without GNSS fixes: no sign is located now.",
    NoticeKind.POSITION_BACK: "The car has a position again.",
    NoticeKind.CAMERA_LOST: "Camera {what} delivers no frames any more: what it sees is not located.",
    NoticeKind.CAMERA_BACK: "Camera {what} delivers frames again.",
    NoticeKind.CLOCK_STEPPED: "The clock of {what} stepped by {number:+.2f} s: the time from before is kept.",
    NoticeKind.FRAMES_DROPPED: "This computer does not follow: {number:.0f} frames were left out so far.",
    NoticeKind.OTHERS_DROPPED: "This computer does not follow: {number:.0f} fixes or samples of motion"
    " were left out so far.",
    NoticeKind.SOURCE_LOST: "{what} does not answer ({why}): twin goes on trying.",
    NoticeKind.SOURCE_ENDED: "{why} has ended: nothing more comes from there.",
    NoticeKind.SOURCE_CLOCK: "{what}: {why}.",
    NoticeKind.SOURCE_DROPPED: "{what} is too fast for its detector: {number:.0f} pictures left out so far.",
    NoticeKind.SOURCE_BACK: "{what} answers again.",
    NoticeKind.GARBAGE: "{what} sends what cannot be read ({why}): {number:.0f} left out so far.",
    NoticeKind.REFUSED: "{number:.0f} frames of a camera that the car does not have, or detections without"
    " a pixel, were left out so far.",
    NoticeKind.UNKNOWN_CAMERA: "{what}: {why}. Its frames are left out.",
    NoticeKind.SINK_BLOCKED: "{what} takes no lines: the oldest are left out, final ones last.",
    NoticeKind.SINK_BACK: "{what} takes lines again; {number:.0f} were left out in all.",
    NoticeKind.SINK_ENDED: "{what} has ended and gets no more lines.",
    NoticeKind.KEEP_FAILING: "{what} cannot be written, {number:.0f} final estimates and verdicts wait: free"
    " space on its disk, or end the program that holds it.",
    NoticeKind.KEEP_BACK: "{what} is written again; {number:.0f} final estimates and verdicts were given up.",
    NoticeKind.NOT_RECORDED: "{why}",
    NoticeKind.CHECK_ENDED: "Nothing more is held against NVDB, estimates go on: {why}",
    NoticeKind.FAULT: "twin itself failed at {number:.0f} arrivals, which were left out: please report it"
    " with the log (--log-file).",
}
_BAD = frozenset(NoticeKind) - {
    NoticeKind.GNSS_BACK,
    NoticeKind.POSITION_BACK,
    NoticeKind.CAMERA_BACK,
    NoticeKind.SOURCE_BACK,
    NoticeKind.SINK_BACK,
    NoticeKind.KEEP_BACK,
}


class Notice(NamedTuple):
    """One thing that has happened.

    Attributes
    ----------
    kind : NoticeKind
    what : str
        The camera, source, sink or file that it is about.
    number : float
        How many, or seconds.
    why : str
        In the words of whoever noticed it.
    """

    kind: NoticeKind
    what: str = ""
    number: float = 0.0
    why: str = ""

    @property
    def is_bad(self) -> bool:
        """Whether something is wrong; else it is well again."""
        return self.kind in _BAD

    def sentence(self) -> str:
        """Say it to people."""
        return _SENTENCES[self.kind].format(what=self.what, number=self.number, why=self.why)


def notices(before: CarState, now: CarState) -> Iterator[Notice]:
    """What has happened between two states."""
    yield from _gnss(before, now)
    yield from _cameras(before, now)
    yield from _sources(before, now)
    yield from _sinks(before, now)
    yield from _keep(before, now)
    if now.steps > before.steps and now.last_step is not None:
        whose = "this computer" if now.last_step.clock is Clock.HOST else now.last_step.name
        yield Notice(NoticeKind.CLOCK_STEPPED, whose, now.last_step.step_s)
    if now.not_recorded and not before.not_recorded:
        yield Notice(NoticeKind.NOT_RECORDED, why=now.not_recorded)
    if now.unchecked and not before.unchecked:
        yield Notice(NoticeKind.CHECK_ENDED, why=now.unchecked)
    counts = (
        (NoticeKind.FRAMES_DROPPED, before.frames_dropped, now.frames_dropped),
        (NoticeKind.OTHERS_DROPPED, before.others_dropped, now.others_dropped),
        (NoticeKind.REFUSED, before.refused, now.refused),
        (NoticeKind.FAULT, before.faults, now.faults),
    )
    for kind, was, is_now in counts:
        if is_now > was:
            yield Notice(kind, number=is_now)


def _gnss(before: CarState, now: CarState) -> Iterator[Notice]:
    changed = {
        Health.LOST: NoticeKind.GNSS_LOST,
        Health.DEGRADED: NoticeKind.GNSS_DEGRADED,
        Health.FINE: NoticeKind.GNSS_BACK,
    }
    if now.gnss is not before.gnss and before.gnss is not Health.WAITING:
        yield Notice(changed[now.gnss])
    has_place = [one.position in (Following.FIXED, Following.PREDICTED) for one in (before, now)]
    if has_place == [True, False]:
        yield Notice(NoticeKind.POSITION_LOST)
    elif has_place == [False, True] and before.position is Following.LOST:
        yield Notice(NoticeKind.POSITION_BACK)


def _cameras(before: CarState, now: CarState) -> Iterator[Notice]:
    was = dict(before.cameras)
    for name, health in now.cameras:
        if was.get(name, health) is not health:
            lost = health is Health.LOST
            yield Notice(NoticeKind.CAMERA_LOST if lost else NoticeKind.CAMERA_BACK, name)


def _sources(before: CarState, now: CarState) -> Iterator[Notice]:
    was = {one.name: one for one in before.sources}
    for one in now.sources:
        old = was.get(one.name, SourceState(one.name))
        if (one.lost, one.ended) != (old.lost, old.ended):
            lost = NoticeKind.SOURCE_ENDED if one.ended else NoticeKind.SOURCE_LOST
            kind = lost if one.lost else NoticeKind.SOURCE_BACK
            yield Notice(kind, one.name, why=one.why)
        if one.garbage > old.garbage:
            yield Notice(NoticeKind.GARBAGE, one.name, one.garbage, one.spoilt)
        for why in one.refused[len(old.refused) :]:
            yield Notice(NoticeKind.UNKNOWN_CAMERA, one.name, why=why)
        if one.dropped > old.dropped:
            yield Notice(NoticeKind.SOURCE_DROPPED, one.name, one.dropped)
        if one.clock > old.clock:
            yield Notice(NoticeKind.SOURCE_CLOCK, one.name, why=one.why)


def _sinks(before: CarState, now: CarState) -> Iterator[Notice]:
    was = {one.name: one for one in before.sinks}
    for one in now.sinks:
        old = was.get(one.name, one._replace(blocked=False, ended=False))
        if one.ended:
            if not old.ended:
                yield Notice(NoticeKind.SINK_ENDED, one.name)
        elif one.blocked is not old.blocked:
            kind = NoticeKind.SINK_BLOCKED if one.blocked else NoticeKind.SINK_BACK
            yield Notice(kind, one.name, one.lost)


def _keep(before: CarState, now: CarState) -> Iterator[Notice]:
    if now.keep is None:
        return
    was_failing = before.keep is not None and before.keep.failing
    if now.keep.failing and not was_failing:
        yield Notice(NoticeKind.KEEP_FAILING, now.keep.name, now.keep.waiting)
    elif was_failing and not now.keep.failing:
        yield Notice(NoticeKind.KEEP_BACK, now.keep.name, now.keep.lost)


_QUIET_NS = 10_000_000_000


class Quieted:
    """Holds back notices that only count on: of one kind and thing one in ten seconds, the newest."""

    def __init__(self) -> None:
        self._said_ns: dict[tuple[NoticeKind, str], int] = {}
        self._held: dict[tuple[NoticeKind, str], Notice] = {}

    def let_through(self, found: Iterator[Notice], at_ns: int) -> Iterator[Notice]:
        """Hand on what is not held back, and what was when its time has come."""
        for one in found:
            if one.kind in _COUNTS:
                self._held[one.kind, one.what] = one
            else:
                yield one
        for key, one in list(self._held.items()):
            last_ns = self._said_ns.get(key)
            if last_ns is None or abs(at_ns - last_ns) >= _QUIET_NS:
                self._said_ns[key] = at_ns
                del self._held[key]
                yield one


_COUNTS = frozenset(
    {
        NoticeKind.FRAMES_DROPPED,
        NoticeKind.OTHERS_DROPPED,
        NoticeKind.GARBAGE,
        NoticeKind.SOURCE_DROPPED,
        NoticeKind.REFUSED,
        NoticeKind.FAULT,
        NoticeKind.CLOCK_STEPPED,
    }
)
