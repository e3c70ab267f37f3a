"""Frame numbers and their stamps."""

from __future__ import annotations

import numpy as np
import pytest
from left_out import counts

from twin.drives.frames.stamp_files import NO_STAMP, read_timestamps
from twin.errors import DriveError

T0_US = 1_781_078_400_000_000  # 2026-06-10 08:00 UTC


def lines(*rows: tuple[int, int]) -> bytes:
    """Write frame numbers and stamps (µs after the start)."""
    return "".join(f"{frame}\t{T0_US + us}\n" for frame, us in rows).encode()


def test_timestamps_are_indexed_by_frame_number() -> None:
    """Microseconds become nanoseconds at the place of the frame number."""
    epoch_ns, skipped = read_timestamps(lines((0, 0), (1, 33_333), (2, 66_667)), "C3.timestamps")
    assert epoch_ns.tolist() == [(T0_US + us) * 1000 for us in (0, 33_333, 66_667)]
    assert skipped == ()


def test_timestamps_may_begin_at_any_number_and_have_holes() -> None:
    """Numbers without a line carry the mark of no stamp; only holes inside the numbering are counted."""
    epoch_ns, skipped = read_timestamps(lines((5, 0), (8, 90)), "C3.timestamps")
    assert len(epoch_ns) == 9
    assert np.flatnonzero(epoch_ns != NO_STAMP).tolist() == [5, 8]
    assert counts(skipped) == {"no stamp for the frame number": 2}


def test_timestamps_csv_gives_the_same_arrays() -> None:
    """The CSV with header says the same as the recorder's lines, whatever the order of its columns."""
    csv = f"time_ns,frame\n{T0_US * 1000},0\n{(T0_US + 9) * 1000},1\n".encode()
    ours, _ = read_timestamps(csv, "C3.csv")
    theirs, _ = read_timestamps(lines((0, 0), (1, 9)), "C3.timestamps")
    assert ours.tolist() == theirs.tolist()


def test_timestamps_count_what_they_leave_out() -> None:
    """Duplicates, backward stamps, absurd clocks and unreadable lines are each counted by reason."""
    content = lines((0, 0), (1, 100), (1, 150), (2, 50), (3, 300), (4, 400)) + b"noise\n5\t12\n-1\t1\n"
    epoch_ns, skipped = read_timestamps(content, "C3.timestamps")
    assert counts(skipped) == {
        "frame number given before": 1,
        "stamp not later than that of the frame before": 1,
        "not a frame number and a stamp": 1,
        "stamp outside the years 2000–2099": 1,
        "frame number outside 0–20000000": 1,
    }
    # Frames 1 (100 µs) and 2 (50 µs) contradict each other: one of them goes.
    assert np.count_nonzero(epoch_ns != NO_STAMP) == 4


def test_timestamps_do_not_allocate_for_an_absurd_frame_number() -> None:
    """A frame number of nineteen digits is left out rather than believed."""
    epoch_ns, skipped = read_timestamps(lines((0, 0), (10**18, 5)), "C3.timestamps")
    assert len(epoch_ns) == 1
    assert sum(counts(skipped).values()) == 1


@pytest.mark.parametrize("content", [b"", b"\n\n", b"<html>", b"frame,stamp\n0,1\n", b"\xff\xfe\x00"])
def test_timestamps_without_a_usable_line_are_refused_by_name(content: bytes) -> None:
    """The error names the file."""
    with pytest.raises(DriveError, match=r"C3\.timestamps"):
        read_timestamps(content, "C3.timestamps")
