"""Damaged recordings of a car's motion: series with counts, or one sentence."""

from __future__ import annotations

import functools
import json
import tempfile
from pathlib import Path
from random import Random

import can
import cantools.database
import numpy as np
from moving_car import TABLE, MovingCar, settings_of
from mutate import Draw, fuzzed, mutated
from sbp.vehicle import MsgOdometry
from track_writers import sbp_clock, sbp_time

from geoloc.simulation.simulate import scenario, simulate_drive
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.motion.read import read_motion
from twin.errors import DriveError

DBC = b"""VERSION ""
BU_: A
BO_ 291 W: 8 A
 SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" A
"""
CAN = {"dbc": '"car.dbc"', "speed": '"W.V"', "utc_offset_hours": "0"}
KEYS = {
    "can.csv": TABLE,
    **{name: {"file": f'"{name}"', **CAN} for name in ("a.asc", "a.blf", "a.log", "a.trc")},
    "car.dbc": {"file": '"a.log"', **CAN},
    "a.sbp": {"file": '"a.sbp"'},
    "a.json": {"file": '"a.json"', "speed": '"V"'},
    "ego.txt": {"file": '"ego.txt"'},
    "log/CAN/speed/value": {"file": '"log"', "time_zero": '"2026-06-10T08:00:00Z"'},
}
"""What drive.toml says of each file."""


@functools.cache
def sound() -> tuple[MovingCar, dict[str, bytes]]:
    """A drive of seconds and its motion in every format."""
    car = MovingCar(simulate_drive(scenario("approach", 20.0), 8), Path())
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        car.table(folder / "can.csv")
        message = cantools.database.load_string(DBC.decode(), "dbc").messages[0]
        rows = list(zip(car.epoch_ns.tolist(), car.speed_mps.tolist(), strict=True))
        for name in ("a.asc", "a.blf", "a.log", "a.trc"):
            with can.Logger(folder / name) as log:
                for t, v in rows:
                    data = message.encode({"V": 3.6 * v})
                    said = can.Message(timestamp=t / 1e9, arbitration_id=291, is_extended_id=False, data=data)
                    log.on_message_received(said)
        (folder / "car.dbc").write_bytes(DBC)
        odometry = [MsgOdometry(tow=sbp_time(t)[1], velocity=round(1e3 * v), flags=1) for t, v in rows]
        (folder / "a.sbp").write_bytes(
            sbp_clock(rows[0][0]) + b"".join(bytes(one.to_binary()) for one in odometry)
        )
        signal = {"signal_name": "V", "unit": "m/s"}
        frames = [{"timestamp_us": t // 1000, "payload": signal | {"value": v}} for t, v in rows]
        (folder / "a.json").write_text("\n".join(map(json.dumps, frames)))
        (folder / "ego.txt").write_text(
            "".join(f"{t // 1000},{i / 6:.2f},0.00,0.00\n" for i, (t, _) in enumerate(rows))
        )
        (folder / "log/CAN/speed").mkdir(parents=True)
        for name, array in (("t", car.seconds), ("value", car.speed_mps)):
            with (folder / "log/CAN/speed" / name).open("wb") as file:
                np.save(file, array)
        files = {
            str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()
        }
    return car, files


def damaged(random: Random) -> tuple[str, bytes]:
    """One of the files, damaged."""
    name = random.choice(sorted(KEYS))
    draw: Draw = mutated([sound()[1][name]])
    return name, draw(random)


@fuzzed(damaged)
def test_fuzz_motion_gives_series_or_a_drive_error(damaged: tuple[str, bytes]) -> None:
    """What comes out is finite and in order of time, and held against the fixes."""
    car, files = sound()
    name, content = damaged
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for other, whole in files.items():
            (folder / other).parent.mkdir(parents=True, exist_ok=True)
            (folder / other).write_bytes(content if other == name else whole)
        settings, notes = settings_of(**KEYS[name]), ReadingNotes()
        try:
            read = read_motion(DriveFolder(folder), settings.motion, "", car.drive.gnss, notes)
        except DriveError:
            return
    for seen in read.seen:
        assert np.all(np.diff(seen.series.epoch_ns) > 0)
        assert np.isfinite(seen.series.values).all()
        assert len(seen.series.values) == len(seen.series.sigma) == len(seen.series.epoch_ns) > 0
    assert all(skipped.count > 0 for skipped in notes.skipped)
