"""A drive whose signs a network finds: from pictures to estimates in the store."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from command_line import Twin
from left_out import counts

from geoloc.earth.geodesy import utm33_from_geographic
from twin.cli import run
from twin.drives.detection.run import DetectorOptions
from twin.drives.read import read_drive
from twin.errors import ConfigError, DriveError
from twin.ingest.ingest import ingest_drive
from twin.store import schema
from twin.store.store import Store


@pytest.fixture(scope="module")
def model(networks: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that boxes what is red and what is blue."""
    return networks.boards(tmp_path_factory.mktemp("model") / "boards.onnx")


def _places(store: Path) -> dict[str, tuple[float, float]]:
    """UTM33 of each estimate, by label."""
    with Store.open(store, create=False) as opened:
        rows = list(opened.rows(sa.select(schema.estimate)))
    return {row["label"]: (row["east_m"], row["north_m"]) for row in rows}


def test_detected_signs_stand_where_the_boards_stand(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """From an H.264 video, a network and a tracker to positions: both boards within 10 cm of truth.

    Boxes are drawn and found to whole pixels: half a pixel is 1 to 3 cm at 10 to 30 m.
    """
    from pyproj import Geod

    drive, folder = board_drive
    with Store.open(tmp_path / "twin.db") as store:
        report = ingest_drive(store, folder, detector=DetectorOptions(model))
    assert (report.n_objects, report.n_estimates) == (2, 2)
    assert report.skipped["detections: box that the frames around it do not show"] == 1
    found = _places(tmp_path / "twin.db")
    for label, (_, east, north, _) in zip(("362.50", "blue board"), drive.boards, strict=True):
        azimuth, metres = np.degrees(np.arctan2(east, north)), np.hypot(east, north)
        longitude, latitude, _ = Geod(ellps="GRS80").fwd(10.40, 63.42, azimuth, metres)
        error_m = np.hypot(*(np.array(found[label]) - utm33_from_geographic(latitude, longitude)))
        assert error_m < 0.10, label


def test_detections_are_annotations_with_ids_codes_and_frames(
    board_drive: tuple[Any, Path], model: Path
) -> None:
    """A class whose name is a sign code gives the code, another class its name; tracks are ids."""
    drive = read_drive(board_drive[1], detector=DetectorOptions(model))
    notes = drive.annotations
    assert set(notes.kind) == {"box"}
    assert notes.has_id.all()
    assert set(notes.skiltnummer[notes.label == "362.50"]) == {"362.50"}
    assert any("blue board" in warning.sentence for warning in drive.warnings)
    assert not drive.annotations_complete
    first = notes.frame == notes.frame.min()
    expected = board_drive[0].picture(int(notes.frame.min()))
    left, top, right, bottom = np.round(notes.box_px[first][0] + 0.5).astype(int)
    inside = expected[top + 1 : bottom - 1, left + 1 : right - 1]
    assert np.all(inside == inside[0, 0])


def test_every_third_frame_gives_the_same_signs(board_drive: tuple[Any, Path], model: Path) -> None:
    """Fewer frames, the same two tracks."""
    notes = read_drive(board_drive[1], detector=DetectorOptions(model, every=3)).annotations
    assert set(notes.frame % 3) == {0}
    assert set(notes.object) == {"d1", "d2"}


def test_frames_outside_the_track_are_not_run(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """Ten seconds of frames after the last pose cannot be placed: they are counted, not looked at."""
    folder = Path(shutil.copytree(board_drive[1], tmp_path / "drive"))
    rows = (folder / "poses.csv").read_text().splitlines()
    (folder / "poses.csv").write_text("\n".join(rows[:41]) + "\n")
    drive = read_drive(folder, detector=DetectorOptions(model))
    left_out = counts(drive.skipped)
    assert left_out["outside the track"] == 56 - 44
    assert drive.annotations.frame.max() <= 43


def test_labels_toml_says_what_classes_mean(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """The label map of annotations holds for classes too, and detections_complete is the drive's word."""
    folder = Path(shutil.copytree(board_drive[1], tmp_path / "drive"))
    (folder / "labels.toml").write_text('[labels]\n"blue board" = "516"\n')
    settings = (folder / "drive.toml").read_text()
    (folder / "drive.toml").write_text("detections_complete = true\n" + settings)
    drive = read_drive(folder, detector=DetectorOptions(model, every=4))
    assert set(drive.annotations.skiltnummer) == {"362.50", "516"}
    assert drive.annotations_complete


def test_another_model_is_another_content(board_drive: tuple[Any, Path], model: Path, tmp_path: Path) -> None:
    """The store must not mix results of two networks: the model counts among what the drive was read from."""
    other = tmp_path / "boards.onnx"
    other.write_bytes(model.read_bytes() + b"\x12\x04twin")
    one, two = (
        read_drive(board_drive[1], detector=DetectorOptions(path, every=4)) for path in (model, other)
    )
    assert one.content_sha256 != two.content_sha256
    assert one.drive_id == two.drive_id


def test_drive_without_pictures_says_what_to_add(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """Neither a video nor images: one sentence with the cure."""
    folder = Path(shutil.copytree(board_drive[1], tmp_path / "drive"))
    (folder / "front.mp4").unlink()
    lines = (folder / "drive.toml").read_text().partition("[frames.front]")[0]
    (folder / "drive.toml").write_text(lines)
    with pytest.raises(DriveError, match="no pictures for the detector"):
        read_drive(folder, detector=DetectorOptions(model))


def test_pictures_of_another_size_are_refused(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """A scaled-down video does not fit the calibration."""
    folder = Path(shutil.copytree(board_drive[1], tmp_path / "drive"))
    rig = json.loads((folder / "rig.json").read_text())
    rig["rig"]["sensors"][0]["properties"] |= {"width": "1280", "height": "800"}
    (folder / "rig.json").write_text(json.dumps(rig))
    with pytest.raises(DriveError, match="have 640 x 400 pixels, but front has 1280 x 800"):
        read_drive(folder, detector=DetectorOptions(model, every=8))


@pytest.mark.parametrize(("every", "threshold"), [(0, 0.5), (1, 0.0), (1, 1.0), (1, float("nan"))])
def test_options_out_of_range_are_refused(
    board_drive: tuple[Any, Path], model: Path, every: int, threshold: float
) -> None:
    """Every 0 frames, or scores that none or all have, are no choice."""
    with pytest.raises(ConfigError, match="whole number from 1"):
        read_drive(board_drive[1], detector=DetectorOptions(model, every, threshold))


def test_methods_that_need_feet_are_refused(
    board_drive: tuple[Any, Path], model: Path, tmp_path: Path
) -> None:
    """A face hangs above the ground: what cuts rays with it has no use for boxes."""
    with (
        Store.open(tmp_path / "twin.db") as store,
        pytest.raises(ConfigError, match="only --method adjusted"),
    ):
        ingest_drive(store, board_drive[1], method="single-frame", detector=DetectorOptions(model))


def test_command_runs_the_detector(
    board_drive: tuple[Any, Path], model: Path, twin: Twin, tmp_path: Path
) -> None:
    """``twin ingest-drive --detector`` ends with two estimates, and tells its progress if asked."""
    answer = twin(
        *("--verbose", "ingest-drive", board_drive[1], "--detector", model, "--detector-every", 4),
        *("--store", tmp_path / "twin.db"),
    )
    assert answer.code == 0
    assert "2 of 2" in answer.out
    assert "frames/s" in answer.err


def test_command_without_the_model_says_so(board_drive: tuple[Any, Path], tmp_path: Path) -> None:
    """A name that is no file is bad data, and leaves no store behind."""
    arguments = ["ingest-drive", str(board_drive[1]), "--detector", str(tmp_path / "no.onnx")]
    assert run([*arguments, "--store", str(tmp_path / "twin.db")]) == 4
    assert not (tmp_path / "twin.db").exists()


def test_images_of_another_size_are_counted(
    model: Path, board_drive: tuple[Any, Path], tmp_path: Path
) -> None:
    """One thumbnail among the images of a camera is left out; the others are looked at."""
    import cv2

    folder = Path(shutil.copytree(board_drive[1], tmp_path / "drive"))
    (folder / "pictures").mkdir()
    for i in range(20, 32):
        image = board_drive[0].picture(i)[:, :, ::-1]
        image = cv2.resize(image, (160, 100)) if i == 25 else image
        name = f"{1_781_078_400_000 + round(i * 1000 / 15)}.png"
        assert cv2.imwrite(str(folder / "pictures" / name), image)
    text = (folder / "drive.toml").read_text().partition("[frames.front]")[0]
    (folder / "drive.toml").write_text(f'{text}[frames]\nfront = "pictures/"\n')
    drive = read_drive(folder, detector=DetectorOptions(model))
    assert counts(drive.skipped) == {"picture of another size than the camera's": 1}
    assert sorted(set(drive.annotations.frame)) == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
