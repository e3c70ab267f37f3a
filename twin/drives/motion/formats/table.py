"""Every format that says how a car moved: how it is recognised and how it is read.

A new format is a module beside this one and a line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.formats import can_log, comma, driveworks, gopro, ros, sbp, table_file
from twin.drives.motion.samples import MotionRead
from twin.errors import DriveError


class MotionFormat(NamedTuple):
    """One format.

    Attributes
    ----------
    name : str
        In a sentence about a file.
    is_it : callable
        Whether a file or folder is of this format.
    read : callable
        Reads what ``drive.toml`` asks for.
    """

    name: str
    is_it: Callable[[DriveFolder, MotionSource], bool]
    read: Callable[[DriveFolder, MotionSource], MotionRead]


TABLE = MotionFormat("a table", lambda _folder, _source: True, table_file.read)
CAN = MotionFormat("a CAN log", can_log.is_can_log, can_log.read)
ROS = MotionFormat("a ROS recording", ros.is_ros, ros.read)
COMMA = MotionFormat("a comma log", comma.is_comma, comma.read)
SBP = MotionFormat("SBP", sbp.is_sbp, sbp.read)
DRIVEWORKS = MotionFormat("DriveWorks JSON or egomotion", driveworks.is_driveworks, driveworks.read)
GOPRO = MotionFormat("a GoPro video", gopro.is_gopro, gopro.read)
FORMATS = (ROS, COMMA, GOPRO, SBP, CAN, DRIVEWORKS, TABLE)
"""The first that knows a file reads it; a table may look like anything."""


def motion_format(folder: DriveFolder, source: MotionSource) -> MotionFormat:
    """Return the format of a file or folder that ``drive.toml`` names.

    Raises
    ------
    DriveError
        If it is not there, or a folder of no format.
    """
    if not folder.is_folder(source.file):
        folder.open(source.file).close()
    its = next(one for one in FORMATS if one.is_it(folder, source))
    if its is TABLE and folder.is_folder(source.file):
        raise DriveError(
            f"{source.file} is a folder that is neither a ROS 2 recording nor a comma log: name a file under"
            f" [{source.table}] in {SETTINGS_FILE}."
        )
    return its
