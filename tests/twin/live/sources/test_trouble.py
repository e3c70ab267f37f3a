"""What goes wrong with a source: said once, counted, and got over."""

from __future__ import annotations

import json
import time
from itertools import pairwise
from pathlib import Path

import pytest
from live_senders import WIDE, Listener, MakeCar, Sender, free_port, until

from geoloc.live.samples import Fix
from twin.live.car import Car
from twin.live.car_state import CarState
from twin.live.events import Arrival, Frame
from twin.live.notices import Notice, NoticeKind, Quieted, notices
from twin.live.ports import Trouble, TroubleKind
from twin.live.sources import Gives, open_source, stream
from twin.live.sources.decoders import LONGEST_SENTENCE, Cutter, FrameLines
from twin.live.sources.epochs import Epochs
from twin.live.sources.frames import FrameReader
from twin.live.watch import Watch

S = 1_000_000_000
HOUR_NS = 1_781_078_400 * S


@pytest.fixture
def nmea(sample: Path) -> list[bytes]:
    """Lines of the sample's first antenna."""
    return (sample / "trip_trondheim" / "gnss50_vehicle.bin").read_bytes().splitlines(keepends=True)


def test_source_that_is_lost_is_found_again(car: Car, nmea: list[bytes]) -> None:
    """Nobody listens, a receiver comes, goes and comes back: lost and back once each, no fix twice."""
    port = free_port()
    with Listener(open_source(f"tcp://127.0.0.1:{port}", Gives.FIXES, car)) as listener:
        until(lambda: listener.troubles(TroubleKind.LOST))
        for n, part in ((5, nmea[:5]), (10, nmea[5:10])):
            with Sender(port) as receiver:
                receiver.send(b"".join(part))
                until(lambda n=n: len(listener.fixes()) == n)
        until(lambda: len(listener.troubles(TroubleKind.LOST)) == 3)
        assert [one.kind for one in listener.troubles()] == [
            TroubleKind.LOST,
            *(TroubleKind.BACK, TroubleKind.LOST) * 2,
        ]
    assert len({fix.epoch_ns for fix in listener.fixes()}) == 10


def test_source_that_falls_silent_is_asked_anew(
    car: Car, nmea: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A connection whose other end has died says nothing of it."""
    monkeypatch.setattr(stream, "SILENT_S", 0.3)
    dead = Sender()
    with Listener(open_source(f"tcp://127.0.0.1:{dead.port}", Gives.FIXES, car)) as listener:
        dead.send(nmea[0])
        until(listener.fixes)
        (lost,) = until(lambda: listener.troubles(TroubleKind.LOST))
        dead._server.close()
        with Sender(dead.port) as receiver:
            receiver.send(nmea[1])
            until(lambda: len(listener.fixes()) == 2)
        dead.hang_up()
    assert "nothing that can be read" in lost.detail


@pytest.mark.parametrize("connects", [True, False])
def test_source_that_waits_is_closed_within_a_second(car: Car, connects: bool) -> None:
    """From another thread, while it reads or while it waits to connect again."""
    with Sender() as receiver:
        port = receiver.port if connects else free_port()
        listener = Listener(open_source(f"tcp://127.0.0.1:{port}", Gives.FIXES, car))
        with listener:
            until(lambda: receiver._connected.is_set() if connects else listener.troubles())
            began_s = time.monotonic()
        assert time.monotonic() - began_s < 1.0


def test_garbage_is_skipped_and_counted(car: Car, nmea: list[bytes]) -> None:
    """The rest of a line that began before, noise, a wrong checksum, a line too long cost themselves."""
    noise = [b"\xff\x00$GP\n", nmea[1].replace(b",E,4,", b",E,5,"), b"x" * 5000 + b"\n"]
    with Sender() as receiver:
        listener = Listener(open_source(f"tcp://127.0.0.1:{receiver.port}", Gives.FIXES, car))
        with listener:
            receiver.send(b"".join([nmea[0][20:], *nmea[2:4], *noise, *nmea[4:6]]))
            until(lambda: len(listener.fixes()) == 4)
            receiver.hang_up()
            until(lambda: listener.troubles(TroubleKind.LOST))
    assert sum(one.count for one in listener.troubles(TroubleKind.GARBAGE)) == 3


def test_line_without_end_is_held_no_longer_than_a_line_may_be() -> None:
    """A megabyte without an end of line leaves nothing behind but its count."""
    cutter = Cutter(LONGEST_SENTENCE)
    for _ in range(1000):
        assert cutter.feed(b"y" * 1000) == []
        assert len(cutter._held) <= LONGEST_SENTENCE
    assert cutter.feed(b"\nwhole\n") == [b"whole"]
    assert cutter.too_long == 1


def test_frames_of_no_use_say_why(make_car: MakeCar) -> None:
    """Another car's camera, no time, no JSON; of a frame that is one, a detection outside the picture."""
    car = make_car()
    good = {"camera": WIDE, "frame": 1, "time_ns": 1_781_078_400_000_000_000}
    lines = [
        good | {"camera": "rear"},
        good | {"time_ns": 3},
        [],
        good | {"detections": [{"foot": [9e3, 1]}]},
    ]
    with Sender() as detector:
        listener = Listener(open_source(f"tcp://127.0.0.1:{detector.port}", Gives.DETECTIONS, car))
        with listener:
            detector.send(json.dumps(lines[0]).encode() + b"\n")
            for line in lines:
                detector.send(json.dumps(line).encode() + b"\n")
                time.sleep(0.05)
            (frame,) = until(listener.frames)
            detector.hang_up()
            until(lambda: listener.troubles(TroubleKind.LOST))
    assert frame == Frame(WIDE, 1, good["time_ns"], ())
    garbage = listener.troubles(TroubleKind.GARBAGE)
    assert sum(one.count for one in garbage) == 2
    assert "outside" in garbage[-1].detail
    refused = listener.troubles(TroubleKind.REFUSED)
    assert sum(one.count for one in refused) == 2
    assert {one.detail for one in refused} == {f"camera rear is not in the rig: it has {WIDE}"}


def test_cameras_that_the_rig_lacks_are_named_once_and_counted(car: Car) -> None:
    """Of two detectors' words each is told once, all are counted, and the source is not lost for them."""
    decoder, watch = FrameLines(FrameReader(car), None), Watch(["roof"])
    garbage, states = stream._Garbage("tcp://detector"), []
    for number, camera in enumerate(["front", "rear", "front"]):
        line = {"camera": camera, "frame": number, "time_ns": HOUR_NS}
        assert decoder.feed(json.dumps(line).encode() + b"\n", HOUR_NS) == []
        for one in garbage.rest([decoder]):
            watch.trouble(one)
        (source,) = watch._sources.values()
        states.append(CarState(HOUR_NS, sources=(source,), refused=watch.refused))
    assert (decoder.readable, decoder.unreadable, watch.refused) == (3, 0, 3)
    found = [one for before, now in pairwise([CarState(HOUR_NS), *states]) for one in notices(before, now)]
    named = [one.sentence() for one in found if one.kind is NoticeKind.UNKNOWN_CAMERA]
    assert [one.split()[2] for one in named] == ["front", "rear"]
    assert all(WIDE in one for one in named)
    assert [one.number for one in found if one.kind is NoticeKind.REFUSED] == [1, 2, 3]


def test_a_count_that_grew_while_it_was_held_back_is_told_later() -> None:
    """One sentence at once, none for 10 s, then the newest count, though nothing more has come."""
    quieted, told = Quieted(), []
    for at_s, count in ((0, 1), (1, 20), (2, 39), (5, 0), (11, 0), (30, 0)):
        found = [Notice(NoticeKind.GARBAGE, "tcp://x", count)] if count else []
        told += [(at_s, one.number) for one in quieted.let_through(iter(found), at_s * S)]
    assert told == [(0, 1), (11, 39)]


def fix(at_ns: int, epoch_ns: int) -> Arrival:
    """A fix that arrives, by the nanoseconds of an hour."""
    return Arrival(HOUR_NS + at_ns, Fix("roof", HOUR_NS + epoch_ns, 63.4, 10.4, 80.0, 4))


def judged(arrivals: list[Arrival]) -> tuple[list[Arrival], list[Trouble]]:
    """What is handed on, and what is said."""
    epochs = Epochs("tcp://receiver")
    found = [one for arrival in arrivals for one in epochs.checked(arrival)]
    return [one for one in found if isinstance(one, Arrival)], [
        one for one in found if isinstance(one, Trouble)
    ]


def test_time_that_stands_is_said_and_not_used() -> None:
    """A receiver that repeats its last fix: the first counts; that it goes on is said too."""
    begin = [fix(S * k // 5, S * k // 5) for k in range(10)]
    stands = [fix(S * k // 5, S * 9 // 5) for k in range(10, 40)]
    goes_on = [fix(S * k // 5, S * k // 5) for k in range(40, 60)]
    handed, said = judged(begin + stands + goes_on)
    assert handed == begin + goes_on
    assert [one.kind for one in said] == [TroubleKind.CLOCK] * 2
    assert "stands" in said[0].detail
    assert said[1].count == 30


@pytest.mark.parametrize(("off_s", "is_said"), [(0.1, False), (-18.0, True), (3600.0, True)])
def test_hosts_clock_that_is_not_on_utc_is_said(off_s: float, is_said: bool) -> None:
    """GPS time, local time; once. Fixes that waited for a while are none of it."""
    late_ns = round(off_s * S)
    backlog = [fix(10 * S + late_ns, S * k // 5) for k in range(50)]
    arrivals = backlog + [fix(S * k // 5 + late_ns, S * k // 5) for k in range(50, 120)]
    handed, said = judged(arrivals)
    assert handed == arrivals
    assert len(said) == is_said
    assert all(f"{off_s:+.1f} s" in one.detail for one in said)
