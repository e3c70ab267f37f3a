"""Frame numbers and their host stamps: DriveWorks ``*.timestamps`` and CSV."""

from __future__ import annotations

from collections import Counter
from pathlib import PureWindowsPath

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.epochs import credible, longest_increasing, unit_hint
from twin.drives.folder.notes import Skipped
from twin.errors import DriveError
from twin.tables import NotTextError, header_of, parted, text_of

NO_STAMP = np.iinfo(np.int64).min
"""Marks a frame number without a stamp in the arrays of ``Drive.frame_epoch_ns``."""

MAX_FRAME = 20_000_000
"""Highest frame number that is taken seriously: a week at 30 frames a second."""

_HEADINGS = ("frame", "image", "time", "stamp")
_MICROSECONDS, _NANOSECONDS = "microseconds", "nanoseconds"

LONGEST_HEADER = 10_000
"""Characters of a header that are looked at."""

_NOT_LATER = "stamp not later than that of the frame before"


def read_timestamps(content: bytes, where: str) -> tuple[IntArray, tuple[Skipped, ...]]:
    """Read the host stamps of one camera's frames.

    Either lines ``<frame> <unix µs>`` (any white space; further columns are ignored), or CSV with a header
    that names the columns ``frame`` and ``time_ns``. Numbering need not start at 0.

    Parameters
    ----------
    content : bytes
    where : str
        File name, for messages.

    Returns
    -------
    epoch_ns : int64 (last frame + 1,)
        UTC host stamp by frame number; `NO_STAMP` for numbers that have none.
    skipped : tuple of Skipped
        Unreadable lines, numbers given twice, stamps that do not increase, and holes in the numbering.

    Raises
    ------
    DriveError
        If no line can be used.
    """
    faults: Counter[str] = Counter()
    frame, stamp_ns, hint = _rows(_text(content, where), where, faults)
    order = np.argsort(frame, kind="stable")
    frame, stamp_ns = frame[order], stamp_ns[order]
    first = np.concatenate(([True], np.diff(frame) > 0))[: len(frame)]
    faults["frame number given before"] += int(np.count_nonzero(~first))
    frame, stamp_ns = frame[first], stamp_ns[first]
    keep = longest_increasing(stamp_ns)
    faults[_NOT_LATER] += int(np.count_nonzero(~keep))
    if len(frame):
        faults["no stamp for the frame number"] += int(frame[-1] - frame[0] + 1 - len(frame))
    frame, stamp_ns = frame[keep], stamp_ns[keep]
    skipped = tuple(Skipped("time stamps", where, n, reason) for reason, n in sorted(faults.items()) if n)
    if not len(frame):
        cure = hint or "it should have a line '<frame> <unix microseconds>' for every frame"
        raise DriveError(f"{where} holds no usable time stamp ({_listed(skipped)}): {cure}.")
    epoch_ns = np.full(int(frame[-1]) + 1, NO_STAMP, dtype=np.int64)
    epoch_ns[frame] = stamp_ns
    return epoch_ns, skipped


def names_images(head: bytes) -> bool:
    """Whether stamps are by image instead of by number: CSV with the columns ``image`` and ``time_ns``."""
    return {"image", "time_ns"} <= {name.lower() for name in header_of(head)}


def read_image_times(content: bytes, where: str) -> tuple[dict[str, int], tuple[Skipped, ...]]:
    """Read the stamps of images by name: CSV with the columns ``image`` and ``time_ns``.

    Returns
    -------
    dict of name to int
        UTC in nanoseconds, in file order; folders before a name are left away.
    skipped : tuple of Skipped

    Raises
    ------
    DriveError
        If no line can be used.
    """
    text, separator = parted(_text(content, where))
    lines = [line for line in text.splitlines() if line.strip()]
    header = _columns(lines[0][:LONGEST_HEADER], separator) if lines else []
    if not {"image", "time_ns"} <= set(header):
        raise DriveError(_columns_missing(header, where))
    image, time = header.index("image"), header.index("time_ns")
    times: dict[str, int] = {}
    faults: Counter[str] = Counter()
    unusable: list[str] = []
    for line in lines[1:]:
        fields = line.split(separator)
        try:
            name, stamp_ns = PureWindowsPath(fields[image].strip(' "')).name, int(fields[time])
        except (ValueError, IndexError):
            faults["not an image and a stamp"] += 1
            unusable += fields[time : time + 1]
            continue
        if not credible(stamp_ns):
            faults["stamp outside the years 2000–2099"] += 1
            unusable.append(fields[time])
        elif not name or name in times:
            faults["image without a name, or given before"] += 1
        else:
            times[name] = stamp_ns
    skipped = tuple(Skipped("time stamps", where, n, reason) for reason, n in sorted(faults.items()))
    if not times:
        cure = unit_hint("".join(unusable[:1]), _NANOSECONDS) or "one line an image"
        raise DriveError(f"{where} holds no usable time stamp ({_listed(skipped)}): {cure}.")
    return times, skipped


def increasing(epoch_ns: IntArray, where: str) -> tuple[IntArray, tuple[Skipped, ...]]:
    """Take away the stamps that do not increase with the frame number, and count them.

    Returns
    -------
    epoch_ns : int64 (n,)
        With `NO_STAMP` in their place.
    skipped : tuple of Skipped
    """
    stamped = np.flatnonzero(epoch_ns != NO_STAMP)
    late = stamped[~longest_increasing(epoch_ns[stamped])]
    if not late.size:
        return epoch_ns, ()
    kept = epoch_ns.copy()
    kept[late] = NO_STAMP
    return kept, (Skipped("time stamps", where, int(late.size), _NOT_LATER),)


def _text(content: bytes, where: str) -> str:
    try:
        return text_of(content)
    except NotTextError as error:
        raise DriveError(f"{where} is not text ({error}): export it again.") from error


def _columns(header: str, separator: str) -> list[str]:
    return [name.strip(' "\r').lower() for name in header.split(separator)]


def _columns_missing(header: list[str], where: str) -> str:
    first = "image" if "image" in header else "frame"
    return (
        f"{where} has the columns {', '.join(header)[:200]}: call them {first},time_ns, with UTC in"
        " nanoseconds since 1970 (1781078400078496000)."
    )


def _is_header(line: str) -> bool:
    """Whether a line names columns, rightly or not."""
    return any(name.startswith(_HEADINGS) for name in header_of(line.lower().encode()))


def _rows(text: str, where: str, faults: Counter[str]) -> tuple[IntArray, IntArray, str]:
    """Frame numbers and stamps (ns) of all readable lines, in file order; the others are counted.

    The text says which unit the first unusable stamp seems to be in (:func:`twin.drives.epochs.unit_hint`).
    """
    table, delimiter = parted(text)
    lines = [line for line in table.splitlines() if line.strip()]
    columns, unit_ns, separator = (0, 1), 1_000, None
    if lines and _is_header(lines[0]):
        header = _columns(lines.pop(0)[:LONGEST_HEADER], delimiter)
        if "frame" not in header or "time_ns" not in header:
            raise DriveError(_columns_missing(header, where))
        columns, unit_ns, separator = (header.index("frame"), header.index("time_ns")), 1, delimiter
    wanted = _NANOSECONDS if separator else _MICROSECONDS
    frames, stamps, unusable = [], [], []
    for line in lines:
        fields = line.split(separator)
        try:
            frame, stamp_ns = int(fields[columns[0]]), int(fields[columns[1]]) * unit_ns
        except (ValueError, IndexError):
            faults["not a frame number and a stamp"] += 1
            unusable += fields[columns[1] : columns[1] + 1]
            continue
        if not 0 <= frame <= MAX_FRAME:
            faults[f"frame number outside 0–{MAX_FRAME}"] += 1
        elif not credible(stamp_ns):
            faults["stamp outside the years 2000–2099"] += 1
            unusable.append(fields[columns[1]])
        else:
            frames.append(frame)
            stamps.append(stamp_ns)
    hint = unit_hint("".join(unusable[:1]), wanted)
    return np.array(frames, dtype=np.int64), np.array(stamps, dtype=np.int64), hint


def _listed(skipped: tuple[Skipped, ...]) -> str:
    return "; ".join(f"{s.count} × {s.reason}" for s in skipped) or "the file is empty"
