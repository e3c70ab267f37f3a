"""What sources receive becomes a drive folder, readable at any moment."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import pytest
from live_senders import ROOF, WIDE, frame_lines

from twin.drives.annotations.formats.frame_lines import FrameLine, frame_of_line
from twin.drives.drive import Drive
from twin.drives.folder.drive_toml import read_settings
from twin.drives.read import read_drive
from twin.errors import RefusedError
from twin.live.car import Car, read_car
from twin.live.recorder import Form, Recorder
from twin.live.toml_text import toml_text


@pytest.fixture(scope="module")
def drive(sample: Path) -> Drive:
    """The sample's first trip."""
    return read_drive(sample / "trip_trondheim")


@pytest.fixture
def car(sample: Path, tmp_path: Path) -> Car:
    """Its car, with settings, a mask and labels of its own."""
    folder = tmp_path / "car"
    folder.mkdir()
    shutil.copy(sample / "trip_trondheim" / "rig.json", folder)
    (folder / "labels.toml").write_text('[labels]\n"speed 50" = "362.50"\n', encoding="utf-8")
    (folder / "drive.toml").write_text(
        'name = "E6"\ndetections_complete = true\ndatum = "EUREF89"\nrolling_shutter_ms = 16.5\n'
        '[gnss]\nsigma_m = 0.02\nfiles = { "gnss50:vehicle" = "old.bin" }\n'
        'lever_arms = { "gnss50:vehicle" = [0.6, 0.5, 1.5], spare = [1.0, 0.0, 1.0] }\n'
        "[errors]\nboresight_deg = 0.1\n[annotations]\nC3_tricam120 = 'old.xml'\n"
        '[motion]\nfile = "can.csv"\ntime = "t"\nspeed = "v"\n',
        encoding="utf-8",
    )
    return read_car(folder)


def record(recorder: Recorder, drive: Drive, sample: Path, seconds: int = 49) -> list[bytes]:
    """Hand the first seconds of the sample over; return its frames."""
    nmea = (sample / "trip_trondheim" / "gnss50_vehicle.bin").read_bytes().splitlines(keepends=True)
    recorder.fixes(ROOF, Form.NMEA)(b"".join(nmea[: 5 * seconds]))
    lines = [line.rstrip(b"\n") for line in frame_lines(drive)][: 60 * seconds]
    for line in lines:
        frame = frame_of_line(line)
        assert frame is not None
        assert frame.stamp_ns is not None
        recorder.frame(frame, line, frame.stamp_ns)
    return lines


def test_recording_is_a_drive_while_it_goes_on(car: Car, drive: Drive, sample: Path, tmp_path: Path) -> None:
    """Nothing waits in this process; a line that a kill has cut is counted, and costs itself."""
    folder = tmp_path / "recorded"
    with Recorder(folder, car) as recorder:
        record(recorder, drive, sample, seconds=10)
        for name in (f"{WIDE}.jsonl", f"{WIDE}.timestamps", "gnss50_vehicle.nmea"):
            with (folder / name).open("ab") as file:
                file.write({"l": b'{"camera":"C3', "s": b"99", "a": b"$GPG"}[name[-1]])
        read = read_drive(folder)
    assert len(read.gnss[0].epoch_ns) == 50
    assert len(read.annotations.frame) == sum(
        len(frame.detections) for line in record_lines(folder) if (frame := frame_of_line(line)) is not None
    )
    assert {(one.what, one.count) for one in read.skipped} == {
        ("GNSS sentences", 1),
        ("annotations", 1),
        ("time stamps", 1),
    }


def record_lines(folder: Path) -> list[bytes]:
    """Frames of a recording."""
    return [line for path in folder.glob("*.jsonl") for line in path.read_bytes().splitlines()]


def test_what_the_car_states_goes_along(car: Car, drive: Drive, sample: Path, tmp_path: Path) -> None:
    """All but what is of recordings; whether a detector finds every sign; arms of antennas that recorded."""
    with Recorder(tmp_path / "recorded", car) as recorder:
        record(recorder, drive, sample, seconds=10)
    read = read_settings((tmp_path / "recorded" / "drive.toml").read_bytes())
    assert (read.name, read.annotations_complete, read.rolling_shutter_ms) == (None, True, 16.5)
    assert (read.gnss_sigma_m, dict(read.errors)) == (0.02, {"boresight_deg": 0.1})
    assert read.lever_arms_m == {ROOF: (0.6, 0.5, 1.5)}
    assert read.gnss == {ROOF: "gnss50_vehicle.nmea"}
    assert read.motion.sources == ()
    assert (tmp_path / "recorded" / "labels.toml").is_file()
    read_drive(tmp_path / "recorded")


def test_camera_that_counts_anew_goes_on(car: Car, tmp_path: Path) -> None:
    """A camera that was started again counts from 0: its frames keep numbers of their own."""
    with Recorder(tmp_path / "recorded", car) as recorder:
        for number, stamp_ns in [(0, 10), (2, 12), (1, 11), (3, 13), (0, 20), (1, 21)]:
            frame = FrameLine(WIDE, number, stamp_ns=stamp_ns)
            recorder.frame(frame, b'{"camera":"%s","frame":%d}' % (WIDE.encode(), number), stamp_ns)
    stamps = (tmp_path / "recorded" / f"{WIDE}.timestamps").read_text(encoding="utf-8").split()
    assert stamps == ["frame,time_ns", "0,10", "2,12", "1,11", "3,13", "4,20", "5,21"]
    frames = [frame_of_line(line) for line in record_lines(tmp_path / "recorded")]
    assert [one.frame for one in frames if one is not None] == [0, 2, 1, 3, 4, 5]


def test_folder_that_holds_something_is_refused(car: Car, tmp_path: Path) -> None:
    """A recording never runs into another."""
    (tmp_path / "recorded").mkdir()
    (tmp_path / "recorded" / "drive.toml").touch()
    with pytest.raises(RefusedError, match="is not empty: name a new folder"):
        Recorder(tmp_path / "recorded", car)


def test_full_disk_ends_the_recording_alone(
    car: Car, drive: Drive, sample: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One sentence says so, once; what is handed over afterwards is dropped without an error."""
    with Recorder(tmp_path / "recorded", car) as recorder:
        (recorder.folder / "gnss50_vehicle.nmea").symlink_to("/dev/full")
        record(recorder, drive, sample, seconds=1)
        assert "takes no more of the drive (No space left on device): free space" in recorder.failure
    assert not list(recorder.folder.glob("*.jsonl"))
    assert caplog.messages == [recorder.failure]


def test_settings_that_are_written_are_read_as_they_were() -> None:
    """Names that need quotation marks, texts with every kind of character, tables in lists, dates."""
    text = """
        at = 2026-06-10T08:00:00Z
        "a.b" = [1, -2.5, 1e30, inf, true, "æ \\" \\u007f \\n", {x = "y", "z z" = []}, [[]]]
        [cameras."C 1"]
        position = [1.8, 0.0, 1.4]
        [cameras."C 1".deeper]
        [empty]
        """
    assert tomllib.loads(toml_text(tomllib.loads(text))) == tomllib.loads(text)
