"""Which surveyed object an estimate is of: by id, or by where it stands."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from twin.matching.one_to_one import cheapest_pairs
from twin.reports.truth import Truth
from twin.store.records import split_codes


@dataclass(frozen=True, slots=True)
class Placed:
    """An estimate, or a single sighting, with the position that it gives its object.

    Attributes
    ----------
    codes : tuple of str
        Empty of a sighting.
    east_m, north_m : float
        EPSG:25833.
    covariance_m2 : (float, float, float)
        East-east, east-north, north-north; NaN where unknown.
    range_m, speed_mps : float
        To the camera; of the car. NaN where unknown.
    height_m, sigma_height_m : float
        Ellipsoidal, and one sigma. NaN of a sighting, or where unknown.
    camera : str
        Of an estimate those that saw it, joined by +.
    epoch_ns : int
        Of a sighting; 0 of an estimate.
    """

    method: str
    drive_id: str
    object: str
    codes: tuple[str, ...]
    east_m: float
    north_m: float
    covariance_m2: tuple[float, float, float]
    range_m: float
    speed_mps: float
    height_m: float = math.nan
    sigma_height_m: float = math.nan
    camera: str = ""
    epoch_ns: int = 0

    @property
    def key(self) -> tuple[str, str, str]:
        """Method, drive and object."""
        return self.method, self.drive_id, self.object


Pairing = Callable[[Placed], Truth | None]
"""The truth of an estimate or a sighting; None where it has none."""


def by_id(truths: Sequence[Truth]) -> Pairing:
    """Pair by object id, and by drive where the truth names one."""
    surveyed = {(truth.drive_id, truth.object): truth for truth in truths}

    def find(placed: Placed) -> Truth | None:
        return surveyed.get((placed.drive_id, placed.object)) or surveyed.get(("", placed.object))

    return find


def by_position(estimates: Sequence[Placed], truths: Sequence[Truth], within_m: float) -> Pairing:
    """Pair each drive's estimates, a method at a time, one-to-one with the truths they stand near.

    The pairs are those that leave the least sum of squared distances, where "no pair" counts as `within_m`:
    an offset that a whole drive has in common does not change them. Where the truth's label begins with a
    sign code, an estimate of other codes is no partner.

    Parameters
    ----------
    estimates : sequence of Placed
    within_m : float
        Pairs that are farther apart are none.
    """
    pairs: dict[tuple[str, str, str], Truth] = {}
    groups: dict[tuple[str, str], list[Placed]] = {}
    for estimate in estimates:
        groups.setdefault((estimate.method, estimate.drive_id), []).append(estimate)
    for (_, drive_id), group in groups.items():
        possible = [truth for truth in truths if truth.drive_id in ("", drive_id)]
        for i, j in _nearest(group, possible, within_m).items():
            pairs[group[i].key] = possible[j]
    return lambda placed: pairs.get(placed.key)


def nearest_m(estimates: Sequence[Placed], survey_m: FloatArray) -> float:
    """Distance of the estimate that stands nearest to any surveyed position (n, 2), EPSG:25833."""
    from scipy.spatial import cKDTree

    tree = cKDTree(survey_m)
    distance_m, _ = tree.query(np.array([(e.east_m, e.north_m) for e in estimates]))
    return float(np.min(distance_m))


def _nearest(estimates: Sequence[Placed], truths: Sequence[Truth], within_m: float) -> dict[int, int]:
    """Estimate → truth, by their numbers."""
    from scipy.spatial import cKDTree

    if not estimates or not truths:
        return {}
    estimated = cKDTree([(e.east_m, e.north_m) for e in estimates])
    surveyed = cKDTree([(truth.east_m, truth.north_m) for truth in truths])
    near = estimated.sparse_distance_matrix(surveyed, within_m, output_type="ndarray")
    pairs = zip(near["i"].tolist(), near["j"].tolist(), strict=True)
    fits = np.array([_same_sign(estimates[i], truths[j]) for i, j in pairs], dtype=bool)
    near = near[fits]
    return cheapest_pairs(near["i"], near["j"], near["v"] ** 2 - within_m**2)


def _same_sign(estimate: Placed, truth: Truth) -> bool:
    """Whether codes are shared, as far as both are known: words in a label ("skilt") are no codes."""
    annotated, surveyed = (
        {code for code in codes if code[:1].isdigit()} for codes in (estimate.codes, split_codes(truth.label))
    )
    return not (annotated and surveyed) or bool(annotated & surveyed)
