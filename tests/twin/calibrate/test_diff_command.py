"""``twin calibrate diff``: calibrations from different pictures, one that changed, one without covariance."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import Twin

from geoloc.earth.geodesy import rpy_from_rotation
from geoloc.rig.rig import FLU_R_RDF, Rig, rig_document
from geoloc.simulation.car import simulated_rig
from geoloc.simulation.pictures.yard import turned_camera
from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, EXAMPLE_CAMERA
from twin.cli import run


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two calibrations of the example's camera from different pictures."""
    folders = []
    for seed in (1, 2):
        root = tmp_path_factory.mktemp(f"fit{seed}")
        assert run(["calibrate", "example", str(root / "board"), "--seed", str(seed), "--pictures", "6"]) == 0
        options = ["--board", EXAMPLE_BOARD, "--camera", EXAMPLE_CAMERA, "--model", "ftheta"]
        pictures = str(root / "board" / "pictures")
        assert run(["calibrate", "intrinsics", pictures, *options, "--out", str(root / "out")]) == 0
        folders.append(root / "out")
    return folders[0], folders[1]


@pytest.mark.slow
def test_two_calibrations_of_one_lens_agree(fits: tuple[Path, Path], twin: Twin, tmp_path: Path) -> None:
    """Different pictures, one lens: the verdict is that they agree, in one sentence and in a picture."""
    plot = tmp_path / "diff.png"
    answer = twin("calibrate", "diff", *fits, "--plot", plot, "--json", "--exit-code")
    assert answer.code == 0, answer.err
    (camera,) = answer.json["cameras"]
    assert camera["lens"]["verdict"] == "agree"
    assert 0.2 < camera["lens"]["in_sigmas"] < 2.5
    assert camera["lens"]["largest_deg"] < 0.02
    assert 0.2 < camera["lens"]["part_compared"] < 1.0
    assert camera["mounting"] is None
    assert "the lenses agree" in camera["sentence"]
    assert cv2.imread(str(plot)).std() > 10.0
    assert (fits[0] / EXAMPLE_CAMERA / "metres.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_lens_that_changed_differs_by_that_much(
    fits: tuple[Path, Path], twin: Twin, tmp_path: Path
) -> None:
    """A lens 0.2 % longer is told as most of a tenth of a degree at the edge, and exit code 1."""
    changed = tmp_path / "changed"
    shutil.copytree(fits[1], changed)
    path = changed / EXAMPLE_CAMERA / "report.json"
    document = json.loads(path.read_text())
    for parameter in document["parameters"][2:]:
        parameter["value"] *= 1.002
    path.write_text(json.dumps(document))
    report = "calibrate", "diff", fits[0] / EXAMPLE_CAMERA / "report.json", path
    assert twin(*report).code == 0
    answer = twin(*report, "--exit-code")
    assert answer.code == 1
    assert re.search(r"the lenses differ by 0\.0[4-9]\d+° .* at the (top|bottom)? ?(left|right)", answer.out)
    assert "fewer than 1 of 100,000" in answer.out
    # The rig beside it has the old lens: a report that is not of it gives no covariance.
    answer = twin("calibrate", "diff", fits[0], changed, "--json")
    assert answer.json["cameras"][0]["lens"]["verdict"] == "not_judged"


def test_files_without_covariance_are_compared_without_a_verdict(fits: tuple[Path, Path], twin: Twin) -> None:
    """Against a rig file alone the difference is told in degrees, pixels and metres, and why not more."""
    kept = fits[0] / EXAMPLE_CAMERA / "report.json"
    answer = twin("calibrate", "diff", kept, fits[1].parent / "board" / "true_rig.json", "--exit-code")
    assert answer.code == 0
    assert "the lenses part by 0.0" in answer.out
    assert "nothing says whether chance explains" in answer.err


def mounted(folder: Path, rig: Rig, sigma_deg: float) -> Path:
    """A rig and, beside it, `extrinsics.json` with angles known to `sigma_deg` and places to 1 mm."""
    folder.mkdir()
    (folder / "rig.json").write_text(json.dumps(rig_document(rig)))
    cameras = [
        {
            "camera": name,
            "roll_pitch_yaw_deg": rpy_from_rotation(camera.rig_R_camera @ FLU_R_RDF.T),
            "position_m": camera.rig_t_camera_m.tolist(),
            "covariance_rad_m": np.diag([np.radians(sigma_deg) ** 2] * 3 + [1e-6] * 3).tolist(),
        }
        for name, camera in rig.cameras.items()
    ]
    (folder / "extrinsics.json").write_text(json.dumps({"cameras": cameras}))
    return folder


def test_a_camera_that_was_moved_is_told_and_the_others_are_not(twin: Twin, tmp_path: Path) -> None:
    """One camera of three is 0.1° nose down: it alone differs, half a metre along; unsure fits agree."""
    rig = simulated_rig()
    moved = turned_camera(rig.cameras["C2_tricam60"], np.array([0.0, 0.1, 0.0]), np.array([0.001, 0.0, 0.0]))
    other = replace(rig, cameras={**rig.cameras, "C2_tricam60": moved})
    now, then = mounted(tmp_path / "now", other, 0.01), mounted(tmp_path / "then", rig, 0.01)
    answer = twin("calibrate", "diff", then, now, "--json", "--exit-code")
    assert answer.code == 1
    found = {one["camera"]: one for one in answer.json["cameras"]}
    verdicts = {name: one["mounting"]["verdict"] for name, one in found.items()}
    assert verdicts == {name: "differ" if name == "C2_tricam60" else "agree" for name in rig.cameras}
    mounting = found["C2_tricam60"]["mounting"]
    np.testing.assert_allclose(mounting["roll_pitch_yaw_deg"], [0.0, 0.1, 0.0], atol=1e-6)
    np.testing.assert_allclose(mounting["sigma_deg"], 0.01 * np.sqrt(2.0), rtol=1e-6)
    height_m = float(rig.cameras["C2_tricam60"].rig_t_camera_m[2])
    along_m = np.radians(0.1) * (20.0**2 + height_m**2) / height_m
    assert mounting["along_m"] == pytest.approx(along_m, rel=0.02)
    assert found["C2_tricam60"]["lens"]["verdict"] == "same"
    unsure = mounted(tmp_path / "unsure", other, 0.1)
    assert twin("calibrate", "diff", then, unsure, "--exit-code").code == 0


@pytest.mark.parametrize(
    ("option", "code", "told"), [("--camera", 2, "no camera C9"), (None, 4, "1920 x 1208")]
)
def test_what_cannot_be_compared_is_refused(
    fits: tuple[Path, Path], twin: Twin, tmp_path: Path, option: str | None, code: int, told: str
) -> None:
    """A camera that is in neither, and another picture size, end the command with one sentence."""
    other = fits[1]
    if option is None:
        document = json.loads((fits[1] / "rig.json").read_text())
        document["rig"]["sensors"][0]["properties"] |= {"width": "1920", "height": "1208"}
        other = tmp_path / "rig.json"
        other.write_text(json.dumps(document))
    answer = twin("calibrate", "diff", fits[0], other, *([option, "C9"] if option else []))
    assert answer.code == code
    assert told in answer.err
