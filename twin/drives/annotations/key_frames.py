"""Tracks of which an annotation tool drew most rows itself: what of them was measured, what was only seen.

Between two key frames, which somebody set, tools draw the box on a straight line. A car that passes a sign
sees it on no straight line: such rows miss it by a residual that changes slowly, and hundreds of them would
outweigh the few that were looked at.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.annotations.gather import only
from twin.drives.drive import Annotation, Annotations
from twin.drives.folder.notes import DriveDoubt, ReadingNotes, SkipKind, skipped_annotations
from twin.drives.frames.stamp_files import NO_STAMP

CURE = "set key frames (K in CVAT) where the mark fits, in three pictures or more on the way past the sign"


def key_frames(annotations: Annotations, notes: ReadingNotes) -> tuple[Annotations, Annotations]:
    """Part what was measured from what the tool interpolated, and tell how much that is.

    Parameters
    ----------
    annotations : Annotations
        Each with a time.
    notes : ReadingNotes
        Gets the counts of each file, and a warning of objects that have no key frame at all.

    Returns
    -------
    measured, interpolated : Annotations
    """
    by_hand = annotations.is_measured
    measured, interpolated = only(annotations, by_hand), only(annotations, ~by_hand)
    for file, count in zip(*np.unique(interpolated.file, return_counts=True), strict=True):
        notes.skipped.append(skipped_annotations(SkipKind.INTERPOLATED, str(file), int(count)))
    without = never_measured(measured, interpolated)
    if without:
        rows = int(np.isin(interpolated.object, sorted(without)).sum())
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"Annotated objects without a key frame: {len(without):,} (such as {min(without):.60}); all that"
            f" there is of them, {rows:,} rows, is interpolated, so they have no position: {CURE}.",
        )
    return measured, interpolated


def never_measured(measured: Annotations, interpolated: Annotations) -> set[str]:
    """Objects with an id of which there are interpolated rows alone."""
    return set(interpolated.object[interpolated.has_id].tolist()) - set(measured.object.tolist())


def drawn_on_ground(
    rows: Sequence[Annotation],
    frame_epoch_ns: Mapping[str, IntArray],
    sources: Mapping[str, str],
    notes: ReadingNotes,
) -> tuple[Annotation, ...]:
    """Keep what lies on the ground where somebody drew it and the picture has a time; the others are counted.

    Parameters
    ----------
    sources : mapping of camera to file
        Where the stamps are from, for messages.
    """
    drawn, untimed, interpolated = [], Counter[str](), Counter[str]()
    for row in rows:
        stamps = frame_epoch_ns.get(row.camera, ())
        if not row.is_measured:
            interpolated[row.file] += 1
        elif row.frame >= len(stamps) or stamps[row.frame] == NO_STAMP:
            untimed[row.camera] += 1
        else:
            drawn.append(row)
    for file, count in sorted(interpolated.items()):
        notes.skipped.append(skipped_annotations(SkipKind.INTERPOLATED, file, count))
    for camera, count in sorted(untimed.items()):
        notes.skipped.append(
            skipped_annotations(SkipKind.NO_TIME, sources.get(camera, camera), count, camera)
        )
    return tuple(drawn)
