"""Which files of a drive folder are annotations, and of which tool: found by content.

Tools that write one file for each image (labelme, LabelMe, YOLO, Mapillary Vistas) fill a folder: the drive
folder itself, a folder in it, or one that ``drive.toml`` names. Such a folder counts as one export.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from pathlib import PurePosixPath

from twin.drives.annotations.formats.coco import looks_like_coco, read_coco
from twin.drives.annotations.formats.cvat import is_cvat, read_cvat, root_tag
from twin.drives.annotations.formats.datumaro import looks_like_datumaro, read_datumaro
from twin.drives.annotations.formats.json_values import parse_json
from twin.drives.annotations.formats.labelme import looks_like_labelme, read_labelme
from twin.drives.annotations.formats.labelme_xml import looks_like_labelme_xml, read_labelme_xml
from twin.drives.annotations.formats.labelstudio import looks_like_labelstudio, read_labelstudio
from twin.drives.annotations.formats.plain_csv import (
    lacking,
    looks_like_annotations_csv,
    read_annotations_csv,
)
from twin.drives.annotations.formats.shapes import AnnotationFile, merged
from twin.drives.annotations.formats.vistas import looks_like_vistas, read_vistas
from twin.drives.annotations.formats.yolo import (
    NAME_FILES,
    YoloClasses,
    looks_like_yolo,
    read_yolo,
    read_yolo_classes,
)
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import DriveDoubt, ReadingNotes, SkipKind, skipped_annotations
from twin.errors import DriveError

FORMATS = "CVAT XML 1.1, COCO, Label Studio, labelme, YOLO, Datumaro, Mapillary Vistas or CSV"
_SUFFIXES = (".xml", ".json", ".csv", ".txt")
_ANNOTATING = re.compile(
    rb'"(?:shapes|imageData|imagePath|images|annotations|categories|items|completions|objects|result)"\s*:'
)
_ARCHIVES = (".zip", ".7z", ".rar", ".tar", ".tar.gz", ".tgz")
_UNPACK = "if it holds annotations of this drive, unpack it in the drive folder"
_EMPTY_BYTES = 64
_MOST_NAMES = 5
_DEEPER = ("annotations", "labels")
LARGEST_JSON_BYTES = 200_000_000
"""JSON takes some ten times its size in memory: a million boxes stay below this."""


def read_annotation_json(content: bytes, where: str, feet: Collection[str] = ()) -> AnnotationFile | None:
    """Read a JSON export of whichever tool wrote it; None if it is none that twin knows.

    Raises
    ------
    DriveError
        If it is larger than an export may be, or is not JSON.
    """
    if len(content) > LARGEST_JSON_BYTES:
        raise DriveError(
            f"{where} is {len(content) / 1e6:.0f} MB, more than the {LARGEST_JSON_BYTES / 1e6:.0f} MB that a"
            " JSON of annotations may have: export it in parts."
        )
    document = parse_json(content, where)
    readers: tuple[tuple[Callable[[object], bool], Callable[[], AnnotationFile]], ...] = (
        (looks_like_labelme, lambda: read_labelme(document, where)),
        (looks_like_coco, lambda: read_coco(document, where, feet)),
        (looks_like_datumaro, lambda: read_datumaro(document, where, feet)),
        (looks_like_labelstudio, lambda: read_labelstudio(document, where)),
        (looks_like_vistas, lambda: read_vistas(document, where)),
    )
    return next((read() for looks_like, read in readers if looks_like(document)), None)


def annotation_folders(folder: DriveFolder) -> list[str]:
    """Folders that are searched: those in the drive folder, and what they call annotations or labels.

    So tools lay out their exports: Datumaro's and COCO's are ``annotations/default.json``.
    """
    found = []
    for name in folder.folders():
        deeper = folder.folders(name)
        found += [name, *(one for one in deeper if PurePosixPath(one).name.lower() in _DEEPER)]
    return found


def find_annotations(
    folder: DriveFolder, notes: ReadingNotes, feet: Collection[str] = ()
) -> list[AnnotationFile]:
    """Read every annotation file of the drive folder and of `annotation_folders`.

    Raises
    ------
    DriveError
        If one in the drive folder itself is damaged.
    """
    found = _read_files(folder, "", notes, feet)
    archives = folder.names(*_ARCHIVES)
    for name in annotation_folders(folder):
        found += _read_files(folder, f"{name}/", notes, feet)
        archives += folder.names_in(name, *_ARCHIVES)
    notes.warn(
        DriveDoubt.ANNOTATIONS,
        *(f"{name} is an archive, which is not read: {_UNPACK}." for name in archives),
    )
    tools = {file.tool for file in found}
    if len(tools) > 1:
        listed = ", ".join(f"{file.where} ({file.tool})" for file in found)
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"The annotations come from more than one tool, and all are read: {listed}. If they show the same"
            f" signs, name those that count under [annotations] in {SETTINGS_FILE}.",
        )
    return found


def named_annotations(
    folder: DriveFolder, names: Sequence[str], notes: ReadingNotes, feet: Collection[str] = ()
) -> list[AnnotationFile]:
    """Read the annotation files, or folders of them, that ``drive.toml`` names for one camera.

    Raises
    ------
    DriveError
        If one is absent, damaged, or holds no annotations that twin knows.
    """
    found: list[AnnotationFile] = []
    for name in names:
        if folder.is_folder(name):
            inside = "" if name in {".", "./"} else name.rstrip("/") + "/"
            files = _read_files(folder, inside, notes, feet, is_named=True)
        elif name.lower().endswith(_ARCHIVES) and folder.has(name):
            raise DriveError(f"{name} is an archive: {_UNPACK}, and name what comes out of it.")
        else:
            one = _read_file(folder, name, _classes(folder, name) or YoloClasses({}), feet, is_named=True)
            files = [] if one is None else [one]
        if not files:
            raise DriveError(
                f"{name} holds no annotations that twin reads: export them as {FORMATS}, or correct"
                f" [annotations] in {SETTINGS_FILE}."
            )
        found += files
    return _together(found, "./")


def _together(files: Sequence[AnnotationFile], where: str) -> list[AnnotationFile]:
    """Bring files of one image each together, by tool."""
    images: dict[str, list[AnnotationFile]] = {}
    for file in files:
        if file.is_one_image:
            images.setdefault(file.tool, []).append(file)
    whole = [file for file in files if not file.is_one_image]
    return whole + [merged(of_tool, where) for _, of_tool in sorted(images.items())]


def _read_files(
    folder: DriveFolder, inside: str, notes: ReadingNotes, feet: Collection[str], *, is_named: bool = False
) -> list[AnnotationFile]:
    """Read the annotations directly in one folder; files of one image each are brought together by tool."""
    names = folder.names_in(inside, *_SUFFIXES) if inside else folder.names(*_SUFFIXES)
    is_txt = any(name.lower().endswith(".txt") for name in names)
    classes = _classes(folder, inside) if is_txt else None
    if classes is None and is_named:
        classes = YoloClasses({})
    found: list[AnnotationFile] = []
    damaged: list[str] = []
    for name in names:
        try:
            file = _read_file(folder, name, classes, feet)
        except DriveError as error:
            if not inside:
                raise
            damaged.append(str(error))
            continue
        if file is not None:
            found.append(file)
        elif not inside and name.lower().endswith(".xml"):
            root = root_tag(folder.head(name))
            what = f"no export of annotations (it begins with <{root:.40}>)" if root else "empty or no XML"
            notes.warn(DriveDoubt.ANNOTATIONS, f"{name} is {what}, so it is not read: export it again.")
    contents = {b"", b"{}", b"[]"} if any(file.is_one_image for file in found) else {b""}
    _tell_of_empty([name for name in names if _is_json_of(folder, name, contents)], inside, notes)
    if damaged:
        notes.skipped.append(skipped_annotations(SkipKind.DAMAGED_FILE, inside, len(damaged)))
        notes.warn(
            DriveDoubt.ANNOTATIONS,
            f"{len(damaged)} of the files in {inside} are left out, as damaged: {damaged[0]}",
        )
    return _together(found, inside or "./")


def _read_file(
    folder: DriveFolder,
    name: str,
    classes: YoloClasses | None,
    feet: Collection[str],
    *,
    is_named: bool = False,
) -> AnnotationFile | None:
    """Read one file; None if it is none of the formats. `classes` is None where YOLO is not expected."""
    suffix = PurePosixPath(name).suffix.lower()
    try:
        head = folder.head(name) if folder.has(name) else b""
    except DriveError:
        if is_named or suffix == ".xml":
            raise
        return None  # a link that leads out of the folder: of interest only if it is asked for
    reader: Callable[[bytes], AnnotationFile | None] | None = None
    if suffix == ".json" and (is_named or _ANNOTATING.search(head)):
        document = read_annotation_json(folder.peek(name), name, feet)
        reader = None if document is None else (lambda _content: document)
    elif suffix == ".csv" and (is_named or looks_like_annotations_csv(head)):
        reader = lambda content: read_annotations_csv(content, name)  # noqa: E731
    elif suffix == ".txt" and classes is not None and _is_labels(name) and looks_like_yolo(head):
        reader = lambda content: read_yolo(content, name, classes, feet)  # noqa: E731
    elif looks_like_labelme_xml(head):
        reader = lambda content: read_labelme_xml(content, name)  # noqa: E731
    elif is_named or (suffix == ".xml" and is_cvat(head)):
        reader = lambda content: read_cvat(content, name, feet)  # noqa: E731
    return None if reader is None else reader(folder.content(name))


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
