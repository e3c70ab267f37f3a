"""Surveyed positions to measure estimates by, and the file that they come from."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from twin.errors import TruthError

_REQUIRED = ("object", "easting", "northing")


@dataclass(frozen=True, slots=True)
class Truth:
    """One surveyed object, EPSG:25833.

    `drive_id` is "" where the file does not tell drives apart, `label` where it has none. `height_m` is
    ellipsoidal, None where the file has none.
    """

    object: str
    drive_id: str
    east_m: float
    north_m: float
    label: str = ""
    height_m: float | None = None


def read_truth(path: Path | str) -> list[Truth]:
    """Read surveyed positions: CSV with the columns object, label, easting, northing (EPSG:25833).

    A column ``drive_id`` is optional; without it an object's truth holds for every drive in the store. So is
    ``label``; one that begins with a sign code ("362.50;808") helps to pair by position. So is ``height``, of
    the foot, metres above the ellipsoid; a cell of it may be empty.

    Raises
    ------
    TruthError
        No such file, a missing column, or a number that is none: file, line and cure.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TruthError(
            f"The truth file {path} cannot be read ({error.strerror}): check its name."
        ) from error
    except UnicodeDecodeError as error:
        raise TruthError(f"The truth file {path} is not text in UTF-8: name a CSV file.") from error
    reader = csv.DictReader(text.splitlines())
    missing = [name for name in _REQUIRED if name not in (reader.fieldnames or ())]
    if missing:
        columns = "column" if len(missing) == 1 else "columns"
        raise TruthError(
            f"The truth file {path} lacks the {columns} {', '.join(missing)}: it needs object, label, "
            "easting, northing (EPSG:25833), separated by commas."
        )
    truths = [_truth(row, path, number) for number, row in enumerate(reader, start=2)]
    if not truths:
        raise TruthError(f"The truth file {path} has no rows: give one a surveyed object.")
    return truths


def _truth(row: Mapping[str, str | None], path: Path, line: int) -> Truth:
    try:
        east, north = float(row["easting"] or ""), float(row["northing"] or "")
    except ValueError as error:
        raise TruthError(f"{path}, line {line}: easting and northing must be numbers ({error}).") from error
    try:
        text = (row.get("height") or "").strip()
        height = float(text) if text else None
    except ValueError as error:
        raise TruthError(f"{path}, line {line}: height must be a number or empty ({error}).") from error
    if not (-200_000 < east < 1_200_000 and 6_300_000 < north < 8_100_000):
        raise TruthError(
            f"{path}, line {line}: easting {east} and northing {north} are not in Norway in EPSG:25833: "
            "check the coordinate system and that the columns are not swapped."
        )
    names = ((row.get(name) or "").strip() for name in ("object", "drive_id", "label"))
    name, drive_id, label = names
    return Truth(name, drive_id, east, north, label, height)
