"""Folders that twin writes into."""

from __future__ import annotations

from pathlib import Path

from twin.errors import RefusedError


def make_folder(path: Path | str) -> Path:
    """Return the folder, made if it does not exist.

    Raises
    ------
    RefusedError
        A file is in the way, or this user may not write there.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise RefusedError(f"{folder} is a file, so it cannot hold others: name a folder.") from error
    except OSError as error:
        raise RefusedError(
            f"The folder {folder} cannot be made ({error.strerror}): name one that this user may write to."
        ) from error
    return folder
