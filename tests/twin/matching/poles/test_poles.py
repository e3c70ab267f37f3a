"""Estimates → poles: plates of one foot, and the same pole in several drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from twin.matching.config import MatchConfig
from twin.matching.poles.poles import observed_poles
from twin.store.records import Estimate, split_codes

CONFIG = MatchConfig()


def estimate(
    drive_id: str,
    name: str,
    east: float,
    code: str,
    *,
    north: float = 0.0,
    sigma: float = 0.2,
    cameras: tuple[str, ...] = ("C1",),
) -> Estimate:
    """Make an estimate as well known in all directions."""
    return Estimate(
        drive_id=drive_id,
        object=name,
        codes=split_codes(code),
        east_m=east,
        north_m=north,
        covariance_m2=(sigma**2, 0.0, sigma**2),
        cameras=cameras,
        n_sightings=5,
    )


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


def test_observed_poles_fuse_drives_without_overconfidence() -> None:
    """Two drives with equal sigmas meet half-way, and share their errors: the sigma does not fall."""
    rows = [estimate("a", "1", 0.0, "202"), estimate("b", "9", 0.4, "202")]
    (pole,) = observed_poles(rows, ["a", "b"], CONFIG)
    assert pole.east_m == pytest.approx(0.2)
    assert pole.sigma_m == pytest.approx(0.2)
    assert pole.drive_ids == ("a", "b")


def test_observed_poles_weigh_the_better_drive_more() -> None:
    """A drive with a third of the sigma has nine tenths of the weight, and more."""
    rows = [estimate("a", "1", 0.0, "202", sigma=0.3), estimate("b", "9", 0.4, "202", sigma=0.1)]
    (pole,) = observed_poles(rows, ["a", "b"], CONFIG)
    assert pole.east_m > 0.36
    assert 0.1 <= pole.sigma_m < 0.12


def test_observed_poles_follow_a_change_that_stays() -> None:
    """A 50 in two drives and a 60 at the same place in two later ones: the sign was changed."""
    codes = ("362.50", "362.50", "362.60", "362.60")
    rows = [replace(estimate(d, "1", 0.0, codes[k]), last_ns=k) for k, d in enumerate("abcd")]
    (pole,) = observed_poles(rows, ["a", "b", "c", "d"], CONFIG)
    assert pole.codes == ("362.60",)
    assert [reading.drive_id for reading in pole.readings()[0]] == ["a", "b", "c", "d"]


def test_observed_poles_outvote_a_slip() -> None:
    """One drive of four that reads a 60, not the last: the sign is a 50 still, and no plate was added."""
    rows = [estimate(d, "1", 0.0, "362.50;808") for d in "abcd"]
    rows[1] = replace(rows[1], codes=("362.60", "808"))
    (pole,) = observed_poles(rows, ["a", "b", "c", "d"], CONFIG)
    assert pole.codes == ("362.50", "808")


def test_observed_poles_average_what_is_each_drives_own() -> None:
    """Four drives alike have a quarter of the weight each; their sigma does not fall."""
    rows = [estimate(d, "1", 0.1 * k, "202") for k, d in enumerate("abcd")]
    (pole,) = observed_poles(rows, ["a", "b", "c", "d"], CONFIG)
    assert pole.east_m == pytest.approx(0.15)
    assert pole.averaged == pytest.approx(0.25)
    assert pole.sigma_m == pytest.approx(0.2)


def test_observed_poles_take_the_cameras_of_a_drive_for_one_observer() -> None:
    """Two cameras of one drive share trajectory and clock: nothing is averaged."""
    rows = [estimate("a", f"{c}:1", 0.1, "202", cameras=(c,)) for c in ("C2", "C3")]
    (pole,) = observed_poles(rows, ["a"], CONFIG)
    assert pole.averaged == 1.0


def test_observed_poles_keep_other_codes_a_metre_away_apart() -> None:
    """Another code 1 m away in another drive is another pole."""
    rows = [estimate("a", "1", 0.0, "362.50"), estimate("b", "1", 1.0, "202")]
    assert len(observed_poles(rows, ["a", "b"], CONFIG)) == 2


def test_observed_poles_join_the_cameras_of_one_drive() -> None:
    """Without the attribute object each camera has ids of its own: what they share is found by position."""
    left = [estimate("a", f"C2:{i}", 8.0 * i, "202", cameras=("C2",)) for i in range(5)]
    right = [estimate("a", f"C3:{i}", 8.0 * i + 0.5, "202", cameras=("C3",)) for i in range(5)]
    poles = observed_poles(left + right, ["a"], CONFIG)
    assert [pole.members for pole in poles] == [(f"a:C2:{i}", f"a:C3:{i}") for i in range(5)]


def test_observed_poles_never_join_two_objects_of_one_camera() -> None:
    """Two poles 0.8 m apart in one camera stay two when another camera has seen but one of them."""
    rows = [
        estimate("a", "C2:1", 0.0, "202", cameras=("C2",)),
        estimate("a", "C2:2", 0.8, "202", cameras=("C2",)),
        estimate("a", "C3:1", 0.7, "202", cameras=("C3",)),
    ]
    first, second = observed_poles(rows, ["a"], CONFIG)
    assert first.members == ("a:C2:1",)
    assert second.members == ("a:C2:2", "a:C3:1")


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


def test_observed_poles_know_when_they_were_seen() -> None:
    """First and last sighting span the drives, and the directions of all members are kept."""
    early = replace(estimate("a", "1", 0.0, "202"), first_ns=10, last_ns=20)
    late = replace(estimate("b", "9", 0.1, "202"), first_ns=50, last_ns=60)
    directions = {"a:1": frozenset({0.0}), "b:9": frozenset({30.0})}
    (pole,) = observed_poles([late, early], ["a", "b"], CONFIG, directions)
    assert (pole.first_ns, pole.last_ns, pole.drive_ids) == (10, 60, ("a", "b"))
    assert pole.seen_from_deg == {0.0, 30.0}


def test_observed_poles_fuse_as_the_matrices_say() -> None:
    """The fused position is that of covariance intersection written out with inverses."""
    rows = [estimate("a", "1", 0.0, "202"), estimate("b", "9", 0.2, "202", north=0.1)]
    rows[0] = replace(rows[0], covariance_m2=(0.05, 0.02, 0.03))
    rows[1] = replace(rows[1], covariance_m2=(0.02, -0.01, 0.06))
    a, b = np.array([[0.05, 0.02], [0.02, 0.03]]), np.array([[0.02, -0.01], [-0.01, 0.06]])
    share = 0.08 / 0.16
    weight_a, weight_b = share * np.linalg.inv(a), (1 - share) * np.linalg.inv(b)
    covariance = np.linalg.inv(weight_a + weight_b)
    (pole,) = observed_poles(rows, ["a", "b"], CONFIG)
    assert np.allclose(pole.covariance_m2, covariance)
    assert np.allclose((pole.east_m, pole.north_m), covariance @ weight_b @ np.array([0.2, 0.1]))
