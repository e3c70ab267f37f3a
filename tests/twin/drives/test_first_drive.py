"""What the first drive of a new car is told: each usual slip with what, where and the cure."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drive_damage import video
from drive_slips import Slip, assert_refused, assert_told, read
from PIL import Image
from track_writers import S, gpx_document, gpx_point

from geoloc.calibration_files.kalibr import kalibr_text
from geoloc.cameras import PinholeCamera
from twin.drives.inspection.inspect import inspect_drive
from twin.drives.read import read_drive
from twin.errors import DriveError

WIDE, NARROW = "C3_wide", "C1_narrow"
STAMPS = f"{WIDE}.h264.timestamps"
TIMED = f'[timestamps]\n{WIDE} = "t.csv"\n'
GPX = '[gnss]\nfiles = { "gnss50:vehicle" = "walk.gpx" }\n'
HEAD = "frame,label,x_px,y_px\n"
MARKS = HEAD + "".join(f"{20 + i},202,{700 + 10 * i},{500 + 2 * i}\n" for i in range(30))
SMALL = HEAD + "".join(f"{20 + i},202,{350 + 5 * i},{250 + i}\n" for i in range(30))
CHAIN = kalibr_text([PinholeCamera(1280, 800, 1000.0, 1000.0, 639.5, 399.5)])
POSED = "position = [1.8, 0.0, 1.4]\nroll_pitch_yaw = [0.0, 2.5, 0.0]\n"
ALONE = f"""
[cameras.{WIDE}]
intrinsics = "chain.yaml"
{POSED}
[gnss]
files = {{ roof = "gnss52_vehicle.bin" }}
lever_arms = {{ roof = [1.0, 0.0, 1.6] }}
[timestamps]
{WIDE} = "{STAMPS}"
"""
LABELME = '{"imagePath": "21.png", "shapes": [{"label": "202", "points": [[9, 9]], "shape_type": "point"}]}'


def _timed(text: str) -> dict[str, str | None]:
    return {"t.csv": text, "drive.toml": TIMED, STAMPS: None}


def _only_walk(text: str, toml: str | None = GPX) -> dict[str, str | None]:
    return {
        "gnss50_vehicle.bin": None,
        "gnss52_vehicle.bin": None,
        "walk.gpx": text,
        **({"drive.toml": toml} if toml else {}),
    }


def _marked(**files: str) -> dict[str, str | None]:
    return {f"{WIDE}.xml": None, **files}


REFUSED = (
    # Times
    Slip("column_time", _timed("image,time\n1.png,1\n"), r"the columns image, time: call them image,time_ns"),
    Slip("column_of_frames", _timed("frame,time\n1,1\n"), r"call them frame,time_ns, with UTC in nanosec"),
    Slip(
        "microseconds",
        _timed("image,time_ns\n1.png,1781078400004105\n"),
        r"1781078400004105 looks like microseconds: write it in nanoseconds .* 1781078400004105000\.",
    ),
    Slip(
        "milliseconds", _timed("frame,time_ns\n1,1781078400004\n"), r"milliseconds: .* 1781078400004000000\."
    ),
    Slip("seconds", _timed("frame,time_ns\n1,1781078400.25\n"), r"like seconds: .* as 1781078400250000000\."),
    Slip("nanoseconds", _timed("1 1781078400004105000\n"), r"nanoseconds: write it in microseconds"),
    # Recordings
    Slip(
        "gpx_empty", _only_walk(""), r"^walk\.gpx is empty: record or export the GPX file of this drive again"
    ),
    Slip("gpx_page", _only_walk("<html>login"), r"^walk\.gpx is no GPX \(it begins '<html>login'\)"),
    Slip("gpx_empty_unnamed", _only_walk("", None), r"holds no GNSS recording .*\. walk\.gpx is empty"),
    # The rig
    Slip(
        "no_rig",
        {"car.json": None, "drive.toml": ""},
        r"Add the rig file .* or give every camera .*\[cameras\]",
    ),
    Slip(
        "camera_misspelt",
        {"drive.toml": f"[cameras.C3_wde]\n{POSED}"},
        r"C3_wde, which no rig file has \(its cameras: C3_wide, C1_narrow; the nearest is C3_wide\)",
    ),
    # Cameras of annotations
    Slip(
        "camera_of_a_row",
        _marked(**{f"{WIDE}.csv": "frame,camera,label,x_px,y_px\n21,cam7,202,9,9\n"}),
        r"C3_wide\.csv names .* cam7, which car\.json does not have \(its cameras: C3_wide, C1_narrow\)",
    ),
    Slip(
        "camera_of_a_folder", _marked(**{"#cam7/a.csv": MARKS}), r"#cam7/a\.csv names the camera cam7, which"
    ),
    Slip(
        "camera_of_a_table",
        {"drive.toml": f'[annotations]\nC3_wid = "{WIDE}.xml"\n'},
        r"names the camera C3_wid, which .*; the nearest is C3_wide\): correct the name",
    ),
    Slip("archive_named", {"a.zip": "PK", "drive.toml": f'[annotations]\n{WIDE} = "a.zip"\n'}, r"unpack it"),
    # Sizes
    Slip(
        "drawn_on_larger_pictures",
        _marked(**{f"{WIDE}.csv": re.sub(r",(\d+),(\d+)\n", r",2\1,\2\n", MARKS)}),
        r"30 of 30 annotations in C3_wide\.csv lie outside the 1280 x 800 pixels of C3_wide in car.json,"
        r" as far as x = 2990, y = 558: .* Give the calibration of pictures of that size",
    ),
    Slip(
        "sigma_zero",
        {"drive.toml": "[gnss]\nsigma_m = 0\n"},
        r"gnss\.sigma_m = 0\.0: .* above 0 and up to 100",
    ),
)

TOLD = (
    Slip(
        "drawn_on_smaller_pictures",
        _marked(**{f"{WIDE}.csv": SMALL}),
        r"All 30 annotations of C3_wide lie in the upper left quarter of its 1280 x 800 pixels in car\.json",
    ),
    Slip(
        "code_unknown",
        {"labels.toml": '[labels]\na = "999.99"\nb = "362.5"\nc = "362.50"\n'},
        r"^labels\.toml uses sign codes .*: 362\.5 \(nearest: 362\.50\), 999\.99 \(nearest",
    ),
    Slip(
        "labelme_empty",
        _marked(**{f"{WIDE}/21.json": LABELME, f"{WIDE}/22.json": "{}", f"{WIDE}/23.json": ""}),
        r"^C3_wide/22\.json, C3_wide/23\.json are empty, so they mark nothing: save them again",
    ),
    Slip("export_empty", {"signs.json": ""}, r"^signs\.json is empty, so it marks nothing: save it again"),
    Slip("archive", {"job_1.zip": "PK"}, r"^job_1\.zip is an archive, .* unpack it in the drive folder"),
    Slip(
        "pose_twice",
        {"drive.toml": f"[cameras.{WIDE}]\n{POSED}"},
        r"under \[cameras\.C3_wide\] in drive\.toml count, not those of car\.json, which differ by 0\.50° and"
        r" 0\.000 m: .* delete both keys",
    ),
)


@pytest.mark.parametrize("slip", REFUSED, ids=lambda slip: slip.name)
def test_slip_is_refused_with_the_cure(maker: Any, tmp_path: Path, slip: Slip) -> None:
    """One sentence names the file, what is wrong in it, and what to write instead."""
    assert_refused(maker, tmp_path, slip)


@pytest.mark.parametrize("slip", TOLD, ids=lambda slip: slip.name)
def test_slip_that_may_be_meant_is_told(maker: Any, tmp_path: Path, slip: Slip) -> None:
    """The drive is read, with a warning."""
    assert_told(maker, tmp_path, slip)


def test_sound_trip_is_told_nothing_of_the_kind(maker: Any, tmp_path: Path) -> None:
    """None of the warnings above comes without its cause."""
    assert read(maker, tmp_path, {}).warnings == ()


def test_camera_may_be_named_by_the_folder_of_its_annotations(maker: Any, tmp_path: Path) -> None:
    """As CVAT's exports unpack: annotations.xml in a folder."""
    files = _marked(**{f"{WIDE}/annotations.xml": maker.annotations()})
    assert set(read(maker, tmp_path, files).annotations.camera.tolist()) == {WIDE}


def test_number_sign_of_a_run_names_no_camera(maker: Any, tmp_path: Path) -> None:
    """``run #3`` is a number; the camera's name stands beside it."""
    files = _marked(**{f"run #3 {WIDE}/a.csv": MARKS})
    assert len(read(maker, tmp_path, files).annotations.frame) == 30


def _pictures(folder: Path, width: int, height: int) -> None:
    """Ten pictures of this size, and their times in their names."""
    (folder / "wide").mkdir(parents=True)
    made = io.BytesIO()
    Image.fromarray(np.zeros((height, width), np.uint8)).save(made, format="PNG")
    for number in range(60):
        (folder / "wide" / f"{1_781_078_400_000_000 + number * 100_000}.png").write_bytes(made.getvalue())


@pytest.mark.parametrize(
    ("size", "cure"), [((640, 400), "0.5 times as large"), ((640, 480), "nor stretched")]
)
def test_calibration_of_another_size_than_the_pictures_is_refused(
    maker: Any, tmp_path: Path, size: tuple[int, int], cure: str
) -> None:
    """Both sizes are named; pictures of the same shape say by what factor they differ."""
    _pictures(tmp_path, *size)
    toml = f'[frames]\n{WIDE} = "wide"\n'
    files = _marked(**{f"{WIDE}.csv": MARKS, "drive.toml": toml})
    sizes = (
        rf"The pictures of C3_wide in wide have {size[0]} x {size[1]} pixels, but car\.json .* at 1280 x 800"
    )
    with pytest.raises(DriveError, match=f"{sizes}: .*{cure}"):
        read(maker, tmp_path, {**files, STAMPS: None})


def test_calibration_of_another_size_than_the_video_is_refused(maker: Any, tmp_path: Path) -> None:
    """The video is named, and only its header is asked."""
    (tmp_path / f"{WIDE}.mp4").write_bytes(video(range(0, 10_000, 100)))
    files = _marked(**{f"{WIDE}.csv": MARKS})
    with pytest.raises(
        DriveError, match=r"of C3_wide in C3_wide\.mp4 have 64 x 48 pixels, but .* at 1280 x 800"
    ):
        read(maker, tmp_path, files)


def test_size_is_told_before_anything_is_annotated(maker: Any, tmp_path: Path) -> None:
    """Inspect compares the pictures of a new drive with the calibration."""
    (tmp_path / f"{WIDE}.mp4").write_bytes(video(range(0, 10_000, 100)))
    found = inspect_drive(maker.write(tmp_path, maker.files(**_marked())))
    assert any("have 64 x 48 pixels, but car.json calibrates it at 1280 x 800" in w for w in found.warnings)


def test_small_previews_do_no_harm_where_annotations_say_their_size(maker: Any, tmp_path: Path) -> None:
    """Their pixels are those of the size that the tool wrote down."""
    _pictures(tmp_path, 640, 400)
    meta = "<original_size><width>1280</width><height>800</height></original_size>"
    marks = maker.cvat(maker.track(3, {20: (700.5, 500.5)}), meta=f"<task><id>1</id>{meta}</task>")
    files = {f"{WIDE}.xml": marks, "drive.toml": f'[frames]\n{WIDE} = "wide"\n', STAMPS: None}
    assert len(read(maker, tmp_path, files).annotations.frame) == 1


def _walk(maker: Any) -> str:
    points = (gpx_point(maker.start_ns + i * S // 5, 63.42 + 2e-6 * i, 10.4, 80.0) for i in range(60))
    return gpx_document(points).decode()


def test_fixes_of_which_nothing_is_said_are_told_of_until_sigma_m_says_it(maker: Any, tmp_path: Path) -> None:
    """GPX counts as 2 m, with a sentence; with [gnss] sigma_m as what it says, without one."""
    without = read(maker, tmp_path / "without", _only_walk(_walk(maker)))
    assert np.isnan(without.gnss[0].sigma_horizontal_m).all()
    (told,) = (one.sentence for one in without.warnings if "[gnss] sigma_m" in one.sentence)
    assert "walk.gpx are taken as good to 2 m" in told
    with_sigma = read(maker, tmp_path / "with", _only_walk(_walk(maker), f"{GPX}sigma_m = 0.02\n"))
    assert set(with_sigma.gnss[0].sigma_horizontal_m.tolist()) == {0.02}
    assert not any("sigma_m" in one.sentence for one in with_sigma.warnings)


def test_sigma_m_leaves_what_a_receiver_states(maker: Any, tmp_path: Path) -> None:
    """GST sentences say it for each fix."""
    nmea = "".join(
        line + maker.sentence(f"GPGST,{line[7:16]},,,,,0.11,0.11,0.2") if "GGA" in line else line
        for line in maker.nmea().splitlines(keepends=True)
    )
    files = {"gnss52_vehicle.bin": nmea, "drive.toml": "[gnss]\nsigma_m = 0.5\n"}
    left, right = read(maker, tmp_path, files).gnss
    assert set(left.sigma_horizontal_m.tolist()) == {0.5}
    assert np.all(np.abs(right.sigma_horizontal_m - 0.11) < 0.05)


def test_rig_line_counts_the_antennas_of_the_settings(maker: Any, tmp_path: Path) -> None:
    """A rig of drive.toml alone has the antennas of [gnss]; one of each is said in the singular."""
    files = {"car.json": None, "chain.yaml": CHAIN, "drive.toml": ALONE}
    said: list[str] = []
    read_drive(maker.write(tmp_path, maker.files(**files)), progress=said.append)
    assert said[0] == "Rig drive.toml: 1 camera, 1 antenna."


def test_corrected_rig_beside_a_whole_table_is_told(maker: Any, tmp_path: Path) -> None:
    """What calibrate verify --apply writes is not passed over without a word."""
    drive = read(maker, tmp_path, {"chain.yaml": CHAIN, "drive.toml": ALONE})
    (warning,) = drive.warnings
    assert "not those of car.json, which differ by 0.50°" in warning.sentence
