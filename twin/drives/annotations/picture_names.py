"""Which of a camera's pictures an annotated image is, by the name that a tool gave it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import PurePosixPath

from twin.drives.frames.find import UPLOADED

NOT_AMONG_PICTURES, UPLOADED_TWICE = -2, -3
_DOWNLOADED = re.compile(r"(?:_(?:jpe?g|png|bmp))?\.rf\.[0-9a-f]+$", re.IGNORECASE)
"""What Roboflow puts after the name of an image: ``frame_12_jpg.rf.0a1b2c``."""


class PictureNames:
    """The pictures of one camera, and the images of one annotation file.

    Parameters
    ----------
    frames : mapping of name, with and without suffix, to frame number
        The camera's pictures.
    annotated : iterable of str
        Names of all images of the file, or addresses that end with them.

    Attributes
    ----------
    example : str
        One of the names; "" where there are none.
    """

    def __init__(self, frames: Mapping[str, int], annotated: Iterable[str]) -> None:
        self.example = next(iter(frames), "")
        self._frames = frames
        self._annotated = annotated

    def frame_of(self, image: str) -> int:
        """Return the frame of an image; `NOT_AMONG_PICTURES`, or `UPLOADED_TWICE` if two images may be it.

        A name counts as it is; then without what Roboflow adds; then without what Label Studio adds.
        """
        path = _path(image)
        names = (path.name, path.stem, _DOWNLOADED.sub("", path.stem))
        found = next((self._frames[name] for name in names if name in self._frames), None)
        if found is not None:
            return found
        bare = UPLOADED.sub("", path.name)
        if bare == path.name:
            return NOT_AMONG_PICTURES
        frame = self._as_uploaded.get(bare, self._as_uploaded.get(PurePosixPath(bare).stem))
        if frame is None:
            return NOT_AMONG_PICTURES
        return UPLOADED_TWICE if len(self._images_of[bare]) > 1 else frame

    @cached_property
    def _as_uploaded(self) -> dict[str, int]:
        """Frame by the name that an upload gets; names that two pictures would get are left out."""
        frames: dict[str, int | None] = {}
        for name, frame in self._frames.items():
            uploaded = _as_uploaded(name)
            frames[uploaded] = frame if frames.get(uploaded, frame) == frame else None
        return {name: frame for name, frame in frames.items() if frame is not None}

    @cached_property
    def _images_of(self) -> dict[str, set[str]]:
        """Images of the file by their names without what Label Studio adds."""
        images: dict[str, set[str]] = {}
        for name in {_path(image).name for image in self._annotated}:
            images.setdefault(UPLOADED.sub("", name), set()).add(name)
        return images


def plain_name(image: str) -> str:
    """Return an image's name without folders, suffix and what tools added.

    Eight digits before a dash are the number of a frame where no other number follows.
    """
    plain = _DOWNLOADED.sub("", _path(image).stem)
    bare = UPLOADED.sub("", plain)
    return plain if plain[:8].isdecimal() and not re.search(r"[0-9]", bare) else bare


def _path(image: str) -> PurePosixPath:
    return PurePosixPath(image.replace("\\", "/"))


def _as_uploaded(name: str) -> str:
    """Name by which Label Studio (as Django) keeps an upload: without what may not stand in an address."""
    return re.sub(r"[^-\w.]", "", name.strip().replace(" ", "_"))
