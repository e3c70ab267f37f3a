"""When each frame of the annotated cameras was taken."""

from __future__ import annotations

import numpy as np

from geoloc.rig import Rig
from twin.drives.annotated import AnnotationsRead
from twin.drives.drive import IntArray
from twin.drives.driveworks import find_timestamps
from twin.drives.folder import DriveFolder
from twin.drives.notes import ReadingNotes
from twin.drives.read_annotations import check_camera
from twin.drives.settings import SETTINGS_FILE, DriveSettings
from twin.drives.timestamps import NO_STAMP, read_timestamps
from twin.errors import DriveError


def read_stamps(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, found: AnnotationsRead, notes: ReadingNotes
) -> tuple[dict[str, IntArray], dict[str, str]]:
    """Frame stamps of the annotated cameras, and of those for which ``drive.toml`` names them."""
    stamps, files = {}, {}
    for camera in settings.timestamps:
        check_camera(rig, camera, "[timestamps]")
    for camera in sorted({*found.cameras, *settings.timestamps, *(settings.annotations or ())}):
        file = settings.timestamps.get(camera) or find_timestamps(folder, rig.camera(camera))
        if file is None:
            wanted = rig.camera(camera).timestamps or f"{camera}.timestamps"
            raise DriveError(
                f"{wanted} is not in {folder.root}, so the annotated frames of {camera} have no time: add the"
                f" file, or name it under [timestamps] in {SETTINGS_FILE}."
            )
        stamps[camera], skipped = read_timestamps(folder.content(file), file)
        files[camera] = file
        notes.skipped += skipped
        notes.say(f"Time stamps {file}: {np.count_nonzero(stamps[camera] != NO_STAMP)} frames.")
    return stamps, files
