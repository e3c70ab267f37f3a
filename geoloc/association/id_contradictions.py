"""Ids that contradict the geometry: one id on two signs, two ids on one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.association.bearings import AssociationRules, Bearings
from geoloc.association.merging import fit_together

# An id holds two signs, or two ids are one, if each side has so many sightings.
_MIN_EVIDENCE = 3


class IdFinding(NamedTuple):
    """Ids that contradict the geometry.

    Attributes
    ----------
    kind : str
        ``split``: one id holds two signs; ``merge``: two ids are one sign.
    ids : tuple of str
        The one, or the two.
    rows : tuple of int64 arrays
        Sightings of the two sides, in time order.
    message : str
        One sentence for the annotator.
    """

    kind: str
    ids: tuple[str, ...]
    rows: tuple[IntArray, IntArray]
    message: str


class _Suspect(NamedTuple):
    """Two sides that are held for two signs of one id, or one sign of two ids."""

    ids: tuple[str, ...]
    sides: tuple[IntArray, IntArray]


def contradictions(
    seen: Bearings, by_lens: Bearings, group: IntArray, ids: NDArray[np.str_], rules: AssociationRules
) -> tuple[IdFinding, ...]:
    """Compare ids with objects, and confirm each difference by fitting points.

    Parameters
    ----------
    seen : Bearings (n,)
    by_lens : Bearings (n,)
        The same with directions as poor as the lens makes them: what contradicts also these is two signs.
    group : int64 (n,)
        Objects found without the ids.
    ids : str (n,)

    Returns
    -------
    tuple of IdFinding
    """
    findings = []
    for kind, rays, suspects in (
        ("split", by_lens, _splits(seen, group, ids)),
        ("merge", seen, _merges(seen, group, ids)),
    ):
        held = list(suspects)
        one = fit_together(rays, [side for suspect in held for side in suspect.sides], rules)
        findings += [
            IdFinding(
                kind,
                suspect.ids,
                (seen.row[suspect.sides[0]], seen.row[suspect.sides[1]]),
                _message(kind, suspect),
            )
            for suspect, is_one in zip(held, one.tolist(), strict=True)
            if is_one == (kind == "merge")
        ]
    return tuple(findings)


def _message(kind: str, suspect: _Suspect) -> str:
    first, second = (side.size for side in suspect.sides)
    if kind == "split":
        return f"{suspect.ids[0]} marks two signs: {first} sightings fit one place, {second} another."
    one, other = suspect.ids
    return f"{one} ({first} sightings) and {other} ({second}) are one sign: one place fits both."


def _splits(seen: Bearings, group: IntArray, ids: NDArray[np.str_]) -> Iterator[_Suspect]:
    """Ids whose sightings of one kind belong to several objects: the largest against each other one."""
    for name in np.unique(ids[ids != ""]).tolist():
        for face in (False, True):
            rows = np.flatnonzero((ids == name) & (seen.face == face))
            if not rows.size or _twice_in_one_picture(seen, rows):
                continue
            sides = _sides(rows, group[rows])
            for other in sides[1:]:
                yield _Suspect((name,), (sides[0], other))


def _merges(seen: Bearings, group: IntArray, ids: NDArray[np.str_]) -> Iterator[_Suspect]:
    """Pairs of ids that share an object and never one picture."""
    pairs: set[tuple[str, str, bool]] = set()
    for number in np.unique(group[group >= 0]).tolist():
        for face in (False, True):
            rows = np.flatnonzero((group == number) & (seen.face == face) & (ids != ""))
            names, count = np.unique(ids[rows], return_counts=True)
            enough = names[count >= _MIN_EVIDENCE].tolist()
            pairs |= {(one, other, face) for one, other in combinations(enough, 2)}
    for one, other, face in sorted(pairs):
        sides = tuple(np.flatnonzero((ids == name) & (seen.face == face)) for name in (one, other))
        if not _twice_in_one_picture(seen, np.concatenate(sides)):
            yield _Suspect((one, other), (sides[0], sides[1]))


def _sides(rows: IntArray, group: IntArray) -> list[IntArray]:
    """Rows by object, the largest first, those with too few sightings left out."""
    names, count = np.unique(group[group >= 0], return_counts=True)
    order = np.argsort(-count, kind="stable")
    return [rows[group == names[i]] for i in order if count[i] >= _MIN_EVIDENCE]


def _twice_in_one_picture(seen: Bearings, rows: IntArray) -> bool:
    return bool(np.unique(seen.frame[rows]).size < rows.size)
