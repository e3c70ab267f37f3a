"""Passes, and known places, that agree with one another through the drives."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.fusion.fuse import Clocks, Fused, Known, Passes, fuse
from geoloc.locate.accuracy import nees

LEAST = 3
"""So many have to agree before any of them counts."""
# 99 % of chi-square with two degrees of freedom.
_GATE = 9.21
_ROUNDS = 5
# 99.99 % of the same: what a drive saw elsewhere was another pole.
_ANOTHER_POLE, _MOST_TAKEN_OUT = 18.4, 20


def passes_that_agree(passes: Passes, clocks: Clocks) -> BoolArray:
    """Which passes (n,) are of the pole that they were put to, as far as drives can tell.

    A pole that was merged wrongly would pull the tracks of its drives. Each pass is held against what all
    else says of its place, and the worst at its pole and of its drive is taken out, round by round. Of two
    passes nobody knows which one is wrong: both are taken out.
    """
    return _agreeing(passes, clocks, int(passes.pole.max()) + 1)[0]


def _agreeing(passes: Passes, clocks: Clocks, poles: int) -> tuple[BoolArray, Fused]:
    """Which passes agree, and what these give for so many poles."""
    nobody = Known(np.full((poles, 2), np.nan), np.ones(poles))
    keep = np.ones(passes.pole.size, dtype=np.bool_)
    for _ in range(_MOST_TAKEN_OUT):
        rows = np.flatnonzero(keep)
        part = _rows(passes, keep)
        fused = fuse(part, clocks, nobody)
        square = fused.square
        if not square.size:
            return keep, fused
        worst = (square > _ANOTHER_POLE) & _largest_of(square, part.pole) & _largest_of(square, part.drive)
        if not worst.any():
            return keep, fused
        left = np.bincount(part.pole) - np.bincount(part.pole[worst], minlength=part.pole.max() + 1)
        keep[rows[worst | (np.isin(part.pole, part.pole[worst]) & (left[part.pole] < 2))]] = False
    return keep, fuse(_rows(passes, keep), clocks, nobody)


def _largest_of(square: FloatArray, group: IntArray) -> BoolArray:
    """Where a value is the largest of its group; two that are as large are."""
    largest = np.zeros(group.max() + 1)
    np.maximum.at(largest, group, square)
    return np.asarray(square >= (1.0 - 1e-6) * largest[group])


def _rows(passes: Passes, keep: BoolArray) -> Passes:
    return Passes(*(getattr(passes, name)[keep] for name in Passes.__dataclass_fields__))


def fuse_with_agreeing(passes: Passes, clocks: Clocks, known: Known) -> tuple[Fused, BoolArray]:
    """Fuse passes that agree, tied to those known places that agree with what the others and the drives say.

    A pole none of whose passes agree has no place (`passes_that_agree`). Each known place is held against
    the place that its pole gets without it, and loses weight by how far that is off (Cauchy), round by round;
    then those beyond 99 % are left out. Fewer than `LEAST` count for nothing.

    Returns
    -------
    Fused
    used : bool (m,)
        Which known places count.
    """
    nothing = np.zeros_like(known.there)
    keep, fused = _agreeing(passes, clocks, len(known.place_m))
    passes = _rows(passes, keep)
    if known.there.sum() < LEAST:
        return fused, nothing
    sigma_m = known.sigma_m
    for _ in range(_ROUNDS):
        square = _squares(fuse(passes, clocks, Known(known.place_m, sigma_m)), known)
        sigma_m = known.sigma_m * np.sqrt(1.0 + square)
    used = known.there & (square <= _GATE)
    # Those that were left out drew on the others, if little: once more without them.
    fused = fuse(passes, clocks, _only(known, used))
    used &= _squares(fused, known) <= _GATE
    if used.sum() < LEAST:
        return fuse(passes, clocks, _only(known, nothing)), nothing
    return fuse(passes, clocks, _only(known, used)), used


def _squares(fused: Fused, known: Known) -> FloatArray:
    """Squared distances over variances (m,), 0 where nothing is known."""
    covariance = fused.covariance_m2 + known.sigma_m[:, None, None] ** 2 * np.eye(2)
    square = np.zeros(len(known.place_m))
    there = known.there & np.isfinite(fused.place_m[:, 0])
    square[there] = nees((fused.place_m - known.place_m)[there], covariance[there])
    return square


def _only(known: Known, used: BoolArray) -> Known:
    return Known(np.where(used[:, None], known.place_m, np.nan), known.sigma_m)
