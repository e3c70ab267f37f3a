"""Why a finding has no pictures, or fewer than it could have, as kinds with facts.

Kept in the store as JSON with the kind's name under ``kind``, as reasons are (:mod:`twin.words.reasons`).
"""

from __future__ import annotations

from typing import Any, get_args

import msgspec

from twin.words.reasons import Told, _Kind
from twin.words.table import Lang, say


class NoRecording(_Kind, frozen=True):
    """The drive's folder holds no pictures."""

    drive: str
    folder: str


class OtherCameras(_Kind, frozen=True):
    """The drive has pictures, but none of the cameras that saw the sign."""

    drive: str
    cameras: tuple[str, ...]


class FolderGone(_Kind, frozen=True):
    """The drive's folder is not where it was ingested from."""

    drive: str
    folder: str


class FolderUnknown(_Kind, frozen=True):
    """The store does not know where the drive was ingested from."""

    drive: str


class CannotBeRead(_Kind, frozen=True):
    """A folder, a video or images cannot be read: `error` is the error's own sentence, in English."""

    error: str


class FramesLost(_Kind, frozen=True):
    """Pictures that did not come out of a video or folder; `reason` is what its reader says, in English."""

    n: int
    camera: str
    where: str
    reason: str


class CameraLost(_Kind, frozen=True):
    """Pictures that did not come, and nothing says why."""

    camera: str


class OtherSize(_Kind, frozen=True):
    """Pictures that are not of the size that their camera was calibrated at."""

    n: int
    camera: str
    drive: str
    width_px: int
    height_px: int


class NotShown(_Kind, frozen=True):
    """No picture that is there shows the place of the face."""


WhyNoPicture = (
    NoRecording
    | OtherCameras
    | FolderGone
    | FolderUnknown
    | CannotBeRead
    | FramesLost
    | CameraLost
    | OtherSize
    | NotShown
    | Told
)
"""Why there is no picture, or no such one; `Told` is the sentence that older versions kept."""

GAP_KEYS = {kind: f"gap.{kind.__struct_config__.tag}" for kind in get_args(WhyNoPicture) if kind is not Told}
"""Kind → its message. A message names the kind's own fields as its facts."""


def gap_sentence(why: WhyNoPicture, lang: Lang = Lang.EN) -> str:
    """Make the sentence of a gap.

    >>> gap_sentence(CameraLost("C1"), Lang.NB)
    'Bildene av det kom ikke ut av C1.'
    """
    if isinstance(why, Told):
        return why.text
    facts: dict[str, Any] = msgspec.structs.asdict(why)
    if isinstance(why, OtherCameras):
        facts["cameras"] = ", ".join(why.cameras)
    return say(lang, GAP_KEYS[type(why)], **facts)


def gap_to_json(why: WhyNoPicture) -> dict[str, Any]:
    """Return the JSON object that the store keeps."""
    document: dict[str, Any] = msgspec.to_builtins(why)
    return document


def gap_from_json(document: object) -> WhyNoPicture:
    """Take it back from the store's JSON.

    Raises
    ------
    msgspec.ValidationError
        It is of no kind that this version knows.
    """
    return msgspec.convert(document, WhyNoPicture)  # type: ignore[no-any-return]
