"""Estimates → poles: plates of one foot, and the same pole in several drives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from twin.matching.config import MatchConfig
from twin.matching.observed import observed_poles, split_codes

CONFIG = MatchConfig()


def estimate(
    drive_id: str, name: str, east: float, code: str, *, north: float = 0.0, sigma: float = 0.2
) -> dict[str, Any]:
    """Make a row of the estimate table."""
    return {
        "drive_id": drive_id,
        "object": name,
        "east_m": east,
        "north_m": north,
        "cov_ee_m2": sigma**2,
        "cov_en_m2": 0.0,
        "cov_nn_m2": sigma**2,
        "skiltnummer": code,
        "n_sightings": 5,
    }


def test_observed_poles_join_plates_of_one_foot() -> None:
    """Two plates annotated one by one at the same foot are one pole with two codes."""
    rows = [estimate("a", "1", 0.0, "362.50"), estimate("a", "2", 0.1, "808")]
    (pole,) = observed_poles(rows, ["a"], CONFIG)
    assert pole.codes == ("362.50", "808")
    assert pole.n_sightings == 10
    # Their errors are shared, so the second plate does not make the pole better known.
    assert pole.covariance_m2[0, 0] == pytest.approx(0.04)


def test_observed_poles_keep_neighbours_of_one_drive_apart() -> None:
    """Poles 0.8 m apart in one drive stay two."""
    rows = [estimate("a", "1", 0.0, "202"), estimate("a", "2", 0.8, "202")]
    assert len(observed_poles(rows, ["a"], CONFIG)) == 2


def test_observed_poles_fuse_drives_by_covariance() -> None:
    """Two drives with equal sigmas meet half-way, and the sigma falls by the square root of two."""
    rows = [estimate("a", "1", 0.0, "202"), estimate("b", "9", 0.4, "202")]
    (pole,) = observed_poles(rows, ["a", "b"], CONFIG)
    assert pole.east_m == pytest.approx(0.2)
    assert pole.sigma_m == pytest.approx(0.2 / np.sqrt(2))
    assert pole.drive_ids == ("a", "b")


def test_observed_poles_do_not_fuse_contradicting_codes() -> None:
    """A 50 and a 60 at the same place in two drives are two observations, not one."""
    rows = [estimate("a", "1", 0.0, "362.50"), estimate("b", "1", 0.1, "362.60")]
    assert len(observed_poles(rows, ["a", "b"], CONFIG)) == 2


def test_observed_poles_keep_their_key_when_a_later_drive_arrives() -> None:
    """The key comes from the first drive in time, so that a finding's id survives later drives."""
    rows = [estimate("z", "1", 0.0, "202")]
    (before,) = observed_poles(rows, ["z"], CONFIG)
    (after,) = observed_poles([*rows, estimate("a", "7", 0.1, "202")], ["z", "a"], CONFIG)
    assert before.key == after.key == "z:1"


def test_observed_poles_do_not_depend_on_row_order() -> None:
    """Shuffled rows give the same poles."""
    rng = np.random.default_rng(1)
    rows = [estimate("a", str(i), 5.0 * i, "202") for i in range(8)]
    rows += [estimate("b", str(i), 5.0 * i + 0.1, "202") for i in range(8)]
    expected = [(p.key, p.east_m) for p in observed_poles(rows, ["a", "b"], CONFIG)]
    shuffled = [rows[i] for i in rng.permutation(len(rows))]
    assert [(p.key, p.east_m) for p in observed_poles(shuffled, ["a", "b"], CONFIG)] == expected


def test_split_codes_ignores_blanks() -> None:
    """Codes come apart at semicolons; an empty text has none."""
    assert split_codes("362.50; 808.1;") == ("362.50", "808.1")
    assert split_codes("") == ()
