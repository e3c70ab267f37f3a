"""Pictures in which no board was found, and why: blurred, mirrored, or simply not there."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from geoloc.arrays import ByteArray
from geoloc.calibration.intrinsics import MIN_VIEWS, some
from geoloc.doubts import Doubt
from twin.calibrate.boards.boards import Board
from twin.calibrate.boards.detect import BLURRED_PX, detect
from twin.calibrate.boards.pictures import Picture

_FLIPPED_TRIALS = 40
"""Pictures that are flipped and looked at again; a long film may have hundreds without the board."""
_MIRRORED = "mirrored: the board is found only when the picture is flipped"
_BLURRED = f"blurred: the board was not found, and no edge is sharper than {BLURRED_PX:g} px"
_NOT_THERE = "the board was not found"
_GAUSS_WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0)) / np.sqrt(2.0 * np.pi)


class PictureFault(StrEnum):
    """What can be wrong with the pictures of a board."""

    MIRRORED_PICTURES = "mirrored_pictures"
    BLURRED_PICTURES = "blurred_pictures"
    BLURRED_CAMERA = "blurred_camera"
    SIMILAR_VIEWS = "similar_views"
    WRONG_SQUARE_SIZE = "wrong_square_size"


@dataclass(slots=True)
class PicturesWithoutBoard:
    """Gathers the pictures in which no board was found.

    Attributes
    ----------
    board : Board
    reasons : dict of str to str
        Picture → why, as far as it is known.
    blurred, mirrored : list of str
        Names of those that are.
    """

    board: Board
    reasons: dict[str, str] = field(default_factory=dict)
    blurred: list[str] = field(default_factory=list)
    mirrored: list[str] = field(default_factory=list)
    _trials: int = _FLIPPED_TRIALS

    def add(self, picture: Picture) -> None:
        """Look for the reason in one more picture."""
        reason = _NOT_THERE
        if sharpest_edge_px(picture.grey) > BLURRED_PX:
            self.blurred.append(picture.name)
            reason = _BLURRED
        elif self.board.kind == "charuco" and self._trials > 0:
            self._trials -= 1
            if detect(np.ascontiguousarray(picture.grey[:, ::-1]), self.board, picture.name):
                self.mirrored.append(picture.name)
                reason = _MIRRORED
        self.reasons[picture.name] = reason

    def why_so_few(self, n_seen: int) -> str:
        """Sentence about pictures that do not show the board often enough, with the likeliest cause."""
        n_pictures = n_seen + len(self.reasons)
        if len(self.mirrored) > 0.5 * len(self.reasons):
            return (
                f"The pictures are mirrored: {self.mirrored[0]} shows the board only when it is flipped. "
                "Switch mirroring off in the camera, or flip the pictures back."
            )
        what = f"The board {self.board.text} was found in {n_seen} of {n_pictures} pictures"
        if len(self.blurred) > 0.5 * len(self.reasons):
            return (
                f"{what}, and {len(self.blurred)} are blurred ({some(self.blurred)}): focus the camera, hold "
                "it and the board still, and give it light."
            )
        if n_pictures < MIN_VIEWS:
            return f"{what}, and {MIN_VIEWS} are the least that give a camera: take 30 or more."
        checkerboard = self.board.kind == "checkerboard"
        counted = "inner corners" if checkerboard else "squares and the dictionary of the markers"
        return (
            f"{what}, and {MIN_VIEWS} are the least: count its {counted} again, and see that pictures show "
            f"it {'whole and ' if checkerboard else ''}sharp, with a white margin."
        )

    def faults(self, n_pictures: int) -> list[Doubt]:
        """Tell of mirrored and blurred pictures among good ones; a film also has frames without a board."""
        faults = []
        if self.mirrored:
            faults.append(
                Doubt(
                    PictureFault.MIRRORED_PICTURES,
                    f"{len(self.mirrored)} of {n_pictures} pictures are mirrored ({some(self.mirrored)}) and "
                    "were left out: flip them back, if they are of this camera.",
                )
            )
        if self.blurred:
            faults.append(
                Doubt(
                    PictureFault.BLURRED_PICTURES,
                    f"{len(self.blurred)} of {n_pictures} pictures are blurred ({some(self.blurred)}), and "
                    "no board was found in them: hold camera and board still.",
                )
            )
        return faults


def sharpest_edge_px(image: ByteArray) -> float:
    """Width of the sharpest edges of a picture at half height: height over slope, as of a blurred step.

    The height is that of the picture's grey values, the slope one that a thousandth of the pixels exceeds.
    NaN for a picture of one grey.
    """
    grey = image.astype(np.float64)
    low, high = np.quantile(grey, [0.01, 0.99])
    down, across = np.gradient(grey)
    slope = float(np.quantile(np.hypot(down, across), 0.999))
    return float((high - low) / slope * _GAUSS_WIDTH) if slope > 0.0 else float("nan")
