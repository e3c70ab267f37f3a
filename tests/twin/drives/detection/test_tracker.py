"""Boxes → tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from twin.drives.detection.tracker import tracks
from twin.drives.detection.yolo_output import Detections

STEP_NS = 33_333_333


def _pictures(boxes: Sequence[Sequence[tuple[float, float, float, int]]]) -> list[Detections]:
    """Pictures of square boxes (x, y, size, class)."""
    made = []
    for picture in boxes:
        rows = np.array(picture, dtype=np.float64).reshape(-1, 4)
        half = rows[:, 2:3] / 2
        corners = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
        made.append(Detections(corners, np.full(len(rows), 0.9), rows[:, 3].astype(np.int64)))
    return made


def _epochs(count: int, step_ns: int = STEP_NS) -> list[int]:
    return [1_781_078_400_000_000_000 + i * step_ns for i in range(count)]


def _passed(
    ahead_m: float, right_m: float, up_m: float, picture: int, kind: int = 0, step_m: float = 0.55
) -> tuple[float, float, float, int]:
    """Where a 0.6 m sign appears (f = 1000 px) from a car that drives `step_m` between two pictures."""
    distance = ahead_m - step_m * picture
    return 1000 * right_m / distance, -1000 * up_m / distance, 600 / distance, kind


@pytest.mark.parametrize("step_m", [0.3, 0.55, 1.1])
def test_sign_that_comes_nearer_is_one_track(step_m: float) -> None:
    """At 30 pictures a second and 30 to 120 km/h, from 40 m until it leaves the picture."""
    count = int(33 / step_m)
    numbers = tracks(_epochs(count), _pictures([[_passed(40, 4, 1, i, step_m=step_m)] for i in range(count)]))
    assert set(numbers) == {0}


def test_signs_that_cross_keep_their_tracks() -> None:
    """A near sign overtakes a far one in the picture: 4 m to the right at 20 m, 6 m at 45 m."""
    pictures = [[_passed(45, 6, 1, i), _passed(20, 4, 1, i)] for i in range(28)]
    # The order in which a detector gives them says nothing.
    shuffled = [row[:: -1 if i % 2 else 1] for i, row in enumerate(pictures)]
    numbers = tracks(_epochs(28), _pictures(shuffled)).reshape(28, 2)
    assert {tuple(row[:: -1 if i % 2 else 1]) for i, row in enumerate(numbers)} == {tuple(numbers[0])}
    assert set(numbers[0]) == {0, 1}


def test_two_plates_of_one_pole_stay_apart() -> None:
    """One above the other, half a size between their edges."""
    pictures = [[_passed(30, 4, 1.0, i, 1), _passed(30, 4, 1.7, i, 2)] for i in range(40)]
    numbers = tracks(_epochs(40), _pictures(pictures)).reshape(40, 2)
    assert {tuple(row) for row in numbers.tolist()} == {(0, 1)}


def test_gap_of_some_pictures_does_not_end_a_track() -> None:
    """Ten pictures without a find, a third of a second: motion and growth are carried on."""
    pictures = [[] if 20 <= i < 30 else [_passed(40, 4, 1, i)] for i in range(60)]
    assert set(tracks(_epochs(60), _pictures(pictures))) == {0}


def test_long_gap_ends_a_track() -> None:
    """After a second another sign may stand there."""
    pictures = [[(300.0, 100.0, 30.0, 0)] if not 10 <= i < 40 else [] for i in range(50)]
    assert tracks(_epochs(50), _pictures(pictures)).tolist() == [0] * 10 + [1] * 10


def test_false_positives_make_no_track() -> None:
    """Boxes that come and go at random, three a picture, beside one sign: only the sign stays."""
    rng = np.random.default_rng(3)
    pictures = []
    for i in range(60):
        noise = [(rng.uniform(-900, 900), rng.uniform(-500, 500), rng.uniform(8, 60), 0) for _ in range(3)]
        pictures.append([_passed(40, 4, 1, i), *noise])
    numbers = tracks(_epochs(60), _pictures(pictures)).reshape(60, 4)
    assert len(set(numbers[:, 0])) == 1
    assert np.count_nonzero(numbers[:, 1:] >= 0) <= 9


def test_class_that_flickers_does_not_break_a_track() -> None:
    """50 is read as 60 now and then."""
    pictures = [[_passed(40, 4, 1, i, kind=int(i % 7 == 3))] for i in range(60)]
    assert set(tracks(_epochs(60), _pictures(pictures))) == {0}


def test_slow_pictures_are_linked_as_well() -> None:
    """Four pictures a second at 18 km/h: gates and gaps follow the time between two pictures."""
    pictures = [[_passed(40, 4, 1, i, step_m=1.25)] for i in range(24)]
    assert set(tracks(_epochs(24, 250_000_000), _pictures(pictures))) == {0}


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_boxes_are_no_track(count: int) -> None:
    """No pictures, no boxes, or a sign that is seen once or twice."""
    numbers = tracks(_epochs(count), _pictures([[_passed(40, 4, 1, i)] for i in range(count)]))
    assert numbers.tolist() == [-1] * count
