"""Shapes of one drive → :class:`~twin.drives.drive.Annotations`: camera, frame, object and sign codes.

Which camera a shape belongs to
    What ``drive.toml`` says; else the camera whose name stands in the name of the file or folder, of its
    task or video, or of the image. If those disagree or say nothing, the drive is refused. A rig with a
    single camera needs no name.

Which object it is
    The attribute ``object`` (or ``object_id``) as written: the same value is the same physical object, in
    whichever file and camera. Without it the track id, which CVAT numbers anew in every file: it stands alone
    (``12``) only where nothing else could be confused with it, that is in a drive with one annotation file,
    one camera and no ``object`` attributes; otherwise it carries its camera (``C3_tricam120:12``), and its
    file where a camera has several (``C3_tricam120/evening:12``). Image tasks have no tracks: there the
    attribute ``track_id`` counts as one, and a shape without it is an object of its own (``f123.1``: frame
    123, first such shape) until :mod:`twin.drives.objects.identify` finds out where it belongs.

Which frame
    The number that the tool gives; else that of the image among the drive's pictures; else the last digits of
    the image's name (:mod:`twin.drives.annotations.frame_numbers`).

Whether it was measured
    What its reader says (CVAT's and Label Studio's own marks), and the attribute ``keyframe``, by which CVAT
    marks the rows of tracks in the formats of other tools.

What lies on the ground
    What ``labels.toml`` calls so: points, lines and polygons, kept apart from signs with all their corners.

What it is
    The attribute ``skiltnummer``; else what the drive's ``labels.toml`` says of the label; else a label that
    begins with a sign code; else the labels that ship with twin (:mod:`.labels`). What is written on it
    says the attribute ``text`` or ``tekst``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.rig.rig import Rig, RigCamera
from twin.drives.annotations.camera_of_file import CameraChooser
from twin.drives.annotations.drawn_size import check_reach, check_size
from twin.drives.annotations.formats.shapes import KEY_FRAME, AnnotationFile, Pixel, Shape, is_key_frame
from twin.drives.annotations.frame_numbers import frame_of, is_numbered
from twin.drives.annotations.labels import LabelMap, Meanings, codes_from_attribute
from twin.drives.annotations.left_out import (
    NOT_AMONG,
    TWICE,
    FileReading,
    all_left_out,
    left_out,
)
from twin.drives.annotations.picture_names import NOT_AMONG_PICTURES, UPLOADED_TWICE, PictureNames
from twin.drives.drive import Annotation, Annotations
from twin.drives.folder.notes import SkipKind, Skipped, skipped_annotations
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import DriveError

OBJECT_ATTRIBUTES = ("object", "object_id")
TEXT_ATTRIBUTES = ("text", "tekst")
_HIGHEST_FRAME = 2**62
_NO_OUTLINE = "a box of what lies on the ground: draw it as a point, a line or a polygon"
_LONGEST_TEXT = 200
"""Texts are kept in arrays of one width: a single long one would take its length in every row."""


@dataclass(frozen=True, slots=True)
class AnnotationsRead:
    """Annotations of a drive, the cameras that were annotated, and what was left out.

    Attributes
    ----------
    other_objects : mapping of label to vegobjekttype
        Labels of what is no sign.
    unmapped : mapping of label to count
        Labels that say no sign code and no type.
    unsized : frozenset of str
        Cameras with annotations in pixels that do not say of how large a picture.
    numbered : mapping of camera to example
        Cameras whose frames are numbers in a CSV or in names of images, and one of them.
    warnings : tuple of str
        Of each camera of a file of whose annotations not one could be used.
    on_ground : tuple of Annotation
        Points, lines and areas of what lies on the ground, in the same order.
    """

    annotations: Annotations
    cameras: tuple[str, ...]
    skipped: tuple[Skipped, ...]
    other_objects: Mapping[str, int] = field(default_factory=dict)
    unmapped: Mapping[str, int] = field(default_factory=dict)
    unsized: frozenset[str] = frozenset()
    numbered: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    on_ground: tuple[Annotation, ...] = ()


def gather(
    files: Sequence[tuple[AnnotationFile, str | None]],
    rig: Rig,
    labels: LabelMap | None = None,
    image_frames: Mapping[str, Mapping[str, int]] | None = None,
    first_frame: int = 0,
) -> AnnotationsRead:
    """Bring the shapes of all annotation files of a drive together.

    Parameters
    ----------
    files : sequence of (file, camera)
        `camera` is None where ``drive.toml`` does not say it.
    rig : Rig
    labels : LabelMap, optional
        The drive's own.
    image_frames : mapping of camera to frame number by image name, optional
        Of cameras whose pictures are files.
    first_frame : int
        Number of the first frame in a CSV and in names of images.

    Returns
    -------
    AnnotationsRead
        Rows sorted by camera, frame, object and kind, whatever the order of the files.

    Raises
    ------
    DriveError
        If a camera is unclear, not in the rig, or of another image size than the annotations.
    """
    rows: list[tuple[Annotation, str]] = []
    cameras: set[str] = set()
    unsized: set[str] = set()
    skipped: list[Skipped] = []
    meanings = Meanings(labels)
    numbered: dict[str, str] = {}
    warnings: list[str] = []
    for file, declared in files:
        skipped += file.skipped
        chooser = CameraChooser(file, declared, rig)
        cameras |= chooser.of_empty_file() if not file.shapes else set()
        images = [shape.image for shape in file.shapes]
        pictures = {c: PictureNames(of, images) for c, of in (image_frames or {}).items() if of}
        context = FileReading(rig.source, meanings, pictures, first_frame, numbered)
        rows += annotations_of(file, chooser.of, context)
        warnings += all_left_out(file, declared, chooser, context)
        unsized |= check_reach(file, chooser, rig.source)
        skipped += left_out(context, file.where)
        cameras |= chooser.chosen
    named = _named(rows)
    # Points carry math.nan itself as their box, so that equal rows compare equal. Another export of the same
    # row may lack the word that it was interpolated: such rows stand first.
    unique = list({row._replace(file="", is_measured=True): row for row in reversed(named)}.values())[::-1]
    if len(unique) < len(named):
        where = ", ".join(sorted({row.file for row in named}))
        skipped.append(skipped_annotations(SkipKind.REPEATED, where, len(named) - len(unique)))
    return AnnotationsRead(
        Annotations.of([row for row in unique if not row.outline_px]),
        tuple(sorted(cameras)),
        tuple(skipped),
        meanings.other_objects(),
        dict(sorted(meanings.unmapped.items(), key=lambda item: (-item[1], item[0]))),
        frozenset(unsized),
        numbered,
        tuple(warnings),
        tuple(row for row in unique if row.outline_px),
    )


def stamped(
    annotations: Annotations, frame_epoch_ns: Mapping[str, IntArray], sources: Mapping[str, str]
) -> tuple[Annotations, tuple[Skipped, ...]]:
    """Keep the annotations whose frame has a time stamp.

    Parameters
    ----------
    sources : mapping of camera to file
        Where the stamps are from, for messages.

    Raises
    ------
    DriveError
        If none of a camera's annotated frames has one.
    """
    keep = epochs_of(annotations, frame_epoch_ns) != NO_STAMP
    skipped = []
    for camera in np.unique(annotations.camera).tolist():
        has_stamp = keep[annotations.camera == camera]
        if not has_stamp.any():
            frames = annotations.frame[annotations.camera == camera]
            stamped_frames = np.flatnonzero(frame_epoch_ns[camera] != NO_STAMP)
            raise DriveError(
                f"The annotated frames {frames.min()}–{frames.max()} of {camera} are none of the frames"
                f" {stamped_frames[0]}–{stamped_frames[-1]} in {sources[camera]}: give the annotations of"
                " this recording."
            )
        if not has_stamp.all():
            lost = int(np.count_nonzero(~has_stamp))
            skipped.append(skipped_annotations(SkipKind.NO_TIME, sources[camera], lost, camera))
    return only(annotations, keep), tuple(skipped)


def epochs_of(annotations: Annotations, frame_epoch_ns: Mapping[str, IntArray]) -> IntArray:
    """Host stamp of each annotation; `NO_STAMP` for unknown frames, and cameras that are not given."""
    epoch_ns = np.full(len(annotations.frame), NO_STAMP, dtype=np.int64)
    for camera, stamps in frame_epoch_ns.items():
        stamped_rows = (annotations.camera == camera) & (annotations.frame < len(stamps))
        epoch_ns[stamped_rows] = stamps[annotations.frame[stamped_rows]]
    return epoch_ns


def only(annotations: Annotations, keep: NDArray[np.bool_]) -> Annotations:
    """Those rows of the annotations where `keep` is true."""
    return Annotations(**{f.name: getattr(annotations, f.name)[keep] for f in fields(Annotations)})


def annotations_of(
    file: AnnotationFile, camera_of: Callable[[Shape], RigCamera], context: FileReading
) -> Iterator[tuple[Annotation, str]]:
    """Yield annotations, named only by their attribute ``object``, and their tracks, unique in the file."""
    inherited = _track_attributes(file.shapes)
    singles: Counter[tuple[str, int]] = Counter()
    for drawn in file.shapes:
        camera = camera_of(drawn)
        check_size(drawn, camera, file.where, context.rig_source)
        shape = drawn.in_pixels(camera.model.width_px, camera.model.height_px)
        frame = _frame(shape, camera.name, file.tool, context)
        attributes = inherited.get((shape.task, shape.track), {}) | _filled(shape)
        track = shape.track or attributes.get("track_id", "")
        name = next((attributes[a] for a in OBJECT_ATTRIBUTES if a in attributes), "")
        reason = _unusable(shape, frame, camera) or _too_long(name, track)
        if reason:
            context.faults.setdefault(camera.name, Counter())[reason] += 1
            continue
        context.understood.add(camera.name)
        label = shape.label[:_LONGEST_TEXT]
        meaning = context.labels.of(label, _codes(attributes.get("skiltnummer", ""), context.codeless))
        if meaning.is_ignored:
            context.ignored[label] += 1
            continue
        kind, outline = _on_ground(shape) if meaning.is_on_ground else (shape.kind, ())
        if not kind:
            context.faults.setdefault(camera.name, Counter())[_NO_OUTLINE] += 1
            continue
        has_id = bool(name or track)
        if not track:
            singles[camera.name, frame] += 1
            track = f"f{frame}.{singles[camera.name, frame]}"
        row = Annotation(
            camera.name,
            frame,
            name,
            has_id,
            label,
            meaning.codes,
            _text(attributes),
            kind,
            shape.pixel_px,
            shape.box_px,
            file.where,
            is_measured=shape.is_measured and is_key_frame(shape.attributes.get(KEY_FRAME)),
            is_track=has_id and not name,
            outline_px=outline,
        )
        yield row, track


def _on_ground(shape: Shape) -> tuple[str, tuple[Pixel, ...]]:
    """Return what a shape on the ground is, and its corners; "" for a box, whose corners lie in the air."""
    if shape.kind == "foot":
        return "point", (shape.pixel_px,)
    if shape.kind == "line":
        return "line", shape.outline_px
    return ("area", shape.outline_px) if len(shape.outline_px) > 2 else ("", ())


def _text(attributes: Mapping[str, str]) -> str:
    """What is written on the plates, on one line; nothing that a file or database might not take."""
    said = next((attributes[a] for a in TEXT_ATTRIBUTES if a in attributes), "")
    line = " ".join(said[:_LONGEST_TEXT].split())
    return "".join(filter(str.isprintable, line))


def _too_long(*names: str) -> str:
    return f"object id longer than {_LONGEST_TEXT} characters" if max(map(len, names)) > _LONGEST_TEXT else ""


def _filled(shape: Shape) -> dict[str, str]:
    return {name: text for name, text in shape.attributes.items() if text}


def _track_attributes(shapes: Sequence[Shape]) -> dict[tuple[str, str], dict[str, str]]:
    """First value of each attribute in a track: exports may write it on one row only."""
    attributes: dict[tuple[str, str], dict[str, str]] = {}
    for shape in shapes:
        if shape.track:
            track = attributes.setdefault((shape.task, shape.track), {})
            for name, text in _filled(shape).items():
                track.setdefault(name, text)
    return attributes


def _codes(attribute: str, codeless: Counter[str]) -> str:
    codes = codes_from_attribute(attribute[:_LONGEST_TEXT])
    if attribute and not codes:
        codeless[attribute[:_LONGEST_TEXT]] += 1
    return codes


def _frame(shape: Shape, camera: str, tool: str, context: FileReading) -> int:
    pictures = context.pictures.get(camera)
    first_frame = 0
    if is_numbered(shape, tool, pictures):
        first_frame = context.first_frame
        context.numbered.setdefault(camera, shape.image or f"{shape.frame} in a CSV")
    return frame_of(shape, camera, pictures, first_frame)


def _unusable(shape: Shape, frame: int, camera: RigCamera) -> str:
    """Why a shape is left out; "" if it is not."""
    if frame == NOT_AMONG_PICTURES:
        return NOT_AMONG
    if frame == UPLOADED_TWICE:
        return TWICE
    if not 0 <= frame < _HIGHEST_FRAME:
        return "frame number unreadable"
    width, height = camera.model.width_px, camera.model.height_px
    for x, y in (shape.pixel_px, *shape.outline_px):
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            return "outside the image"
    left, top, right, bottom = shape.box_px
    if right - left > width or bottom - top > height:
        return "box larger than the image"
    return ""


def _named(rows: Sequence[tuple[Annotation, str]]) -> list[Annotation]:
    """Settle the object ids of annotations and their tracks (see the module's text), and sort."""
    files_of: dict[str, set[str]] = {}
    for row, _ in rows:
        files_of.setdefault(row.camera, set()).add(row.file)
    n_files = len({row.file for row, _ in rows})
    alone = len(files_of) == 1 and n_files == 1 and not any(row.object for row, _ in rows)

    def name(row: Annotation, track: str) -> str:
        if row.object or alone:
            return row.object or track
        if len(files_of[row.camera]) > 1:
            return f"{row.camera}/{_without_suffix(row.file)}:{track}"
        return f"{row.camera}:{track}"

    named = [row._replace(object=name(row, track)) for row, track in rows]
    return sorted(named, key=lambda r: (r.camera, r.frame, r.object, r.kind, r.pixel_px, r.is_measured))


def _without_suffix(file: str) -> str:
    path = PurePosixPath(file)
    return str(path.with_suffix("")) if path.name else file
