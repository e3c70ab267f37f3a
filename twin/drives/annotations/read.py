"""The annotations of a drive folder: which files, which cameras, what was left out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from geoloc.doubts import Doubt
from geoloc.rig.rig import Rig
from twin.drives.annotations.drawn_size import reach_warnings
from twin.drives.annotations.find import find_annotations, named_annotations, nearly_annotations
from twin.drives.annotations.formats.shapes import AnnotationFile, Hints
from twin.drives.annotations.formats.table import NAMES
from twin.drives.annotations.gather import AnnotationsRead, gather
from twin.drives.annotations.labels import LABELS_FILE, LabelMap, read_label_map, unknown_codes_warning
from twin.drives.folder.drive_toml import DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes, doubts
from twin.drives.rig.rig_files import check_camera
from twin.errors import DriveError

_MOST_LABELS = 12
"""Labels without a meaning that are listed by name."""


def read_annotations(
    folder: DriveFolder,
    settings: DriveSettings,
    rig: Rig,
    notes: ReadingNotes,
    *,
    labels: Path | None = None,
    image_frames: Mapping[str, Mapping[str, int]] | None = None,
) -> AnnotationsRead:
    """Read the annotation files that ``drive.toml`` names, else those that the folder holds.

    Parameters
    ----------
    labels : Path, optional
        What labels mean, instead of the folder's own ``labels.toml``.
    image_frames : mapping of camera to frame number by image name, optional
        Of cameras whose pictures are files.

    Raises
    ------
    DriveError
        If a file cannot be read, or is of a camera that the rig does not have.
    """
    label_map = read_drive_labels(folder, labels)
    label_file = LABELS_FILE if labels is None else labels.name
    notes.warn(DriveDoubt.LABELS, *unknown_codes_warning(label_map, label_file))
    hints = Hints(label_map.foot_keypoints, on_ground=label_map.is_on_ground)
    files: list[tuple[AnnotationFile, str | None]] = []
    if settings.annotations is None:
        files += ((file, None) for file in find_annotations(folder, notes, hints))
    for camera, names in (settings.annotations or {}).items():
        check_camera(rig, camera, "[annotations]")
        files += ((file, camera) for file in named_annotations(folder, names, notes, hints))
    read = gather(files, rig, label_map, image_frames, settings.first_frame or 0)
    notes.skipped += read.skipped
    notes.warnings += _warnings(folder, [file.where for file, _ in files], read)
    notes.warn(DriveDoubt.ANNOTATIONS, *read.warnings, *reach_warnings(read.annotations, read.unsized, rig))
    n_files = sum(file.n_files for file, _ in files)
    n_read = len(read.annotations.frame) + len(read.on_ground)
    notes.say(f"Annotations: {n_read} in {n_files} file{'' if n_files == 1 else 's'}.")
    return read


def read_drive_labels(folder: DriveFolder, labels: Path | None = None) -> LabelMap:
    """Read what labels mean in this drive: the given file, else the folder's ``labels.toml``, else nothing.

    Raises
    ------
    DriveError
        If the file cannot be read, or is not as :mod:`twin.drives.annotations.labels` says.
    """
    if labels is not None:
        try:
            content = labels.read_bytes()
        except OSError as error:
            raise DriveError(f"{labels} cannot be read ({error.strerror}): check its name.") from error
        folder.enter(_entered(labels), content)
        return read_label_map(content, labels.name)
    if folder.has(LABELS_FILE):
        return read_label_map(folder.content(LABELS_FILE))
    return LabelMap()


def label_files(labels: Path | None) -> frozenset[str]:
    """Names under which the file of labels' meanings may be among those that the drive was read from."""
    return frozenset({LABELS_FILE} if labels is None else {_entered(labels)})


def _entered(labels: Path) -> str:
    return f"--labels {labels.name}"


def _warnings(folder: DriveFolder, files: list[str], read: AnnotationsRead) -> tuple[Doubt, ...]:
    if not files:
        nearly = "".join(f" {one}." for one in nearly_annotations(folder))
        none = (
            f"{folder.root.name} holds no annotations ({NAMES}), so the drive has a track but no sightings."
        )
        return doubts(DriveDoubt.NO_ANNOTATION_FILES, none + nearly)
    if not len(read.annotations.frame) and not read.on_ground:
        nothing = f"{', '.join(files)}: not one point or box that can be used, so the drive has no sightings."
        return doubts(DriveDoubt.ANNOTATIONS, nothing)
    return doubts(DriveDoubt.LABELS, *unmapped_warning(read))


def unmapped_warning(read: AnnotationsRead) -> list[str]:
    """List the labels of which nobody says what they mean; empty if there are none."""
    if not read.unmapped:
        return []
    listed = [f"{label or '(none)'} ({n})" for label, n in read.unmapped.items()]
    more = f" and {len(listed) - _MOST_LABELS} more" if len(listed) > _MOST_LABELS else ""
    unmapped = (
        f"No sign code for the labels {', '.join(listed[:_MOST_LABELS])}{more}: map them in {LABELS_FILE}"
        " (`twin help labels`), or give the attribute skiltnummer."
    )
    return [unmapped]
