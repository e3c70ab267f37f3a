"""Which rows are kept when stamps are out of order."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.drives.epochs import longest_increasing

stamps = st.lists(st.integers(-5, 5), max_size=9)


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(stamps)
def test_longest_increasing_is_as_long_as_the_best_of_all_subsequences(values: list[int]) -> None:
    """No subsequence that increases strictly is longer than the one kept."""
    keep = longest_increasing(np.array(values, dtype=np.int64))
    kept = np.array(values, dtype=np.int64)[keep]
    assert np.all(np.diff(kept) > 0)
    best = max(
        (
            n
            for n in range(len(values) + 1)
            for chosen in combinations(values, n)
            if all(a < b for a, b in pairwise(chosen))
        ),
        default=0,
    )
    assert len(kept) == best


def test_longest_increasing_loses_only_the_stamp_from_the_future() -> None:
    """One stamp far ahead costs itself, not the rows after it."""
    keep = longest_increasing(np.array([1, 2, 999, 3, 4], dtype=np.int64))
    assert keep.tolist() == [True, True, False, True, True]


def test_longest_increasing_keeps_the_first_of_equal_values() -> None:
    """A duplicate loses to the row before it."""
    keep = longest_increasing(np.array([1, 2, 2, 3], dtype=np.int64))
    assert keep.tolist() == [True, True, False, True]
