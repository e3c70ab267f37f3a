"""When a video began: by its tag, its name and the track, which need not agree on the zone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from twin.drives.epochs import utc_text
from twin.drives.frames.name_times import epoch_from_name
from twin.drives.frames.video import VideoIndex

_NS = 1_000_000_000
_HOUR_NS = 3600 * _NS
_ZONES_H = (2, 1, *(sign * hour for hour in range(1, 15) for sign in (1, -1) if sign * hour not in (1, 2)))
"""Norwegian summer and winter time before all others."""
_OUTSIDE = 0.1
_SAME_NS = 10 * _NS


@dataclass(frozen=True, slots=True)
class VideoStart:
    """Epoch of a video's first frame, and why it is that one.

    Attributes
    ----------
    epoch_ns : int
    why : str
        A clause, for people.
    fits : bool
        Whether the video then lies within the track.
    """

    epoch_ns: int
    why: str
    fits: bool


def start_of(index: VideoIndex, track_ns: tuple[int, int] | None) -> VideoStart | None:
    """Find out when a video began.

    Cameras write local time as if it were UTC, and some the end of the recording: the first reading by which
    the video lies within the track is taken; without a track, or where none does, the tag or name as it
    stands.

    Parameters
    ----------
    index : VideoIndex
    track_ns : (int, int) or None
        First and last fix.

    Returns
    -------
    VideoStart or None
        None where neither tag nor name says a time.
    """
    readings = list(_readings(index))
    length_ns = 0 if index.offset_ns is None else int(index.offset_ns[-1])
    if not readings:
        return None
    for zone_h in (0, *_ZONES_H):
        for epoch_ns, why in readings:
            start_ns = epoch_ns - zone_h * _HOUR_NS
            if track_ns is not None and _lies_within(start_ns, length_ns, track_ns):
                zone = "" if not zone_h else f", less {zone_h:+d} h: it is local time, as the track shows"
                return VideoStart(start_ns, f"{why}{zone}", fits=True)
    return VideoStart(*readings[0], fits=track_ns is None)


def _readings(index: VideoIndex) -> Iterator[tuple[int, str]]:
    """What tag and name say, as if both were UTC; the end of the recording last."""
    named_ns = epoch_from_name(index.where, 0.0)
    length_ns = 0 if index.offset_ns is None else int(index.offset_ns[-1])
    tag_ns = index.created_ns
    if tag_ns is not None:
        at_end = named_ns is not None and abs(_apart(tag_ns - length_ns, named_ns)) < _SAME_NS
        said = utc_text(tag_ns)
        start = (tag_ns, f"its tag creation_time, {said}")
        end = (tag_ns - length_ns, f"its tag creation_time, {said}, is that of the end")
        yield from (end, start) if at_end and abs(_apart(tag_ns, named_ns or 0)) > _SAME_NS else (start, end)
    if named_ns is not None:
        yield named_ns, "the time in its name"


def _apart(one_ns: int, other_ns: int) -> int:
    """Difference but for whole hours."""
    return (one_ns - other_ns + _HOUR_NS // 2) % _HOUR_NS - _HOUR_NS // 2


def _lies_within(start_ns: int, length_ns: int, track_ns: tuple[int, int]) -> bool:
    """Whether all but a little of a video lies within the track, or of the track within the video."""
    shared = min(start_ns + length_ns, track_ns[1]) - max(start_ns, track_ns[0])
    shorter = min(length_ns, track_ns[1] - track_ns[0])
    return shared >= (1.0 - _OUTSIDE) * shorter and shared >= 0
