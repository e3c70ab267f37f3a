"""How well a pole and a site fit, term by term, as log odds against "no match"."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geoloc.arrays import FloatArray, IntArray
from twin.matching.config import MatchConfig
from twin.matching.plates.readings import family
from twin.matching.plates.texts import text_odds, text_pairs
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site

TERMS = ("position", "code", "text", "facing", "side", "presence")
"""What a pair is scored by, in the order of `Pairs.terms`."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs within the gate.

    Attributes
    ----------
    pole, site : int64 (k,)
    terms : float64 (k, 6)
        Natural log of the odds that each of `TERMS` adds for the pair, against the pole being new and the
        site standing alone. They add up: above 0 the pair is likelier.
    """

    pole: IntArray
    site: IntArray
    terms: FloatArray

    @property
    def cost(self) -> FloatArray:
        """Minus the sum of the terms: below 0 the pair is likelier than "no match"."""
        return np.asarray(-self.terms.sum(axis=1))

    def part(self, rows: IntArray | NDArray[np.bool_]) -> Pairs:
        """Some of the pairs."""
        return Pairs(self.pole[rows], self.site[rows], self.terms[rows])


def gated_pairs(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    p_unannotated: FloatArray,
    config: MatchConfig,
    common: Mapping[str, float] | None = None,
) -> Pairs:
    """Find and score the pairs within the gate.

    The gate is `MatchConfig.gate_m`, wider where four sigmas of both sides together reach further.
    """
    i, j = _near(poles, sites, config)
    return Pairs(i, j, score(poles, sites, p_unannotated, i, j, config, common))


def widest_gap_m(variance_m2: ArrayLike, config: MatchConfig) -> FloatArray:
    """How far apart a pole and a site may be, by the variance of both together."""
    return np.maximum(config.gate_m, _GATE_SIGMAS * np.sqrt(variance_m2))


def _near(
    poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig
) -> tuple[IntArray, IntArray]:
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    if not poles or not sites:
        return none, none
    tree = cKDTree(np.array([(p.east_m, p.north_m) for p in poles]))
    place = np.array([(s.east_m, s.north_m) for s in sites])
    ours = max(float(np.trace(p.covariance_m2)) for p in poles) / 2
    sigma = np.array([s.sigma_m for s in sites])
    reach = widest_gap_m(sigma**2 + ours, config)
    # A country has a million sites, and a drive passes a few of them.
    distance, _ = tree.query(place, distance_upper_bound=float(reach.max()))
    some = np.flatnonzero(distance <= reach)
    hits = tree.query_ball_point(place[some], reach[some])
    j = np.repeat(some, [len(one) for one in hits])
    i = np.concatenate([none, *(np.array(one, dtype=np.int64) for one in hits)])
    order = np.lexsort((j, i))
    i, j = i[order], j[order]
    spread = np.array([float(np.trace(p.covariance_m2)) for p in poles])[i] / 2 + sigma[j] ** 2
    gate = widest_gap_m(spread, config)
    east = np.array([p.east_m for p in poles])[i] - place[j, 0]
    north = np.array([p.north_m for p in poles])[i] - place[j, 1]
    inside = np.hypot(east, north) <= gate
    return i[inside], j[inside]


_GATE_SIGMAS = 4.0


def score(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    p_unannotated: FloatArray,
    i: IntArray,
    j: IntArray,
    config: MatchConfig,
    common: Mapping[str, float] | None = None,
) -> FloatArray:
    """Score pairs ``poles[i], sites[j]``; see :class:`Pairs` for the result, (k, 6)."""
    if common is None:
        common = cost_of_common(Counter(code for site in sites for code in site.codes), config)
    position, side = _position(poles, sites, i, j, config)
    pairs = [(poles[a], sites[b]) for a, b in zip(i.tolist(), j.tolist(), strict=True)]
    codes: dict[tuple[tuple[str, ...], tuple[str, ...]], float] = {}
    code = np.empty(i.size)
    text, facing = np.zeros(i.size), np.zeros(i.size)
    behind = float(np.log(max(config.p_behind, 1e-12)))
    for k, (pole, site) in enumerate(pairs):
        known = site.codes
        seen = pole.codes_as(known)
        if (seen, known) not in codes:
            codes[seen, known] = _code_odds(seen, known, common, config)
        code[k] = codes[seen, known]
        if pole.texts:  # of a fleet's poles few have one
            text[k] = _text_odds(pole, seen, site, config)
        if pole.seen_from_deg and not _faces_a_camera(pole, site):
            facing[k] = behind
    noticed = (1 - config.p_gone) * np.maximum(1 - p_unannotated[j], 0.5)
    alone = config.p_gone + (1 - config.p_gone) * p_unannotated[j]
    return np.stack([position, code, text, facing, side, np.log(noticed / alone)], axis=1)


def _text_odds(pole: ObservedPole, seen: Sequence[str], site: Site, config: MatchConfig) -> float:
    """Log odds of the texts of all plates that have one on both sides; 0 where there is none."""
    pairs = text_pairs(seen, pole.texts, site.plates, config)
    return math.fsum(text_odds(alike, config) for _, _, alike in pairs)


def _position(
    poles: Sequence[ObservedPole], sites: Sequence[Site], i: IntArray, j: IntArray, config: MatchConfig
) -> tuple[FloatArray, FloatArray]:
    """Log odds of the position, and of the side of the road for sites on the centre line."""
    pole_place = np.array([(p.east_m, p.north_m) for p in poles]).reshape(-1, 2)
    site_place = np.array([(s.east_m, s.north_m) for s in sites]).reshape(-1, 2)
    covariance = np.array([p.covariance_m2 for p in poles]).reshape(-1, 2, 2)[i]
    sigma = np.array([s.sigma_m for s in sites])[j]
    offset = pole_place[i] - site_place[j]
    ee, en, nn = covariance[:, 0, 0] + sigma**2, covariance[:, 0, 1], covariance[:, 1, 1] + sigma**2
    east, north = offset.T
    determinant = ee * nn - en**2
    mahalanobis2 = (nn * east**2 - 2 * en * east * north + ee * north**2) / determinant
    in_place = np.exp(-0.5 * mahalanobis2) / (2 * np.pi * np.sqrt(determinant))
    side = np.zeros(i.size)
    road = np.array([s.road_azimuth_deg for s in sites], dtype=np.float64)[j]
    beside = np.flatnonzero(np.isfinite(road))
    if beside.size:
        letters = np.array([s.side for s in sites])[j[beside]]
        turned = np.deg2rad(road[beside])
        axis = np.stack([np.sin(turned), np.cos(turned)], axis=1)
        along = offset[beside, 0] * axis[:, 0] + offset[beside, 1] * axis[:, 1]
        right = offset[beside, 0] * axis[:, 1] - offset[beside, 1] * axis[:, 0]
        # Term by term: a sum by einsum may take another order where there are more pairs.
        sin, cos, of_pair = axis[:, 0], axis[:, 1], covariance[beside]
        own = of_pair[:, 0, 0] * sin**2 + 2 * of_pair[:, 0, 1] * sin * cos + of_pair[:, 1, 1] * cos**2
        spread = np.sqrt(config.along_road_sigma_m**2 + own)
        density = np.exp(-0.5 * (along / spread) ** 2) / (np.sqrt(2 * np.pi) * spread)
        in_place[beside] = density * (np.abs(right) <= config.verge_m) / (2 * config.verge_m)
        right_side = np.where(letters == "H", right > 0, right < 0)
        ratio = np.where(right_side, 2 * (1 - config.p_other_side), 2 * config.p_other_side)
        side[beside] = np.where(letters == "", 0.0, np.log(ratio))
    density = (1 - config.p_moved) * in_place + config.p_moved * moved_density(np.hypot(east, north), config)
    return np.asarray(np.log(density / config.new_per_m2)), side


def moved_density(distance_m: ArrayLike, config: MatchConfig) -> FloatArray:
    """Density per square metre of where a moved sign stands now: every distance up to the gate alike.

    So a short move is likelier per square metre than a long one; below half a metre that says no more.
    """
    return np.asarray(1.0 / (2 * np.pi * np.maximum(np.asarray(distance_m), 0.5) * config.gate_m))


def _faces_a_camera(pole: ObservedPole, site: Site) -> bool:
    """Whether some camera that saw the pole stood before a plate of the code seen (any, if none has it)."""
    plates = [plate for plate in site.plates if plate.code in pole.codes] or site.plates
    return not plates or any(plate.shows_to(azimuth) for plate in plates for azimuth in pole.seen_from_deg)


def cost_of_common(counts: Mapping[str, int], config: MatchConfig) -> dict[str, float]:
    """What each code that is commoner than `MatchConfig.p_code` takes from the odds of a pair.

    To a tenth, so that a few plates more or less change nothing.

    Parameters
    ----------
    counts : mapping
        How often each code occurs among NVDB's plates.
    """
    total = sum(counts.values()) + _SMOOTHING
    cost = {
        code: round(math.log((count + _SMOOTHING * config.p_code) / total / config.p_code), 1)
        for code, count in counts.items()
        if config.p_code > 0
    }
    return {code: odds for code, odds in sorted(cost.items()) if odds > 0}


def _code_odds(
    seen: tuple[str, ...], known: tuple[str, ...], common: Mapping[str, float], config: MatchConfig
) -> float:
    """Log odds of the codes seen, against a new pole that carries them by chance.

    A code that every third sign carries proves less than `p_code` says; a rare one is not taken to prove
    more, because signs of one code come in pairs and rows.
    """
    if not seen or not known:
        return 0.0
    odds = math.log(code_probability(seen, known, config)) - len(seen) * math.log(config.p_code)
    return odds - math.fsum(common.get(code, 0.0) for code in set(seen) & set(known))


_SMOOTHING = 50.0
"""Plates that the prior `p_code` counts for beside those of the mirror."""


def code_probability(seen: Sequence[str], known: Sequence[str], config: MatchConfig) -> float:
    """Probability of the codes seen, given the codes that NVDB has, plate by plate.

    Equal codes are taken for the same plate, then codes of one family, then any two. What is left was put up
    since (`p_plate_extra`; its code is not counted, as it would be the same chance on a new pole), or was not
    read (`p_plate_unread`).
    """
    if not seen or not known:
        return 1.0
    left, rest = list(seen), list(known)
    chance = 1.0
    for alike, p_code in (
        (_same, 1.0 - config.p_code_wrong),
        (_kin, config.p_code_wrong * config.p_of_family),
        (_any, config.p_code_wrong * config.p_of_another_family),
    ):
        for code in list(left):
            partner = next((other for other in rest if alike(code, other)), None)
            if partner is not None:
                left.remove(code)
                rest.remove(partner)
                chance *= p_code
    return chance * (config.p_plate_extra * config.p_code) ** len(left) * config.p_plate_unread ** len(rest)


def _same(code: str, other: str) -> bool:
    return code == other


def _kin(code: str, other: str) -> bool:
    return family(code) == family(other)


def _any(_code: str, _other: str) -> bool:
    return True
