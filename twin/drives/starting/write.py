"""Put ``drive.toml`` into its folder: whole or not at all, never over one that stands."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.errors import RefusedError
from twin.store.atomic_files import replace_file as put


def refuse_if_there(folder: Path, *, replace: bool) -> None:
    """Refuse to go on where a ``drive.toml`` stands and nobody asked to replace it.

    Raises
    ------
    RefusedError
    """
    if not replace and (folder / SETTINGS_FILE).exists():
        raise RefusedError(
            f"{folder / SETTINGS_FILE} is there already, and stays as it is: twin inspect {folder} says what"
            " it lacks; --replace writes a new one and keeps a copy."
        )


def write_settings(folder: Path, text: str, *, replace: bool) -> list[Path]:
    """Write it, after a copy of what stood there.

    Returns
    -------
    list of Path
        What was written; the copy first.

    Raises
    ------
    RefusedError
        As :func:`refuse_if_there`, or where the folder cannot be written to.
    """
    refuse_if_there(folder, replace=replace)
    target, written = folder / SETTINGS_FILE, []
    if target.exists():
        copy = folder / f"{SETTINGS_FILE}.{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}.before"
        put(copy, target.read_bytes())
        written.append(copy)
    put(target, text.encode())
    return [*written, target]
