"""``twin calibrate extrinsics``: from pictures of tags to a rig file."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoloc.rig import read_rig
from geoloc.simulation.car import simulated_rig
from geoloc.simulation.yard import draw_yard, seen_tags, yard_picture
from twin.calibrate.example_yard import write_yard
from twin.calibrate.tag_corners import find_tags

Twin = Callable[..., Any]


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rendered yard, its layout, the drawn and the true rig."""
    folder = tmp_path_factory.mktemp("yard") / "yard"
    write_yard(folder, seed=2)
    return folder


def arguments(yard: Path, out: Path) -> list[object]:
    """The worked example's own command."""
    return [
        *("calibrate", "extrinsics", yard / "pictures", "--tags", yard / "layout.toml"),
        *("--rig", yard / "drawn_rig.json", "--out", out),
    ]


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
    """Keys and sensors of other programs come through the new rig file unchanged."""
    document = json.loads((yard / "drawn_rig.json").read_text())
    document["rig"]["vehicle"] = {"valid": True, "value": {"body": {"length": 4.87}}}
    document["rig"]["sensors"][0]["calibrated-by"] = "someone"
    document["rig"]["sensors"].append({"name": "lidar", "protocol": "lidar.virtual"})
    (tmp_path / "rig.json").write_text(json.dumps(document))
    command = arguments(yard, tmp_path / "out")
    command[command.index("--rig") + 1] = tmp_path / "rig.json"
    assert twin(*command).code == 0
    written = json.loads((tmp_path / "out" / "rig.json").read_text())
    assert written["rig"]["vehicle"] == document["rig"]["vehicle"]
    assert written["rig"]["sensors"][0]["calibrated-by"] == "someone"
    assert written["rig"]["sensors"][-1] == document["rig"]["sensors"][-1]


def test_table_and_warnings_say_what_was_found(yard: Path, tmp_path: Path, twin: Twin) -> None:
    """The table names every camera with its sigmas; a tag that the layout lacks is told."""
    text = (yard / "layout.toml").read_text()
    (tmp_path / "layout.toml").write_text(text.replace("id = 10\n", "id = 400\n"))
    command = arguments(yard, tmp_path / "out")
    command[command.index("--tags") + 1] = tmp_path / "layout.toml"
    answer = twin(*command)
    assert answer.code == 0
    assert "C3_tricam120" in answer.out
    assert "tag 10 is not in the layout" in answer.err


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
    command = arguments(yard, tmp_path / "out")
    command[2] = pictures
    answer = twin(*command)
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
    ],
)
def test_bad_layouts_are_refused_in_one_sentence(
    yard: Path, tmp_path: Path, twin: Twin, text: str, told: str
) -> None:
    """A layout that cannot be meant is refused with the key and the cure."""
    (tmp_path / "layout.toml").write_text(text)
    command = arguments(yard, tmp_path / "out")
    command[command.index("--tags") + 1] = tmp_path / "layout.toml"
    answer = twin(*command)
    assert answer.code == 2
    assert told in answer.err.replace("\n", " ")


def test_board_on_the_floor_stands_in_for_tags(tmp_path: Path, twin: Twin) -> None:
    """A ChArUco board of known place among the tags is used like one of them."""
    from geoloc.calibration.extrinsics.observed import Pose
    from geoloc.simulation.render import Plane, render_planes
    from twin.calibrate.boards import board_from_text

    board, rig = board_from_text("charuco:8x6:0.25:0.18"), simulated_rig()
    texture, size = board.texture()
    flat = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    middle = np.array([5.0, 0.1, 0.0])
    corner = Pose(flat, middle).t_m + flat @ [-size[0] / 2.0, -size[1] / 2.0, 0.0]
    (tmp_path / "pictures").mkdir()
    rng = np.random.default_rng(0)
    for camera in rig.cameras.values():
        pose = (
            camera.rig_R_camera.T @ flat,
            camera.rig_R_camera.T @ (corner - camera.rig_t_camera_m),
        )
        picture = render_planes(camera.model, [Plane(texture, size, *pose)], rng=rng)
        cv2.imwrite(str(tmp_path / "pictures" / f"{camera.name}.png"), picture)
    (tmp_path / "layout.toml").write_text(
        'floor_sigma_m = 0.001\n[[board]]\nboard = "charuco:8x6:0.25:0.18"\nfloor = true\n'
        "centre = [5.0, 0.1, 0.0]\nsigma_m = 0.001\n"
    )
    write_yard(tmp_path / "yard", seed=1)
    answer = twin(
        *("calibrate", "extrinsics", tmp_path / "pictures", "--tags", tmp_path / "layout.toml"),
        *("--rig", tmp_path / "yard" / "drawn_rig.json", "--out", tmp_path / "out", "--json"),
    )
    assert answer.code == 0, answer.err
    wide = next(c for c in answer.json["cameras"] if c["camera"] == "C3_tricam120")
    true = read_rig(tmp_path / "yard" / "true_rig.json").cameras["C3_tricam120"]
    # One board tells how the camera stands over it; which way the board lies on the floor nobody measured.
    assert wide["position_m"][2] == pytest.approx(true.rig_t_camera_m[2], abs=0.01)
    assert any("yaw" in text for text in answer.json["doubts"])
