"""Whether estimates beyond an edge can change how those within are put together into poles."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from twin.matching.asked import Asked
from twin.matching.kept import NotSure
from twin.matching.poles.poles import SAME_CODE_CHI2
from twin.matching.reading import rows_of_drives
from twin.store import schema

BEYOND_M = 512.0
"""Estimates so far beyond what is read may reach in."""
_WITHIN_M = 64.0
_SLACK = 2.0
"""A pole of many estimates need not stand between them, but within so many times their reach."""
_ROUNDED_M = 0.5
"""Estimates that stand so near to each other count as one here."""


class Edge(NamedTuple):
    """A square, and how far about it poles are needed, and estimates were read.

    Attributes
    ----------
    corner_m : float64 (2,)
        South-west, EPSG:25833.
    side_m, needed_m, read_m : float
    """

    corner_m: FloatArray
    side_m: float
    needed_m: float
    read_m: float


def check_edge(asked: Asked, drive_ids: Collection[str], edge: Edge) -> None:
    """Make sure that no estimate beyond what was read can change poles that are needed.

    One estimate changes another's pole if a pair of them is possible, and then those for which that one is
    possible, and so on. So what hangs together by possible pairs must not reach from what was not read to
    what is needed. How far apart a pair can be follows from the gate and both covariances.

    Parameters
    ----------
    drive_ids : collection of str
        All that come within `BEYOND_M` of what was read.

    Raises
    ------
    NotSure
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    place_m, reach_m = _places(asked, drive_ids)
    (west, south), (east, north) = edge.corner_m, edge.corner_m + edge.side_m
    beyond = [west - place_m[:, 0], place_m[:, 0] - east, south - place_m[:, 1], place_m[:, 1] - north]
    off = np.max(beyond, axis=0)
    band = (off > edge.needed_m - _WITHIN_M) & (off < edge.read_m + BEYOND_M)
    place_m, reach_m, off = place_m[band], reach_m[band], off[band]
    if not (off > edge.read_m).any() or not (off <= edge.needed_m).any():
        return
    # Whoever has the longer reach finds the other.
    near = cKDTree(place_m).query_ball_point(place_m, 2 * reach_m)
    first = np.repeat(np.arange(len(near)), [len(one) for one in near])
    second = np.concatenate([np.array(one, dtype=np.int64) for one in near])
    apart = np.hypot(*(place_m[first] - place_m[second]).T)
    linked = apart <= reach_m[first] + reach_m[second]
    ends = first[linked], second[linked]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(len(off), len(off)))
    _, group = connected_components(graph, directed=False)
    if np.intersect1d(group[off > edge.read_m], group[off <= edge.needed_m]).size:
        raise NotSure


def _places(asked: Asked, drive_ids: Collection[str]) -> tuple[FloatArray, FloatArray]:
    """Where estimates stand (n, 2), and so far from each a pole of it can be paired (n,): half of a pair."""
    t = schema.estimate.c
    statement = sa.select(t.east_m, t.north_m, t.cov_ee_m2, t.cov_nn_m2).where(
        t.method == asked.method, t.nvdb_type.is_(None)
    )
    rows = rows_of_drives(asked.view, statement, t.drive_id, drive_ids)
    values = np.array([tuple(row.values()) for row in rows], dtype=np.float64).reshape(-1, 4)
    least_m = max(asked.config.same_pole_m, asked.config.seen_twice_m) / 2
    reach_m = np.maximum(_SLACK * np.sqrt(SAME_CODE_CHI2 * (values[:, 2] + values[:, 3])), least_m)
    # Forty drives past one sign are one place here, with the longest of their reaches.
    rounded, of = np.unique(np.round(values[:, :2] / _ROUNDED_M), axis=0, return_inverse=True)
    longest = np.zeros(len(rounded))
    np.maximum.at(longest, of.reshape(-1), reach_m)
    return rounded * _ROUNDED_M, longest + _ROUNDED_M
