"""Known places that agree with one another through the drives that passed them."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.fusion.fuse import Clocks, Fused, Known, Passes, fuse
from geoloc.locate.accuracy import nees

LEAST = 3
"""So many have to agree before any of them counts."""
# 99 % of chi-square with two degrees of freedom.
_GATE = 9.21
_ROUNDS = 5


def fuse_with_agreeing(passes: Passes, clocks: Clocks, known: Known) -> tuple[Fused, BoolArray]:
    """Fuse, tied to those known places that agree with what the others and the drives say.

    Each is held against the place that its pole gets without it, and loses weight by how far that is off
    (Cauchy), round by round; then those beyond 99 % are left out. Fewer than `LEAST` count for nothing.

    Returns
    -------
    Fused
    used : bool (m,)
        Which known places count.
    """
    if known.there.sum() < LEAST:
        return fuse(passes, clocks), np.zeros_like(known.there)
    sigma_m = known.sigma_m
    for _ in range(_ROUNDS):
        square = _squares(fuse(passes, clocks, Known(known.place_m, sigma_m)), known)
        sigma_m = known.sigma_m * np.sqrt(1.0 + square)
    used = known.there & (square <= _GATE)
    # Those that were left out drew on the others, if little: once more without them.
    fused = fuse(passes, clocks, _only(known, used))
    used &= _squares(fused, known) <= _GATE
    if used.sum() < LEAST:
        return fuse(passes, clocks), np.zeros_like(used)
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
