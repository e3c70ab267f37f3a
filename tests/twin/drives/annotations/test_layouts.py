"""Where tools put their files when an export is unpacked."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.drives.annotations.find import find_annotations
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes

BOX = "0 0.5 0.5 0.1 0.1\n"
CLASSES = "names:\n  0: '202'\n"


def write(folder: Path, files: dict[str, str]) -> None:
    """Write files in folders."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.mark.parametrize("above", ["", "front/", "export/annotations/"])
@pytest.mark.parametrize("inside", ["labels/train/", "labels/", "obj_train_data/", "train/labels/"])
def test_export_is_found_where_its_tool_puts_it(above: str, inside: str, tmp_path: Path) -> None:
    """At the top of the drive folder, in a camera's folder or deeper; the classes stand beside or above."""
    files = {f"{above}{inside}12.txt": BOX, f"{above}labels/val/13.txt": BOX, f"{above}data.yaml": CLASSES}
    write(tmp_path, files)
    notes = ReadingNotes()
    found = find_annotations(DriveFolder(tmp_path), notes)
    assert sorted(shape.image for file in found for shape in file.shapes) == sorted([*files][:2])
    assert {shape.label for file in found for shape in file.shapes} == {"202"}
    assert notes.warnings == []


def test_annotations_of_a_kind_that_is_not_read_are_told(tmp_path: Path) -> None:
    """Pascal VOC in a folder of its own, beside what is read."""
    voc = "<annotation><object><name>202</name><bndbox><xmin>1</xmin></bndbox></object></annotation>"
    write(tmp_path, {f"Annotations/{k}.xml": voc for k in range(3)} | {"Annotations/note.xml": "<project/>"})
    notes = ReadingNotes()
    assert find_annotations(DriveFolder(tmp_path), notes) == []
    (said,) = notes.warnings
    assert str(said).startswith("Annotations/0.xml and 2 more: annotations of a kind that is not read")
