"""GPS weeks, rollovers and leap seconds; which rows are kept when stamps are out of order."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.drives.epochs import (
    ROLLOVER_NS,
    WEEK_NS,
    after_rollovers,
    leap_seconds,
    longest_increasing,
    nearest_week,
    utc_from_gps,
)

S = 1_000_000_000


def epoch(*moment: int) -> int:
    """Nanoseconds since 1970 of a UTC date and time."""
    return int(datetime(*moment, tzinfo=UTC).timestamp()) * S  # type: ignore[misc,arg-type]


@pytest.mark.parametrize(
    ("moment", "ahead"),
    [((2012, 6, 30), 15), ((2012, 7, 1), 16), ((2015, 7, 1), 17), ((2016, 12, 31), 17), ((2026, 6, 10), 18)],
)
def test_leap_seconds_are_those_of_bulletin_c(moment: tuple[int, ...], ahead: int) -> None:
    """From the day on which each was put in."""
    assert leap_seconds(epoch(*moment)) == ahead


def test_utc_of_a_known_week() -> None:
    """Week 2098, 271,497.8 s, is 2020-03-25 03:24:39.8 UTC, as the Piksi that recorded it wrote itself."""
    gps_ns = 2098 * WEEK_NS + 271_497_800_000_000
    assert utc_from_gps(gps_ns) == epoch(2020, 3, 25, 3, 24, 39) + 800_000_000
    assert utc_from_gps(gps_ns, 0) == epoch(2020, 3, 25, 3, 24, 57) + 800_000_000


@given(st.integers(epoch(2010, 1, 1), epoch(2026, 12, 1)), st.integers(0, 2))
def test_rollovers_are_undone_for_every_date_of_a_drive(epoch_ns: int, times: int) -> None:
    """Dates up to the end of 2029 come back from one or two rollovers; sound dates stay."""
    stated = epoch_ns - times * ROLLOVER_NS
    if stated >= epoch(1980, 1, 6) and epoch_ns < epoch(2010, 1, 1) + ROLLOVER_NS:
        assert after_rollovers(stated) == epoch_ns


@given(st.integers(0, 4000 * WEEK_NS), st.integers(-3 * 86_400 * S, 3 * 86_400 * S))
def test_nearest_week_finds_the_epoch_from_any_day_around(gps_ns: int, off_ns: int) -> None:
    """The time of the week, and another epoch less than half a week away, are enough."""
    assert nearest_week(gps_ns % WEEK_NS, gps_ns + off_ns) == gps_ns


stamps = st.lists(st.integers(-5, 5), max_size=9)


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


@pytest.mark.parametrize(
    ("values", "kept"),
    [([1, 2, 999, 3, 4], [True, True, False, True, True]), ([1, 2, 2, 3], [True, True, False, True])],
)
def test_longest_increasing_loses_a_stamp_from_the_future_and_the_second_of_equals(
    values: list[int], kept: list[bool]
) -> None:
    """One stamp far ahead costs itself, not the rows after it; a duplicate loses to the row before it."""
    assert longest_increasing(np.array(values, dtype=np.int64)).tolist() == kept
