"""Estimates of one or more drives → observed poles, one a physical pole."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from twin.matching.config import MatchConfig
from twin.matching.one_to_one import cheapest_pairs
from twin.matching.plates.readings import (
    PlateHistory,
    PlateReading,
    Reader,
    code_now,
    is_disputed,
    text_now,
    together,
)
from twin.matching.plates.texts import split_texts
from twin.store.records import Estimate

_CHI2_999_2DOF = 13.816
"""99.9 % quantile of chi-square with two degrees of freedom: one true pair in a thousand is torn apart."""
SAME_CODE_CHI2 = 20.0
"""The same where they share a code: one in twenty thousand, since a torn pair is a sign that is found new."""
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
        What identifies the pole for good (:mod:`twin.matching.poles.keys`): until then its first member.
    east_m, north_m : float
        EPSG:25833.
    covariance_m2 : float64 (2, 2)
        Grid east, grid north.
    codes : tuple of str
        Sign code of each plate as the readings have it now, top down; empty if not annotated.
    cameras : frozenset of str
        ``drive/camera`` that saw it: one camera never sees one pole as two objects.
    first_ns, last_ns : int
        Epochs of its first and last sighting, UTC.
    seen_from_deg : frozenset of float
        Azimuths from true north, in steps of 30°, in which cameras that saw it stood from it. Empty where
        not known.
    p_taken_down : float
        Probability that it is gone: later, completely annotated drives passed and did not see it.
    averaged : float
        What is left of one drive's own variance in the mean of all: 1 for one drive, 1/n for n alike.
    readers : tuple of Reader
        The drives, where each of them read the same plates; empty for a single one.
    plates : tuple of tuples of PlateReading
        What each drive read on each plate, where that was not the same; see :meth:`readings`.
    disputed : bool
        Whether the drives disagree on the code of a plate.
    texts : tuple of str
        What is written on each plate as it was read last, "" where unknown; empty if no plate has a text.
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
    first_ns: int = 0
    last_ns: int = 0
    seen_from_deg: frozenset[float] = frozenset()
    p_taken_down: float = 0.0
    averaged: float = 1.0
    readers: tuple[Reader, ...] = ()
    plates: tuple[PlateHistory, ...] = ()
    disputed: bool = False
    texts: tuple[str, ...] = ()

    def readings(self) -> tuple[PlateHistory, ...]:
        """What each drive read on each plate, in the order of `codes`."""
        # Made when asked for: a fleet's poles are a hundred thousand, and nearly all are read alike.
        readers = self.who_read()
        if self.plates or not self.texts:
            return self.plates or tuple(
                [tuple([PlateReading(code, *r) for r in readers]) for code in self.codes]
            )
        said = zip(self.codes, self.texts, strict=True)
        return tuple(tuple(PlateReading(code, *r, text) for r in readers) for code, text in said)

    def who_read(self) -> tuple[Reader, ...]:
        """The drives, where each of them read the same plates."""
        return self.readers or (Reader(self.drive_ids[0], self.last_ns, self.seen_from_deg),)

    def codes_as(self, known: Sequence[str]) -> tuple[str, ...]:
        """Codes of the plates; where drives disagree on one, a known code that one of them read."""
        if not self.disputed:
            return self.codes
        return tuple(
            next((reading.code for reading in plate if reading.code in known), code)
            for code, plate in zip(self.codes, self.readings(), strict=True)
        )

    @property
    def sigma_m(self) -> float:
        """Mean one-sigma radius."""
        return float(np.sqrt(np.trace(self.covariance_m2) / 2))


def observed_poles(
    estimates: Sequence[Estimate],
    drive_order: Sequence[str],
    config: MatchConfig,
    seen_from_deg: Mapping[str, frozenset[float]] | None = None,
) -> list[ObservedPole]:
    """Merge estimates into poles: plates that share a foot, cameras of one drive, then drives.

    Parameters
    ----------
    estimates : sequence of Estimate, of one method
        Some may be of several objects at once: see :mod:`twin.matching.poles.same_pole`.
    drive_order : drive ids in time order
    seen_from_deg : mapping of member to azimuths, optional
        See :class:`ObservedPole`.

    Returns
    -------
    list of ObservedPole
        In the order of their keys.
    """
    gathered = _Gathered(config)
    by_drive: dict[str, list[Estimate]] = {}
    for estimate in estimates:
        by_drive.setdefault(estimate.drive_id, []).append(estimate)
    for drive_id in drive_order:
        by_cameras: dict[tuple[str, ...], list[ObservedPole]] = {}
        for estimate in sorted(by_drive.get(drive_id, ()), key=lambda e: e.object):
            pole = _pole_of_estimate(estimate, seen_from_deg or {})
            by_cameras.setdefault(tuple(sorted(estimate.cameras)), []).append(pole)
        # Objects that several cameras share (by the annotator's id) come first: single ones join them.
        seen = _Gathered(config)
        for cameras in sorted(by_cameras, key=lambda names: (-len(names), names)):
            seen.merge(_poles_of_cameras(by_cameras[cameras], config))
        gathered.merge(seen.poles)
    return sorted(gathered.poles, key=lambda pole: pole.key)


def _pole_of_estimate(estimate: Estimate, seen_from_deg: Mapping[str, frozenset[float]]) -> ObservedPole:
    ee, en, nn = estimate.covariance_m2
    members = estimate.members
    return ObservedPole(
        members=members,
        key=members[0],
        east_m=estimate.east_m,
        north_m=estimate.north_m,
        covariance_m2=np.array([[ee, en], [en, nn]], dtype=np.float64),
        codes=estimate.codes,
        drive_ids=(estimate.drive_id,),
        cameras=frozenset(f"{estimate.drive_id}/{camera}" for camera in estimate.cameras),
        n_sightings=estimate.n_sightings,
        first_ns=estimate.first_ns,
        last_ns=estimate.last_ns,
        seen_from_deg=frozenset().union(*(seen_from_deg.get(member, ()) for member in members)),
        texts=split_texts(estimate.text, estimate.codes),
    )


def _poles_of_cameras(single: Sequence[ObservedPole], config: MatchConfig) -> list[ObservedPole]:
    """Group what was annotated plate by plate at the same foot, in the same cameras of one drive."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

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
    if len(group) == 1:
        return group[0]
    best = min(group, key=lambda pole: (float(np.trace(pole.covariance_m2)), pole.key))
    texts = tuple(text for pole in group for text in pole.texts or ("",) * len(pole.codes))
    return replace(
        best,
        members=tuple(sorted(member for pole in group for member in pole.members)),
        key=min(pole.key for pole in group),
        codes=tuple(code for pole in group for code in pole.codes),
        texts=texts if any(texts) else (),
        n_sightings=sum(pole.n_sightings for pole in group),
        first_ns=min(pole.first_ns for pole in group),
        last_ns=max(pole.last_ns for pole in group),
        seen_from_deg=frozenset().union(*(pole.seen_from_deg for pole in group)),
    )


class _Gathered:
    """Poles gathered so far, and where they stand as an array: a fleet's next drive passes few of them."""

    def __init__(self, config: MatchConfig) -> None:
        self._config = config
        self.poles: list[ObservedPole] = []
        # Easting, northing and the sum of both variances; grown by doubling.
        self._rows = np.empty((64, 3))

    def put(self, number: int, pole: ObservedPole) -> None:
        """Put a pole in the place of another, or behind the last."""
        if number == len(self.poles):
            self.poles.append(pole)
            if number == len(self._rows):
                self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self.poles[number] = pole
        self._rows[number] = pole.east_m, pole.north_m, _spread(pole)

    def merge(self, seen: Sequence[ObservedPole]) -> None:
        """Pair what one more observer saw with the known poles, one-to-one, and fuse the pairs."""
        if not seen:
            return
        i, j, cost = self._near_pairs(seen)
        # "No pair" costs the gate itself: a pair beyond it never lowers the total.
        partner = {b: a for a, b in cheapest_pairs(i, j, cost - _CHI2_999_2DOF).items()}
        for b, pole in enumerate(seen):
            if b in partner:
                self.put(partner[b], _fuse(self.poles[partner[b]], pole, self._config))
            else:
                self.put(len(self.poles), pole)

    def _near_pairs(self, seen: Sequence[ObservedPole]) -> tuple[IntArray, IntArray, FloatArray]:
        """Pairs within the gate, and what each costs."""
        from scipy.spatial import cKDTree

        place = np.array([(p.east_m, p.north_m) for p in seen])
        rows = self._rows[: len(self.poles)]
        # The widest ellipse of either side bounds the gate.
        widest = max(_spread(p) for p in seen) + rows[:, 2].max(initial=0.0)
        reach = float(np.sqrt(max(_CHI2_999_2DOF, SAME_CODE_CHI2) * widest))
        box = (rows[:, :2] >= place.min(axis=0) - reach) & (rows[:, :2] <= place.max(axis=0) + reach)
        inside = np.flatnonzero(box.all(axis=1))
        if not inside.size:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
        near = cKDTree(rows[inside, :2]).sparse_distance_matrix(cKDTree(place), reach, output_type="ndarray")
        i, j = inside[near["i"]], near["j"]
        pairs = zip(i.tolist(), j.tolist(), strict=True)
        cost = np.array([_pair_cost(self.poles[a], seen[b]) for a, b in pairs])
        keep = cost < _CHI2_999_2DOF
        return i[keep], j[keep], cost[keep]


def _spread(pole: ObservedPole) -> float:
    """Sum of both variances: no axis of the ellipse has more."""
    ee, _, nn = _parts(pole)
    return ee + nn


def _pair_cost(a: ObservedPole, b: ObservedPole) -> float:
    """Squared Mahalanobis distance on one scale; infinite for one camera's, or if the codes contradict."""
    if a.cameras & b.cameras:
        return float("inf")
    east, north = a.east_m - b.east_m, a.north_m - b.north_m
    (ee, en), (_, nn) = (a.covariance_m2 + b.covariance_m2).tolist()
    cost = (nn * east**2 - 2 * en * east * north + ee * north**2) / (ee * nn - en**2)
    if _share_a_code(a, b):
        return float(cost * _CHI2_999_2DOF / SAME_CODE_CHI2)
    if a.codes and b.codes:
        same_drive = set(a.drive_ids) & set(b.drive_ids)
        near = math.hypot(east, north) < _OTHER_CODE_M
        return float(cost + _OTHER_CODE_COST) if near and not same_drive else float("inf")
    return float(cost)


def _read_together(a: ObservedPole, b: ObservedPole, config: MatchConfig) -> dict[str, Any]:
    """Fields of the plates of a pole that two observers saw, `b` the later one."""
    if a.codes == b.codes and not (a.plates or b.plates or a.texts or b.texts):  # nearly always
        known = a.who_read()
        drives = {reader.drive_id for reader in known}
        return {"readers": (*known, *(r for r in b.who_read() if r.drive_id not in drives))}
    plates = together(a.readings(), b.readings())
    texts = tuple(map(text_now, plates))
    return {
        "codes": tuple(code_now(plate, config) for plate in plates),
        "readers": (),
        "plates": plates,
        "disputed": any(map(is_disputed, plates)),
        "texts": texts if any(texts) else (),
    }


def _share_a_code(a: ObservedPole, b: ObservedPole) -> bool:
    """Whether both were ever read with one code."""
    if not set(a.codes).isdisjoint(b.codes):
        return True
    if not (a.disputed or b.disputed):
        return False
    return not {r.code for plate in a.readings() for r in plate}.isdisjoint(
        r.code for plate in b.readings() for r in plate
    )


def _parts(pole: ObservedPole) -> tuple[float, float, float]:
    """Variance of the easting, covariance, variance of the northing."""
    (ee, en), (_, nn) = pole.covariance_m2.tolist()
    return ee, en, nn


def _fuse(a: ObservedPole, b: ObservedPole, config: MatchConfig) -> ObservedPole:
    """Fuse what two observers say of one pole; `b` is the later one.

    By covariance intersection (Julier and Uhlmann 1997): ground slope, kerb and boresight are the same errors
    in every drive past a pole, and how far two estimates share theirs is not known. The result is never
    more certain than the better of the two. The weights are those that make the mean best if each drive's
    errors are its own: n drives alike have 1/n each, in whatever order they came.
    """
    (a_ee, a_en, a_nn), (b_ee, b_en, b_nn) = _parts(a), _parts(b)
    of_a, of_b = a.averaged * (a_ee + a_nn), b.averaged * (b_ee + b_nn)
    share = of_b / (of_a + of_b)
    averaged = share**2 * a.averaged + (1 - share) ** 2 * b.averaged
    if not set(a.drive_ids).isdisjoint(b.drive_ids):
        averaged = max(a.averaged, b.averaged)  # the cameras of one drive share trajectory and clock
    # Weighted inverses of 2×2 matrices by hand: a fleet fuses a hundred thousand of them.
    w_a, w_b = share / (a_ee * a_nn - a_en**2), (1 - share) / (b_ee * b_nn - b_en**2)
    ee, en, nn = w_a * a_nn + w_b * b_nn, -w_a * a_en - w_b * b_en, w_a * a_ee + w_b * b_ee
    determinant = ee * nn - en**2
    covariance = np.array([[nn, -en], [-en, ee]]) / determinant
    # The mean is that of `b`, plus what `a` draws towards itself.
    east, north = a.east_m - b.east_m, a.north_m - b.north_m
    pull_e, pull_n = w_a * (a_nn * east - a_en * north), w_a * (a_ee * north - a_en * east)
    east = b.east_m + (nn * pull_e - en * pull_n) / determinant
    north = b.north_m + (ee * pull_n - en * pull_e) / determinant
    return replace(
        a,
        members=a.members + b.members,
        east_m=east,
        north_m=north,
        covariance_m2=covariance,
        drive_ids=tuple(dict.fromkeys(a.drive_ids + b.drive_ids)),
        cameras=a.cameras | b.cameras,
        n_sightings=a.n_sightings + b.n_sightings,
        first_ns=min(a.first_ns, b.first_ns),
        last_ns=max(a.last_ns, b.last_ns),
        seen_from_deg=a.seen_from_deg | b.seen_from_deg,
        averaged=averaged,
        **_read_together(a, b, config),
    )
