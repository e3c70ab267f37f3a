"""Slips of a first drive: files that are not as they should be, and what must be said of them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.errors import DriveError


class Slip(NamedTuple):
    """Files that differ from those of a sound trip (None: left out), and the words of the sentence."""

    name: str
    files: dict[str, str | None]
    said: str


def read(maker: Any, folder: Path, files: dict[str, str | None]) -> Drive:
    """Read a trip with these files instead of the sound ones."""
    return read_drive(maker.write(folder, maker.files(**files)))


def assert_refused(maker: Any, folder: Path, slip: Slip) -> None:
    """The drive is refused with the slip's words."""
    with pytest.raises(DriveError, match=slip.said):
        read(maker, folder, slip.files)


def assert_told(maker: Any, folder: Path, slip: Slip) -> None:
    """The drive is read, and a warning has the slip's words."""
    warnings = read(maker, folder, slip.files).warnings
    assert any(re.search(slip.said, warning.sentence) for warning in warnings), warnings
