"""Whole drives, read from their folders."""

from __future__ import annotations

import json
import shutil
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoloc.trajectory.trajectory import PoseTrack
from twin.drives.drive import Drive
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.read import read_drive
from twin.errors import DriveError

WIDE, NARROW = "C3_wide", "C1_narrow"
STAMPS = f"{WIDE}.h264.timestamps"
S = 1_000_000_000

GENERIC = f"""
name = "trip"
rig = "calibration/the car.json"
[gnss]
files = {{"gnss52:vehicle" = "right.nmea", "gnss50:vehicle" = "left.nmea"}}
[timestamps]
{WIDE} = "frames.csv"
[annotations]
{WIDE} = "signs.xml"
"""


def generic(maker: Any, toml: str = GENERIC, **changes: str | None) -> dict[str, str]:
    """Build the same drive as ``maker.files()`` under other names."""
    trip = maker.files()
    rows = [line.split("\t") for line in trip[STAMPS].splitlines()]
    files = {
        "drive.toml": toml,
        "calibration/the car.json": trip["car.json"],
        "left.nmea": trip["gnss50_vehicle.bin"],
        "right.nmea": trip["gnss52_vehicle.bin"],
        "frames.csv": "frame,time_ns\n" + "".join(f"{i},{us}000\n" for i, us in rows),
        "signs.xml": trip[f"{WIDE}.xml"],
    }
    return {name: text for name, text in (files | changes).items() if text is not None}


def poses(maker: Any) -> str:
    """Ten seconds of poses at 10 Hz."""
    head = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n"
    return head + "".join(f"{maker.start_ns + i * S // 10},63.42,10.4,80,0,1.5,0\n" for i in range(101))


def assert_same_arrays(one: Drive, other: Drive) -> None:
    """Fixes, stamps and annotations are equal to the last bit, whatever the files are called."""
    for ours, theirs in zip(one.gnss, other.gnss, strict=True):
        for f in fields(ours):
            np.testing.assert_array_equal(getattr(ours, f.name), getattr(theirs, f.name), f.name)
    assert one.frame_epoch_ns.keys() == other.frame_epoch_ns.keys()
    for camera, stamps in one.frame_epoch_ns.items():
        assert np.array_equal(stamps, other.frame_epoch_ns[camera])
    for f in (f for f in fields(one.annotations) if f.name != "file"):
        ours, theirs = getattr(one.annotations, f.name), getattr(other.annotations, f.name)
        assert np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f")


def test_driveworks_trip_is_read_whole(tmp_path: Path, maker: Any) -> None:
    """Rig by content, GNSS and stamps by the rig's names, annotations by camera."""
    said: list[str] = []
    drive = read_drive(maker.write(tmp_path / "Trip001", maker.files()), progress=said.append)
    assert drive.name == "Trip001"
    assert [f.antenna for f in drive.gnss] == ["gnss50:vehicle", "gnss52:vehicle"]
    assert [len(f.epoch_ns) for f in drive.gnss] == [50, 50]
    assert drive.poses is None
    assert set(drive.frame_epoch_ns) == {WIDE}
    assert drive.frame_epoch_ns[WIDE][:2].tolist() == [maker.start_ns, maker.start_ns + S // 10]
    assert drive.annotations.object.tolist() == ["3", "3", "5"]
    assert drive.annotations.skiltnummer.tolist() == ["362.50", "362.50", "206"]
    assert drive.annotations.pixel_px.tolist() == [[700.0, 500.0], [719.75, 520.0], [399.5, 449.5]]
    assert json.loads(drive.rig_document) == maker.rig()
    assert (drive.annotations_complete, drive.datum, drive.camera_offset_ns) == (False, "EUREF89", 0)
    assert (drive.warnings, drive.skipped) == ((), ())
    assert any("5.0 Hz" in line for line in said)


def test_generic_folder_gives_the_same_arrays_as_the_trip(tmp_path: Path, maker: Any) -> None:
    """The layout of the folder does not change the drive."""
    trip = read_drive(maker.write(tmp_path / "trip", maker.files()))
    other = read_drive(maker.write(tmp_path / "generic", generic(maker)))
    assert_same_arrays(trip, other)
    assert other.name == "trip"


def test_drive_id_is_the_same_wherever_the_folder_is(tmp_path: Path, maker: Any) -> None:
    """Moved, renamed, annotated anew, with files that are not read: the same id. Another track: another."""
    first = read_drive(maker.write(tmp_path / "a", maker.files()))
    shutil.copytree(tmp_path / "a", tmp_path / "deep" / "b")
    maker.write(tmp_path / "deep" / "b", {"notes.txt": "sunny", f"{WIDE}.h264": "video"})
    assert read_drive(tmp_path / "deep" / "b").drive_id == first.drive_id
    changed = maker.annotations().replace("700.5", "700.6")
    again = read_drive(maker.write(tmp_path / "c", maker.files(**{f"{WIDE}.xml": changed})))
    assert again.drive_id == first.drive_id
    assert again.content_sha256 != first.content_sha256
    shorter = {name: text[: text.rindex("$")] for name, text in maker.files().items() if "gnss" in name}
    other = read_drive(maker.write(tmp_path / "d", maker.files(**shorter)))
    assert other.drive_id != first.drive_id
    assert len(first.drive_id) == 12


def test_settings_override_what_the_trip_would_say(tmp_path: Path, maker: Any) -> None:
    """A ``drive.toml`` in a trip folder may say a little; the rest is searched."""
    toml = 'annotations_complete = true\ndatum = "ITRF2020"\ncamera_offset_ms = -16\nname = "Okstad"\n'
    toml += '[gnss]\nlever_arms = {"gnss50:vehicle" = [0.9, 0.4, 1.7]}\n'
    drive = read_drive(maker.write(tmp_path, maker.files(**{"drive.toml": toml})))
    assert (drive.name, drive.datum, drive.annotations_complete) == ("Okstad", "ITRF2020", True)
    assert drive.camera_offset_ns == -16_000_000
    assert drive.rig.antennas["gnss50:vehicle"].rig_t_antenna_m.tolist() == [0.9, 0.4, 1.7]
    assert drive.rig.antennas["gnss52:vehicle"].rig_t_antenna_m.tolist() == [1.0, -0.5, 1.6]
    assert len(drive.annotations.frame) == 3


def test_pose_track_takes_the_place_of_gnss(tmp_path: Path, maker: Any) -> None:
    """With poses the drive has no fixes, and nose-up pitch is turned."""
    toml = 'pitch_positive = "nose_up"\n[poses]\nfile = "poses.csv"\n'
    files = maker.files(**{"drive.toml": toml, "poses.csv": poses(maker)})
    drive = read_drive(maker.write(tmp_path, files))
    assert drive.gnss == ()
    assert isinstance(drive.poses, PoseTrack)
    assert set(drive.poses.pitch_deg.tolist()) == {-1.5}
    assert drive.warnings == ()


def test_rig_is_found_by_content(tmp_path: Path, maker: Any) -> None:
    """Other JSON, broken JSON and an identical copy do not matter."""
    rig = json.dumps(maker.rig(), indent=2)
    others = {"coco.json": '{"images": []}', "list.json": "[1]", "zz.json": rig, "cut.json": rig[:90]}
    drive = read_drive(maker.write(tmp_path, maker.files(**others)))
    assert drive.rig.source == "car.json"


def test_rig_of_two_different_ones_is_what_drive_toml_says(tmp_path: Path, maker: Any) -> None:
    """Without its word they are refused."""
    other = json.dumps(maker.rig(maker.camera(WIDE, cx="600")))
    files = maker.files(**{"other.json": other, "drive.toml": 'rig = "car.json"'})
    assert read_drive(maker.write(tmp_path, files)).rig.source == "car.json"


def test_folder_that_holds_no_drive_says_what_was_found(tmp_path: Path, maker: Any) -> None:
    """The error tells what was looked for, what is there, and why a JSON file was no rig."""
    maker.write(tmp_path, {"holiday.jpg": "x", "broken.json": "{"})
    with pytest.raises(
        DriveError, match=r"no drive: looked for drive\.toml.*broken\.json is not JSON.*holiday\.jpg"
    ):
        read_drive(tmp_path)


def test_rig_that_is_malformed_is_refused_as_a_drive_error(tmp_path: Path, maker: Any) -> None:
    """Calibration errors arrive as the one error of this package, with their sentence."""
    files = maker.files(**{"car.json": json.dumps(maker.rig(maker.camera(WIDE, width="wide")))})
    with pytest.raises(DriveError, match=r"width of sensor C3_wide in car\.json"):
        read_drive(maker.write(tmp_path, files))
    maker.write(tmp_path, {"drive.toml": 'rig = "text.json"', "text.json": "no JSON"})
    with pytest.raises(DriveError, match=r"text\.json is not JSON"):
        read_drive(tmp_path)


def test_drive_is_read_without_one_antenna(tmp_path: Path, maker: Any) -> None:
    """A receiver that is absent or has no fix does not cost the drive; the loss is told."""
    for text, said in ((None, ""), ("noise\n", " holds no usable GNSS fix")):
        drive = read_drive(maker.write(tmp_path / str(text), maker.files(**{"gnss52_vehicle.bin": text})))
        assert [f.antenna for f in drive.gnss] == ["gnss50:vehicle"]
        assert f"gnss52_vehicle.bin{said}" in drive.warnings[0].sentence


def test_gnss_that_the_rig_does_not_name_is_found_by_content(tmp_path: Path, maker: Any) -> None:
    """Recordings under other names belong to the antenna in their name."""
    trip = maker.files()
    changes = {
        "gnss50_vehicle.bin": None,
        "gnss52_vehicle.bin": None,
        "gnss50-vehicle.log": trip["gnss50_vehicle.bin"],
        "gnss52 vehicle": trip["gnss52_vehicle.bin"],
        "noise.bin": "\0\1\2",
    }
    drive = read_drive(maker.write(tmp_path / "a", maker.files(**changes)))
    assert_same_arrays(drive, read_drive(maker.write(tmp_path / "b", trip)))
    changes |= {"gnss52 vehicle": None, "rover.log": trip["gnss52_vehicle.bin"]}
    with pytest.raises(
        DriveError, match=r"rover\.log is a GNSS recording, but not which antenna's.*gnss50:vehicle"
    ):
        read_drive(maker.write(tmp_path / "c", maker.files(**changes)))


def test_rig_without_antennas_takes_the_recording_at_its_origin(tmp_path: Path, maker: Any) -> None:
    """The antenna gets the file's name, no lever arm, and a warning with the cure."""
    rig = json.dumps(maker.rig(maker.camera(WIDE)))
    files = maker.files(**{"car.json": rig, "gnss52_vehicle.bin": None})
    drive = read_drive(maker.write(tmp_path, files))
    assert drive.gnss[0].antenna == "gnss50_vehicle"
    assert drive.rig.antennas["gnss50_vehicle"].rig_t_antenna_m.tolist() == [0.0, 0.0, 0.0]
    assert "lever arms of gnss50_vehicle are all zero" in drive.warnings[0].sentence


def test_zero_lever_arms_are_warned_of_with_the_cure(tmp_path: Path, maker: Any) -> None:
    """As in the real car's rig file: unknown lever arms are written as zeros."""
    sensors = [maker.camera(WIDE), *(maker.antenna(f"gnss{n}:vehicle", [0.0, 0.0, 0.0]) for n in (50, 52))]
    files = maker.files(**{"car.json": json.dumps(maker.rig(*sensors))})
    drive = read_drive(maker.write(tmp_path, files))
    assert len(drive.warnings) == 1
    assert "gnss50:vehicle, gnss52:vehicle are all zero" in drive.warnings[0].sentence
    assert "[gnss] lever_arms in drive.toml" in drive.warnings[0].sentence


def test_antenna_that_is_misspelt_in_the_settings_is_refused(tmp_path: Path, maker: Any) -> None:
    """A typing error must not quietly give an antenna without a lever arm."""
    for toml in (
        GENERIC.replace("gnss50:", "gnns50:"),
        GENERIC.replace("[timestamps]", "lever_arms = {x = [1, 2, 3]}\n[timestamps]"),
    ):
        folder = maker.write(tmp_path, generic(maker, toml))
        with pytest.raises(DriveError, match=r"names the antenna .*gnss50:vehicle, gnss52:vehicle"):
            read_drive(folder)


def test_camera_that_is_not_in_the_rig_is_refused_with_those_that_are(tmp_path: Path, maker: Any) -> None:
    """In [annotations] and in [timestamps] alike."""
    for table in ("annotations", "timestamps"):
        toml = f'[{table}]\nC9 = "{WIDE}.xml"\n'
        folder = maker.write(tmp_path / table, maker.files(**{"drive.toml": toml}))
        with pytest.raises(
            DriveError, match=rf"\[{table}\] in drive\.toml names the camera C9.*C3_wide, C1_narrow"
        ):
            read_drive(folder)


def test_stamps_under_another_name_are_found_by_their_camera(tmp_path: Path, maker: Any) -> None:
    """``<camera>*.timestamps`` will do, unless there are two of them."""
    stamps = maker.stamps()
    changes = {
        STAMPS: None,
        f"{WIDE}.mp4.timestamps": stamps,
        f"{WIDE}2.timestamps": "x",
        f"{NARROW}.timestamps": "x",
    }
    drive = read_drive(maker.write(tmp_path, maker.files(**changes)))
    assert len(drive.frame_epoch_ns[WIDE]) == 100
    maker.write(tmp_path, {f"{WIDE}_copy.timestamps": stamps})
    with pytest.raises(DriveError, match=r"could both hold the time stamps.*\[timestamps\]"):
        read_drive(tmp_path)


def test_frames_beyond_the_stamps_are_counted_and_all_of_them_refused(tmp_path: Path, maker: Any) -> None:
    """Frame 30 is lost with the recording's end; with no frame left the drive is refused."""
    drive = read_drive(maker.write(tmp_path, maker.files(**{STAMPS: maker.stamps(frames=25)})))
    assert drive.annotations.frame.tolist() == [20, 23]
    assert [(s.what, s.count) for s in drive.skipped] == [("annotations", 1)]
    maker.write(tmp_path, {STAMPS: maker.stamps(frames=10)})
    with pytest.raises(DriveError, match=r"frames 20–30 of C3_wide are none of the frames 0–9"):
        read_drive(tmp_path)


def test_frame_without_a_stamp_is_marked_and_its_annotation_counted(tmp_path: Path, maker: Any) -> None:
    """A hole in the numbering is no time, not another frame's."""
    stamps = "".join(line for line in maker.stamps().splitlines(keepends=True) if not line.startswith("23\t"))
    drive = read_drive(maker.write(tmp_path, maker.files(**{STAMPS: stamps})))
    assert drive.frame_epoch_ns[WIDE][23] == NO_STAMP
    assert drive.annotations.frame.tolist() == [20, 30]
    assert {s.reason for s in drive.skipped} == {
        "no stamp for the frame number",
        f"frame of {WIDE} without a time stamp",
    }


def test_frames_all_outside_the_gnss_time_are_refused_with_both_spans(tmp_path: Path, maker: Any) -> None:
    """Files of two drives: the error shows when each was recorded."""
    later = maker.stamps(start_ns=maker.start_ns + 3600 * S)
    with pytest.raises(
        DriveError,
        match=r"frames are from 2026-06-10 09:00:02\.000 UTC to 2026-06-10 09:00:03\.000 UTC, the GNSS fixes"
        r" from 2026-06-10 08:00:00\.000 UTC to 2026-06-10 08:00:09\.800 UTC",
    ):
        read_drive(maker.write(tmp_path, maker.files(**{STAMPS: later})))


def test_camera_offset_brings_frames_into_the_gnss_time(tmp_path: Path, maker: Any) -> None:
    """A camera clock an hour ahead is mended by its offset."""
    changes = {
        STAMPS: maker.stamps(start_ns=maker.start_ns + 3600 * S),
        "drive.toml": "camera_offset_ms = -3600000\n",
    }
    drive = read_drive(maker.write(tmp_path, maker.files(**changes)))
    assert drive.camera_offset_ns == -3600 * S
    assert drive.warnings == ()


def test_frames_partly_outside_the_gnss_time_are_warned_of(tmp_path: Path, maker: Any) -> None:
    """Frame 30, a tenth of a second after the last fix, is kept and told of."""
    late = maker.stamps(start_ns=maker.start_ns + 6_900_000_000)
    drive = read_drive(maker.write(tmp_path, maker.files(**{STAMPS: late})))
    assert len(drive.annotations.frame) == 3
    assert "1 of 3 annotations lie outside the GNSS fixes" in drive.warnings[0].sentence


def test_drive_without_annotations_is_a_track_with_a_warning(tmp_path: Path, maker: Any) -> None:
    """It is no error: the drive can be annotated later."""
    drive = read_drive(maker.write(tmp_path, maker.files(**{f"{WIDE}.xml": None})))
    assert len(drive.annotations.frame) == 0
    assert dict(drive.frame_epoch_ns) == {}
    assert "no annotations" in drive.warnings[0].sentence


def test_drive_whose_annotations_are_empty_keeps_the_cameras_frames(tmp_path: Path, maker: Any) -> None:
    """A camera in which no sign was seen can still testify that one is missing."""
    files = maker.files(**{f"{WIDE}.xml": maker.cvat(), "drive.toml": "annotations_complete = true"})
    drive = read_drive(maker.write(tmp_path, files))
    assert set(drive.frame_epoch_ns) == {WIDE}
    assert f"{WIDE}.xml: not one point or box" in drive.warnings[0].sentence


def test_other_xml_in_the_folder_is_not_read(tmp_path: Path, maker: Any) -> None:
    """Only files whose root is <annotations> are CVAT's."""
    drive = read_drive(maker.write(tmp_path, maker.files(**{"map.xml": "<osm/>", "cut.xml": "<ann"})))
    assert len(drive.annotations.frame) == 3


def test_file_that_the_settings_name_and_the_folder_lacks_is_refused(tmp_path: Path, maker: Any) -> None:
    """Each kind of file is named in the error."""
    for name in ("calibration/the car.json", "left.nmea", "frames.csv", "signs.xml"):
        folder = maker.write(tmp_path / name.replace("/", "_"), generic(maker, **{name: None}))
        with pytest.raises(DriveError, match=f"{name} is not in the drive folder"):
            read_drive(folder)


def test_several_annotated_cameras_are_read_together(tmp_path: Path, maker: Any) -> None:
    """Each camera has its stamps, and objects that share an attribute are one."""
    track = maker.cvat(maker.track(1, {20: (5, 5)}, object="pole 1"))
    changes = {f"{WIDE}.xml": track, f"{NARROW}.xml": track, f"{NARROW}.h264.timestamps": maker.stamps()}
    drive = read_drive(maker.write(tmp_path, maker.files(**changes)))
    assert drive.annotations.camera.tolist() == [NARROW, WIDE]
    assert drive.annotations.object.tolist() == ["pole 1", "pole 1"]
    assert set(drive.frame_epoch_ns) == {NARROW, WIDE}


def test_gnss_without_host_stamps_is_dated_by_rmc(tmp_path: Path, maker: Any) -> None:
    """A receiver's own log gives the same epochs; host stamps are then unknown."""
    nmea = {f"gnss{n}_vehicle.bin": maker.nmea(host=False) for n in (50, 52)}
    drive = read_drive(maker.write(tmp_path, maker.files(**nmea)))
    assert drive.gnss[0].epoch_ns[0] == maker.start_ns
    assert np.array_equal(drive.gnss[0].host_ns, drive.gnss[0].epoch_ns)


def test_file_instead_of_a_folder_is_refused(tmp_path: Path, maker: Any) -> None:
    """The cure is to give the folder."""
    maker.write(tmp_path, maker.files())
    with pytest.raises(DriveError, match=r"car\.json is a file: give the folder"):
        read_drive(tmp_path / "car.json")
