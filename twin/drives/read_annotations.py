"""The annotations of a drive folder: which files, which cameras, what was left out."""

from __future__ import annotations

from geoloc.errors import CalibrationError
from geoloc.rig import Rig
from twin.drives.annotated import AnnotationsRead, gather
from twin.drives.cvat import read_cvat
from twin.drives.driveworks import find_annotations
from twin.drives.folder import DriveFolder
from twin.drives.notes import ReadingNotes
from twin.drives.settings import SETTINGS_FILE, DriveSettings
from twin.errors import DriveError


def read_annotations(
    folder: DriveFolder, settings: DriveSettings, rig: Rig, notes: ReadingNotes
) -> AnnotationsRead:
    """Read the annotation files that ``drive.toml`` names, else those that the folder holds.

    Raises
    ------
    DriveError
        If a file cannot be read, or is of a camera that the rig does not have.
    """
    if settings.annotations is None:
        wanted: list[tuple[str, str | None]] = [(name, None) for name in find_annotations(folder)]
    else:
        wanted = [(name, camera) for camera, names in settings.annotations.items() for name in names]
        for camera in settings.annotations:
            check_camera(rig, camera, "[annotations]")
    files = [(read_cvat(folder.content(name), name), camera) for name, camera in wanted]
    found = gather(files, rig)
    notes.skipped += found.skipped
    if not files:
        notes.warnings.append(
            f"{folder.root.name} holds no annotations (CVAT XML 1.1), so the drive has a track but no"
            " sightings."
        )
    elif not len(found.annotations.frame):
        names = ", ".join(name for name, _ in wanted)
        notes.warnings.append(
            f"{names}: not one point or box that can be used, so the drive has no sightings."
        )
    notes.say(f"Annotations: {len(found.annotations.frame)} in {len(files)} files.")
    return found


def check_camera(rig: Rig, camera: str, table: str) -> None:
    """Refuse a camera of ``drive.toml`` that the rig does not have.

    Raises
    ------
    DriveError
        Naming the table and the cameras that there are.
    """
    try:
        rig.camera(camera)
    except CalibrationError as error:
        raise DriveError(f"{table} in {SETTINGS_FILE} names the camera {camera}: {error}") from error
