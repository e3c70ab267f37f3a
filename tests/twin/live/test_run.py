"""A drive on which everything fails goes on to its end, says what failed, and keeps what was final."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, takewhile
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from live_faulty import (
    Feed,
    Heard,
    Span,
    drive_with,
    gnss_stepped,
    host_stepped,
    kept_in,
    late_fixes,
    spoilt,
    without_camera,
    without_fixes,
)
from live_senders import until

from geoloc.live.causal import Following
from geoloc.live.samples import Fix
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.errors import StoreError
from twin.live import Arrival, Estimate, Frame, LiveEngine, LiveRun, RunSettings, State, arrivals_of, car_of
from twin.live.car_state import CarState, Health
from twin.live.features import line_of
from twin.live.keep import Keeper
from twin.live.notices import Notice, NoticeKind
from twin.live.ports import Said, Trouble, TroubleKind
from twin.live.watch import Watch
from twin.samples.demo import sample_folder

TRIP = sample_folder() / "trip_trondheim"
SECOND_NS = 1_000_000_000
RECORDED = RunSettings(waits=True)


@pytest.fixture(scope="module")
def drive() -> Drive:
    """The sample's first trip."""
    return read_drive(TRIP)


def away_m(found: list[Estimate]) -> dict[str, float]:
    """How far each final place is from its pole, beyond the ellipse of 95 %, at most."""
    with (sample_folder() / "truth.csv").open(encoding="utf-8") as file:
        poles = {
            row["object"]: (float(row["easting"]), float(row["northing"])) for row in csv.DictReader(file)
        }
    off = {}
    for one in found:
        about = one.feature()["properties"]
        if one.state is State.FINAL:
            east, north = poles[one.id.partition("#")[0]]
            off[one.id] = float(np.hypot(about["easting"] - east, about["northing"] - north))
            off[one.id] /= max(about["major95_m"], 0.05)
    return off


def finals(heard: Heard) -> list[Estimate]:
    """Estimates that change no more."""
    return [one for one in heard.final if isinstance(one, Estimate)]


@pytest.mark.slow
def test_a_drive_on_which_everything_fails_goes_on_to_its_end(drive: Drive, tmp_path: Path) -> None:
    """One fault after the other: each is said once, and poles are located to within their ellipses."""
    begin_ns = next(arrivals_of(drive)).at_ns

    def span(begin_s: float, end_s: float) -> Span:
        return Span(begin_ns + round(begin_s * 1e9), begin_ns + round(end_s * 1e9))

    some = without_fixes(arrivals_of(drive), span(6.0, 10.0))
    some = without_camera(some, span(13.0, 17.0), "C2_tricam60")
    some = spoilt(some, span(18.0, 19.0))
    some = late_fixes(some, span(20.0, 26.0))
    # The later ones first: a step moves the stamps of all that follows.
    some = gnss_stepped(some, span(36.0, 36.0), 18.0)
    some = host_stepped(some, span(29.0, 29.0), 3600.0)
    outcome = drive_with(LiveEngine(car_of(drive)), some, tmp_path, settings=RECORDED)
    said = [one.kind for one in outcome.notices]
    assert [one for one in said if one is not NoticeKind.REFUSED] == [
        NoticeKind.GNSS_LOST,
        NoticeKind.GNSS_BACK,
        NoticeKind.CAMERA_LOST,
        NoticeKind.CAMERA_BACK,
        NoticeKind.GNSS_LOST,
        NoticeKind.GNSS_BACK,
        NoticeKind.GNSS_LOST,
        NoticeKind.GNSS_BACK,
        NoticeKind.CLOCK_STEPPED,
        NoticeKind.CLOCK_STEPPED,
    ]
    assert NoticeKind.REFUSED in said
    found = finals(outcome.heard)
    assert {one.id for one in found if one.state is State.FINAL} >= {f"P{i:02d}" for i in range(2, 16)}
    off = away_m(found)
    assert np.median(list(off.values())) < 1.0
    assert np.mean(np.array(list(off.values())) < 1.2) > 0.8
    assert outcome.kept == {one.id: one.state.value for one in found}
    last = outcome.run.last
    assert (last.faults, last.frames_dropped, last.steps) == (0, 0, 3)
    assert last.position is Following.FIXED
    assert last.gnss is Health.FINE


def test_the_run_says_what_the_engine_says(drive: Drive, tmp_path: Path) -> None:
    """Queues of two lose nothing of a recorded drive, and change no line and no order."""
    until_ns = next(arrivals_of(drive)).at_ns + 12 * SECOND_NS
    some = list(takewhile(lambda one: one.at_ns < until_ns, arrivals_of(drive)))
    engine, lines = LiveEngine(car_of(drive)), list[str]()
    for one in some:
        lines += [line_of(estimate) for estimate in engine.feed(one)]
    lines += [line_of(estimate) for estimate in engine.finish()]

    class Every(Heard):
        def write(self, said: object) -> None:
            if isinstance(said, Estimate):
                heard.append(line_of(said))

    heard: list[str] = []
    settings = RunSettings(waits=True, queue=2, lines=2)
    run = LiveRun(
        LiveEngine(car_of(drive)), [Feed(some)], [Every(), Heard(flows=_flowing())], settings=settings
    )
    run.start()
    assert run.wait(120.0)
    assert heard == lines
    assert len(lines) > 20


def _flowing() -> Event:
    flows = Event()
    flows.set()
    return flows


@pytest.mark.slow
def test_a_run_that_is_stopped_ends_within_five_seconds(drive: Drive, tmp_path: Path) -> None:
    """With a source that never ends and a sink that takes nothing: what was open is in the file, final."""
    until_ns = next(arrivals_of(drive)).at_ns + 6 * SECOND_NS
    some = list(takewhile(lambda one: one.at_ns < until_ns, arrivals_of(drive)))
    ended = Event()

    def endless() -> Iterator[Arrival]:
        yield from some
        ended.wait()

    path = tmp_path / "live.gpkg"
    stuck = Heard()
    run = LiveRun(LiveEngine(car_of(drive)), [Feed(endless())], [stuck], keeper=Keeper(path, "a drive"))
    run.start()
    until(lambda: run.last.sinks and run.last.sinks[0].blocked)
    run.stop()
    assert run.wait(15.0)
    ended.set()
    assert run.whole
    assert run.last.sinks[0].lost > 0
    assert set(kept_in(path).values()) == {"final"}


@dataclass
class Cars(Heard):
    """A sink that keeps what is said of the car."""

    states: list[CarState] = field(default_factory=list)

    def write(self, said: Said) -> None:
        """Take a line."""
        if isinstance(said, CarState):
            self.states.append(said)


@pytest.mark.slow
def test_when_all_falls_silent_time_goes_on_and_nothing_comes_again(drive: Drive, tmp_path: Path) -> None:
    """What was in view is kept, the position is predicted, then lost, until fixes come; no line goes back."""
    begin_ns = next(arrivals_of(drive)).at_ns
    every = list(takewhile(lambda one: one.at_ns < begin_ns + 10 * SECOND_NS, arrivals_of(drive)))
    before = [one for one in every if one.at_ns < begin_ns + 6 * SECOND_NS]
    silence_ns = 600 * SECOND_NS
    after = [
        Arrival(one.at_ns + silence_ns, one.what._replace(epoch_ns=one.what.epoch_ns + silence_ns))
        for one in every[len(before) :]
    ]
    fails, comes, silent = Event(), Event(), Event()
    clock_s = [0.0]

    def clock() -> float:
        # Two seconds each time that the loop looks, where nothing is to come.
        clock_s[0] += 2.0 * silent.is_set()
        return clock_s[0]

    def heard(some: Sequence[Arrival]) -> bool:
        return run.engine.frames == sum(isinstance(one.what, Frame) for one in some)

    def port() -> Iterator[Arrival | Trouble]:
        yield from before
        fails.wait()
        yield Trouble(begin_ns, "port", TroubleKind.LOST, detail="refused")
        comes.wait()
        yield from after
        stopped.wait()

    stopped, told, cars, path = Event(), list[Notice](), Cars(), tmp_path / "live.gpkg"
    run = LiveRun(
        LiveEngine(car_of(drive)),
        [Feed(port())],
        [cars],
        keeper=Keeper(path, "a drive"),
        tell=told.append,
        settings=RunSettings(queue=5000),
        clock=clock,
    )
    run.start()

    def is_lost() -> bool:
        return (run.last.gnss, run.last.position) == (Health.LOST, Following.LOST)

    until(lambda: heard(before))
    silent.set()
    until(is_lost)
    # As a kill would leave it.
    until(lambda: path.exists() and run.last.keep is not None and not run.last.keep.waiting)
    until(lambda: set(kept_in(path).values()) == {"final"})
    fails.set()
    until(lambda: NoticeKind.SOURCE_LOST in [one.kind for one in told])
    assert all(one.is_bad for one in told)
    silent.clear()
    comes.set()
    until(lambda: heard(every))
    silent.set()
    until(is_lost)
    fine = [one.kind for one in told if not one.is_bad]
    run.stop()
    assert run.wait(15.0)
    stopped.set()
    assert [one.kind for one in told if not one.is_bad] == fine
    assert fine.count(NoticeKind.POSITION_BACK) == fine.count(NoticeKind.GNSS_BACK) == 1
    times = [one.at_ns for one in cars.states]
    assert times == sorted(times)
    positions = [position.value for position, _ in groupby(one.position for one in cars.states)]
    assert positions == ["waiting", *["fixed", "predicted", "lost"] * 2]
    assert cars.states[-1].at_ns == run.last.at_ns


def test_a_camera_that_is_lost_is_not_back_by_frames_that_are_left_out(drive: Drive) -> None:
    """Of the frames that a slow computer leaves out nobody knows the camera."""
    engine = LiveEngine(car_of(drive))
    watch = Watch(engine.car.antennas)
    for camera, at_s in (("gone", 1), ("there", 9)):
        watch.take(Arrival(at_s * SECOND_NS, Frame(camera, 1, at_s * SECOND_NS, ())))
    watch.frames_dropped(10 * SECOND_NS, 13 * SECOND_NS)
    assert watch.state(14 * SECOND_NS, engine).cameras == (("gone", Health.LOST), ("there", Health.FINE))


def test_faults_of_parts_cost_no_drive(drive: Drive) -> None:
    """A source that fails is asked again, a check without its store is left, and both are told of."""
    until_ns = next(arrivals_of(drive)).at_ns + 6 * SECOND_NS
    some = list(takewhile(lambda one: one.at_ns < until_ns, arrivals_of(drive)))

    class Failing(Feed):
        def arrivals(self) -> Iterator[Arrival]:
            if not self.closed.is_set():
                self.closed.set()
                yield from list(self.every)[:200]
                raise RuntimeError("a fault")
            yield from self.every

    class WithoutStore:
        def take(self, _arrival: Arrival, _estimates: Sequence[Estimate]) -> Sequence[Said]:
            raise StoreError("The store has gone.")

        finish = let_pass = take

    told: list[Notice] = []
    heard = Heard(flows=_flowing())
    engine = LiveEngine(car_of(drive))
    run = LiveRun(
        engine,
        [Failing(some)],
        [heard],
        check=WithoutStore(),
        tell=told.append,
        settings=RunSettings(queue=5000),
    )
    run.start()
    assert run.wait(120.0)
    kinds = [one.kind for one in told]
    assert kinds.count(NoticeKind.CHECK_ENDED) == kinds.count(NoticeKind.SOURCE_LOST) == 1
    assert "The store has gone." in next(one for one in told if one.kind is NoticeKind.CHECK_ENDED).sentence()
    assert engine.frames == sum(isinstance(one.what, Frame) for one in [*some[:200], *some])
    assert heard.final
    assert run.last.faults == 0


def test_what_is_worse_than_before_is_degraded(drive: Drive) -> None:
    """A single fix where they were RTK, and an antenna of two that falls silent or never speaks."""
    engine = LiveEngine(car_of(drive))
    roof, other = engine.car.antennas

    def healths(fixes: Iterable[tuple[float, str, int]], until_s: float) -> list[Health]:
        watch, found = Watch(engine.car.antennas), list[Health]()
        for at_s, antenna, quality in fixes:
            at_ns = round(at_s * 1e9)
            watch.take(Arrival(at_ns, Fix(antenna, at_ns, 63.4, 10.4, 100.0, quality)))
            found.append(watch.state(at_ns, engine).gnss)
        return [*found, watch.state(round(until_s * 1e9), engine).gnss]

    assert healths([], 1.0) == [Health.WAITING]
    both = [(0.2 * i, name, 4) for i in range(50) for name in (roof, other)]
    assert set(healths(both, 10.0)) == {Health.FINE}
    assert healths(both, 13.0)[-1] is Health.LOST
    assert healths([*both, (10.0, roof, 1)], 10.0)[-1] is Health.DEGRADED
    alone = [(0.2 * i, roof, 4) for i in range(50)]
    assert healths(alone, 10.0)[-1] is Health.DEGRADED
