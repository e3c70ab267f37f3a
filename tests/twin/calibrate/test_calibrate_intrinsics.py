"""``twin calibrate intrinsics``: from rendered pictures to a rig file, and what it says of bad pictures."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command_line import Twin

from geoloc.calibration.intrinsics import angle_between
from geoloc.calibration_files import read_cameras
from geoloc.cameras import FThetaCamera
from geoloc.errors import CalibrationError
from geoloc.rig.rig import read_rig
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.intrinsics.calibrate import Calibrated, calibrate_intrinsics
from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, EXAMPLE_CAMERA, example_camera, rendered
from twin.cli import run as run_twin


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pictures of docs/calibration.md, fewer of them."""
    folder = tmp_path_factory.mktemp("example") / "board"
    assert run_twin(["calibrate", "example", str(folder), "--pictures", "8"]) == 0
    return folder


@pytest.fixture(scope="module")
def calibrated(example: Path) -> Path:
    """What the command of docs/calibration.md writes of them."""
    out = example.parent / "calibrated"
    options = ["--board", EXAMPLE_BOARD, "--camera", EXAMPLE_CAMERA, "--out", str(out)]
    assert run_twin(["calibrate", "intrinsics", str(example / "pictures"), *options]) == 0
    return out


@pytest.fixture(scope="module")
def report(calibrated: Path) -> Any:
    """Its report."""
    return json.loads((calibrated / EXAMPLE_CAMERA / "report.json").read_text(encoding="utf-8"))


def copied(
    example: Path, folder: Path, change: Callable[[int, np.ndarray], np.ndarray], n: int | None = None
) -> Path:
    """The first n pictures, or all, each changed."""
    folder.mkdir()
    for number, path in enumerate(sorted((example / "pictures").iterdir())[:n]):
        cv2.imwrite(str(folder / path.name), change(number, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)))
    return folder


def save(folder: Path, board: Board, n: int, **options: Any) -> Path:
    """Render pictures into a folder."""
    folder.mkdir()
    made = rendered(example_camera(), board, n, np.random.default_rng(2), **options)
    for number, picture in enumerate(made):
        cv2.imwrite(str(folder / f"{number:02d}.png"), picture)
    return folder


def run(twin: Twin, pictures: Path, *options: object) -> Any:
    """The command on a folder of pictures."""
    arguments = ("--board", EXAMPLE_BOARD, "--out", pictures.parent / "out", "--model", "ftheta", *options)
    return twin("calibrate", "intrinsics", pictures, *arguments)


def faults(made: Calibrated) -> dict[str, str]:
    """Kind → sentence."""
    return {fault.kind: fault.sentence for fault in made.faults}


def test_example_is_calibrated_to_the_lens_it_was_rendered_by(calibrated: Path, example: Path) -> None:
    """From pictures to rig.json: rays within 0.03 degrees of the true ones where boards were seen."""
    true = read_rig(example / "true_rig.json").camera(EXAMPLE_CAMERA).model
    ours = read_rig(calibrated / "rig.json").camera(EXAMPLE_CAMERA).model
    assert isinstance(ours, FThetaCamera)
    assert true == example_camera()
    u, v = np.meshgrid(np.arange(200.0, 760.0, 40.0), np.arange(120.0, 480.0, 40.0))
    pixel = np.stack([u, v], axis=-1)
    off = angle_between(true.camera_ray_from_pixel(pixel)[0], ours.camera_ray_from_pixel(pixel)[0])
    assert np.degrees(off).max() < 0.03


def test_report_states_parameters_with_sigmas_that_hold_the_truth(report: Any) -> None:
    """The true principal point lies within four stated sigmas, and auto takes the lens's own family."""
    assert report["model"] == "ftheta, degree 4"
    values = {p["name"]: (p["value"], p["sigma"]) for p in report["parameters"]}
    for name, true in (("cx_px", example_camera().cx_px), ("cy_px", example_camera().cy_px)):
        value, sigma = values[name]
        assert abs(value - true) < 4.0 * sigma < 0.5
    assert report["residuals"]["sigma_px"] < 0.06
    # The families, and those whose pixels may be stretched or sheared.
    assert len(report["models"]) == 8
    assert sum(m["chosen"] for m in report["models"]) == 1
    assert len(report["residuals_over_the_image"]) == 9
    assert 0.3 < report["coverage"]["part_of_the_image"] < 1.0


def test_all_files_are_written_and_read_back(calibrated: Path, report: Any) -> None:
    """Rig, OpenCV, Kalibr and OCamCalib files hold cameras that agree in the middle of the image."""
    own = calibrated / EXAMPLE_CAMERA
    files = {"opencv.yaml", "kalibr.yaml", "mrcal.cameramodel", "ocamcalib.txt", "report.json", "report.md"}
    files |= {"residuals.png", "coverage.png", "curve.png", "metres.png"}
    assert {path.name for path in calibrated.iterdir()} == {"rig.json", EXAMPLE_CAMERA}
    assert {path.name for path in own.iterdir()} == files
    pixel = np.array([[480.0, 300.0], [600.0, 200.0]])
    true, _ = example_camera().camera_ray_from_pixel(pixel)
    for name in ("../rig.json", "opencv.yaml", "kalibr.yaml", "mrcal.cameramodel", "ocamcalib.txt"):
        (camera,) = read_cameras((own / name).read_bytes(), name).values()
        off = angle_between(camera.model.camera_ray_from_pixel(pixel)[0], true)
        assert np.degrees(off).max() < 0.05, name
    for name in ("residuals.png", "coverage.png", "curve.png"):
        picture = cv2.imread(str(own / name))
        assert picture.shape[1] > 600
        assert picture.std() > 10.0
    text = (own / "report.md").read_text(encoding="utf-8")
    assert "Nothing is vouched for outside" in text
    assert report["files"]["rig.json"] == "ftheta, degree 4"


@pytest.mark.slow
def test_rig_keeps_all_but_the_camera(twin: Twin, example: Path, tmp_path: Path) -> None:
    """--rig writes the rig again with new intrinsics: unknown keys, other sensors and bw-poly stay.

    Without --json there are tables on stdout, and each fault is one sentence on stderr; a report that was
    there is set aside and told, since it may have been one half of a comparison.
    """
    document = json.loads((example / "true_rig.json").read_text(encoding="utf-8"))
    (sensor,) = document["rig"]["sensors"]
    polynomial = sensor["properties"].pop("polynomial")
    for key in ("polynomial-type", "linear-c", "linear-d", "linear-e"):
        sensor["properties"].pop(key)
    sensor["properties"] |= {"bw-poly": polynomial, "serial": "42"}
    sensor["note"] = {"by": "hand"}
    document["rig"]["sensors"].append({"name": "can", "protocol": "can.virtual", "properties": None})
    rig, pictures, out = (tmp_path / name for name in ("rig.json", "pictures", "out"))
    rig.write_text(json.dumps(document), encoding="utf-8")
    pictures.mkdir()
    for path in sorted((example / "pictures").iterdir())[:6]:
        shutil.copy(path, pictures)
    (out / EXAMPLE_CAMERA).mkdir(parents=True)
    (out / EXAMPLE_CAMERA / "report.json").write_text("{}")
    (out / f"{EXAMPLE_CAMERA}.1").mkdir()
    answer = run(twin, pictures, "--rig", rig, "--camera", EXAMPLE_CAMERA)
    assert answer.code == 0
    assert "cx_px" in answer.out
    assert "report.md" in answer.out
    assert "Only 6 views were used: take 10 or more" in answer.err
    assert f"its files are in {EXAMPLE_CAMERA}.2 now" in " ".join(answer.err.split())
    assert (out / f"{EXAMPLE_CAMERA}.2" / "report.json").read_text() == "{}"
    written = json.loads((out / "rig.json").read_text(encoding="utf-8"))
    new = written["rig"]["sensors"][0]
    assert set(new["properties"]) == set(sensor["properties"])
    assert new["properties"]["bw-poly"] != polynomial
    assert new["properties"]["serial"] == "42"
    new["properties"] = sensor["properties"]
    assert written == document


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "C9"}, "There is no camera C3_tricam120 in"),
        (
            {"properties": {"width": "1920", "height": "1208"}},
            "has 1920 x 1208 pixels, the pictures have 960 x 604",
        ),
    ],
)
def test_rig_that_does_not_fit_is_refused(
    twin: Twin, example: Path, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    """Another camera's name or another image size: nothing is written."""
    document = json.loads((example / "true_rig.json").read_text(encoding="utf-8"))
    document["rig"]["sensors"][0] |= change
    rig, pictures = tmp_path / "rig.json", tmp_path / "pictures"
    rig.write_text(json.dumps(document), encoding="utf-8")
    shutil.copytree(example / "pictures", pictures)
    answer = run(twin, pictures, "--rig", rig, "--camera", EXAMPLE_CAMERA)
    assert answer.code == 4
    assert message in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_mirrored_pictures_are_named(example: Path, tmp_path: Path) -> None:
    """A camera that mirrors its pictures is found out by the markers."""
    pictures = copied(example, tmp_path / "pictures", lambda _n, picture: picture[:, ::-1], n=3)
    with pytest.raises(CalibrationError, match=r"The pictures are mirrored: board_01\.png shows"):
        calibrate_intrinsics([pictures], EXAMPLE_BOARD)


def test_blurred_view_is_left_out_by_name(example: Path, tmp_path: Path) -> None:
    """One picture taken while the board moved is left out, and the report says how blurred it is."""

    def blur(number: int, picture: np.ndarray) -> np.ndarray:
        return cv2.blur(picture, (7, 1)) if number == 4 else picture

    pictures = copied(example, tmp_path / "pictures", blur)
    left_out = calibrate_intrinsics([pictures], EXAMPLE_BOARD, model="ftheta").intrinsics.left_out
    assert list(left_out) == ["board_05.png"]
    assert "blurred: its edges are" in left_out["board_05.png"]


def test_pictures_without_a_board_are_named_with_the_reason(example: Path, tmp_path: Path) -> None:
    """Of eight pictures one is mirrored and two are blurred: each is named, with why it was left out."""

    def spoilt(number: int, picture: np.ndarray) -> np.ndarray:
        if number == 2:
            return picture[:, ::-1]
        return cv2.GaussianBlur(picture, (0, 0), 3.5) if number in (4, 5) else picture

    pictures = copied(example, tmp_path / "pictures", spoilt)
    made = calibrate_intrinsics([pictures], EXAMPLE_BOARD, model="ftheta")
    assert made.intrinsics.left_out["board_03.png"].startswith("mirrored: ")
    assert made.intrinsics.left_out["board_05.png"].startswith("blurred: ")
    assert "1 of 8 pictures are mirrored (board_03.png)" in faults(made)["mirrored_pictures"]
    assert "2 of 8 pictures are blurred (board_05.png, board_06.png)" in faults(made)["blurred_pictures"]


def test_blur_is_named_before_squares_are_counted(example: Path, tmp_path: Path) -> None:
    """Where no board is found because all is blurred, the sentence says so."""
    pictures = copied(example, tmp_path / "pictures", lambda _n, p: cv2.GaussianBlur(p, (0, 0), 3.5), n=3)
    with pytest.raises(CalibrationError, match=r"in 0 of 3 pictures, and 3 are blurred \(board_01.png"):
        calibrate_intrinsics([pictures], EXAMPLE_BOARD)


@pytest.mark.slow
def test_copies_of_one_picture_are_too_similar(example: Path, tmp_path: Path) -> None:
    """Eight noisy copies of one picture are one view, and one view gives no camera."""
    one = cv2.imread(str(example / "pictures" / "board_02.png"), cv2.IMREAD_GRAYSCALE)
    rng = np.random.default_rng(0)

    def copy(_number: int, _picture: np.ndarray) -> np.ndarray:
        return np.clip(one + rng.normal(scale=2.0, size=one.shape), 0, 255).astype(np.uint8)

    pictures = copied(example, tmp_path / "pictures", copy)
    with pytest.raises(CalibrationError, match="too similar: 7 of 8 show the board just as another"):
        calibrate_intrinsics([pictures], EXAMPLE_BOARD)


@pytest.mark.slow
def test_blurred_camera_is_named(tmp_path: Path) -> None:
    """A camera out of focus is calibrated, and its blur named."""
    text = "checkerboard:9x6:0.08"
    pictures = save(tmp_path / "pictures", board_from_text(text), 6, blur_px=2.8, fill=(0.5, 0.7), inside=1.0)
    assert (
        "All pictures are blurred"
        in faults(calibrate_intrinsics([pictures], text, model="ftheta"))["blurred_camera"]
    )


@pytest.mark.slow
def test_wrong_square_size_of_a_charuco_board_is_named(example: Path) -> None:
    """Squares stated larger than they are do not fit the markers in the pictures."""
    made = calibrate_intrinsics([example / "pictures"], "charuco:12x9:0.08:0.045", model="ftheta")
    assert "by --board (0.045 m of 0.08 m) it is 0.56" in faults(made)["wrong_square_size"]


@pytest.mark.slow
def test_square_two_per_cent_off_is_named(tmp_path: Path) -> None:
    """Sharp pictures tell squares of 61.2 mm that are stated as 60 mm, and not those that are right."""
    pictures = save(tmp_path / "pictures", board_from_text("charuco:12x9:0.0612:0.045"), 6, blur_px=0.5)
    for stated, named in (("charuco:12x9:0.06:0.045", True), ("charuco:12x9:0.0612:0.045", False)):
        found = faults(calibrate_intrinsics([pictures], stated, model="ftheta"))
        assert ("wrong_square_size" in found) == named


def test_distance_tells_the_scale(example: Path, report: Any) -> None:
    """A measured distance names the right side of a square where the stated one is wrong."""
    view = report["views"][3]
    measured = {view["view"]: 1.5 * view["distance_m"]}
    made = calibrate_intrinsics([example / "pictures"], EXAMPLE_BOARD, model="ftheta", distances_m=measured)
    assert "they are rather 0.0900 m" in faults(made)["wrong_square_size"]


@pytest.mark.slow
def test_bent_board_is_named(tmp_path: Path) -> None:
    """Pictures of a board bent by 8 mm: the report says so, and by how much."""
    pictures = save(tmp_path / "pictures", board_from_text(EXAMPLE_BOARD), 8, sagitta_m=0.008)
    sentence = faults(calibrate_intrinsics([pictures], EXAMPLE_BOARD, model="ftheta"))["bent_board"]
    assert "The board is bent: its edges stand" in sentence
    assert "mm before its middle" in sentence


@pytest.mark.slow
def test_film_is_calibrated_from_its_frames(example: Path, tmp_path: Path) -> None:
    """A film of the board gives a camera; `every` says which frames are looked at."""
    path = tmp_path / "board.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (960, 604))
    for picture in sorted((example / "pictures").iterdir())[:5]:
        for _ in range(2):
            film.write(cv2.imread(str(picture)))
    film.release()
    made = calibrate_intrinsics([path], EXAMPLE_BOARD, model="ftheta", every=2)
    assert (made.n_pictures, made.n_found) == (5, 5)
    assert made.intrinsics.views[1] == "board.avi#2"


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (("--board", "charuco:5x5"), 2, "The board is given as charuco:5x5: write checkerboard:"),
        (("--board", EXAMPLE_BOARD, "--model", "brown"), 2, "There is no camera model brown"),
        (("--board", EXAMPLE_BOARD, "--distance", "2.5"), 2, "write PICTURE=METRES"),
        (("--board", EXAMPLE_BOARD, "--distance", "x.png=2.5"), 2, "in which the board was not found"),
        (("--board", EXAMPLE_BOARD, "--rig", "no.json"), 4, "Cannot read the rig file no.json"),
    ],
)
def test_wrong_options_are_one_sentence(
    twin: Twin, example: Path, tmp_path: Path, options: tuple[str, ...], code: int, message: str
) -> None:
    """What is wrong, where, and the cure; nothing is written."""
    answer = twin("calibrate", "intrinsics", example / "pictures", "--out", tmp_path / "out", *options)
    assert answer.code == code
    assert message in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_board_of_another_dictionary_is_not_found(twin: Twin, example: Path, tmp_path: Path) -> None:
    """However hard it is looked for: two pictures are enough to say so."""
    (tmp_path / "two").mkdir()
    for path in sorted((example / "pictures").iterdir())[:2]:
        shutil.copy(path, tmp_path / "two")
    board = ("--board", f"{EXAMPLE_BOARD}:DICT_7X7_250")
    answer = twin("calibrate", "intrinsics", tmp_path / "two", "--out", tmp_path / "out", *board)
    assert answer.code == 4
    assert "was found in 0 of 2 pictures, and 5 are" in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_example_refuses_a_folder_that_holds_something(twin: Twin, example: Path) -> None:
    """Pictures of another board are not mixed with those of the example."""
    answer = twin("calibrate", "example", example)
    assert answer.code == 5
    assert "is not an empty folder" in answer.err
