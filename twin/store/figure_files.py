"""Figures into files that people name: PNG, SVG or PDF by the ending, whole or not there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import ConfigError
from twin.figures import FORMATS
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_figure_name(path: Path | str) -> Path:
    """Return the path of a figure that can be written; to be asked before the work of drawing it.

    Raises
    ------
    ConfigError
        The name does not end in ``.png``, ``.svg`` or ``.pdf``.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(
            f"The figure {path} is neither PNG, SVG nor PDF: let its name end in {', '.join(FORMATS)}."
        )
    return path


def write_figure(figure: Figure, path: Path | str) -> Path:
    """Write a figure as the ending of its name says; its folder is made if it does not exist.

    Raises
    ------
    ConfigError
        As :func:`check_figure_name`.
    RefusedError
        The file or its folder cannot be written.
    """
    path = check_figure_name(path)
    make_folder(path.parent)
    replace_file(path, FORMATS[path.suffix.lower()](figure))
    return path
