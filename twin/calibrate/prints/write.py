"""A PDF into the file that people name."""

from __future__ import annotations

from pathlib import Path

from twin.errors import ConfigError
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder


def write_print(path: Path, content: bytes) -> Path:
    """Write a print, whole or not at all.

    Raises
    ------
    ConfigError
        If its name does not end in ``.pdf``.
    RefusedError
        If it cannot be written.
    """
    if path.suffix.lower() != ".pdf":
        raise ConfigError(f"The print {path} is a PDF: let its name end in .pdf.")
    make_folder(path.parent)
    replace_file(path, content)
    return path
