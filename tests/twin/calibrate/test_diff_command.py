"""``twin calibrate diff``: calibrations from different pictures, one that changed, one without covariance."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import cv2
import pytest
from command_line import Twin

from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, EXAMPLE_CAMERA
from twin.cli import run


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two calibrations of the example's camera from different pictures."""
    folders = []
    for seed in (1, 2):
        root = tmp_path_factory.mktemp(f"fit{seed}")
        assert run(["calibrate", "example", str(root / "board"), "--seed", str(seed), "--pictures", "8"]) == 0
        options = ["--board", EXAMPLE_BOARD, "--camera", EXAMPLE_CAMERA, "--model", "ftheta"]
        pictures = str(root / "board" / "pictures")
        assert run(["calibrate", "intrinsics", pictures, *options, "--out", str(root / "out")]) == 0
        folders.append(root / "out")
    return folders[0], folders[1]


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
