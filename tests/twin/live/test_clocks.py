"""Clocks that step go on by the time that they had before, and slow links stay what they are."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator

import pytest

from geoloc.live.samples import Fix
from twin.live import Arrival, Frame
from twin.live.car_state import Clock
from twin.live.clocks import Clocks

BEGIN_NS = 1_781_078_400_000_000_000
LINK_S = 0.08


def ns(seconds: float) -> int:
    """Seconds of the drive as an epoch."""
    return BEGIN_NS + round(seconds * 1e9)


def arrived(until_s: float = 30.0, rate_hz: float = 10.0) -> list[Arrival]:
    """Fixes over a link with jitter, and frames of two cameras, as all clocks agree."""
    draw = random.Random(1)
    found = []
    for i in range(round(until_s * rate_hz)):
        at_s = i / rate_hz
        late_s = LINK_S + draw.uniform(0.0, 0.02)
        fix = Fix("roof", ns(at_s), 63.4 + 1e-6 * i, 10.4, 100.0, 4)
        found.append(Arrival(ns(at_s + late_s), fix))
    for camera in ("left", "right"):
        found += [Arrival(ns(i / 30.0), Frame(camera, i, ns(i / 30.0))) for i in range(round(until_s * 30.0))]
    return sorted(found, key=lambda one: one.at_ns)


def steadied(arrivals: Iterable[Arrival]) -> tuple[Clocks, list[Arrival]]:
    """All that comes out."""
    clocks = Clocks()
    found = [one for arrival in arrivals for one in clocks.steadied(arrival)]
    return clocks, found + list(clocks.rest())


def host_stepped(arrivals: Iterable[Arrival], at_s: float, by_s: float) -> Iterator[Arrival]:
    """The host's clock stepped, which stamps what arrives and the frames."""
    by_ns = round(by_s * 1e9)
    for one in arrivals:
        if one.at_ns < ns(at_s):
            yield one
            continue
        what = one.what
        yield Arrival(
            one.at_ns + by_ns,
            what._replace(epoch_ns=what.epoch_ns + by_ns) if isinstance(what, Frame) else what,
        )


def gnss_stepped(arrivals: Iterable[Arrival], at_s: float, by_s: float) -> Iterator[Arrival]:
    """The receiver's clock stepped."""
    for one in arrivals:
        is_later = isinstance(one.what, Fix) and one.what.epoch_ns >= ns(at_s)
        yield (
            one._replace(what=one.what._replace(epoch_ns=one.what.epoch_ns + round(by_s * 1e9)))
            if (is_later)
            else one
        )


def farthest_s(found: Iterable[Arrival], truth: Iterable[Arrival]) -> float:
    """How far an epoch or a stamp is from what it is without a step, at most."""

    def key(one: Arrival) -> tuple[str, float]:
        what = one.what
        return (what.camera, what.number) if isinstance(what, Frame) else ("", what.latitude_deg)

    true = {key(one): one for one in truth}
    pairs = [(one, true[key(one)]) for one in found]
    assert len(pairs) == len(true)
    off_ns = [
        max(abs(one.at_ns - other.at_ns), abs(one.what.epoch_ns - other.what.epoch_ns))
        for one, other in pairs
    ]
    return max(off_ns) / 1e9


def test_clocks_that_agree_are_left_alone() -> None:
    """Nothing is changed, held back or put into another order."""
    every = arrived()
    clocks, found = steadied(every)
    assert found == every
    assert clocks.steps == 0


@pytest.mark.parametrize("by_s", [-3600.0, -20.0, -0.8, 2.0, 37.0, 86_400.0])
def test_the_hosts_step_is_taken_back(by_s: float) -> None:
    """Arrivals and frames go on as if it had not stepped, to within the link's jitter."""
    every = arrived()
    clocks, found = steadied(host_stepped(every, 15.0, by_s))
    assert clocks.steps == 1
    assert clocks.last is not None
    assert clocks.last.clock is Clock.HOST
    assert clocks.last.step_s == pytest.approx(by_s, abs=0.03)
    assert farthest_s(found, every) < 0.03


@pytest.mark.parametrize("by_s", [-3600.0, -18.0, 1.0, 18.0, 604_800.0 * 1024])
@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_the_receivers_step_is_taken_back(by_s: float, rate_hz: float) -> None:
    """A leap second, a week that rolls over."""
    every = arrived(rate_hz=rate_hz)
    clocks, found = steadied(gnss_stepped(every, 15.0, by_s))
    assert clocks.steps == 1
    assert clocks.last is not None
    assert (clocks.last.clock, clocks.last.name) == (Clock.GNSS, "roof")
    assert clocks.last.step_s == pytest.approx(by_s, abs=0.03)
    assert farthest_s(found, every) < 0.03


@pytest.mark.parametrize("late_s", [3.0, 9.0])
def test_a_link_that_was_interrupted_is_no_step(late_s: float) -> None:
    """Fixes that come at once after a while keep their epochs."""
    every = [
        Arrival(max(one.at_ns, ns(12.0 + late_s)), one.what)
        if isinstance(one.what, Fix) and ns(12.0) <= one.what.epoch_ns < ns(12.0 + late_s)
        else one
        for one in arrived()
    ]
    every.sort(key=lambda one: one.at_ns)
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0


def test_fixes_out_of_order_are_no_step() -> None:
    """Delays that differ by up to two seconds."""
    draw = random.Random(2)
    every = [
        one._replace(at_ns=one.at_ns + round(draw.uniform(0.0, 2e9))) if isinstance(one.what, Fix) else one
        for one in arrived()
    ]
    every.sort(key=lambda one: one.at_ns)
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0


def test_silence_is_no_step() -> None:
    """A recording that pauses for a minute, and a machine that sleeps: time passes for the receiver too."""
    every = [one for one in arrived(90.0) if not ns(15.0) < one.at_ns < ns(75.0)]
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0


def test_a_single_wrong_time_is_left_out() -> None:
    """One sentence with a wrong hour, and all is as before."""
    every = arrived()
    wrong = next(i for i, one in enumerate(every) if isinstance(one.what, Fix) and one.at_ns > ns(10.0))
    spoilt = list(every)
    spoilt[wrong] = every[wrong]._replace(
        what=every[wrong].what._replace(epoch_ns=every[wrong].what.epoch_ns + 3600 * 10**9)
    )
    clocks, found = steadied(spoilt)
    assert (clocks.steps, clocks.wrong) == (0, 1)
    assert found == every[:wrong] + every[wrong + 1 :]


def later(arrivals: Iterable[Arrival], kind: type, late_s: Callable[[float], float]) -> list[Arrival]:
    """What arrives later than it did, by how much at a second of the drive, each stream in its order."""
    found = []
    for one in arrivals:
        more_s = late_s((one.at_ns - BEGIN_NS) / 1e9) if isinstance(one.what, kind) else 0.0
        found.append(one._replace(at_ns=one.at_ns + round(more_s * 1e9)))
    return sorted(found, key=lambda one: one.at_ns)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_what_a_link_has_held_at_first_is_no_step(rate_hz: float) -> None:
    """Four seconds of fixes at once, then each when it comes."""
    every = later(arrived(rate_hz=rate_hz), Fix, lambda at_s: max(4.0 - at_s, 0.0))
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0


@pytest.mark.parametrize("late_s", [2.0, 8.0])
def test_a_detector_that_is_slow_for_a_while_is_no_step(late_s: float) -> None:
    """Its queue is full for ten seconds, all frames late by the same, and is worked off."""
    every = later(
        arrived(),
        Frame,
        lambda at_s: late_s if 8.0 < at_s < 18.0 else max(late_s + 18.0 - at_s, 0.0) * (at_s > 8),
    )
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0


def test_a_computer_that_stood_still_has_not_stepped() -> None:
    """For four seconds nothing is read, then all that was sent meanwhile at once."""
    every = later(arrived(), object, lambda at_s: max(19.0 - at_s, 0.0) * (at_s > 15.0))
    clocks, found = steadied(every)
    assert clocks.steps == 0
    assert farthest_s(found, every) == 0.0
