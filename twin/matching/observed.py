"""Estimates of one or more drives → observed poles, one a physical pole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.matching.config import MatchConfig

_CHI2_99_2DOF = 9.210
"""99 % quantile of chi-square with two degrees of freedom."""


@dataclass(frozen=True, slots=True)
class ObservedPole:
    """One pole as the drives saw it.

    Attributes
    ----------
    key : str
        ``drive:object`` of its first estimate in time: the same in every run, also after later drives.
    east_m, north_m : float
        EPSG:25833.
    covariance_m2 : float64 (2, 2)
        Grid east, grid north.
    codes : tuple of str
        Sign codes seen, top down; empty if not annotated.
    """

    key: str
    east_m: float
    north_m: float
    covariance_m2: NDArray[np.float64]
    codes: tuple[str, ...]
    drive_ids: tuple[str, ...]
    n_sightings: int

    @property
    def sigma_m(self) -> float:
        """Mean one-sigma radius."""
        return float(np.sqrt(np.trace(self.covariance_m2) / 2))


def observed_poles(
    estimates: Sequence[Mapping[str, Any]], drive_order: Sequence[str], config: MatchConfig
) -> list[ObservedPole]:
    """Merge estimates into poles: plates of one drive that share a foot, then the same pole across drives.

    Parameters
    ----------
    estimates : rows of the ``estimate`` table, of one method
    drive_order : drive ids in time order; the key of a pole comes from the first that saw it

    Returns
    -------
    list of ObservedPole
        In the order of their keys.
    """
    poles: list[ObservedPole] = []
    for drive_id in drive_order:
        own = sorted((e for e in estimates if e["drive_id"] == drive_id), key=lambda e: str(e["object"]))
        seen = _poles_of_drive(own, config)
        poles = _merge_drive(poles, seen)
    return sorted(poles, key=lambda pole: pole.key)


def split_codes(text: str) -> tuple[str, ...]:
    """``"362.50;808.1"`` → ``("362.50", "808.1")``."""
    return tuple(code.strip() for code in text.split(";") if code.strip())


def _pole_of_estimate(row: Mapping[str, Any]) -> ObservedPole:
    covariance = np.array(
        [[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]], dtype=np.float64
    )
    return ObservedPole(
        key=f"{row['drive_id']}:{row['object']}",
        east_m=row["east_m"],
        north_m=row["north_m"],
        covariance_m2=covariance,
        codes=split_codes(row["skiltnummer"]),
        drive_ids=(row["drive_id"],),
        n_sightings=row["n_sightings"],
    )


def _poles_of_drive(rows: Sequence[Mapping[str, Any]], config: MatchConfig) -> list[ObservedPole]:
    """Group what one drive annotated plate by plate at the same foot."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not rows:
        return []
    single = [_pole_of_estimate(row) for row in rows]
    pairs = cKDTree([(p.east_m, p.north_m) for p in single]).query_pairs(
        config.same_pole_m, output_type="ndarray"
    )
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(single), len(single)))
    _, label = connected_components(graph, directed=False)
    groups: dict[int, list[ObservedPole]] = {}
    for pole, group in zip(single, label, strict=True):
        groups.setdefault(int(group), []).append(pole)
    return [_same_foot(group) for group in groups.values()]


def _same_foot(group: Sequence[ObservedPole]) -> ObservedPole:
    """One pole from the plates of one drive: their errors are shared, so the best estimate is kept."""
    best = min(group, key=lambda pole: (float(np.trace(pole.covariance_m2)), pole.key))
    return ObservedPole(
        key=min(pole.key for pole in group),
        east_m=best.east_m,
        north_m=best.north_m,
        covariance_m2=best.covariance_m2,
        codes=tuple(code for pole in group for code in pole.codes),
        drive_ids=best.drive_ids,
        n_sightings=sum(pole.n_sightings for pole in group),
    )


def _merge_drive(known: list[ObservedPole], seen: list[ObservedPole]) -> list[ObservedPole]:
    """Pair one more drive's poles with the known ones, one-to-one, and fuse the pairs."""
    from scipy.optimize import linear_sum_assignment

    if not known or not seen:
        return known + seen
    cost = np.array([[_pair_cost(a, b) for b in seen] for a in known])
    # "No pair" costs the gate itself: a pair beyond it never lowers the total.
    rows, columns = linear_sum_assignment(np.minimum(cost, _CHI2_99_2DOF))
    partner = {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < _CHI2_99_2DOF}
    merged = [_fuse(pole, seen[partner[i]]) if i in partner else pole for i, pole in enumerate(known)]
    return merged + [pole for j, pole in enumerate(seen) if j not in partner.values()]


def _pair_cost(a: ObservedPole, b: ObservedPole) -> float:
    """Squared Mahalanobis distance; infinite where the codes contradict each other."""
    if a.codes and b.codes and not set(a.codes) & set(b.codes):
        return float("inf")
    offset = np.array([a.east_m - b.east_m, a.north_m - b.north_m])
    return float(offset @ np.linalg.solve(a.covariance_m2 + b.covariance_m2, offset))


def _fuse(a: ObservedPole, b: ObservedPole) -> ObservedPole:
    """Inverse-covariance mean of two drives' positions."""
    weight_a, weight_b = np.linalg.inv(a.covariance_m2), np.linalg.inv(b.covariance_m2)
    covariance = np.linalg.inv(weight_a + weight_b)
    east, north = covariance @ (
        weight_a @ np.array([a.east_m, a.north_m]) + weight_b @ np.array([b.east_m, b.north_m])
    )
    extra = tuple(code for code in b.codes if code not in a.codes)
    return ObservedPole(
        key=a.key,
        east_m=float(east),
        north_m=float(north),
        covariance_m2=covariance,
        codes=a.codes + extra,
        drive_ids=tuple(dict.fromkeys(a.drive_ids + b.drive_ids)),
        n_sightings=a.n_sightings + b.n_sightings,
    )
