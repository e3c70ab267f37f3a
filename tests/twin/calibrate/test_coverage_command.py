"""``twin calibrate coverage``: what is missing in words, and a folder in which pictures arrive."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import Twin

from geoloc.errors import CalibrationError
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.coverage.look import watch
from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, example_camera, rendered, write_picture


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three pictures of the example's board, and one without it."""
    folder = tmp_path_factory.mktemp("coverage")
    made = rendered(example_camera(), board_from_text(EXAMPLE_BOARD), 3, np.random.default_rng(5))
    for number, picture in enumerate(made):
        write_picture(folder / f"{number}.png", picture)
    write_picture(folder / "wall.png", np.full((604, 960), 120, np.uint8))
    return folder


@pytest.mark.slow
def test_what_is_missing_is_said_in_words_and_drawn(pictures: Path, twin: Twin, tmp_path: Path) -> None:
    """A few pictures: how many more, and where and how to hold the board next."""
    plot = tmp_path / "coverage.png"
    answer = twin("calibrate", "coverage", pictures, "--board", EXAMPLE_BOARD, "--plot", plot)
    assert answer.code == 0, answer.err
    assert "About 27 more." in answer.out
    assert answer.out.count("- Hold the board ") == 3
    assert "towards the camera" in answer.out
    assert "wall.png" in answer.out
    assert cv2.imread(str(plot)).std() > 10.0
    document = twin("calibrate", "coverage", pictures, "--board", EXAMPLE_BOARD, "--json").json
    assert (document["pictures"], document["boards"], document["missing"]) == (4, 3, 27)
    assert sum(document["reaches"].values()) == 3


def test_pictures_are_looked_at_as_they_arrive(pictures: Path, tmp_path: Path) -> None:
    """A picture is read once, when it has stopped growing; the hint after each knows those before it."""
    waiting = sorted(pictures.iterdir())[:2]
    whole = waiting[1].read_bytes()
    steps = iter(
        [
            lambda: shutil.copy(waiting[0], tmp_path),
            lambda: None,
            lambda: (tmp_path / waiting[1].name).write_bytes(whole[:1000]),
            lambda: (tmp_path / waiting[1].name).write_bytes(whole),
            lambda: None,
        ]
    )

    def wait() -> None:
        try:
            next(steps)()
        except StopIteration:
            raise KeyboardInterrupt from None

    found = []
    with contextlib.suppress(KeyboardInterrupt):
        for name, log, shown in watch(tmp_path, EXAMPLE_BOARD, wait):
            found.append((name, len(log.found), len(shown.views)))
    assert found == [(waiting[0].name, 1, 1), (waiting[1].name, 2, 2)]


def test_watch_refuses_what_it_cannot_follow(twin: Twin, tmp_path: Path, pictures: Path) -> None:
    """Several folders, and none, are refused; so is a picture of another size."""
    options = "--board", EXAMPLE_BOARD, "--watch"
    assert twin("calibrate", "coverage", pictures, tmp_path, *options).code == 2
    assert twin("calibrate", "coverage", pictures, *options, "--json").code == 2
    assert twin("calibrate", "coverage", tmp_path / "none", *options).code == 4
    write_picture(tmp_path / "a.png", np.full((604, 960), 120, np.uint8))
    write_picture(tmp_path / "b.png", np.full((300, 400), 120, np.uint8))
    with pytest.raises(CalibrationError, match=r"b\.png has 400 x 300 pixels"):
        list(watch(tmp_path, EXAMPLE_BOARD, lambda: None))
