"""``twin inspect``: a folder looked at, whatever is in it."""

from __future__ import annotations

import functools
import operator
import random
from pathlib import Path

import numpy as np
import pytest
from command_line import Twin

from twin.drives.inspection.inspect import inspect_drive
from twin.drives.inspection.picture import text_timeline
from twin.drives.inspection.sensors import frames_span
from twin.samples.simulation import simulate


def test_sample_is_recognised_whole(sample: Path) -> None:
    """Every file of the shipped trip has a kind, was read, and the trip is ready."""
    found = inspect_drive(sample / "trip_trondheim")
    assert found.ready
    assert found.refusals == ()
    kinds = {file.name: file.kind for file in found.files}
    assert kinds["rig.json"] == "DriveWorks rig"
    assert kinds["gnss50_vehicle.bin"] == "GNSS, NMEA 0183"
    assert kinds["C3_tricam120.xml"] == "annotations, CVAT XML 1.1"
    assert kinds["C1_front60Single.h264.timestamps"] == "frame times"
    assert all(file.used for file in found.files)


def test_sensors_have_their_rates_delays_and_counts(sample: Path) -> None:
    """GNSS at 5 Hz that arrives 78 ms late, frames at 30 Hz, and the 1,042 annotations."""
    sensors = {(s.name, s.kind): s for s in inspect_drive(sample / "trip_trondheim").sensors}
    left = sensors["gnss50:vehicle", "GNSS"]
    assert left.rate_hz == pytest.approx(5.0, abs=0.01)
    assert left.delay_ms == pytest.approx(78.0, abs=2.0)
    assert left.quality == {"RTK fixed": left.count}
    assert sensors["C3_tricam120", "frames"].rate_hz == pytest.approx(30.0, abs=0.1)
    assert sum(s.count for s in sensors.values() if s.kind == "annotations") == 1042


def test_gap_in_a_recording_is_found(trip: Path) -> None:
    """Ten seconds cut out of one antenna's recording are one gap, and show in the timeline."""
    file = trip / "gnss52_vehicle.bin"
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:100] + lines[150:]))
    found = inspect_drive(trip)
    (right,) = (s for s in found.sensors if s.name == "gnss52:vehicle")
    assert right.n_gaps == 1
    assert right.gaps[0].seconds == pytest.approx(10.2, abs=0.1)
    line = text_timeline(found.sensors)[[s.name for s in found.sensors].index("gnss52:vehicle")]
    assert "▒" in line.strip("▒")


@pytest.mark.parametrize(
    ("remove", "told"),
    [
        ("rig.json", "Add the rig file of the car"),
        ("C3_tricam120.h264.timestamps", "the annotated frames of C3_tricam120 have no time"),
    ],
)
def test_what_is_missing_is_told_and_the_rest_is_shown(
    trip: Path, twin: Twin, remove: str, told: str
) -> None:
    """A folder that ingest-drive would refuse is still shown, with the sentence it would refuse by."""
    (trip / remove).unlink()
    answer = twin("inspect", trip)
    assert answer.code == 4
    assert told in answer.err
    assert "would refuse" in answer.err
    assert "Ready" not in answer.err
    assert "gnss50" in answer.out


def test_both_antennas_gone_is_told_beside_the_cameras(trip: Path) -> None:
    """Without GNSS the frames still have their spans."""
    for file in trip.glob("gnss*"):
        file.unlink()
    found = inspect_drive(trip)
    assert any("holds no GNSS recording" in refusal for refusal in found.refusals)
    assert {s.kind for s in found.sensors} == {"frames", "annotations"}


def test_json_has_everything_that_the_tables_show(sample: Path, tmp_path: Path, twin: Twin) -> None:
    """One document: files, cameras, antennas, sensors with epochs, and where the picture is."""
    picture = tmp_path / "timeline.png"
    document = twin("inspect", sample / "trip_trondheim", "--out", picture, "--json").json
    assert document["ready"] is True
    assert len(document["cameras"]) == 3
    assert document["antennas"]["gnss50:vehicle"] == [0.62, 0.55, 1.56]
    assert document["sensors"][0]["last_ns"] > document["sensors"][0]["first_ns"] > 1.7e18
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_folder_without_times_has_no_picture(tmp_path: Path, twin: Twin) -> None:
    """Nothing to draw is said in a sentence, the rest is told all the same, and no file is made."""
    answer = twin("inspect", tmp_path, "--out", tmp_path / "timeline.png")
    assert answer.code == 4
    assert "camera clock" in answer.out
    assert "there is no timeline to draw" in answer.err
    assert list(tmp_path.iterdir()) == []


def test_path_that_is_no_folder_is_refused(tmp_path: Path, twin: Twin) -> None:
    """A file is not a drive folder."""
    (tmp_path / "a.nmea").write_text("$GPGGA")
    assert twin("inspect", tmp_path / "a.nmea").code == 4


def test_thousands_of_images_are_one_line(tmp_path: Path) -> None:
    """Files of one kind that tools write for each picture are told together."""
    (tmp_path / "images").mkdir()
    for number in range(300):
        (tmp_path / "images" / f"{number:04d}.png").write_bytes(b"\x89PNG")
    (line,) = inspect_drive(tmp_path).files
    assert (line.name, line.count, line.kind) == ("images/*.png", 300, "image")


def test_any_folder_is_looked_at_without_a_crash(sample: Path, tmp_path: Path) -> None:
    """Cut, mixed up and renamed files of a trip: there is always a report."""
    draw = random.Random(7)
    files = sorted((sample / "trip_trondheim").iterdir())
    for round_number in range(25):
        folder = tmp_path / str(round_number)
        folder.mkdir()
        for file in files:
            content = file.read_bytes()
            name = draw.choice(files).name if draw.random() < 0.2 else file.name
            start, end = sorted(draw.randrange(len(content) + 1) for _ in range(2))
            damaged = [content, content[:end], content[start:end], b"\0" * 50 + content[start:], b""]
            (folder / name).write_bytes(draw.choices(damaged, [6, 1, 1, 1, 1])[0])
        found = inspect_drive(folder)
        assert found.ready is not bool(found.refusals)
        assert len(found.files) == len(list(folder.iterdir()))
        found.as_json()


def test_spans_of_frames_without_a_stamp_are_none() -> None:
    """A camera whose frames have no time is not on the timeline."""
    from twin.drives.frames.stamp_files import NO_STAMP

    assert frames_span("front", np.array([NO_STAMP, NO_STAMP]), "front.timestamps") is None


def test_recording_without_host_stamps_has_no_delay(tmp_path: Path) -> None:
    """Where nobody stamped the fixes, no delay is invented."""
    simulate(tmp_path / "drive", name="approach", seed=1)
    for file in (tmp_path / "drive").glob("gnss*"):
        lines = [line.rsplit(b" ", 1)[0] for line in file.read_bytes().splitlines()]
        body = b"GPZDA,075900.00,10,06,2026,00,00"
        checksum = functools.reduce(operator.xor, body)
        file.write_bytes(b"$%s*%02X\n" % (body, checksum) + b"\n".join(lines))
    sensors = inspect_drive(tmp_path / "drive").sensors
    assert [s.delay_ms for s in sensors if s.kind == "GNSS"] == [None, None]
