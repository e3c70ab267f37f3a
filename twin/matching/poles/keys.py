"""Which pole of earlier matches an observed pole is: by its clicks, else by its place; never by an id.

Annotators number objects anew, and another person numbers them otherwise: what a decision was made about must
not follow the number. The same clicks are the same object, wherever a better calibration puts them. Where the
clicks are other ones, the nearest pole of before is it, one-to-one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from twin.matching.one_to_one import cheapest_pairs
from twin.matching.poles.poles import ObservedPole

_REACH_M = 2.0
"""Other clicks put a pole within this of where it was, or within its ellipse."""
_OTHER_CODE_M = 1.0
"""What it costs that a pole and that of before share no sign code."""
_CHI_95_2DOF = 2.448


@dataclass(frozen=True, slots=True)
class Mark:
    """One annotated object of a drive, as far as it does not depend on its id.

    Attributes
    ----------
    clicks : str
        Of all its annotations (:func:`twin.matching.poles.seen_in.clicks_of`).
    east_m, north_m : float
        EPSG:25833.
    codes : tuple of str
        Of its plates.
    """

    drive_id: str
    clicks: str
    east_m: float
    north_m: float
    codes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class KnownMark:
    """A mark of an earlier match, and the key of the pole that it was part of."""

    mark: Mark
    pole: str


def with_known_keys(
    poles: Sequence[ObservedPole],
    marks: Mapping[str, Mark],
    known: Sequence[KnownMark],
    elsewhere: Set[str] = frozenset(),
    used: Set[str] = frozenset(),
) -> list[ObservedPole]:
    """Give each pole the key that it had in earlier matches, or one that no pole ever had.

    Parameters
    ----------
    poles : sequence of ObservedPole
    marks : mapping of member to its mark
    known : sequence of KnownMark
        The oldest first: of poles that have come together the oldest key stays, of one that has come apart
        the oldest part keeps it.
    elsewhere : set of str
        Keys that other poles have.
    used : set of str
        Keys that no pole may get for a new one.

    Returns
    -------
    list of ObservedPole
        In the order of their keys.
    """
    own = [[marks[member] for member in pole.members if member in marks] for pole in poles]
    key_of = _by_clicks(own, known, elsewhere)
    named = {*key_of.values(), *elsewhere}
    free = [one for one in known if one.pole not in named]
    left = [i for i in range(len(poles)) if i not in key_of and own[i]]
    key_of |= _by_place(poles, own, left, free)
    taken = {*elsewhere, *used, *(one.pole for one in known)}
    for i, pole in enumerate(poles):
        if i not in key_of:
            key_of[i] = _new_key(pole, taken)
            taken.add(key_of[i])
    return sorted((replace(p, key=key_of[i]) for i, p in enumerate(poles)), key=lambda pole: pole.key)


def _by_clicks(
    own: Sequence[Sequence[Mark]], known: Sequence[KnownMark], elsewhere: Set[str]
) -> dict[int, str]:
    """Pole → key, of those that have an object with the clicks of before."""
    holders: dict[tuple[str, str], list[tuple[int, Mark]]] = {}
    for i, of_pole in enumerate(own):
        for mark in of_pole:
            holders.setdefault((mark.drive_id, mark.clicks), []).append((i, mark))
    key_of: dict[int, str] = {}
    taken = set(elsewhere)
    for one in known:
        if one.pole in taken:
            continue
        known_as = (one.mark.drive_id, one.mark.clicks)
        # Of two objects that were clicked alike the nearer one: else they would swap keys in every match.
        left = [(i, mark) for i, mark in holders.get(known_as, ()) if i not in key_of]
        if left:
            i, _ = min(left, key=lambda pair: _apart_m(pair[1], one.mark)) if len(left) > 1 else left[0]
            key_of[i] = one.pole
            taken.add(one.pole)
    return key_of


def _apart_m(mark: Mark, other: Mark) -> float:
    return math.hypot(mark.east_m - other.east_m, mark.north_m - other.north_m)


def _by_place(
    poles: Sequence[ObservedPole],
    own: Sequence[Sequence[Mark]],
    left: Sequence[int],
    free: Sequence[KnownMark],
) -> dict[int, str]:
    """Pole → key, of those that stand where one of before stood: one-to-one, the nearest."""
    from scipy.spatial import cKDTree

    if not left or not free:
        return {}
    reach = {i: max(_REACH_M, _CHI_95_2DOF * poles[i].sigma_m) for i in left}
    present = [(i, mark) for i in left for mark in own[i]]
    here = cKDTree([(mark.east_m, mark.north_m) for _, mark in present])
    there = cKDTree([(one.mark.east_m, one.mark.north_m) for one in free])
    near = here.sparse_distance_matrix(there, max(reach.values()), output_type="ndarray")
    keys = list(dict.fromkeys(one.pole for one in free))
    number = {key: j for j, key in enumerate(keys)}
    # Being alone costs nothing: a pair is worth how far it stays within the reach.
    cost: dict[tuple[int, int], float] = {}
    for a, b, distance in zip(near["i"].tolist(), near["j"].tolist(), near["v"].tolist(), strict=True):
        (i, mark), one = present[a], free[b]
        pair = i, number[one.pole]
        strange = mark.codes and one.mark.codes and set(mark.codes).isdisjoint(one.mark.codes)
        worth = distance + (_OTHER_CODE_M if strange else 0.0) - reach[i]
        cost[pair] = min(worth, cost.get(pair, 0.0))
    wanted = {pair: worth for pair, worth in cost.items() if worth < 0}
    rows, columns = np.array(list(wanted), dtype=np.int64).reshape(-1, 2).T
    partner = cheapest_pairs(rows, columns, np.array(list(wanted.values())))
    return {i: keys[j] for i, j in partner.items()}


def _new_key(pole: ObservedPole, taken: Set[str]) -> str:
    """A member's name, but none that another pole has or had: its id may have been that pole's before."""
    key = next((member for member in pole.members if member not in taken), f"{pole.members[0]}+")
    while key in taken:
        key += "+"
    return key
