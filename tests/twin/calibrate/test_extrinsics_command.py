"""``twin calibrate extrinsics``: from pictures of tags to a rig file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from checkout import ROOT
from command_line import Twin
from scipy.spatial.transform import Rotation

from geoloc.rig.rig import read_rig
from geoloc.simulation.car import simulated_rig
from geoloc.simulation.pictures.render import Plane, render_planes
from geoloc.simulation.pictures.yard import draw_yard, seen_tags, yard_picture
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.camera_files import new_rig_document, rig_text
from twin.calibrate.extrinsics.example import write_yard
from twin.calibrate.extrinsics.layout import FIRST_BOARD, read_layout
from twin.calibrate.extrinsics.tag_corners import find_tags

pytestmark = pytest.mark.usefixtures("unarranged")


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rendered yard, its layout, the drawn and the true rig."""
    folder = tmp_path_factory.mktemp("yard") / "yard"
    write_yard(folder, seed=2)
    return folder


def arguments(yard: Path, out: Path, **instead: Path) -> list[object]:
    """The worked example's own command, with other `pictures`, `tags` or `rig`."""
    files = {"pictures": yard / "pictures", "tags": yard / "layout.toml", "rig": yard / "drawn_rig.json"}
    files |= instead
    pictures = files.pop("pictures")
    options = [word for name, path in files.items() for word in (f"--{name}", path)]
    return ["calibrate", "extrinsics", pictures, *options, "--out", out]


def test_corners_by_edges_are_found_to_hundredths_of_a_pixel() -> None:
    """Refined corners of rendered tags are off by less than 0.06 px, without bias."""
    rng = np.random.default_rng(1)
    tags, camera = draw_yard(rng), simulated_rig().cameras["C3_tricam120"]
    found = find_tags(yard_picture(tags, camera, rng), camera.model)
    true = seen_tags(tags, camera, rng, sigma_px=0.0)
    rows = [true.tag_ids.tolist().index(tag) for tag in found.ids.tolist()]
    error = (found.corners_px - true.corners_px[rows]).reshape(-1, 2)
    assert len(found.ids) >= 12
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert np.abs(error.mean(axis=0)).max() < 0.02


def test_worked_example_finds_the_true_rig(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """A drawn rig that is a degree off becomes true to 0.03° and 5 mm, and sigmas say so."""
    answer = twin(*arguments(yard, tmp_path / "out"), "--json")
    assert answer.code == 0, answer.err
    found, true = read_rig(tmp_path / "out" / "rig.json"), read_rig(yard / "true_rig.json")
    for row in answer.json["cameras"]:
        mine, right = found.cameras[row["camera"]], true.cameras[row["camera"]]
        turn = Rotation.from_matrix(mine.rig_R_camera @ right.rig_R_camera.T).as_rotvec()
        assert np.abs(np.degrees(turn)).max() < 0.03
        assert np.abs(mine.rig_t_camera_m - right.rig_t_camera_m).max() < 0.005
        assert max(row["sigma_deg"]) < 0.02
    assert answer.json["doubts"] == []
    assert (tmp_path / "out" / "extrinsics.png").read_bytes().startswith(b"\x89PNG")


def test_written_rig_keeps_what_twin_does_not_know(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """Keys and sensors of other programs come through the new rig file unchanged.

    The table names every camera with its sigmas; a tag that the layout lacks is told.
    """
    document = json.loads((yard / "drawn_rig.json").read_text())
    document["rig"]["vehicle"] = {"valid": True, "value": {"body": {"length": 4.87}}}
    document["rig"]["sensors"][0]["calibrated-by"] = "someone"
    document["rig"]["sensors"].append({"name": "lidar", "protocol": "lidar.virtual"})
    rig, layout = tmp_path / "rig.json", tmp_path / "layout.toml"
    rig.write_text(json.dumps(document))
    layout.write_text((yard / "layout.toml").read_text().replace("id = 10\n", "id = 400\n"))
    answer = twin(*arguments(yard, tmp_path / "out", rig=rig, tags=layout))
    assert answer.code == 0
    assert "C3_tricam120" in answer.out
    assert "tag 10 is not in the layout" in answer.err
    written = json.loads((tmp_path / "out" / "rig.json").read_text())
    assert written["rig"]["vehicle"] == document["rig"]["vehicle"]
    assert written["rig"]["sensors"][0]["calibrated-by"] == "someone"
    assert written["rig"]["sensors"][-1] == document["rig"]["sensors"][-1]


@pytest.mark.slow
def test_camera_that_is_blurred_is_named(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """A picture blurred by 3 px is told by the width of its edges, whatever its residuals are."""
    pictures = tmp_path / "pictures"
    shutil.copytree(yard / "pictures", pictures)
    path = pictures / "C1_front60Single.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(path), cv2.GaussianBlur(image, (0, 0), 3.0))
    answer = twin(*arguments(yard, tmp_path / "out", pictures=pictures), "--json")
    assert answer.code == 0, answer.err
    (told,) = (doubt for doubt in answer.json["doubts"] if "is blurred: the tags' edges are" in doubt)
    assert told.startswith("C1_front60Single.png")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("mirrored", "shows its tags mirrored"),
        ("size", "give pictures in the camera's own size"),
        ("name", "names no camera of the rig"),
        ("damaged", "cannot be read as a picture"),
        ("empty", "There are no pictures"),
    ],
)
def test_bad_pictures_are_refused_in_one_sentence(
    yard: Path, tmp_path: Path, twin: Twin, change: str, told: str
) -> None:
    """A picture that cannot be used ends the command with what, where and the cure, and writes nothing."""
    pictures = tmp_path / "pictures"
    shutil.copytree(yard / "pictures", pictures)
    path = pictures / "C3_tricam120.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if change == "mirrored":
        cv2.imwrite(str(path), image[:, ::-1])
    elif change == "size":
        cv2.imwrite(str(path), image[::2, ::2])
    elif change == "name":
        path.rename(pictures / "front.png")
    elif change == "damaged":
        path.write_bytes(b"not a picture")
    else:
        shutil.rmtree(pictures)
        pictures.mkdir()
    answer = twin(*arguments(yard, tmp_path / "out", pictures=pictures))
    assert answer.code == 4 or (change in ("name", "empty") and answer.code == 2), answer.err
    assert told in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("size_m = 0.6\n", "names no tag"),
        ("free = [1]\n", "gives tag 1 no size"),
        ("size_m = 0.6\nfree = [1]\nfloor = [1]\n", "names tag 1 twice"),
        ("size_m = 0.6\nfree = [900]\n", "ids of the family 36h11 are 0 to 586"),
        ("size_m = -1\nfree = [1]\n", "must be metres, above 0"),
        ("size_m = 0.6\n[[tag]]\nid = 1\ncenter = [1, 2, 3]\n", "the nearest known one is centre"),
        ("size_m = 0.6\n[[tag]]\nid = 1\ncentre = [1, 2]\n", "it must be [x, y, z]"),
        ('size_m = 0.6\n[[board]]\nboard = "9x6"\n', "describe the ChArUco board"),
        ("size_m = \n", "is not valid TOML"),
        ("floor = 3\n", "it must be a list of tag ids"),
        ("size_m = 0.6\n[[tag]]\nid = 1\ncentre = [1, 2, 3]\nz = 1\n", "both centre and x, y or z"),
        ("size_m = 0.6\n[[tag]]\nid = 1\ntop_left = [1, 2]\n", "it must be [x, y, z]"),
        (2 * '[[board]]\nboard = "charuco:8x6:0.3:0.2"\n', "which pictures cannot tell apart"),
    ],
)
def test_bad_layouts_are_refused_in_one_sentence(
    yard: Path, tmp_path: Path, twin: Twin, text: str, told: str
) -> None:
    """A layout that cannot be meant is refused with the key and the cure."""
    (tmp_path / "layout.toml").write_text(text)
    answer = twin(*arguments(yard, tmp_path / "out", tags=tmp_path / "layout.toml"))
    assert answer.code == 4
    assert told in answer.err.replace("\n", " ")


def test_layout_of_the_documentation_is_read() -> None:
    """What docs/camera-mounting.md shows is a layout, every line of it."""
    text = (ROOT / "docs" / "camera-mounting.md").read_text(encoding="utf-8")
    layout = read_layout(
        text.split("`layout.toml` says what was measured:\n```toml\n")[1].split("```")[0].encode(),
        "layout.toml",
    )
    assert sorted(layout.tags) == [1, 2, 20, 21, 22, 30, 31, FIRST_BOARD]
    assert len(layout.tags[FIRST_BOARD].marks_m) == 3
    assert layout.tags[FIRST_BOARD].marks_m[0].tolist() == pytest.approx([-1.28, -0.96, 0.0])
    assert layout.tags[2].mark_places_m.tolist() == [[7.10, 0.31, 1.25]]


def test_layout_that_settles_no_camera_is_refused(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """One tag settles no camera: refused with what is open of each, and nothing is written."""
    (tmp_path / "layout.toml").write_text("size_m = 0.6\n[[tag]]\nid = 9\ncentre = [8.93, -1.02, 1.36]\n")
    answer = twin(*arguments(yard, tmp_path / "out", tags=tmp_path / "layout.toml"))
    assert answer.code == 4
    assert "No camera was calibrated" in answer.err
    assert "C3_tricam120: roll, pitch, yaw, x, y, z are not determined" in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_camera_that_is_left_open_stays_as_it_was(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """A camera that sees one tag, and no other does, is shown as open; its entry in the rig is kept."""
    shutil.copytree(yard / "pictures", tmp_path / "pictures")
    alone = None
    for name, camera in read_rig(yard / "true_rig.json").cameras.items():
        path = tmp_path / "pictures" / f"{name}.png"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        tags = find_tags(image, camera.model)
        alone = int(tags.ids[0]) if alone is None else alone
        for tag, corners in zip(tags.ids.tolist(), tags.corners_px, strict=True):
            # The first camera keeps that tag alone, the others all but it.
            if (tag == alone) == (name != "C1_front60Single"):
                (left, top), (right, bottom) = (
                    corners.min(axis=0).astype(int),
                    corners.max(axis=0).astype(int),
                )
                image[top : bottom + 1, left : right + 1] = 150
        cv2.imwrite(str(path), image)
    answer = twin(*arguments(yard, tmp_path / "out", pictures=tmp_path / "pictures"))
    assert answer.code == 0, answer.err
    assert "open" in answer.out
    assert "C1_front60Single: " in answer.err
    assert " not determined" in answer.err
    assert "C1_front60Single: not calibrated, and in rig.json as before" in answer.err
    before, after = (json.loads(p.read_text()) for p in (yard / "drawn_rig.json", tmp_path / "out/rig.json"))
    assert after["rig"]["sensors"][0] == before["rig"]["sensors"][0]
    assert after["rig"]["sensors"][1] != before["rig"]["sensors"][1]


BOARD = "charuco:8x6:0.32:0.24"
FLAT = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
MIDDLE = np.array([5.5, 0.1, 0.0])
CORNERS = "top_left = [6.46, 1.38, 0]\ntop_right = [6.46, -1.18, 0]\nbottom_right = [4.54, -1.18, 0]\n"


def board_on_floor(
    twin: Twin, folder: Path, places: str, *, sagitta_m: float = 0.0, stated: str = BOARD, step: int = 1
) -> Any:
    """Calibrate the wide camera, of whose place nothing is known, by a board that lies ahead of the car.

    The layout states a board; a step of -1 flips the picture.
    """
    board, camera = board_from_text(BOARD), simulated_rig().cameras["C3_tricam120"]
    texture, size = board.texture()
    corner = MIDDLE + FLAT @ [-size[0] / 2.0, -size[1] / 2.0, 0.0]
    pose = (camera.rig_R_camera.T @ FLAT, camera.rig_R_camera.T @ (corner - camera.rig_t_camera_m))
    plane = Plane(texture, size, *pose, sagitta_m)
    (folder / "pictures").mkdir()
    picture = render_planes(camera.model, [plane], rng=np.random.default_rng(0))
    cv2.imwrite(str(folder / "pictures" / "C3_tricam120.png"), picture[:, ::step])
    layout = f'floor_sigma_m = 0.001\n[[board]]\nboard = "{stated}"\nfloor = true\nsigma_m = 0.001\n{places}'
    (folder / "layout.toml").write_text(layout)
    (folder / "rig.json").write_text(rig_text(new_rig_document({"C3_tricam120": camera.model})))
    return twin(
        *("calibrate", "extrinsics", folder / "pictures", "--tags", folder / "layout.toml"),
        *("--rig", folder / "rig.json", "--out", folder / "out", "--json"),
    )


@pytest.mark.slow
def test_board_on_the_floor_with_its_corners_is_enough(tmp_path: Path, twin: Twin) -> None:
    """A ChArUco board on the ground, three of its corners measured: the camera to 0.02° and 2 mm."""
    answer = board_on_floor(twin, tmp_path, CORNERS)
    assert answer.code == 0, answer.err
    mine = read_rig(tmp_path / "out" / "rig.json").cameras["C3_tricam120"]
    right = simulated_rig().cameras["C3_tricam120"]
    turn = Rotation.from_matrix(mine.rig_R_camera @ right.rig_R_camera.T).as_rotvec()
    assert np.abs(np.degrees(turn)).max() < 0.02
    assert np.abs(mine.rig_t_camera_m - right.rig_t_camera_m).max() < 0.002
    assert answer.json["doubts"] == []


def test_board_on_the_floor_without_its_corners_leaves_yaw_open(tmp_path: Path, twin: Twin) -> None:
    """A board of which the middle alone was measured settles no yaw: refused, and nothing is written."""
    answer = board_on_floor(twin, tmp_path, "centre = [5.5, 0.1, 0.0]\n")
    assert answer.code == 4
    assert "C3_tricam120: yaw, x, y are not determined" in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_bent_board_on_the_floor_is_named(tmp_path: Path, twin: Twin) -> None:
    """A board whose middle lies a centimetre lower than its edges is told as bent, by its description."""
    answer = board_on_floor(twin, tmp_path, CORNERS, sagitta_m=0.01)
    assert answer.code == 0, answer.err
    (told,) = (text for text in answer.json["doubts"] if " is bent by " in text)
    assert told.startswith(f"The board {BOARD}:DICT_5X5_250 is bent by ")
    # Off the plane through its inner corners, which reach 0.67 of the way to the print's edges.
    assert 1.5 < float(told.split(" is bent by ")[1].split(" mm")[0]) < 5.0


def test_board_of_another_size_is_named_with_its_factor(tmp_path: Path, twin: Twin) -> None:
    """Squares of 0.32 m that the layout says are 0.31 are told as 3.2 % larger, by the measured corners."""
    answer = board_on_floor(twin, tmp_path, CORNERS, stated="charuco:8x6:0.31:0.2325")
    assert answer.code == 0, answer.err
    (told,) = answer.json["doubts"]
    assert told.startswith("The tags seem 3.2 % larger than the layout says")
    mine = read_rig(tmp_path / "out" / "rig.json").cameras["C3_tricam120"]
    right = simulated_rig().cameras["C3_tricam120"]
    assert np.abs(mine.rig_t_camera_m - right.rig_t_camera_m).max() < 0.002


def test_mirrored_board_is_named(tmp_path: Path, twin: Twin) -> None:
    """A flipped picture of a board is refused as mirrored, and nothing is written."""
    answer = board_on_floor(twin, tmp_path, CORNERS, step=-1)
    assert answer.code == 4
    assert "shows its tags mirrored" in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_rig_without_poses_is_a_start(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """Cameras of a rig file that says nothing of where they sit are found from the tags alone."""
    document = json.loads((yard / "drawn_rig.json").read_text())
    for sensor in document["rig"]["sensors"]:
        if sensor["protocol"].startswith("camera"):
            del sensor["nominalSensor2Rig_FLU"]
    (tmp_path / "rig.json").write_text(json.dumps(document))
    answer = twin(*arguments(yard, tmp_path / "out", rig=tmp_path / "rig.json"), "--json")
    assert answer.code == 0, answer.err
    assert all(camera["moved_m"] is None for camera in answer.json["cameras"])
    found, true = read_rig(tmp_path / "out" / "rig.json"), read_rig(yard / "true_rig.json")
    for name, camera in true.cameras.items():
        assert np.abs(found.cameras[name].rig_t_camera_m - camera.rig_t_camera_m).max() < 0.005


def test_one_camera_takes_only_the_pictures_that_name_it(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """Pictures of other cameras in the folder are left out by name where one names the rig's only camera."""
    document = json.loads((yard / "drawn_rig.json").read_text())
    sensors = document["rig"]["sensors"]
    document["rig"]["sensors"] = [s for s in sensors if s["name"] == "C3_tricam120"]
    (tmp_path / "rig.json").write_text(json.dumps(document))
    answer = twin(*arguments(yard, tmp_path / "out", rig=tmp_path / "rig.json"), "--json")
    assert answer.code == 0, answer.err
    assert [camera["camera"] for camera in answer.json["cameras"]] == ["C3_tricam120"]
    assert any(
        text.startswith("C1_front60Single.png, C2_tricam60.png: left") for text in answer.json["notes"]
    )
    assert answer.json["doubts"] == []
