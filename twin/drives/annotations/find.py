"""Which files of a drive folder are annotations, and of which tool: found by content.

Tools that write one file for each image (labelme, LabelMe, YOLO, Mapillary Vistas) fill a folder: the drive
folder itself, a folder in it, or one that ``drive.toml`` names. Such a folder counts as one export.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from twin.drives.annotations.formats import cvat, plain_csv, yolo
from twin.drives.annotations.formats.cvat import root_tag
from twin.drives.annotations.formats.plain_csv import lacking
from twin.drives.annotations.formats.shapes import NO_HINTS, AnnotationFile, Hints, YoloClasses, merged
from twin.drives.annotations.formats.table import (
    FORMATS,
    JSON,
    MAY_ANNOTATE,
    NAMES,
    ONE_IMAGE,
    SUFFIXES,
    XML,
    format_of,
    read_annotation_json,
    suffix_of,
)
from twin.drives.annotations.formats.yolo import NAME_FILES, looks_like_yolo, read_yolo_classes
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes, SkipKind, skipped_annotations
from twin.errors import DriveError

_OF_NAMED_CSV, _OF_OTHER_NAMED = (
    next(one for one in FORMATS if one.tool == tool) for tool in (plain_csv.TOOL, cvat.TOOL)
)
"""Readers of files that ``drive.toml`` names and no format recognises: they say what is wrong."""
_ARCHIVES = (".zip", ".7z", ".rar", ".tar", ".tar.gz", ".tgz")
_UNPACK = "if it holds annotations of this drive, unpack it in the drive folder"
_EMPTY_BYTES = 64
_MOST_NAMES = 5
_DEEPER = re.compile(
    r"annotations|labels|default|train|val(id)?|test|obj_(train|valid|test)_data", re.IGNORECASE
)
_DEEPEST = 4


def annotation_folders(folder: DriveFolder) -> list[str]:
    """Folders that are searched: those in the drive folder, and in these what tools call their own so.

    Datumaro's and COCO's are ``annotations/default.json``, YOLO's ``labels/train/12.txt``.
    """
    folders = folder.folders()
    last = folders
    for _ in range(_DEEPEST - 1):
        inside = (one for name in last for one in folder.folders(name))
        last = [one for one in inside if _DEEPER.fullmatch(PurePosixPath(one).name)]
        folders = folders + last
    return sorted(folders)


def find_annotations(
    folder: DriveFolder, notes: ReadingNotes, hints: Hints = NO_HINTS
) -> list[AnnotationFile]:
    """Read every annotation file of the drive folder and of `annotation_folders`.

    Raises
    ------
    DriveError
        If one in the drive folder itself is damaged.
    """
    files = _read_files(folder, "", notes, hints)
    archives = folder.names(*_ARCHIVES)
    for name in annotation_folders(folder):
        files += _read_files(folder, f"{name}/", notes, hints)
        archives += folder.names_in(name, *_ARCHIVES)
    notes.warn(
        DriveDoubt.ANNOTATIONS,
        *(f"{name} is an archive, which is not read: {_UNPACK}." for name in archives),
    )
    tools = {file.tool for file in files}
    if len(tools) > 1:
        listed = ", ".join(f"{file.where} ({file.tool})" for file in files)
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"The annotations come from more than one tool, and all are read: {listed}. If they show the same"
            f" signs, name those that count under [annotations] in {SETTINGS_FILE}.",
        )
    return files


def named_annotations(
    folder: DriveFolder, names: Sequence[str], notes: ReadingNotes, hints: Hints = NO_HINTS
) -> list[AnnotationFile]:
    """Read the annotation files, or folders of them, that ``drive.toml`` names for one camera.

    Raises
    ------
    DriveError
        If one is absent, damaged, or holds no annotations that twin knows.
    """
    files: list[AnnotationFile] = []
    for name in names:
        if folder.is_folder(name):
            inside = "" if name in {".", "./"} else name.rstrip("/") + "/"
            read = _read_files(folder, inside, notes, hints, is_named=True)
        elif name.lower().endswith(_ARCHIVES) and folder.has(name):
            raise DriveError(f"{name} is an archive: {_UNPACK}, and name what comes out of it.")
        else:
            classes = _classes(folder, name) or YoloClasses({})
            file = _read_file(folder, name, replace(hints, classes=classes), is_named=True)
            read = [] if file is None else [file]
        if not read:
            raise DriveError(
                f"{name} holds no annotations that twin reads: export them as {NAMES}, or correct"
                f" [annotations] in {SETTINGS_FILE}."
            )
        files += read
    return _together(files, "./")


def _together(files: Sequence[AnnotationFile], where: str) -> list[AnnotationFile]:
    """Bring files of one image each together, by tool."""
    images: dict[str, list[AnnotationFile]] = {}
    for file in files:
        if file.tool in ONE_IMAGE:
            images.setdefault(file.tool, []).append(file)
    exports = [file for file in files if file.tool not in ONE_IMAGE]
    return exports + [merged(of_tool, where) for _, of_tool in sorted(images.items())]


def _read_files(
    folder: DriveFolder, inside: str, notes: ReadingNotes, hints: Hints, *, is_named: bool = False
) -> list[AnnotationFile]:
    """Read the annotations directly in one folder; files of one image each are brought together by tool."""
    names = folder.names_in(inside, *SUFFIXES) if inside else folder.names(*SUFFIXES)
    is_txt = any(name.lower().endswith(".txt") for name in names)
    classes = _classes(folder, inside) if is_txt else None
    if classes is None and is_named:
        classes = YoloClasses({})
    hints = replace(hints, classes=classes)
    files: list[AnnotationFile] = []
    damaged: list[str] = []
    unread: list[str] = []
    for name in names:
        try:
            file = _read_file(folder, name, hints)
        except DriveError as error:
            if not inside:
                raise
            damaged.append(str(error))
            continue
        if file is not None:
            files.append(file)
        elif inside and name.lower().endswith(XML):
            unread += [name] if root_tag(folder.head(name)).startswith("annotation") else []
        elif name.lower().endswith(XML):
            root = root_tag(folder.head(name))
            what = f"no export of annotations (it begins with <{root:.40}>)" if root else "empty or no XML"
            notes.warn(DriveDoubt.ANNOTATIONS, f"{name} is {what}, so it is not read: export it again.")
    contents = {b"", b"{}", b"[]"} if any(file.tool in ONE_IMAGE for file in files) else {b""}
    _tell_of_empty([name for name in names if _is_json_of(folder, name, contents)], inside, notes)
    if unread:
        kinds = f"{unread[0]} and {len(unread) - 1:,} more" if len(unread) > 1 else unread[0]
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"{kinds}: annotations of a kind that is not read (such as Pascal VOC): export them as {NAMES}.",
        )
    if damaged:
        notes.skipped.append(skipped_annotations(SkipKind.DAMAGED_FILE, inside, len(damaged)))
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"{len(damaged)} of the files in {inside} are left out, as damaged: {damaged[0]}",
        )
    return _together(files, inside or "./")


def _read_file(
    folder: DriveFolder, name: str, hints: Hints, *, is_named: bool = False
) -> AnnotationFile | None:
    """Read one file; None if it is none of the formats. Without names of classes YOLO is not expected."""
    try:
        head = folder.head(name) if folder.has(name) else b""
    except DriveError:
        if is_named or name.lower().endswith(XML):
            raise
        return None  # a link that leads out of the folder: of interest only if it is asked for
    suffix = suffix_of(name, head)
    if suffix == JSON:
        if not is_named and not MAY_ANNOTATE.search(head):
            return None
        content = folder.peek(name)
        file = read_annotation_json(content, name, hints)
        if file is not None:
            folder.enter(name, content)
        return file
    its = format_of(suffix, head)
    if its is not None and its.tool == yolo.TOOL and (hints.classes is None or not _is_labels(name)):
        its = None
    if its is None and is_named:  # refused by its reader, who says what is wrong
        its = _OF_NAMED_CSV if suffix == ".csv" else _OF_OTHER_NAMED
    return None if its is None else its.read(folder.content(name), name, hints)


def _tell_of_empty(empty: Sequence[str], inside: str, notes: ReadingNotes) -> None:
    """Warn of files that hold nothing, as tools leave them that were stopped while they saved."""
    if not empty:
        return
    more = f" and {len(empty) - _MOST_NAMES} more" if len(empty) > _MOST_NAMES else ""
    are, they_mark, them = ("is", "it marks", "it") if len(empty) == 1 else ("are", "they mark", "them")
    notes.skipped.append(skipped_annotations(SkipKind.EMPTY_FILE, inside or "./", len(empty)))
    notes.warn(
        DriveDoubt.ANNOTATIONS,
        f"{', '.join(empty[:_MOST_NAMES])}{more} {are} empty, so {they_mark} nothing: save {them} again with"
        f" the annotation tool, or delete {them}.",
    )


def _is_json_of(folder: DriveFolder, name: str, contents: Collection[bytes]) -> bool:
    if not name.lower().endswith(".json"):
        return False
    try:
        return folder.head(name, _EMPTY_BYTES).strip() in contents
    except DriveError:
        return False  # a link that leads out of the folder


def nearly_annotations(folder: DriveFolder) -> list[str]:
    """Say of tables and folders of a drive without annotations why they are none, a clause each."""
    said = []
    for inside in ("", *(f"{name}/" for name in annotation_folders(folder))):
        names = folder.names_in(inside, ".csv", ".txt") if inside else folder.names(".csv", ".txt")
        heads = [(name, _head(folder, name)) for name in names]
        said += [f"{name} {why}" for name, head in heads if (why := lacking(head))]
        rows = [
            n for n, head in heads if n.lower().endswith(".txt") and head.strip() and looks_like_yolo(head)
        ]
        rows = [name for name in rows if _is_labels(name)]
        if rows and _classes(folder, inside) is None:
            said.append(
                f"{rows[0]} looks like YOLO, but no data.yaml, obj.names or classes.txt names its classes:"
                f" add it, or name {inside or rows[0]} under [annotations] in {SETTINGS_FILE}"
            )
    return said[:_MOST_NAMES]


def _head(folder: DriveFolder, name: str) -> bytes:
    try:
        return folder.head(name)
    except DriveError:
        return b""  # a link that leads out of the folder


def _is_labels(name: str) -> bool:
    return not name.lower().endswith(NAME_FILES)


def _classes(folder: DriveFolder, inside: str) -> YoloClasses | None:
    """Names of the YOLO classes, from the folder of the labels, those above it, or the drive folder."""
    place = PurePosixPath(inside)
    for above in (place, *place.parents):
        prefix = "" if str(above) == "." else f"{above}/"
        if prefix and not folder.is_folder(prefix):
            continue
        for name in _name_files(folder, prefix):
            return read_yolo_classes(folder.content(name), name)
    return None


def _name_files(folder: DriveFolder, prefix: str) -> list[str]:
    """Files that name classes; YAML only if it says ``names:``, since calibrations are YAML as well."""

    def names_classes(name: str) -> bool:
        is_yaml = name.lower().endswith((".yaml", ".yml"))
        return not is_yaml or re.search(rb"(?m)^names\s*:", folder.head(name)) is not None

    names = folder.names_in(prefix, *NAME_FILES) if prefix else folder.names(*NAME_FILES)
    # data.yaml also knows the key points.
    return sorted(filter(names_classes, names), key=lambda name: not name.lower().endswith((".yaml", ".yml")))
