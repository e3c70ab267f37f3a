"""Rows that are out of order in time: which ones to keep."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray


def longest_increasing(values: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the longest strictly increasing subsequence.

    Keeping "every row that is later than the row before" lets one stamp from the future throw away the rest
    of a recording; the longest increasing subsequence loses only the odd stamp itself.

    Parameters
    ----------
    values : int64 (n,)

    Returns
    -------
    bool (n,)
        True on the rows to keep. Of equal values in a row the first is kept.

    Notes
    -----
    Patience sorting, O(n log n): Fredman, *On computing the length of longest increasing subsequences*,
    Discrete Mathematics 11 (1975), doi:10.1016/0012-365X(75)90103-X.
    """
    n = len(values)
    if n < 2 or bool(np.all(np.diff(values) > 0)):
        return np.ones(n, dtype=np.bool_)
    ends: list[int] = []  # smallest last value of an increasing run of each length, and its row
    rows: list[int] = []
    before = np.full(n, -1, dtype=np.int64)
    for row, value in enumerate(values.tolist()):
        length = bisect_left(ends, value)
        if length < len(ends) and ends[length] == value:
            continue
        before[row] = rows[length - 1] if length else -1
        ends[length : length + 1] = [value]
        rows[length : length + 1] = [row]
    keep = np.zeros(n, dtype=np.bool_)
    row = rows[-1]
    while row >= 0:
        keep[row] = True
        row = int(before[row])
    return keep
