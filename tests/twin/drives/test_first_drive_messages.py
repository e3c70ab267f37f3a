"""What is told of annotations, times and recordings that are read, but not as they were meant."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from drive_slips import Slip, assert_refused, assert_told, read

from geoloc.calibration_files.read import calibration_kind, read_cameras
from twin.drives.annotations.formats.plain_csv import read_annotations_csv
from twin.drives.inspection.inspect import inspect_drive

WIDE, NARROW = "C3_wide", "C1_narrow"
HEAD = "frame,label,x_px,y_px"
GNSS = (
    '[gnss]\nfiles = { "gnss50:vehicle" = "gnss50_vehicle.bin", "gnss52:vehicle" = "gnss52_vehicle.bin" }\n'
)
WIDE_LENS = """%YAML:1.0
---
image_width: 1280
image_height: 800
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 639.5, 0., 600., 399.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0.012, -0.004, 0.001, -0.0002 ]
"""


def _marks(frames: range, head: str = HEAD) -> str:
    return "\n".join([head, *(f"{frame},202,{700 + frame},{500 + frame}" for frame in frames)])


def _marked(name: str, text: str) -> dict[str, str | None]:
    return {f"{WIDE}.xml": None, name: text}


def _coco(image: str, visibility: int = 2) -> str:
    images = [{"id": 21, "file_name": image, "width": 1280, "height": 800}]
    mark = {"id": 1, "image_id": 21, "category_id": 1, "keypoints": [700, 500, visibility]}
    categories = [{"id": 1, "name": "202", "keypoints": ["foot"]}]
    return json.dumps({"images": images, "annotations": [mark], "categories": categories})


REFUSED = (
    Slip(
        "comma_in_a_text",
        _marked(f"{WIDE}.csv", f"{HEAD},text\n" + "20,202,700,500,Oslo, E6\n" * 3),
        r"line 2 \('20,202,700,500,Oslo, E6'\) has 6 cells, the header 5, .* in quotation marks",
    ),
    Slip(
        "semicolons_below_commas",
        _marked(f"{WIDE}.csv", f"{HEAD}\n" + "20;202;700,5;500,5\n" * 3),
        r"line 2 .* write semicolons in the header too, and points in its numbers",
    ),
    Slip(
        "first_frame", {"drive.toml": "first_frame = 2\n"}, r"first_frame = 2: it must be 0 or 1: the number"
    ),
    Slip("no_quotes", {"drive.toml": "rig = car.json\n"}, r'a text needs quotation marks, rig = "car\.json"'),
    Slip(
        "named_recording_empty",
        {"drive.toml": GNSS, "gnss50_vehicle.bin": ""},
        r"^gnss50_vehicle\.bin holds no usable GNSS fix",
    ),
)

TOLD = (
    Slip(
        "frames_from_1",
        _marked(f"{WIDE}.csv", _marks(range(1, 40, 3))),
        r"of C3_wide .* seem to be numbered from 1, .*: the first is 1, .* Write first_frame = 1 in",
    ),
    Slip(
        "beyond_the_last", _marked(f"{WIDE}.csv", _marks(range(40, 101))), r"the last is 100, one beyond it"
    ),
    Slip(
        "foot_not_marked",
        _marked(f"{WIDE}.json", _coco("21.png", 0)),
        r"^All 1 annotations of C3_wide in C3_wide\.json were left out: foot not marked",
    ),
    Slip(
        "all_outside_the_picture",
        _marked(f"{WIDE}.csv", f"{HEAD}\n1,202,-5,-5\n"),
        r"^All 1 annotations of C3_wide in C3_wide\.csv were left out: outside the image",
    ),
    Slip(
        "columns_called_x",
        _marked("signs.csv", _marks(range(20, 30), "frame,label,x,y")),
        r"signs\.csv has the columns frame, label, x, y, and lacks x_px, y_px",
    ),
    Slip(
        "yolo_without_classes",
        _marked(f"{WIDE}/frame_21.txt", "0 0.5 0.5 0.1 0.1\n"),
        r"C3_wide/frame_21\.txt looks like YOLO, but no data\.yaml, .* name C3_wide/ under \[annotations\]",
    ),
)


@pytest.mark.parametrize("slip", REFUSED, ids=lambda slip: slip.name)
def test_slip_is_refused_with_what_to_write(maker: Any, tmp_path: Path, slip: Slip) -> None:
    """One sentence names the file, what is wrong in it, and what to write instead."""
    assert_refused(maker, tmp_path, slip)


@pytest.mark.parametrize("slip", TOLD, ids=lambda slip: slip.name)
def test_slip_is_told_with_an_example(maker: Any, tmp_path: Path, slip: Slip) -> None:
    """The drive is read, with a warning that names what stands in the file."""
    assert_told(maker, tmp_path, slip)


def test_first_frame_shifts_rows_and_settles_the_question(maker: Any, tmp_path: Path) -> None:
    """Row 1 is frame 0 by first_frame = 1 and frame 1 by 0; neither is told of any more."""
    marks = _marked(f"{WIDE}.csv", _marks(range(1, 40, 3)))
    for first in (0, 1):
        drive = read(maker, tmp_path / str(first), marks | {"drive.toml": f"first_frame = {first}\n"})
        assert int(drive.annotations.frame.min()) == 1 - first
        assert drive.warnings == ()


def test_few_rows_with_too_many_cells_are_counted_with_the_first() -> None:
    """Their cells would stand below the wrong columns; rows that fit are read."""
    text = f"{HEAD},text\n20,202,700,500,Oslo, E6\n" + "21,202,700,500,Oslo\n" * 3
    file = read_annotations_csv(text.encode(), "signs.csv")
    assert len(file.shapes) == 3
    (skipped,) = file.skipped
    assert skipped.reason == "more cells than the header, such as '20,202,700,500,Oslo, E6'"


def test_decimal_comma_between_commas_is_named_with_its_row() -> None:
    """Where commas part cells, a quoted number with a comma may be of two kinds: it is none."""
    file = read_annotations_csv(b'frame,label,x_px,y_px\n20,202,"700,5","500,5"\n', "signs.csv")
    assert [s.reason for s in file.skipped] == ["decimal comma: write a point, such as '700,5 500,5'"]


def test_wide_lens_of_four_coefficients_is_told_until_the_model_is_named() -> None:
    """Nothing is said of a narrow lens, nor where the file says what it is."""
    said = read_cameras(WIDE_LENS.encode(), "wide.yml")["camera"].warning
    assert "wide.yml is read as pinhole (k1 k2 p1 p2)" in said
    assert "add fisheye_model: 1" in said
    for told in (f"{WIDE_LENS}fisheye_model: 0\n", f"{WIDE_LENS}fisheye_model: 1\n"):
        assert not read_cameras(told.encode(), "wide.yml")["camera"].warning
    narrow = WIDE_LENS.replace("600.", "1600.")
    assert not read_cameras(narrow.encode(), "narrow.yml")["camera"].warning


def test_yolo_rows_of_a_class_as_large_as_the_row_are_no_calibration() -> None:
    """Class 7 with seven numbers; OCamCalib's own file has a comment, or two polynomials and a centre."""
    assert calibration_kind(b"7 .5 .5 .1 .1 .5 .6 2\n" * 3) is None
    assert calibration_kind(b"2 -500.0 0.001\n3 1.0 2.0 3.0\n400.0 640.0\n") == "ocamcalib"


def test_export_in_a_folder_of_a_folder_is_found(maker: Any, tmp_path: Path) -> None:
    """As Datumaro writes it, below a folder that names the camera."""
    files = _marked(f"{WIDE}/annotations/default.json", _coco("frame_21.png"))
    assert read(maker, tmp_path, files).annotations.frame.tolist() == [21]


def test_antenna_that_stops_early_is_told(maker: Any, tmp_path: Path) -> None:
    """Half of one recording is missing: 25 of 50 fixes."""
    half = "".join(maker.nmea().splitlines(keepends=True)[:40])
    warnings = read(maker, tmp_path, {"gnss52_vehicle.bin": half}).warnings
    assert any(
        re.search(r"^gnss52_vehicle\.bin stops 6\.0 s before .*\(20 fixes\)", w.sentence) for w in warnings
    )


def test_camera_in_local_time_is_named_with_the_hours(maker: Any, tmp_path: Path) -> None:
    """One of two cameras is two hours ahead: its file of stamps is to be corrected, not the drive's clock."""
    late = maker.stamps(start_ns=maker.start_ns + 7_200_000_000_000)
    files = {f"{NARROW}.h264.timestamps": late, f"{NARROW}.xml": maker.annotations()}
    (warning,) = read(maker, tmp_path, files).warnings
    assert warning.sentence.startswith("All 3 annotations of C1_narrow lie outside the GNSS fixes")
    assert "then add -7200 s to the times in C1_narrow.h264.timestamps" in warning.sentence


def test_files_of_one_image_are_counted_and_stamps_told_once(maker: Any, tmp_path: Path) -> None:
    """A folder of 30 labels is 30 files; each camera's time stamps are one line of inspect's progress."""
    labels = {f"{WIDE}/frame_{n}.txt": f"0 0.5 0.{n} 0.1 0.1\n" for n in range(20, 50)}
    toml = f'[timestamps]\n{WIDE} = "{WIDE}.h264.timestamps"\n'
    files = {f"{WIDE}.xml": None, **labels, "classes.txt": "202\n", "drive.toml": toml}
    said: list[str] = []
    inspect_drive(maker.write(tmp_path, maker.files(**files)), progress=said.append)
    assert "Annotations: 30 in 30 files." in said
    assert [line.split()[2] for line in said if "Time stamps" in line] == [f"{WIDE}.h264.timestamps:"]
