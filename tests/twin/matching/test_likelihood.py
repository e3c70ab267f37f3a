"""Scores: each term says what it should."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS, code_probability, gated_pairs, moved_density, score
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Plate, Site

CONFIG = MatchConfig()


def pole(east: float, north: float, *codes: str, sigma: float = 0.1, key: str = "d:1") -> ObservedPole:
    """Make an observed pole."""
    return ObservedPole((key,), key, east, north, sigma**2 * np.eye(2), codes, ("d",), frozenset({"d/C"}), 10)


def site(nvdb_id: int, east: float, *codes: str, sigma: float = 0.3, face: float = math.nan) -> Site:
    """Make a site at (east, 0) whose plates all face one way."""
    plates = tuple(Plate(nvdb_id * 10 + i, 1, c, None, (face, math.nan)) for i, c in enumerate(codes))
    return Site(95, nvdb_id, 1, east, 0.0, sigma, True, plates)


def terms(one: ObservedPole, other: Site) -> dict[str, float]:
    """The terms of one pair."""
    zero = np.zeros(1, dtype=np.int64)
    row = score([one], [other], np.array([0.002]), zero, zero, CONFIG)[0]
    return dict(zip(TERMS, row.tolist(), strict=True))


def test_code_probability_counts_every_plate() -> None:
    """Two equal plates are likelier than one equal and one changed, that than one equal and one unread."""
    both = code_probability(["202", "808"], ["202", "808"], CONFIG)
    changed = code_probability(["362.50", "808"], ["362.60", "808"], CONFIG)
    other = code_probability(["372", "808"], ["202", "808"], CONFIG)
    assert both > changed > other > 0


def test_code_of_a_row_of_equal_signs_proves_less() -> None:
    """Where every sign carries one code, the code says less than where it is rare."""
    alone, row = [site(1, 0.0, "202")], [site(k, 0.0, "202") for k in range(500)]
    zero = np.zeros(1, dtype=np.int64)
    code = TERMS.index("code")
    rare = score([pole(0, 0, "202")], alone, np.ones(1), zero, zero, CONFIG)[0, code]
    common = score([pole(0, 0, "202")], row, np.ones(500), zero, zero, CONFIG)[0, code]
    assert 0 < common < rare


def test_facing_away_from_every_camera_speaks_against_a_pair() -> None:
    """A plate that looks north was not read from the south; without a direction nothing is said."""
    seen = replace(pole(0, 0, "202"), seen_from_deg=frozenset({180.0}))
    assert terms(seen, site(1, 0.0, "202", face=180.0))["facing"] == 0.0
    assert terms(seen, site(1, 0.0, "202", face=0.0))["facing"] == pytest.approx(math.log(CONFIG.p_behind))
    assert terms(seen, site(1, 0.0, "202"))["facing"] == 0.0
    assert terms(pole(0, 0, "202"), site(1, 0.0, "202", face=0.0))["facing"] == 0.0


def test_facing_decides_between_two_signs_of_one_code() -> None:
    """Half-way between two equal signs, the one that looks at the camera is the match."""
    seen = replace(pole(0, 0, "202"), seen_from_deg=frozenset({180.0}))
    sites = [site(1, -1.0, "202", face=0.0), site(2, 1.0, "202", face=180.0)]
    result = assign([seen], sites, np.ones(2), CONFIG)
    assert result.site_of_pole.tolist() == [1]
    assert result.confidence_of_pole[0] > CONFIG.review_below


def test_gate_is_wider_where_nvdb_is_worse() -> None:
    """18 m is out of reach of a site good to 0.3 m, and within four sigmas of one good to 5 m."""
    sites = [site(1, 18.0, "202"), site(2, 18.0, "202", sigma=5.0)]
    assert gated_pairs([pole(0, 0, "202")], sites, np.ones(2), CONFIG).site.tolist() == [1]


def on_the_line(side: str) -> Site:
    """A site on the centre line of a road to the north."""
    return replace(site(1, 0.0, "202", sigma=8.0), own_geometry=False, road_azimuth_deg=0.0, side=side)


def test_centre_line_sites_are_matched_along_the_road() -> None:
    """8 m beside the road is where its sign stands; 8 m along the road it is not."""
    beside, along = terms(pole(8, 0, "202"), on_the_line("H")), terms(pole(1, 8, "202"), on_the_line("H"))
    assert beside["position"] > along["position"] + 2


def test_centre_line_sites_keep_to_their_side() -> None:
    """East of a road to the north is right: H; where NVDB names no side, the side says nothing."""
    assert terms(pole(5, 0, "202"), on_the_line("H"))["side"] > 0
    assert terms(pole(5, 0, "202"), on_the_line("V"))["side"] < 0
    assert terms(pole(5, 0, "202"), on_the_line(""))["side"] == 0


def test_moved_density_is_one_over_the_gate() -> None:
    """Summed over rings from half a metre out, a moved sign is somewhere within the gate."""
    radius = np.linspace(0.0, CONFIG.gate_m, 200_001)[1:]
    whole = (moved_density(radius, CONFIG) * 2 * np.pi * radius).sum() * radius[0]
    assert whole == pytest.approx(1.0, abs=0.02)


def test_confidence_of_pairs_is_what_comes_true() -> None:
    """Of pairs of equal signs 0.8 m apart, drawn as the model says, those given p are right p of the time."""
    rng = np.random.default_rng(5)
    n = 4000
    poles, sites = [], []
    for k in range(n):
        for number in range(2):
            north = 100.0 * k + 0.8 * number
            seen, known = rng.normal(0, 0.1, 2), rng.normal(0, 0.3, 2)
            poles.append(pole(seen[0], north + seen[1], "202", key=f"d:{k}-{number}"))
            one = site(2 * k + number, known[0], "202")
            sites.append(replace(one, north_m=north + known[1]))
    result = assign(poles, sites, np.full(2 * n, CONFIG.p_missed), CONFIG)
    right = result.site_of_pole == np.arange(2 * n)
    for low, high in ((0.5, 0.8), (0.8, 0.95), (0.95, 1.01)):
        some = (result.confidence_of_pole >= low) & (result.confidence_of_pole < high)
        stated, share = result.confidence_of_pole[some].mean(), right[some].mean()
        # The two poles of a scene are right or wrong together: half as many draws.
        assert abs(stated - share) < 4 * math.sqrt(stated * (1 - stated) / (some.sum() / 2)) + 0.01
