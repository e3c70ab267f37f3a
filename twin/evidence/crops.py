"""Crops of findings as records: rows of the tables ``crop`` and ``crop_gap``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import sqlalchemy as sa

from twin.decisions.evidence import Ask
from twin.store import schema
from twin.words import Told, WhyNoPicture, gap_from_json, gap_sentence, gap_to_json

Pixel = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right, bottom [px]; (0, 0) is the centre of the first pixel."""
Polygon = tuple[Pixel, ...]


class Role(StrEnum):
    """What a crop shows."""

    FACE = "face"
    """The sign at its native resolution, with nothing drawn over it."""
    WIDE = "wide"
    """Its surroundings, with the face's box, NVDB's position and the error ellipse drawn in."""


class FaceFrom(StrEnum):
    """How it is known where in the picture the sign's face is."""

    BOX = "box"
    """It was annotated, or a detector found it."""
    OUTLINE = "outline"
    """The outline that its code has was found in the picture, above the annotated foot."""
    NOWHERE = "nowhere"
    """It is not known: only where a face would be, by the height that signs are put up at."""


class GapKind(StrEnum):
    """Why a finding has no crops of a drive, or fewer than it could have."""

    NO_PICTURES = "no_pictures"
    FOLDER_GONE = "folder_gone"
    UNREADABLE = "unreadable"
    """The video or the images cannot be opened, or their times do not fit them."""
    FRAME_LOST = "frame_lost"
    """The video ends before it, or it is damaged."""
    OTHER_SIZE = "other_size"
    """The pictures are not of the size that the camera was calibrated at."""
    OUT_OF_VIEW = "out_of_view"
    """It was seen, but its face lies outside the pictures that are there, or on the car itself."""
    NEVER_IN_VIEW = "never_in_view"
    """It was not seen, and no picture that is there has the place in view."""


@dataclass(frozen=True, slots=True)
class MaskProof:
    """What was done to a crop before it was written.

    Attributes
    ----------
    masker : str
        The network's file name; ``geometry`` where none was used, ``none`` for an unmasked crop.
    version : str
        SHA-256 of the network's file, else that of the rules (:data:`twin.evidence.masks.RULES`).
    face_from : FaceFrom
    faces_px : tuple of Polygon
        Protected: nothing inside them was changed. In pixels of the crop.
    boxes_px : tuple of Box
        Of people and vehicles that the network found, with their margin, in pixels of the crop.
    labels : tuple of str
        What it called them.
    share_hidden, share_softened, share_clear : float
        Of the crop's pixels: made unrecognisable, made coarse, left as they were.
    hidden_px, softened_px, window_px : float
        Sides of the squares that the picture was averaged over there; 0 where nothing was.
    place_px : (left, top, right, bottom)
        Which part of the frame the crop shows; the last two are outside.
    of_frame : float
        What share of it that is.
    software : str
    """

    masker: str
    version: str
    face_from: FaceFrom
    faces_px: tuple[Polygon, ...]
    boxes_px: tuple[Box, ...]
    labels: tuple[str, ...]
    share_hidden: float
    share_softened: float
    share_clear: float
    hidden_px: float
    softened_px: float
    window_px: float
    place_px: tuple[int, int, int, int]
    of_frame: float
    software: str

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> MaskProof:
        """Take it from the store's JSON."""
        told = {
            "face_from": FaceFrom(document["face_from"]),
            "faces_px": tuple(tuple((u, v) for u, v in polygon) for polygon in document["faces_px"]),
            "boxes_px": tuple((left, top, right, low) for left, top, right, low in document["boxes_px"]),
            "labels": tuple(document["labels"]),
            "place_px": tuple(document["place_px"]),
        }
        return cls(**{**document, **told})


@dataclass(frozen=True, slots=True)
class Crop:
    """A crop of one picture that shows a finding.

    Attributes
    ----------
    number : int
        Of the view: 0 is the best one. Each view has a crop of either role.
    frame : int
        Number of the picture in the recording of that camera.
    epoch_ns : int
        When it was taken, UTC.
    range_m : float
        Horizontal distance from the camera to the sign.
    sha256 : str
        Of the WebP file, which lies beside the store under this name.
    is_masked : bool
        False only where somebody asked for it and said why; such a crop never leaves by an export.
    """

    change_id: str
    number: int
    role: Role
    drive_id: str
    camera: str
    frame: int
    epoch_ns: int
    range_m: float
    sha256: str
    width_px: int
    height_px: int
    is_masked: bool
    proof: MaskProof

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Crop:
        """Take it from a row of the table ``crop``."""
        return cls(**{**row, "role": Role(row["role"]), "proof": MaskProof.from_json(row["proof"])})

    def to_row(self) -> dict[str, Any]:
        """Return its row of the table ``crop``."""
        return {**asdict(self), "role": self.role.value}


@dataclass(frozen=True, slots=True)
class Gap:
    """Why a finding has no crops of a drive, or fewer than it could have.

    Attributes
    ----------
    drive_id : str
        "" where it is about none.
    why : WhyNoPicture
        What its sentence is made of, in any language (:func:`twin.words.gap_sentence`).
    """

    change_id: str
    drive_id: str
    kind: GapKind
    why: WhyNoPicture

    @property
    def sentence(self) -> str:
        """For people, in English."""
        return gap_sentence(self.why)

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Gap:
        """Take it from a row of the table ``crop_gap``; one from before schema 14 has its text alone."""
        why = Told(row["sentence"]) if row["why"] is None else gap_from_json(row["why"])
        return cls(row["change_id"], row["drive_id"], GapKind(row["kind"]), why)

    def as_json(self) -> dict[str, str]:
        """Return what ``--json`` prints."""
        return {
            "change_id": self.change_id,
            "drive_id": self.drive_id,
            "kind": self.kind.value,
            "sentence": self.sentence,
        }

    def to_row(self) -> dict[str, Any]:
        """Return its row of the table ``crop_gap``."""
        return {**self.as_json(), "why": gap_to_json(self.why)}


def crops_of(ask: Ask, change_id: str) -> tuple[Crop, ...]:
    """Return the crops of one finding, the best view first, the face before its surroundings."""
    table = schema.crop
    return _crops(ask, sa.select(table).where(table.c.change_id == change_id))


def exportable_crops(ask: Ask) -> tuple[Crop, ...]:
    """Return the crops that may leave the machine: those that were masked."""
    return _crops(ask, sa.select(schema.crop).where(schema.crop.c.is_masked))


def n_unmasked_crops(ask: Ask) -> int:
    """Count the crops that may not leave the machine."""
    return len(ask(sa.select(schema.crop.c.sha256).where(~schema.crop.c.is_masked)))


def gaps_of(ask: Ask, change_id: str) -> tuple[Gap, ...]:
    """Return why a finding has no crops, or no more of them."""
    table = schema.crop_gap
    return tuple(
        map(Gap.from_row, ask(sa.select(table).where(table.c.change_id == change_id).order_by("id")))
    )


def _crops(ask: Ask, asked: sa.Select[Any]) -> tuple[Crop, ...]:
    t = schema.crop.c
    return tuple(map(Crop.from_row, ask(asked.order_by(t.change_id, t.number, t.role))))
