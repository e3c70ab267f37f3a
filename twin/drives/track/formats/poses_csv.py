"""``poses.csv``: full poses of an INS or SLAM → :class:`~geoloc.trajectory.poses.PoseTrack`, and back."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from geoloc.trajectory.trajectory import Poses, PoseTrack
from twin.drives.epochs import credible, longest_increasing, unit_hint
from twin.drives.track.fixes import (
    FROZEN,
    SIGMAS,
    LeftOutError,
    PosesRead,
    check_position,
    counted,
    frozen,
    listed,
)
from twin.errors import DriveError
from twin.tables import NotTextError, Table, header_of

REQUIRED = (
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "roll_deg",
    "pitch_deg",
    "heading_deg",
)


_ROUNDED = "time_ns rounded to a power of ten, as spreadsheets do: take the file from before"


def looks_like_poses(head: bytes) -> bool:
    """Whether a file begins with the header of a pose file."""
    return {"time_ns", "latitude_deg", "heading_deg"} <= set(header_of(head))


def read_poses(content: bytes, where: str, *, pitch_nose_up: bool = False) -> PosesRead:
    """Read a pose file: CSV with a header, of any kind that a spreadsheet saves (:mod:`twin.tables`).

    Columns ``time_ns`` (whole nanoseconds UTC since 1970), ``latitude_deg``, ``longitude_deg``, ``height_m``
    (ellipsoidal), ``roll_deg`` (right side down), ``pitch_deg``, ``heading_deg`` (clockwise from true north),
    and any of `SIGMAS`; an absent column or an empty cell is NaN.

    Parameters
    ----------
    content : bytes
    where : str
        File name, for messages.
    pitch_nose_up : bool
        Positive pitch in the file means nose up, as most INS write it; it is turned to nose down.

    Returns
    -------
    PosesRead
        Poses in order of time.

    Raises
    ------
    DriveError
        If a column is missing, or no row can be used.
    """
    faults: Counter[str] = Counter()
    header, times, rows, hint = _table(content, where, faults)
    epoch_ns = np.array(times, dtype=np.int64)
    keep = longest_increasing(epoch_ns)
    faults["epoch not after the pose before"] += int(np.count_nonzero(~keep))
    skipped = counted("poses", where, faults)
    if not times:
        cure = hint or "export the poses of this drive"
        raise DriveError(f"{where} holds no usable pose ({listed(skipped)}): {cure}.")
    if len(times) > 2 and np.count_nonzero(keep) < 0.5 * len(times):
        raise DriveError(
            f"{where} is not in order of time: {np.count_nonzero(~keep)} of {len(times)} poses are not later"
            " than the one before; sort it by time_ns."
        )
    held = frozen(epoch_ns[keep], *np.array(rows, dtype=np.float64)[keep, :3].T)
    keep[keep] = ~held
    faults[FROZEN] += int(np.count_nonzero(held))
    skipped = counted("poses", where, faults)
    values = dict(zip((*REQUIRED, *SIGMAS), np.array(rows, dtype=np.float64)[keep].T, strict=True))
    if pitch_nose_up:
        values["pitch_deg"] = -values["pitch_deg"]
    return PosesRead(PoseTrack(epoch_ns=epoch_ns[keep], **values), skipped, _ignored(header, where))


def write_poses(poses: Poses) -> bytes:
    """Write valid poses as `read_poses` reads them, whole to 0.1 mm and a 100,000th of a degree.

    Roll and pitch share a column for their sigma: it gets the larger one.
    """
    tilt = np.maximum(poses.sigma_roll_deg, poses.sigma_pitch_deg)
    sigmas = (poses.sigma_horizontal_m, poses.sigma_vertical_m, tilt, poses.sigma_heading_deg)
    columns = (*(getattr(poses, name) for name in REQUIRED), *sigmas)
    # No sigma is zero, which no file may state.
    digits = (*(10, 10, 4, 5, 5, 5), *(6 for _ in sigmas))
    lines = [",".join(("time_ns", *REQUIRED, *SIGMAS))]
    for time_ns, *row in zip(poses.epoch_ns.tolist(), *columns, strict=True):
        cells = (f"{value:.{n}f}" for value, n in zip(row, digits, strict=True))
        lines.append(",".join((str(time_ns), *cells)))
    return ("\n".join(lines) + "\n").encode()


def _table(
    content: bytes, where: str, faults: Counter[str]
) -> tuple[list[str], list[int], list[list[float]], str]:
    """Header, epochs and values of all usable rows, in file order; the other rows are counted.

    The text says in which unit ``time_ns`` of the first unusable row seems to be.
    """
    try:
        table = Table(content)
    except (NotTextError, csv.Error) as error:
        raise DriveError(f"{where} is not text ({error}): export it again as CSV.") from error
    times: list[int] = []
    rows: list[list[float]] = []
    unusable: list[str] = []
    try:
        at = _columns(table.header, where)
        for cells in table:
            if not any(cell.strip() for cell in cells):
                continue
            try:
                time_ns, row = _row(cells if table.delimiter == "," else [*map(table.plain, cells)], at)
            except LeftOutError as reason:
                faults[str(reason)] += 1
                unusable += (
                    [_cell(cells, at, "time_ns")] if not unusable and at["time_ns"] < len(cells) else []
                )
                continue
            times.append(time_ns)
            rows.append(row)
    except csv.Error as error:
        raise DriveError(f"{where} is not CSV ({error} in line {table.line}): export it again.") from error
    return list(table.header), times, rows, unit_hint("".join(unusable), "nanoseconds")


def _columns(header: Sequence[str], where: str) -> dict[str, int]:
    """Position of each known column."""
    missing = [name for name in ("time_ns", *REQUIRED) if name not in header]
    if missing:
        raise DriveError(
            f"{where} lacks the columns {', '.join(missing)}: its first line is {','.join(header)!r:.200}."
        )
    twice = sorted({name for name in header if header.count(name) > 1 and name})
    if twice:
        raise DriveError(f"{where} has the column {', '.join(twice)} more than once: keep one of each.")
    return {name: position for position, name in enumerate(header)}


def _row(cells: Sequence[str], at: Mapping[str, int]) -> tuple[int, list[float]]:
    if "E" in _cell(cells, at, "time_ns").upper():
        raise LeftOutError(_ROUNDED)
    try:
        time_ns = int(cells[at["time_ns"]])
        pose = [float(cells[at[name]]) for name in REQUIRED]
        sigmas = [float(text) if (text := _cell(cells, at, name)) else math.nan for name in SIGMAS]
    except ValueError:
        raise LeftOutError("not a number") from None
    except IndexError:
        raise LeftOutError("row too short") from None
    if not credible(time_ns):
        raise LeftOutError("time_ns outside the years 2000–2099")
    if not all(math.isfinite(value) for value in pose) or any(math.isinf(value) for value in sigmas):
        raise LeftOutError("not finite")
    latitude, longitude, height, roll, pitch, heading = pose
    check_position(latitude, longitude, height)
    if abs(roll) > 180 or abs(pitch) > 90 or abs(heading) > 360:
        raise LeftOutError("attitude outside its range")
    if any(sigma <= 0 for sigma in sigmas):
        raise LeftOutError("sigma not positive")
    return time_ns, pose + sigmas


def _cell(cells: Sequence[str], at: Mapping[str, int], name: str) -> str:
    return cells[at[name]].strip() if name in at else ""


def _ignored(header: Sequence[str], where: str) -> tuple[str, ...]:
    """A misspelt sigma column would otherwise quietly become the default."""
    columns = ("time_ns", *REQUIRED, *SIGMAS)
    unknown = [name for name in header if name and name not in columns]
    if not unknown:
        return ()
    return (f"Columns of {where} that were not read: {', '.join(unknown)}; read were {', '.join(columns)}.",)
