"""What needs a library of an extra says so, and which."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HIDE = "import sys; sys.modules[sys.argv.pop(1)] = None; from twin.cli import main; main()"
VIDEO = "C2_tricam60.h264"
LOG = '[motion]\nfile = "bus.log"\ndbc = "car.dbc"\nspeed = "WHEELS.SPEED"\n'


@pytest.fixture
def drive(sample: Path, tmp_path: Path) -> Path:
    """The sample's first drive, with a video of one camera."""
    folder = shutil.copytree(sample / "trip_trondheim", tmp_path / "trip")
    (folder / VIDEO).write_bytes(b"\0\0\0\x01")
    return folder


def _ingest_without(library: str, drive: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", HIDE, library, "ingest-drive", drive.name, "--store", "twin.db", *options],
        cwd=drive.parent,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


@pytest.mark.parametrize(
    ("library", "extra", "options"),
    [
        ("cantools", "can", ()),
        pytest.param("av", "video", (), marks=pytest.mark.slow),
        pytest.param("onnxruntime", "detect", ("--detector", "network.onnx"), marks=pytest.mark.slow),
        pytest.param("rasterio", "terrain", ("--terrain", "dtm.tif"), marks=pytest.mark.slow),
    ],
)
def test_an_extra_that_is_not_installed_is_named(
    drive: Path, library: str, extra: str, options: tuple[str, ...]
) -> None:
    """Its absence is a wrong use, told in one sentence with what to install."""
    if library == "cantools":
        (drive / "drive.toml").write_text(LOG)
        (drive / "bus.log").touch()
        (drive / "car.dbc").touch()
    if library == "av":  # a film without stamps: its own times are needed
        (drive / VIDEO).rename(drive / "C2_tricam60.mp4")
        (drive / f"{VIDEO}.timestamps").unlink()
    (drive.parent / "network.onnx").touch()
    done = _ingest_without(library, drive, *options)
    assert done.returncode == 2, done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("twin:")]
    assert f'which is not installed: pip install "nvdb-twin[{extra}]"' in sentence
    assert done.stdout == ""


@pytest.mark.slow
def test_a_drive_with_stamps_is_located_without_pyav(drive: Path) -> None:
    """Only who looks into a video needs what reads videos: the rest is said and done."""
    done = _ingest_without("av", drive)
    assert done.returncode == 0, done.stderr
    assert f"warning: The video {VIDEO} needs PyAV" in done.stderr
    assert "15 of 15" in done.stdout
