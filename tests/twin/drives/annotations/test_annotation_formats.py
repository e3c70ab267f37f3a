"""One contract for every annotation format: the same marks, written by each tool, are the same."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np
import pytest
from checkout import ROOT

from geoloc.rig.rig import Rig, rig_from_document
from twin.drives.annotations import formats
from twin.drives.annotations.find import find_annotations, named_annotations
from twin.drives.annotations.formats.table import FORMATS
from twin.drives.annotations.gather import AnnotationsRead, gather
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.inspection.recognise import kind_of
from twin.errors import DriveError

WIDTH, HEIGHT = 1280, 800


@dataclass(frozen=True)
class Mark:
    """A foot (width 0) or a face: corner, width and height in pixels from the image's corner."""

    frame: int
    label: str
    x: float
    y: float
    width: float = 0.0
    height: float = 0.0
    track: int = 0


FEET = [Mark(12, "202", 700.0, 500.0, track=3), Mark(13, "regulatory--stop--g1", 640.0, 520.0, track=4)]
FACES = [
    Mark(12, "202", 320.0, 80.0, 64.0, 40.0, track=5),
    Mark(40, "362.50 Fartsgrense", 640.0, 200.0, 32.0, 40.0, track=6),
]
Files = dict[str, str]


def image_of(frame: int) -> str:
    """Name of a picture."""
    return f"drive_000{frame:03d}.png"


def grouped(marks: list[Mark]) -> dict[int, list[Mark]]:
    """Frame → its marks."""
    return {frame: [m for m in marks if m.frame == frame] for frame in sorted({m.frame for m in marks})}


def box(mark: Mark) -> list[float]:
    """``[x, y, width, height]``."""
    return [mark.x, mark.y, mark.width, mark.height]


def cvat(marks: list[Mark]) -> Files:
    """An image task."""
    images = []
    for frame, of_image in grouped(marks).items():
        shapes = "".join(
            f'<box label="{m.label}" xtl="{m.x}" ytl="{m.y}" xbr="{m.x + m.width}" ybr="{m.y + m.height}">'
            f'<attribute name="track_id">{m.track}</attribute></box>'
            if m.width
            else f'<points label="{m.label}" points="{m.x},{m.y}">'
            f'<attribute name="track_id">{m.track}</attribute></points>'
            for m in of_image
        )
        size = f'width="{WIDTH}" height="{HEIGHT}"'
        images.append(f'<image id="0" name="{image_of(frame)}" {size}>{shapes}</image>')
    return {"a.xml": f"<annotations><version>1.1</version>{''.join(images)}</annotations>"}


def coco(marks: list[Mark]) -> Files:
    """Boxes, and feet as the keypoint ``foot`` between two others."""
    labels = sorted({m.label for m in marks})
    annotations = []
    for number, m in enumerate(marks):
        one: dict[str, Any] = {"id": number, "image_id": m.frame, "category_id": labels.index(m.label) + 1}
        # The box of an object with keypoints is that of sign and pole: it is no face.
        one["bbox"] = box(m) if m.width else [m.x - 20, m.y - 300, 40, 300]
        if not m.width:
            one["keypoints"] = [m.x, m.y - 300, 2, m.x, m.y, 2, 0, 0, 0]
        annotations.append(one | {"iscrowd": 0, "attributes": {"track_id": m.track}})
    images = [
        {"id": frame, "file_name": f"pictures/{image_of(frame)}", "width": WIDTH, "height": HEIGHT}
        for frame in grouped(marks)
    ]
    categories = [
        {"id": k + 1, "name": label, "keypoints": ["top", "foot", "lamp"]} for k, label in enumerate(labels)
    ]
    document = {"images": images, "annotations": annotations, "categories": categories}
    return {"instances.json": json.dumps(document)}


def labelstudio(marks: list[Mark]) -> Files:
    """Percent; one result for each shape, and one for its attribute."""
    tasks = []
    for frame, of_image in grouped(marks).items():
        results = []
        for number, m in enumerate(of_image):
            kind = "rectanglelabels" if m.width else "keypointlabels"
            value: dict[str, Any] = {"x": m.x / WIDTH * 100, "y": m.y / HEIGHT * 100, kind: [m.label]}
            value |= {"width": m.width / WIDTH * 100 if m.width else 0.3}
            value |= {"height": m.height / HEIGHT * 100, "rotation": 0} if m.width else {}
            size = {"original_width": WIDTH, "original_height": HEIGHT, "image_rotation": 0}
            results.append({"id": f"r{number}", "type": kind, "value": value, "from_name": "label"} | size)
            track = {
                "id": f"r{number}",
                "type": "number",
                "from_name": "track_id",
                "value": {"number": m.track},
            }
            results.append(track)
        data = {"image": f"/data/local-files/?d=pictures/{image_of(frame)}"}
        tasks.append({"id": 900 + frame, "data": data, "annotations": [{"result": results}]})
    return {"project-1.json": json.dumps(tasks)}


def labelme(marks: list[Mark]) -> Files:
    """One file for each image; rectangles by two corners in any order."""
    files = {}
    for frame, of_image in grouped(marks).items():
        shapes = [
            {
                "label": m.label,
                "points": [[m.x + m.width, m.y], [m.x, m.y + m.height]] if m.width else [[m.x, m.y]],
                "shape_type": "rectangle" if m.width else "point",
                "group_id": m.track,
                "flags": {},
            }
            for m in of_image
        ]
        document = {"version": "5.5.0", "imageData": "AAAA" * 40_000, "imagePath": image_of(frame)}
        document |= {"imageHeight": HEIGHT, "imageWidth": WIDTH, "shapes": shapes}
        files[f"labels/{image_of(frame)[:-4]}.json"] = json.dumps(document)
    return files


def yolo(marks: list[Mark]) -> Files:
    """Fractions: tracked boxes, or poses of three points, the second of which is the foot."""
    labels = sorted({m.label for m in marks})
    files = {}
    for frame, of_image in grouped(marks).items():
        rows = []
        for m in of_image:
            number, x, y = labels.index(m.label), m.x / WIDTH, m.y / HEIGHT
            if m.width:
                w, h = m.width / WIDTH, m.height / HEIGHT
                rows.append(f"{number} {x + w / 2:.9f} {y + h / 2:.9f} {w:.9f} {h:.9f} {m.track}")
            else:
                rows.append(f"{number} {x} {y - 0.2} 0.05 0.4 {x} {y - 0.3} 2 {x} {y} 2 0 0 0")
        files[f"labels/{image_of(frame)[:-4]}.txt"] = "\n".join(rows)
    shape = "" if marks[0].width else "kpt_shape: [3, 3]\nkpt_names: {0: [top, foot, lamp]}\n"
    names = "".join(f"  {k}: {label}\n" for k, label in enumerate(labels))
    return files | {"labels/data.yaml": f"{shape}names:\n{names}", "labels/000099.txt": ""}


def datumaro(marks: list[Mark]) -> Files:
    """Boxes and single points."""
    labels = sorted({m.label for m in marks})
    items = []
    for frame, of_image in grouped(marks).items():
        annotations = [
            {"type": "bbox", "bbox": box(m)} if m.width else {"type": "points", "points": [m.x, m.y]}
            for m in of_image
        ]
        for annotation, m in zip(annotations, of_image, strict=True):
            annotation |= {"label_id": labels.index(m.label), "attributes": {"track_id": m.track}}
        image = {"path": image_of(frame), "size": [HEIGHT, WIDTH]}
        items.append({"id": str(frame), "annotations": annotations, "image": image})
    categories = {"label": {"labels": [{"name": label} for label in labels]}}
    return {"default.json": json.dumps({"info": {}, "categories": categories, "items": items})}


def plain_csv(marks: list[Mark]) -> Files:
    """One row a mark."""
    rows = ["frame,track,label,x_px,y_px,left_px,top_px,right_px,bottom_px"]
    for m in marks:
        foot = ",," if m.width else f"{m.x},{m.y},"
        edges = f"{m.x},{m.y},{m.x + m.width},{m.y + m.height}" if m.width else ",,,"
        rows.append(f"{m.frame},{m.track},{m.label},{foot}{edges}")
    return {"signs.csv": "\n".join(rows) + "\n"}


def frame_lines(marks: list[Mark]) -> Files:
    """One line a frame, one of them without anything."""
    lines: list[dict[str, Any]] = [{"camera": "front", "frame": 99, "time_ns": 1}]
    for frame, of_image in grouped(marks).items():
        found = [
            {"label": m.label, "track": m.track}
            | ({"box": [m.x, m.y, m.x + m.width, m.y + m.height]} if m.width else {"foot": [m.x, m.y]})
            for m in of_image
        ]
        lines.append({"camera": "front", "frame": frame, "stamp_ns": 1, "detections": found})
    return {"found.jsonl": "".join(json.dumps(line) + "\n" for line in lines)}


def vistas(marks: list[Mark]) -> Files:
    """Polygons, as lists of corners; no tracks."""
    files = {}
    for frame, of_image in grouped(marks).items():
        things = []
        for m in of_image:
            right, bottom = m.x + m.width, m.y + m.height
            corners = [[m.x, m.y], [right, m.y], [right, bottom], [m.x, bottom]]
            things.append({"id": 0, "label": m.label, "polygon": corners})
        document = {"height": HEIGHT, "width": WIDTH, "objects": things}
        files[f"labels/{image_of(frame)[:-4]}.json"] = json.dumps(document)
    return files


def labelme_web(marks: list[Mark]) -> Files:
    """XML for each image; polygons, and one that was deleted."""
    files = {}
    for frame, of_image in grouped(marks).items():
        things = "<object><name>gone</name><deleted>1</deleted></object>"
        for m in of_image:
            right, bottom = m.x + m.width, m.y + m.height
            corners = [(m.x, m.y), (right, m.y), (right, bottom), (m.x, bottom)]
            points = "".join(f"<pt><x>{x}</x><y>{y}</y></pt>" for x, y in corners)
            things += f"<object><name>{m.label}</name><polygon>{points}</polygon></object>"
        size = f"<imagesize><nrows>{HEIGHT}</nrows><ncols>{WIDTH}</ncols></imagesize>"
        text = f"<annotation><filename>{image_of(frame)}</filename>{size}{things}</annotation>"
        files[f"labels/{image_of(frame)[:-4]}.xml"] = text
    return files


Writer = Callable[[list[Mark]], Files]
WITH_POINTS: list[Writer] = [cvat, coco, labelstudio, labelme, yolo, datumaro, plain_csv, frame_lines]
EVERY: list[Writer] = [*WITH_POINTS, vistas, labelme_web]


@pytest.fixture
def rig(maker: Any) -> Rig:
    """A car with one camera."""
    return rig_from_document(maker.rig(maker.camera("front")), "car.json")


def read(folder: Path, files: Files, rig: Rig, name: str | None = None) -> AnnotationsRead:
    """Write the files and read what is found there, or what `name` names."""
    for file, text in files.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    drive, notes = DriveFolder(folder), ReadingNotes()
    found = named_annotations(drive, [name], notes) if name else find_annotations(drive, notes)
    assert notes.warnings == []
    return gather([(file, None) for file in found], rig)


@pytest.mark.parametrize("writer", EVERY, ids=lambda writer: writer.__name__)
def test_faces_of_every_tool_are_the_same_boxes(writer: Writer, tmp_path: Path, rig: Rig) -> None:
    """Frame, label, sign code, middle and edges, from the centre of the first pixel, are equal."""
    notes = read(tmp_path, writer(FACES), rig).annotations
    assert notes.frame.tolist() == [12, 40]
    assert notes.kind.tolist() == ["box", "box"]
    assert notes.label.tolist() == [m.label for m in FACES]
    assert notes.skiltnummer.tolist() == ["202", "362.50"]
    np.testing.assert_allclose(notes.pixel_px, [(351.5, 99.5), (655.5, 219.5)], atol=1e-5)
    edges = [(319.5, 79.5, 383.5, 119.5), (639.5, 199.5, 671.5, 239.5)]
    np.testing.assert_allclose(notes.box_px, edges, atol=1e-5)


@pytest.mark.parametrize("writer", WITH_POINTS, ids=lambda writer: writer.__name__)
def test_feet_of_every_tool_are_the_same_points(writer: Writer, tmp_path: Path, rig: Rig) -> None:
    """A point, or the keypoint called foot; a Mapillary name gets its Norwegian code."""
    notes = read(tmp_path, writer(FEET), rig).annotations
    assert notes.frame.tolist() == [12, 13]
    assert notes.kind.tolist() == ["foot", "foot"]
    assert notes.skiltnummer.tolist() == ["202", "204"]
    np.testing.assert_allclose(notes.pixel_px, [(699.5, 499.5), (639.5, 519.5)], atol=1e-5)
    assert np.isnan(notes.box_px).all()


@pytest.mark.parametrize("writer", EVERY, ids=lambda writer: writer.__name__)
def test_track_ids_of_every_tool_are_kept(writer: Writer, tmp_path: Path, rig: Rig) -> None:
    """They are the object, in files of one image each too; without them a shape stands alone."""
    notes = read(tmp_path, writer(FACES), rig).annotations
    if writer in {vistas, labelme_web}:
        assert notes.object.tolist() == ["f12.1", "f40.1"]
        assert not notes.has_id.any()
    else:
        assert notes.object.tolist() == ["5", "6"]
        assert notes.has_id.all()


@pytest.mark.parametrize("writer", EVERY, ids=lambda writer: writer.__name__)
def test_folder_or_file_that_drive_toml_names_is_read(writer: Writer, tmp_path: Path, rig: Rig) -> None:
    """A folder is named with or without its slash."""
    files = writer(FACES)
    first = next(iter(files))
    names = ["labels", "labels/"] if first.startswith("labels/") else [first]
    for name in names:
        assert len(read(tmp_path, files, rig, name).annotations.frame) == 2


@pytest.mark.parametrize("is_named", [False, True], ids=["found", "named"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize("suffix", [".txt", ".csv", ".json"])
@pytest.mark.parametrize("writer", [cvat, labelme_web], ids=lambda writer: writer.__name__)
def test_xml_is_recognised_whatever_it_is_called(
    writer: Writer, suffix: str, encoding: str, is_named: bool, tmp_path: Path, rig: Rig
) -> None:
    """By its content, as every other kind of file."""
    for name, text in writer(FACES).items():
        (tmp_path / Path(name).with_suffix(suffix).name).write_text(text, encoding=encoding)
    names = [path.name for path in tmp_path.iterdir()]
    drive, notes = DriveFolder(tmp_path), ReadingNotes()
    files = named_annotations(drive, names, notes) if is_named else find_annotations(drive, notes)
    assert notes.warnings == []
    assert len(gather([(file, None) for file in files], rig).annotations.frame) == 2
    tool = "CVAT XML 1.1" if writer is cvat else "LabelMe XML"
    assert {kind_of(drive, name) for name in names} == {f"annotations, {tool}"}


def test_text_that_speaks_of_xml_is_no_export(tmp_path: Path) -> None:
    """Only what begins as XML is."""
    (tmp_path / "readme.txt").write_text("The signs are in <annotations> of the old export.\n")
    assert find_annotations(DriveFolder(tmp_path), ReadingNotes()) == []


def test_files_of_one_image_that_drive_toml_lists_are_one_export(tmp_path: Path, rig: Rig) -> None:
    """A track that two of them have is one object."""
    marks = [
        Mark(12, "202", 320.0, 80.0, 64.0, 40.0, track=5),
        Mark(40, "202", 640.0, 200.0, 32.0, 40.0, track=5),
    ]
    files = labelme(marks)
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = named_annotations(DriveFolder(tmp_path), list(files), ReadingNotes())
    assert gather([(file, "front") for file in found], rig).annotations.object.tolist() == ["5", "5"]


def test_named_file_that_holds_no_annotations_is_refused(tmp_path: Path) -> None:
    """JSON of another kind and an empty folder: the sentence lists the formats."""
    (tmp_path / "other.json").write_text('{"a": 1}')
    (tmp_path / "empty").mkdir()
    for name in ("other.json", "empty/"):
        with pytest.raises(DriveError, match=rf"{name} holds no annotations .*COCO, Label Studio"):
            named_annotations(DriveFolder(tmp_path), [name], ReadingNotes())


def test_damaged_file_in_a_folder_is_counted_and_named(tmp_path: Path) -> None:
    """One of two labelme files is cut: the other is read, and a warning says which was left out."""
    (tmp_path / "labels").mkdir()
    for name, text in labelme(FACES).items():
        (tmp_path / name).write_text(text[:-40] if "040" in name else text)
    notes = ReadingNotes()
    (file,) = find_annotations(DriveFolder(tmp_path), notes)
    assert len(file.shapes) == 1
    assert [(s.what, s.count) for s in notes.skipped] == [("annotation files", 1)]
    assert "drive_000040.json is not JSON" in notes.warnings[0].sentence


def test_damaged_export_in_the_drive_folder_is_refused(tmp_path: Path) -> None:
    """A COCO file that was cut is not passed over."""
    (tmp_path / "a.json").write_text(coco(FACES)["instances.json"][:-5])
    with pytest.raises(DriveError, match=r"a\.json is not JSON"):
        find_annotations(DriveFolder(tmp_path), ReadingNotes())


def test_exports_of_two_tools_are_said(tmp_path: Path) -> None:
    """The same signs twice would be one pole seen as two: the warning names both files."""
    for name, text in (coco(FACES) | cvat(FACES)).items():
        (tmp_path / name).write_text(text)
    notes = ReadingNotes()
    assert len(find_annotations(DriveFolder(tmp_path), notes)) == 2
    assert "a.xml (CVAT), instances.json (COCO)" in notes.warnings[0].sentence


def test_files_of_other_kinds_are_no_annotations(tmp_path: Path, maker: Any) -> None:
    """Rig, poses, frame times, a text of numbers without class names and other JSON stay what they are."""
    (tmp_path / "rig.json").write_text(json.dumps(maker.rig()))
    (tmp_path / "list.json").write_text('{"images": 3, "annotations": null}')
    (tmp_path / "poses.csv").write_text("time_ns,latitude_deg\n1,2\n")
    (tmp_path / "frames.csv").write_text("frame,time_ns\n1,2\n")
    (tmp_path / "numbers.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    assert find_annotations(DriveFolder(tmp_path), ReadingNotes()) == []


def test_links_out_of_the_folder_are_not_followed(tmp_path: Path) -> None:
    """Neither a linked folder nor a linked file is looked into; named in drive.toml, it is refused."""
    drive, outside = tmp_path / "drive", tmp_path / "outside"
    for name, text in labelme(FACES).items():
        (outside / name).parent.mkdir(parents=True, exist_ok=True)
        (outside / name).write_text(text)
    drive.mkdir()
    (drive / "labels").symlink_to(outside / "labels", target_is_directory=True)
    (drive / "one.json").symlink_to(next((outside / "labels").iterdir()))
    notes = ReadingNotes()
    assert find_annotations(DriveFolder(drive), notes) == []
    for name in ("labels/", "one.json", "../outside/labels"):
        with pytest.raises(DriveError, match="lies outside the drive folder"):
            named_annotations(DriveFolder(drive), [name], notes)


def test_documented_csv_is_read(tmp_path: Path, rig: Rig) -> None:
    """The page's example is a foot and a face of one sign."""
    page = ROOT / "docs" / "drive-folder.md"
    if not page.exists():
        pytest.skip("docs are not beside the tests")
    (example,) = re.findall(r"```\n(frame,label.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    notes = read(tmp_path, {"signs.csv": example}, rig).annotations
    assert notes.kind.tolist() == ["foot", "box"]
    assert notes.skiltnummer.tolist() == ["362.50", "362.50"]


def test_every_module_of_a_format_stands_in_the_table() -> None:
    """A reader that nobody asks would read nothing."""
    modules = [
        import_module(f"{formats.__name__}.{module.name}") for module in iter_modules(formats.__path__)
    ]
    tools = [module.TOOL for module in modules if hasattr(module, "TOOL")]
    assert sorted(tools) == sorted(one.tool for one in FORMATS)
