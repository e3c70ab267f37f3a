"""A recorded drive, sent over sockets: what the recorder makes of it is the same drive."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from live_senders import Listener, Sender, frame_lines, until

from twin.drives.read import read_drive
from twin.ingest import locate_drive
from twin.live import Arrival, arrivals_of
from twin.live.car import antennas_of, read_car
from twin.live.recorder import Recorder
from twin.live.sources import Gives, open_source

ANTENNAS = ("gnss50:vehicle", "gnss52:vehicle")


def test_drive_over_sockets_is_recorded_as_it_was(sample: Path, tmp_path: Path) -> None:
    """Same drive id, estimates to the last bit, warnings; and live the fixes and frames of a replay."""
    trip = sample / "trip_trondheim"
    drive, car = read_drive(trip), read_car(trip)
    with ExitStack() as stack:
        recorder = stack.enter_context(Recorder(tmp_path / "recorded", car))
        senders = [stack.enter_context(Sender()) for _ in range(3)]
        urls = [
            f"tcp://127.0.0.1:{sender.port}?antenna={name}"
            for sender, name in zip(senders, ANTENNAS, strict=False)
        ]
        assert antennas_of(car, urls) == ANTENNAS
        sources = [open_source(url, Gives.FIXES, car, recorder=recorder) for url in urls]
        detections = f"tcp://127.0.0.1:{senders[2].port}"
        sources.append(open_source(detections, Gives.DETECTIONS, car, recorder=recorder))
        listeners = [stack.enter_context(Listener(source)) for source in sources]
        for sender, name in zip(senders, ("gnss50_vehicle.bin", "gnss52_vehicle.bin"), strict=False):
            sender.send((trip / name).read_bytes())
        lines = list(frame_lines(drive))
        senders[2].send(b"".join(lines))
        until(lambda: [len(one.fixes()) for one in listeners[:2]] == [250, 250])
        until(lambda: len(listeners[2].frames()) == len(lines))
        assert not any(listener.troubles() for listener in listeners)
    found, original = locate_drive(tmp_path / "recorded"), locate_drive(trip)
    assert found.drive.drive_id == original.drive.drive_id
    assert found.estimates == original.estimates
    assert (found.drive.delay_ms, found.drive.warnings) == (original.drive.delay_ms, original.drive.warnings)
    live = {one.what for listener in listeners for one in listener.got if isinstance(one, Arrival)}
    replayed = {one.what for one in arrivals_of(replace(drive, warnings=()))}
    assert {repr(one) for one in live} == {repr(one) for one in replayed}
