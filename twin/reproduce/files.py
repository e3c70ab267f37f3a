"""A reproduction as files: tables as CSV, figures as PNG and PDF."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from twin.errors import RefusedError
from twin.figures import FORMATS
from twin.reports.object_errors import ObjectError
from twin.reports.sighting_errors import SightingError
from twin.reproduce.drawn import figure
from twin.reproduce.experiments import BandRow, Experiment, Reproduction, SignRow, StandingRow, TrendRow
from twin.store.atomic_files import replacing
from twin.tables import csv_bytes, field_names, record_row, records_csv

PICTURES = (".png", ".pdf")


def check_folder(folder: Path | str) -> Path:
    """Return the folder that a reproduction is to be written to; to be asked before the work.

    Raises
    ------
    RefusedError
        It is a file, or holds something.
    """
    folder = Path(folder)
    try:
        used = folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
    except OSError as error:
        raise RefusedError(f"{folder} cannot be read ({error.strerror}): name a new folder.") from error
    if used:
        raise RefusedError(f"{folder} is not an empty folder: name a new one by --out, or remove it.")
    return folder


def write_reproduction(result: Reproduction, folder: Path | str) -> Reproduction:
    """Write tables and figures into a new or empty folder, all of them or none.

    ``table1.csv`` (standing), ``signs.csv`` (tables 2 and 3), ``by_distance.csv`` and ``trends.csv`` (what
    the figures show), ``sightings.csv`` and ``objects.csv`` (every error), and a figure an experiment as PNG
    and PDF.

    Returns
    -------
    Reproduction
        With the files.

    Raises
    ------
    RefusedError
        The folder holds something or cannot be written; nothing was.
    """
    folder = check_folder(folder)
    contents = {**_tables(result), **_figures(result.experiments)}
    try:
        with replacing(folder, tuple(contents)) as staging:
            for name, content in contents.items():
                (staging / name).write_bytes(content)
    except OSError as error:
        raise RefusedError(
            f"The reproduction cannot be written to {folder} ({error.strerror or error}): name a folder that "
            "this user may write to."
        ) from error
    return replace(result, files=tuple(folder / name for name in contents))


def _tables(result: Reproduction) -> dict[str, bytes]:
    tables: dict[str, tuple[type[object], Sequence[object]]] = {
        "table1.csv": (StandingRow, result.standing),
        "signs.csv": (SignRow, result.signs),
        "by_distance.csv": (BandRow, result.bands),
        "trends.csv": (TrendRow, result.trends),
    }
    contents = {name: records_csv(kind, rows) for name, (kind, rows) in tables.items() if rows}
    for name, kind, errors in (
        ("sightings.csv", SightingError, [(one.name, one.sightings) for one in result.experiments]),
        ("objects.csv", ObjectError, [(one.name, one.objects) for one in result.experiments]),
    ):
        rows = ({"experiment": which, **record_row(each)} for which, all_of in errors for each in all_of)
        contents[name] = csv_bytes(["experiment", *field_names(kind)], rows)
    return contents


def _figures(experiments: Iterable[Experiment]) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    for number, one in enumerate(experiments, start=1):
        words = re.sub(r"\W+", "_", one.name).strip("_")[:60]
        name = f"figure{one.figure}_{words}" if one.figure else f"experiment{number}_{words}"
        drawn = figure(one)
        contents |= {name + ending: FORMATS[ending](drawn) for ending in PICTURES}
    return contents
