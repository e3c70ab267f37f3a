"""Assignment: every hypothesis competes, and the cluster's joint best wins."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.likelihood import code_probability, score
from twin.matching.plates.readings import family
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Plate, Site

CONFIG = MatchConfig()


def pole(east: float, north: float, *codes: str, sigma: float = 0.3, key: str = "d:1") -> ObservedPole:
    """Make an observed pole with a round error ellipse."""
    return ObservedPole((key,), key, east, north, sigma**2 * np.eye(2), codes, ("d",), frozenset({"d/C"}), 10)


def site(nvdb_id: int, east: float, north: float, *codes: str, sigma: float = 0.3, own: bool = True) -> Site:
    """Make an NVDB site."""
    plates = tuple(Plate(nvdb_id * 10 + i, 1, code, None) for i, code in enumerate(codes))
    return Site(95, nvdb_id, 1, east, north, sigma, own, plates)


def test_assign_pairs_a_pole_with_the_only_site_near() -> None:
    """One pole half a metre from one site with the same code is that site, almost surely."""
    result = assign([pole(0.5, 0, "362.50")], [site(1, 0, 0, "362.50")], np.array([0.002]), CONFIG)
    assert result.site_of_pole.tolist() == [0]
    assert result.confidence_of_pole[0] > 0.99


def test_assign_never_pairs_beyond_the_gate() -> None:
    """A site 16 m away is out of the gate of 15 m, however well its code fits."""
    result = assign([pole(0, 16, "362.50")], [site(1, 0, 0, "362.50")], np.array([0.002]), CONFIG)
    assert result.site_of_pole.tolist() == [-1]


def test_assign_keeps_close_neighbours_apart() -> None:
    """Two poles 0.8 m apart get two sites 0.8 m apart: nobody is dropped as a duplicate."""
    poles = [pole(0.1, 0, "362.50", key="d:1"), pole(0.9, 0, "372", key="d:2")]
    sites = [site(1, 0, 0, "362.50"), site(2, 0.8, 0, "372")]
    result = assign(poles, sites, np.array([0.002, 0.002]), CONFIG)
    assert result.site_of_pole.tolist() == [0, 1]


def test_assign_prefers_new_and_missing_over_a_far_site_of_another_family() -> None:
    """A give-way sign 6 m from where NVDB has a parking sign is new; the parking sign is gone."""
    result = assign([pole(6, 0, "202")], [site(1, 0, 0, "372")], np.array([0.002]), CONFIG)
    assert result.site_of_pole.tolist() == [-1]
    assert result.confidence_of_site[0] > CONFIG.review_below


def test_assign_pairs_a_moved_sign_of_the_same_code() -> None:
    """The same code 4 m away, with nothing else near, is the same sign moved."""
    result = assign([pole(4, 0, "362.50")], [site(1, 0, 0, "362.50")], np.array([0.002]), CONFIG)
    assert result.site_of_pole.tolist() == [0]
    assert result.confidence_of_pole[0] > CONFIG.review_below


def test_assign_is_unsure_between_two_equal_sites() -> None:
    """A pole half-way between two sites of its code is no certain match of either."""
    sites = [site(1, -1, 0, "362.50"), site(2, 1, 0, "362.50")]
    result = assign([pole(0, 0, "362.50")], sites, np.array([1.0, 1.0]), CONFIG)
    assert result.confidence_of_pole[0] == pytest.approx(0.5, abs=0.02)
    assert {int(result.site_of_pole[0]), int(result.rival_of_pole[0])} == {0, 1}


@pytest.mark.parametrize("seed", range(20))
def test_assign_finds_the_joint_optimum(seed: int) -> None:
    """The assignment's total cost equals the minimum over all one-to-one hypotheses, tried by brute force."""
    rng = np.random.default_rng(seed)
    codes = ["362.50", "362.60", "202"]
    poles = [pole(*rng.uniform(0, 5, 2), rng.choice(codes), key=f"d:{i}") for i in range(3)]
    sites = [site(i, *rng.uniform(0, 5, 2), rng.choice(codes)) for i in range(3)]
    p_unannotated = rng.uniform(0.002, 1.0, 3)
    result = assign(poles, sites, p_unannotated, CONFIG)

    i, j = np.divmod(np.arange(9), 3)
    cost = -score(poles, sites, p_unannotated, i, j, CONFIG).sum(axis=1).reshape(3, 3)

    def total(choice: tuple[int, ...]) -> float:
        # Against everybody alone, which costs 0.
        return float(sum(cost[i, j] for i, j in enumerate(choice) if j >= 0))

    hypotheses = [
        h
        for h in itertools.product((-1, 0, 1, 2), repeat=3)
        if len([j for j in h if j >= 0]) == len({j for j in h if j >= 0})
    ]
    assert total(tuple(result.site_of_pole.tolist())) == pytest.approx(min(map(total, hypotheses)))


def test_assign_of_nothing_is_nothing() -> None:
    """No poles and no sites, or only one of them, give no pairs."""
    assert assign([], [], np.zeros(0), CONFIG).site_of_pole.size == 0
    assert assign([pole(0, 0)], [], np.zeros(0), CONFIG).site_of_pole.tolist() == [-1]
    assert assign([], [site(1, 0, 0)], np.ones(1), CONFIG).confidence_of_site.tolist() == [1.0]


def test_code_probability_orders_same_family_other() -> None:
    """The same code is likelier than its family, that than another family; no code says nothing."""
    same = code_probability(["362.50"], ["362.50"], CONFIG)
    kin = code_probability(["362.60"], ["362.50"], CONFIG)
    other = code_probability(["202"], ["362.50"], CONFIG)
    assert same > kin > other > 0
    assert code_probability([], ["362.50"], CONFIG) == 1.0


def test_family_ignores_variant_and_retirement() -> None:
    """362.50 and 362.60 are kin; a retired U722.2 is of the family 722."""
    assert family("362.50") == family("362.60") == "362"
    assert family("U722.2") == "722"
