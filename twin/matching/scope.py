"""Where a match has to look if only some drives were touched since the last one: the cells about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from twin.matching.cells import CELL_M, NOWHERE, are_among, cells_of, cells_within, widened
from twin.matching.config import MatchConfig
from twin.matching.kept import NotSure
from twin.matching.likelihood import widest_gap_m
from twin.matching.poles.kept_places import KeptPlaces
from twin.matching.poles.windows import ENOUGH, MARGINS_M, SQUARE_M, corner_of, ring_of, squares_of

NEAR_M = 16.0
"""A pole whose estimates changed stands this near to one of them, before and after."""
_CELL_MARGIN_M = 64.0
_USUAL_SIGMA_M = 4.0
"""Poles that are known worse than this reach farther than others."""
_FARTHEST_CELLS = 4
"""What reaches farther than so many cells is at every edge."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Where a match has to look.

    Attributes
    ----------
    drives : frozenset of str
        That were touched.
    changed_m : float64 (n, 2)
        Where these have, or had, estimates: EPSG:25833.
    squares : mapping of a square's number → metres
        Whose poles may stand elsewhere now, and how far about them estimates are read.
    core, results, about, read : int64 (n,)
        Cells, sorted: in which something may have changed; whose findings are worked out; in which the rivals
        of these stand; whose estimates are read. Each holds the one before it.
    """

    drives: frozenset[str]
    changed_m: FloatArray
    squares: Mapping[int, float]
    core: IntArray
    results: IntArray
    about: IntArray
    read: IntArray

    def check(
        self, place_m: FloatArray, group: IntArray, pairs: tuple[IntArray, IntArray], config: MatchConfig
    ) -> None:
        """Make sure that nothing of what was found hangs on something beyond.

        Whether a pair is weighed depends on the other pairs of its pole and of its site. So what may be a
        pair with something beyond the edge is not sure; and what came or went changes its own pairs, and
        those of all that may be a pair with what it may be a pair with.

        Parameters
        ----------
        place_m : float64 (n, 2)
            Of poles and sites.
        group : int64 (n,)
            The same for those whose pairs hang together.
        pairs : (int64 (k,), int64 (k,))
            Rows of all that may be a pair.
        config : MatchConfig

        Raises
        ------
        NotSure
        """
        if not len(place_m):
            return
        cells = cells_of(place_m)
        usual_m = float(widest_gap_m(config.centre_line_sigma_m**2 + _USUAL_SIGMA_M**2, config))
        one, two = _reaches(place_m, pairs, usual_m)
        changed = _touches(place_m, two, self.core, some=True)
        at_edge = ~_touches(place_m, one, self.about, some=False)
        wanted = are_among(cells, self.results)
        n = int(group.max()) + 1

        def groups(of: BoolArray) -> BoolArray:
            return np.asarray(np.bincount(group[of], minlength=n) > 0)

        if (groups(changed) & groups(~wanted)).any() or (groups(wanted) & groups(at_edge)).any():
            raise NotSure


def _reaches(
    place_m: FloatArray, pairs: tuple[IntArray, IntArray], usual_m: float
) -> tuple[FloatArray, FloatArray]:
    """How far from each place its pairs reach at most (n,), and theirs again."""
    first, second = np.concatenate(pairs), np.concatenate(pairs[::-1])
    apart = np.hypot(*(place_m[first] - place_m[second]).T)
    one = np.zeros(len(place_m))
    np.maximum.at(one, first, apart)
    two = np.full(len(place_m), usual_m)
    np.maximum.at(two, first, apart + one[second])
    return np.maximum(one, usual_m), two


def _touches(place_m: FloatArray, reach_m: FloatArray, cells: IntArray, *, some: bool) -> BoolArray:
    """Whether the square about each place touches some of the cells, or lies in them."""
    steps = np.linspace(-1.0, 1.0, 2 * _FARTHEST_CELLS + 1)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    corners = cells_of((place_m[:, None] + reach_m[:, None, None] * grid).reshape(-1, 2))
    among = are_among(corners, cells).reshape(len(place_m), len(grid))
    too_far = reach_m > _FARTHEST_CELLS * CELL_M
    return np.asarray(among.any(axis=1) | too_far if some else among.all(axis=1) & ~too_far)


def scope_about(
    drives: frozenset[str], before_m: FloatArray, now_m: FloatArray, passed: IntArray, kept: KeptPlaces
) -> Scope:
    """Where a match has to look after some drives were touched.

    Parameters
    ----------
    drives : frozenset of str
    before_m, now_m : float64 (n, 2)
        Their estimates at the last match, and now.
    passed : int64 (k,)
        Cells of which they may have had, or have, some part in view.
    kept : KeptPlaces
        What the last match left of poles.
    """
    changed_m = np.concatenate([before_m, now_m])
    squares: dict[int, float] = {}
    around = int(np.ceil((MARGINS_M[-1] + NEAR_M) / SQUARE_M))
    for square in ring_of(squares_of(changed_m), around).tolist() if len(changed_m) else ():
        margin_m, corner = kept.margin_m(square), corner_of(square)
        looked_m = NEAR_M + (margin_m or 0.0)
        if not _within(changed_m, corner, looked_m):
            continue
        fewer = _within(before_m, corner, looked_m)
        squares[square] = margin_m if margin_m and not fewer else _margin_m(square, kept, fewer)
    of_squares = [cells_within(corner_of(square), SQUARE_M, 0.0) for square in squares]
    core = np.unique(np.concatenate([passed, *of_squares]))
    # What reaches two pairs far, on a centre line, is to lie within.
    results = widened(core, 2) if core.size else NOWHERE
    about = widened(results, 1) if core.size else NOWHERE
    wider = [cells_within(corner_of(s), SQUARE_M, m + _CELL_MARGIN_M) for s, m in squares.items()]
    read = np.unique(np.concatenate([widened(about, 1) if core.size else NOWHERE, *wider]))
    return Scope(drives, changed_m, squares, core, results, about, read)


def _margin_m(square: int, kept: KeptPlaces, fewer: int) -> float:
    """How far about a square is enough, if so many of its poles may be gone."""
    for around, margin_m in ((0, MARGINS_M[0]), (1, MARGINS_M[1])):
        if sum(map(kept.poles, ring_of(np.array([square]), around).tolist())) >= ENOUGH + fewer:
            return margin_m
    return MARGINS_M[-1]


def _within(place_m: FloatArray, corner_m: FloatArray, margin_m: float) -> int:
    """How many places lie in a square or so near to it."""
    off = place_m - corner_m
    return int(((off >= -margin_m) & (off < SQUARE_M + margin_m)).all(axis=1).sum())
