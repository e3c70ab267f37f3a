"""Which surveyed object an estimate is of: by id, or by where it stands."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from twin.matching.one_to_one import cheapest_pairs
from twin.reports.truth import Truth

Row = Mapping[str, Any]
Pairing = Callable[[Row], Truth | None]
"""The truth of a row of the tables ``estimate`` or ``sighting``; None where it has none."""


def by_id(truths: Sequence[Truth]) -> Pairing:
    """Pair by object id, and by drive where the truth names one."""
    known = {(truth.drive_id, truth.object): truth for truth in truths}

    def find(row: Row) -> Truth | None:
        return known.get((row["drive_id"], row["object"])) or known.get(("", row["object"]))

    return find


def by_position(estimates: Sequence[Row], truths: Sequence[Truth], within_m: float) -> Pairing:
    """Pair each drive's estimates, a method at a time, one-to-one with the truths they stand near.

    The pairs are those that leave the least sum of squared distances, where "no pair" counts as `within_m`:
    an offset that a whole drive has in common does not change them. Where the truth's label begins with a
    sign code, an estimate of other codes is no partner.

    Parameters
    ----------
    estimates : rows of the ``estimate`` table
    within_m : float
        Pairs that are farther apart are none.
    """
    found: dict[tuple[str, str, str], Truth] = {}
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in estimates:
        groups.setdefault((row["method"], row["drive_id"]), []).append(row)
    for (method, drive_id), rows in groups.items():
        possible = [truth for truth in truths if truth.drive_id in ("", drive_id)]
        for i, j in _nearest(rows, possible, within_m).items():
            found[method, drive_id, rows[i]["object"]] = possible[j]
    return lambda row: found.get((row["method"], row["drive_id"], row["object"]))


def nearest_m(estimates: Sequence[Row], truths: Sequence[Truth]) -> float:
    """Distance of the estimate that stands nearest to any truth."""
    from scipy.spatial import cKDTree

    tree = cKDTree([(truth.east_m, truth.north_m) for truth in truths])
    distance_m, _ = tree.query(np.array([(row["east_m"], row["north_m"]) for row in estimates]))
    return float(np.min(distance_m))


def _nearest(rows: Sequence[Row], truths: Sequence[Truth], within_m: float) -> dict[int, int]:
    """Row → truth."""
    from scipy.spatial import cKDTree

    if not rows or not truths:
        return {}
    estimated = cKDTree([(row["east_m"], row["north_m"]) for row in rows])
    surveyed = cKDTree([(truth.east_m, truth.north_m) for truth in truths])
    near = estimated.sparse_distance_matrix(surveyed, within_m, output_type="ndarray")
    pairs = zip(near["i"].tolist(), near["j"].tolist(), strict=True)
    fits = np.array([_same_sign(rows[i], truths[j]) for i, j in pairs], dtype=bool)
    near = near[fits]
    return cheapest_pairs(near["i"], near["j"], near["v"] ** 2 - within_m**2)


def _same_sign(row: Row, truth: Truth) -> bool:
    """Whether codes are shared, as far as both are known: words in a label ("skilt") are no codes."""
    seen, known = (
        {code.strip() for code in text.split(";") if code.strip()[:1].isdigit()}
        for text in (row["skiltnummer"], truth.label)
    )
    return not (seen and known) or bool(seen & known)
