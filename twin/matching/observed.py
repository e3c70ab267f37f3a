"""Estimates of one or more drives → observed poles, one a physical pole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.matching.config import MatchConfig

_CHI2_999_2DOF = 13.816
"""99.9 % quantile of chi-square with two degrees of freedom: one true pair in a thousand is torn apart."""
_OTHER_CODE_M = 0.6
"""Within this distance a later drive with another code saw the same pole with another plate."""
_OTHER_CODE_COST = 4.0
"""What that costs, so that a pole with the same code is preferred."""


@dataclass(frozen=True, slots=True)
class ObservedPole:
    """One pole as the drives saw it.

    Attributes
    ----------
    members : tuple of str
        ``drive:object`` of its estimates, in time order of the drives.
    key : str
        What identifies the pole for good: by default its first member.
    east_m, north_m : float
        EPSG:25833.
    covariance_m2 : float64 (2, 2)
        Grid east, grid north.
    codes : tuple of str
        Sign codes seen, top down; empty if not annotated.
    cameras : frozenset of str
        ``drive/camera`` that saw it: one camera never sees one pole as two objects.
    """

    members: tuple[str, ...]
    key: str
    east_m: float
    north_m: float
    covariance_m2: NDArray[np.float64]
    codes: tuple[str, ...]
    drive_ids: tuple[str, ...]
    cameras: frozenset[str]
    n_sightings: int

    @property
    def sigma_m(self) -> float:
        """Mean one-sigma radius."""
        return float(np.sqrt(np.trace(self.covariance_m2) / 2))


def observed_poles(
    estimates: Sequence[Mapping[str, Any]],
    drive_order: Sequence[str],
    config: MatchConfig,
    known_keys: Mapping[str, str] | None = None,
) -> list[ObservedPole]:
    """Merge estimates into poles: plates that share a foot, cameras of one drive, then drives.

    Parameters
    ----------
    estimates : rows of the ``estimate`` table, of one method
    drive_order : drive ids in time order
    known_keys : mapping of member to key, optional
        Keys that poles got in earlier runs: a pole keeps the key of its first member that has one.

    Returns
    -------
    list of ObservedPole
        In the order of their keys.
    """
    poles: list[ObservedPole] = []
    for drive_id in drive_order:
        own = sorted((e for e in estimates if e["drive_id"] == drive_id), key=lambda e: str(e["object"]))
        by_cameras: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
        for row in own:
            by_cameras.setdefault(tuple(sorted(row["cameras"])), []).append(row)
        # Objects that several cameras share (by the annotator's id) come first: single ones join them.
        seen: list[ObservedPole] = []
        for cameras in sorted(by_cameras, key=lambda names: (-len(names), names)):
            seen = _merge(seen, _poles_of_cameras(by_cameras[cameras], config))
        poles = _merge(poles, seen)
    poles = [_with_key(pole, known_keys or {}) for pole in poles]
    return sorted(poles, key=lambda pole: pole.key)


def _with_key(pole: ObservedPole, known: Mapping[str, str]) -> ObservedPole:
    key = next((known[member] for member in pole.members if member in known), pole.key)
    return replace(pole, key=key)


def split_codes(text: str) -> tuple[str, ...]:
    """``"362.50;808.1"`` → ``("362.50", "808.1")``."""
    return tuple(code.strip() for code in text.split(";") if code.strip())


def _pole_of_estimate(row: Mapping[str, Any]) -> ObservedPole:
    covariance = np.array(
        [[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]], dtype=np.float64
    )
    member = f"{row['drive_id']}:{row['object']}"
    return ObservedPole(
        members=(member,),
        key=member,
        east_m=row["east_m"],
        north_m=row["north_m"],
        covariance_m2=covariance,
        codes=split_codes(row["skiltnummer"]),
        drive_ids=(row["drive_id"],),
        cameras=frozenset(f"{row['drive_id']}/{camera}" for camera in row["cameras"]),
        n_sightings=row["n_sightings"],
    )


def _poles_of_cameras(rows: Sequence[Mapping[str, Any]], config: MatchConfig) -> list[ObservedPole]:
    """Group what was annotated plate by plate at the same foot, in the same cameras of one drive."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

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
    return replace(
        best,
        members=tuple(sorted(member for pole in group for member in pole.members)),
        key=min(pole.key for pole in group),
        codes=tuple(code for pole in group for code in pole.codes),
        n_sightings=sum(pole.n_sightings for pole in group),
    )


def _merge(known: list[ObservedPole], seen: list[ObservedPole]) -> list[ObservedPole]:
    """Pair what one more observer saw with the known poles, one-to-one, and fuse the pairs."""
    from scipy.optimize import linear_sum_assignment

    if not known or not seen:
        return known + seen
    cost = np.array([[_pair_cost(a, b) for b in seen] for a in known])
    # "No pair" costs the gate itself: a pair beyond it never lowers the total.
    rows, columns = linear_sum_assignment(np.minimum(cost, _CHI2_999_2DOF))
    partner = {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < _CHI2_999_2DOF}
    merged = [_fuse(pole, seen[partner[i]]) if i in partner else pole for i, pole in enumerate(known)]
    return merged + [pole for j, pole in enumerate(seen) if j not in partner.values()]


def _pair_cost(a: ObservedPole, b: ObservedPole) -> float:
    """Squared Mahalanobis distance; infinite where one camera saw both, or where the codes contradict."""
    if a.cameras & b.cameras:
        return float("inf")
    offset = np.array([a.east_m - b.east_m, a.north_m - b.north_m])
    cost = float(offset @ np.linalg.solve(a.covariance_m2 + b.covariance_m2, offset))
    if a.codes and b.codes and not set(a.codes) & set(b.codes):
        same_drive = set(a.drive_ids) & set(b.drive_ids)
        near = float(np.hypot(*offset)) < _OTHER_CODE_M
        return cost + _OTHER_CODE_COST if near and not same_drive else float("inf")
    return cost


def _fuse(a: ObservedPole, b: ObservedPole) -> ObservedPole:
    """Fuse what two observers say of one pole; `b` is the later one, whose plates count if they contradict.

    By covariance intersection (Julier and Uhlmann 1997): ground slope, kerb and boresight are the same errors
    in every drive past a pole, and how far two estimates share theirs is not known. The result is never
    more certain than the better of the two.
    """
    trace_a, trace_b = np.trace(a.covariance_m2), np.trace(b.covariance_m2)
    share = trace_b / (trace_a + trace_b)
    weight_a, weight_b = share * np.linalg.inv(a.covariance_m2), (1 - share) * np.linalg.inv(b.covariance_m2)
    covariance = np.linalg.inv(weight_a + weight_b)
    east, north = covariance @ (
        weight_a @ np.array([a.east_m, a.north_m]) + weight_b @ np.array([b.east_m, b.north_m])
    )
    contradict = bool(a.codes and b.codes and not set(a.codes) & set(b.codes))
    extra = tuple(code for code in b.codes if code not in a.codes)
    return replace(
        a,
        members=a.members + b.members,
        east_m=float(east),
        north_m=float(north),
        covariance_m2=covariance,
        codes=b.codes if contradict else a.codes + extra,
        drive_ids=tuple(dict.fromkeys(a.drive_ids + b.drive_ids)),
        cameras=a.cameras | b.cameras,
        n_sightings=a.n_sightings + b.n_sightings,
    )
