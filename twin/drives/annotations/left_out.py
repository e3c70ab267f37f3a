"""What of one annotation file is left out, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from twin.drives.annotations.camera_of_file import CameraChooser
from twin.drives.annotations.formats.shapes import AnnotationFile
from twin.drives.annotations.labels import Meanings
from twin.drives.annotations.picture_names import PictureNames
from twin.drives.folder.notes import SkipKind, Skipped, skipped_annotations

NOT_AMONG = "image that is not among the drive's pictures"
TWICE = "image of a name that was uploaded twice, so that it may be another drive's: delete the tasks of one"


@dataclass(slots=True)
class FileReading:
    """What the shapes of one file are read with, and the counts of what is left out.

    Attributes
    ----------
    rig_source : str
    labels : Meanings
    pictures : mapping of camera to PictureNames
        Of cameras whose pictures are files.
    first_frame : int
        Number of the first frame in a CSV and in names of images.
    numbered : dict of camera to example
        Filled for cameras whose frames are such numbers.
    understood : set of str
        Cameras of which an annotation could be read, be it of no road object.
    faults : dict of camera to counts by reason
    codeless, ignored : counts of texts that are no sign code, and of labels that are no road object
    """

    rig_source: str
    labels: Meanings
    pictures: Mapping[str, PictureNames]
    first_frame: int
    numbered: dict[str, str]
    understood: set[str] = field(default_factory=set)
    faults: dict[str, Counter[str]] = field(default_factory=dict)
    codeless: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)


def left_out(context: FileReading, where: str) -> Iterable[Skipped]:
    """Count what was left out, by reason."""
    for reason, n in sorted(sum(context.faults.values(), Counter()).items()):
        yield skipped_annotations(SkipKind.UNUSABLE, where, n, reason)
    for label, n in sorted(context.ignored.items()):
        yield Skipped("labels", where, n, f"no road object: {label!r:.60}")
    for text, n in sorted(context.codeless.items()):
        yield Skipped("sign codes", where, n, f"not a sign code: {text!r:.60}")


def all_left_out(
    file: AnnotationFile, declared: str | None, chooser: CameraChooser, context: FileReading
) -> Iterable[str]:
    """Tell of each camera of a file of whose annotations not one could be used."""
    faults = {camera: counts for camera, counts in context.faults.items() if camera not in context.understood}
    if not file.shapes:
        counts = Counter({s.reason: s.count for s in file.skipped})
        cameras = {declared} if declared is not None else chooser.of_empty_file()
        faults = dict.fromkeys(cameras, counts) if counts else {}
    for camera, counts in sorted(faults.items()):
        reasons = "; ".join(reason for reason, _ in counts.most_common(3))
        said = _names_differ(file, camera, chooser, context) if NOT_AMONG in counts else ""
        yield (
            f"All {counts.total():,} annotations of {camera} in {file.where} were left out: {reasons}{said}."
            " Correct them: nothing is known of what this camera saw."
        )


def _names_differ(file: AnnotationFile, camera: str, chooser: CameraChooser, context: FileReading) -> str:
    pictures = context.pictures[camera].example
    image = next((shape.image for shape in file.shapes if chooser.of(shape).name == camera), "")
    return f", such as {image!r:.60}, where the pictures have names such as {pictures!r:.60}"
