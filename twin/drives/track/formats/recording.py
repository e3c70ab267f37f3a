"""What every track format is recognised by and read from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from twin.drives.folder.files import DriveFolder


@dataclass(frozen=True)
class Recording:
    """A file or folder that may say where the car was; nothing of it is read before it is asked for.

    Attributes
    ----------
    folder : DriveFolder
    name : str
        In the drive folder; ``.`` is the drive folder itself.
    """

    folder: DriveFolder
    name: str

    @property
    def where(self) -> str:
        """Name for messages."""
        return self.folder.root.name if self.name == "." else self.name

    @property
    def is_folder(self) -> bool:
        """Whether it is one, of pictures or of the parts of a recording."""
        return self.folder.is_folder(self.name)

    @cached_property
    def head(self) -> bytes:
        """First bytes of a file."""
        return self.folder.head(self.name)

    def content(self) -> bytes:
        """Whole content of a file, which becomes part of what the drive was read from."""
        return self.folder.content(self.name, track=True)
