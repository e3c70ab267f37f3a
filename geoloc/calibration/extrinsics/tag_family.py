"""AprilTags as their authors print them, whatever OpenCV's own tables hold.

OpenCV's tables of the AprilTag families hold every print turned by 180° against the authors' own
(github.com/AprilRobotics/apriltag-imgs), and a change of OpenCV turns them back
(github.com/opencv/opencv/pull/28823). So the tables of the OpenCV that runs are looked at, and the first
corner of a tag is always the top left one of the authors' print.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import ByteArray
from geoloc.errors import CalibrationError

if TYPE_CHECKING:
    from cv2.aruco import Dictionary

FAMILY = "DICT_APRILTAG_36h11"
_PREFIX = "DICT_APRILTAG_"
_SIDE = 6
_FIRST_CODE = 0xD5D628584
"""Tag 0 of 36h11, row by row from the top left, the first bit highest; 1 is white."""


def is_apriltag(dictionary: str) -> bool:
    """Whether a dictionary of OpenCV's is one of the AprilTag families."""
    return dictionary.startswith(_PREFIX)


def quarter_turns(dictionary: Dictionary) -> int:
    """By how many quarter turns (counterclockwise) a dictionary's 36h11 prints differ from the authors'.

    Raises
    ------
    CalibrationError
        If its tag 0 is another one.
    """
    bits = bits_of(dictionary, 0)
    code = np.array([_FIRST_CODE >> shift & 1 for shift in range(_SIDE * _SIDE - 1, -1, -1)])
    for turns in range(4):
        if np.array_equal(np.rot90(code.reshape(_SIDE, _SIDE), turns), bits):
            return turns
    raise CalibrationError(
        "This OpenCV has another tag 0 in its family 36h11 than AprilTag's authors: install another release"
        " of opencv-python-headless."
    )


def bits_of(dictionary: Dictionary, number: int) -> ByteArray:
    """Cells (side, side) of a marker inside its black border; 1 is white."""
    import cv2

    row = dictionary.bytesList[number : number + 1]
    return np.asarray(cv2.aruco.Dictionary.getBitsFromByteList(row, dictionary.markerSize), dtype=np.uint8)


def turned(dictionary: Dictionary, turns: int) -> Dictionary:
    """Turn all prints of a dictionary by quarter turns, counterclockwise."""
    import cv2

    rows = [
        cv2.aruco.Dictionary.getByteListFromBits(np.rot90(bits_of(dictionary, number), turns).copy())
        for number in range(len(dictionary.bytesList))
    ]
    return cv2.aruco.Dictionary(np.concatenate(rows), dictionary.markerSize, dictionary.maxCorrectionBits)


@cache
def dictionary_of(name: str, turns: int = 0) -> Dictionary:
    """OpenCV's dictionary of that name; an AprilTag family with its prints as the authors make them.

    Parameters
    ----------
    name : str
        As in ``cv2.aruco``.
    turns : int
        Quarter turns that are added to that, counterclockwise.
    """
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    if is_apriltag(name):
        # All families are turned alike: they were made, and are mended, by the same rule.
        family = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILY))
        turns -= quarter_turns(family)
    return turned(known, turns) if turns % 4 else known
