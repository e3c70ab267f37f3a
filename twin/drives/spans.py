"""Whether pictures and track are of the same time, and the antennas as long as one another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.annotated import epochs_of
from twin.drives.clock import clock_hint, stamps_hint, utc_text
from twin.drives.drive import Annotations
from twin.drives.read_track import Track
from twin.drives.settings import SETTINGS_FILE
from twin.errors import DriveError

Span = tuple[int, int]


def check_span(
    annotations: Annotations,
    stamps: Mapping[str, IntArray],
    sources: Mapping[str, str],
    offset_ns: int,
    track: Track,
) -> list[str]:
    """Refuse a drive whose annotated frames all lie outside the track; tell of cameras where some do.

    Parameters
    ----------
    annotations : Annotations
        Each with a time.
    stamps, sources : mapping of camera to int64 (frames,), and to the file that says so
    offset_ns : int
        Added to the stamps.
    track : Track

    Raises
    ------
    DriveError
    """
    cameras = np.unique(annotations.camera).tolist()
    epochs = {c: epochs_of(annotations, stamps, c)[annotations.camera == c] + offset_ns for c in cameras}
    if not epochs:
        return []
    span = track.span_ns()
    outside = {c: _outside(epoch_ns, span) for c, epoch_ns in epochs.items()}
    epoch_ns = np.concatenate(list(epochs.values()))
    what = "poses" if track.poses is not None else "GNSS fixes"
    if all(outside[c] == len(epochs[c]) for c in cameras):
        hint = clock_hint(_span(epoch_ns), span)
        raise DriveError(
            f"Every annotated frame lies outside the {what}: the frames are {_spans(epoch_ns, span, what)}."
            f" Bring files of one drive together, or correct the clocks with camera_offset_ms in"
            f" {SETTINGS_FILE}. {hint}".rstrip()
        )
    if len(cameras) > 1 and any(outside[c] == len(epochs[c]) for c in cameras):
        # Of one clock all cameras would be off.
        return [
            f"All {n} annotations of {c} lie outside the {what} and cannot be located: its frames are"
            f" {_spans(epochs[c], span, what)}. {stamps_hint(_span(epochs[c]), span, sources[c])}".rstrip()
            for c, n in outside.items()
            if n == len(epochs[c])
        ]
    if not any(outside.values()):
        return []
    n_outside = sum(outside.values())
    said = (
        f"{n_outside} of {len(epoch_ns)} annotations lie outside the {what} and cannot be located: the"
        f" annotated frames are {_spans(epoch_ns, span, what)}. {clock_hint(_span(epoch_ns), span)}"
    )
    return [said.rstrip()]


def _outside(epoch_ns: IntArray, span: Span) -> int:
    return int(np.count_nonzero((epoch_ns < span[0]) | (epoch_ns > span[1])))


def _span(epoch_ns: IntArray) -> Span:
    return int(epoch_ns.min()), int(epoch_ns.max())


def _spans(epoch_ns: IntArray, track: Span, what: str) -> str:
    (first, last), (begin, end) = map(utc_text, _span(epoch_ns)), map(utc_text, track)
    return f"from {first} to {last}, the {what} from {begin} to {end}"
