"""Videos → frames."""

from __future__ import annotations

import io
from collections import Counter
from typing import Any

import numpy as np
import pytest

from twin.drives.frames import video
from twin.drives.frames.video import decoded, index_video
from twin.errors import DriveError

TIMES_MS = [0, 33, 66, 100, 140, 166, 200, 240, 266, 300]
IDENTITY = "00010000 00000000 00000000 00000000 00010000 00000000 00000000 00000000 40000000"
CLOCKWISE = "00000000 00010000 00000000 ffff0000 00000000 00000000 00000000 00000000 40000000"


def _numbers(
    movies: Any, content: bytes, wanted: np.ndarray | None = None
) -> tuple[list[tuple[int, int]], Counter[str]]:
    """Number and shown number of each decoded frame, and what was lost."""
    index = index_video(io.BytesIO(content), "front.mp4")
    faults: Counter[str] = Counter()
    wanted = np.ones(index.n_frames, dtype=np.bool_) if wanted is None else wanted
    found = [(n, movies.number(i)) for n, i in decoded(io.BytesIO(content), index, wanted, faults)]
    return found, faults


@pytest.mark.parametrize("form", ["mp4", "matroska", "mpegts", "avi"])
def test_frames_of_a_container_have_their_numbers_in_order_of_time(movies: Any, form: str) -> None:
    """B-frames are stored out of order; a frame's number is its place in time."""
    # AVI has a fixed rate, and no B-frames that all readers agree on.
    avi = form == "avi"
    times_ms = [100 * i for i in range(10)] if avi else TIMES_MS
    found, faults = _numbers(movies, movies.video(times_ms, form, bf="0" if avi else "2"))
    assert found == [(i, i) for i in range(10)]
    assert not faults


def test_times_of_a_variable_frame_rate_are_those_of_each_frame(movies: Any) -> None:
    """The epochs follow what the recorder wrote for each frame, not a mean rate."""
    index = index_video(io.BytesIO(movies.video(TIMES_MS)), "front.mp4")
    assert index.offset_ns is not None
    assert np.abs(index.offset_ns / 1e6 - TIMES_MS).max() < 0.1
    assert (index.n_frames, index.width_px, index.height_px) == (10, 64, 48)


@pytest.mark.parametrize("b_frames", ["0", "2"])
def test_a_raw_stream_is_counted_and_has_no_times(movies: Any, b_frames: str) -> None:
    """A .h264 of the car is Annex B: no container, no times, frames in order."""
    content = movies.video(TIMES_MS, "h264", bf=b_frames)
    index = index_video(io.BytesIO(content), "C3.h264")
    assert (index.n_frames, index.pts, index.offset_ns) == (10, None, None)
    assert _numbers(movies, content)[0] == [(i, i) for i in range(10)]


def test_only_wanted_frames_come_out(movies: Any) -> None:
    """Every third frame is asked for, and only those are turned into pictures."""
    wanted = np.arange(10) % 3 == 0
    assert _numbers(movies, movies.video(TIMES_MS), wanted)[0] == [(0, 0), (3, 3), (6, 6), (9, 9)]


def test_a_lost_packet_is_counted_and_shifts_nothing(movies: Any) -> None:
    """With every frame a key frame, damage to one leaves the numbers of all others as they are."""
    content = bytearray(movies.video(TIMES_MS, "h264", g="1", bf="0"))
    starts = [
        i for i in range(len(content) - 4) if content[i : i + 4] == b"\0\0\0\1" and content[i + 4] & 31 == 7
    ]
    assert len(starts) == 10
    picture = content.index(b"\0\0\1\x65", starts[4])
    content[picture + 4 : starts[5]] = bytes(b"\xff" * (starts[5] - picture - 4))
    found, faults = _numbers(movies, bytes(content))
    assert sum(faults.values()) >= 1
    assert {n for n, _ in found} == set(range(10)) - {4}
    assert all(n == shown for n, shown in found)


def test_a_picture_that_is_marked_as_turned_comes_out_upright(movies: Any) -> None:
    """A display matrix of 90° clockwise makes 64 x 48 into 48 x 64."""
    content = movies.video(TIMES_MS)
    matrix = bytes.fromhex(IDENTITY.replace(" ", ""))
    at = content.index(matrix, content.index(matrix) + 1)
    turned = content[:at] + bytes.fromhex(CLOCKWISE.replace(" ", "")) + content[at + 36 :]
    index = index_video(io.BytesIO(turned), "front.mp4")
    _, image = next(decoded(io.BytesIO(turned), index, np.ones(10, dtype=np.bool_), Counter()))
    assert image.shape == (64, 48, 3)


def test_the_tag_creation_time_is_read(movies: Any) -> None:
    """2026-06-10 08:00 UTC is 1781078400 s; a tag without zone says nothing."""
    tagged = movies.video(TIMES_MS, tags={"creation_time": "2026-06-10T08:00:00.000000Z"})
    assert index_video(io.BytesIO(tagged), "front.mp4").created_ns == 1_781_078_400_000_000_000
    assert index_video(io.BytesIO(movies.video(TIMES_MS)), "front.mp4").created_ns is None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "front.mp4 is empty"),
        (b"<!doctype html><html><body>Log in</body></html>" * 20, "web page"),
        (bytes(5000), "not a video"),
        (b"RIFF" + bytes(100), "not a video"),
        (b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n", "not a video"),
        (b"ffconcat version 1.0\nfile /etc/passwd\n", "not a video"),
    ],
)
def test_what_is_no_video_is_said_in_one_sentence(content: bytes, said: str) -> None:
    """Empty files, web pages, noise and play lists are refused by name."""
    with pytest.raises(DriveError, match=said):
        index_video(io.BytesIO(content), "front.mp4")


def test_a_recording_that_was_cut_off_lacks_its_index(movies: Any) -> None:
    """The moov of an mp4 is written last: without it the sentence says what happened."""
    content = movies.video(TIMES_MS)
    with pytest.raises(DriveError, match="no index"):
        index_video(io.BytesIO(content[: content.index(b"moov") - 4]), "front.mp4")


def test_a_giant_picture_is_refused_before_it_is_decoded(
    movies: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The size that the header declares is looked at first."""
    monkeypatch.setattr(video, "MAX_PIXELS", 1000)
    with pytest.raises(DriveError, match="declares pictures of 64 x 48 pixels"):
        index_video(io.BytesIO(movies.video(TIMES_MS)), "front.mp4")


def test_more_frames_than_a_week_holds_are_refused(movies: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counting stops at a limit, so that a forged file cannot fill the memory."""
    monkeypatch.setattr(video, "MAX_FRAME", 5)
    with pytest.raises(DriveError, match="more than 5 frames"):
        index_video(io.BytesIO(movies.video(TIMES_MS)), "front.mp4")
