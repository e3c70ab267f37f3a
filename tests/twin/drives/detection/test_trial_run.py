"""Networks that are tried out in a process of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.drives.detection.trial_run import rehearse
from twin.errors import DriveError


def test_sound_network_passes(networks: Any, tmp_path: Path) -> None:
    """Nothing is said of a network that loads and runs."""
    rehearse(networks.grid(tmp_path / "grid.onnx"))


def test_network_that_ends_its_process_costs_one_sentence(networks: Any, tmp_path: Path) -> None:
    """A convolution with strides of 0, which OpenCV divides by: the child dies, this process does not."""
    path = networks.save(
        tmp_path / "net.onnx",
        [("Conv", ["images", "w"], "out", {"kernel_shape": [1, 1], "strides": [0, 0]})],
        {"w": np.ones((5, 3, 1, 1), np.float32)},
        (1, 3, 8, 8),
    )
    with pytest.raises(
        DriveError, match=r"net\.onnx (makes OpenCV crash|holds a network that OpenCV cannot run)"
    ):
        rehearse(path)


@pytest.mark.parametrize("content", [b"", b"<html>"])
def test_reason_of_the_child_is_the_reason(tmp_path: Path, content: bytes) -> None:
    """What the reader says in the child is what the user reads."""
    (tmp_path / "net.onnx").write_bytes(content)
    with pytest.raises(DriveError, match=r"net\.onnx is not an ONNX model that can be read"):
        rehearse(tmp_path / "net.onnx")


def test_file_that_is_replaced_is_tried_again(networks: Any, tmp_path: Path) -> None:
    """The answer is remembered for this content only."""
    path = tmp_path / "net.onnx"
    path.write_bytes(b"no network")
    with pytest.raises(DriveError):
        rehearse(path)
    rehearse(networks.grid(path))


def test_absent_file_is_named(tmp_path: Path) -> None:
    """No process is started for a file that is not there."""
    with pytest.raises(DriveError, match="cannot be read"):
        rehearse(tmp_path / "none.onnx")
