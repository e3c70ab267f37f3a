"""Which rows of a track somebody set, and which its tool drew between them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from left_out import counts

from geoloc.rig.rig import rig_from_document
from twin.drives.annotations.formats.cvat import read_cvat
from twin.drives.annotations.formats.labelme_xml import read_labelme_xml
from twin.drives.annotations.formats.plain_csv import read_annotations_csv
from twin.drives.annotations.formats.shapes import AnnotationFile, merged
from twin.drives.annotations.formats.table import read_annotation_json
from twin.drives.annotations.gather import gather
from twin.drives.inspection.inspect import inspect_drive
from twin.drives.read import read_drive

WIDE = "C3_wide"
FLAGS = (True, False, True)


def cvat(rows: str) -> AnnotationFile:
    """A track."""
    document = f'<annotations><version>1.1</version><track id="3" label="202">{rows}</track></annotations>'
    return read_cvat(document.encode(), "a.xml")


def cvat_points() -> AnnotationFile:
    """A video task; it ends the track with a key frame that is outside."""
    rows = "".join(f'<points frame="{k}" keyframe="{f:d}" points="5,9"/>' for k, f in enumerate(FLAGS))
    return cvat(rows + '<points frame="3" keyframe="1" outside="1" points="5,9"/>')


def csv() -> AnnotationFile:
    """A table that somebody made of a track."""
    rows = "".join(f"{k},3,5,9,{int(flag)}\n" for k, flag in enumerate(FLAGS))
    return read_annotations_csv(f"frame,track,x_px,y_px,keyframe\n{rows}".encode(), "a.csv")


def cvat_skeleton() -> AnnotationFile:
    """The foot's own rows say it."""
    rows = "".join(f'<points frame="{k}" keyframe="{f:d}" points="5,9"/>' for k, f in enumerate(FLAGS))
    return cvat(f'<skeleton frame="0" keyframe="0" points="5,9"/><track label="foot">{rows}</track>')


def exported(document: Any) -> AnnotationFile:
    """Read a JSON document of whichever tool."""
    file = read_annotation_json(json.dumps(document).encode(), "a.json")
    assert file is not None
    return file


def coco() -> AnnotationFile:
    """CVAT's COCO."""
    told = [{"attributes": {"track_id": 3, "keyframe": flag}} for flag in FLAGS]
    shapes = [{"image_id": k, "category_id": 1, "bbox": [1, 2, 3, 4]} | one for k, one in enumerate(told)]
    images = [{"id": k, "file_name": f"{k}.png"} for k in range(3)]
    return exported({"images": images, "categories": [], "annotations": shapes})


def datumaro() -> AnnotationFile:
    """CVAT's Datumaro."""
    shape = {"type": "bbox", "bbox": [1, 2, 3, 4], "label_id": 0}
    told = [shape | {"attributes": {"track_id": 3, "keyframe": flag}} for flag in FLAGS]
    items = [{"id": f"{k}", "annotations": [one]} for k, one in enumerate(told)]
    return exported({"categories": {"label": {}}, "items": items})


def labelme() -> AnnotationFile:
    """CVAT's LabelMe: all that is said of an object in one text."""
    corners = "<polygon><pt><x>1</x><y>2</y></pt><pt><x>4</x><y>6</y></pt></polygon>"
    said = (f"<attributes>occluded=False, track_id=3, keyframe={flag}</attributes>" for flag in FLAGS)
    things = (f"<object><name>202</name>{one}{corners}</object>" for one in said)
    return merged(
        [
            read_labelme_xml(f"<annotation>{thing}</annotation>".encode(), f"{k}.xml")
            for k, thing in enumerate(things)
        ],
        "default/",
    )


def label_studio() -> AnnotationFile:
    """A video that was exported with interpolated key frames."""
    row = {"x": 10, "y": 20, "width": 2, "height": 4, "rotation": 0}
    told = [row | {"frame": 1, "enabled": True}, row | {"frame": 2, "enabled": True, "auto": True}]
    told.append(row | {"frame": 3, "enabled": False})
    value = {"id": "3", "type": "videorectangle", "value": {"labels": ["202"], "sequence": told}}
    return exported([{"data": {"video": "/data/front.mp4"}, "annotations": [{"result": [value]}]}])


@pytest.mark.parametrize("read", [cvat_points, cvat_skeleton, csv, coco, datumaro, labelme, label_studio])
def test_row_that_the_tool_drew_was_not_measured(read: Any, maker: Any) -> None:
    """The second of three; all are rows of one track."""
    notes = gather([(read(), WIDE)], rig_from_document(maker.rig(), "car.json")).annotations
    assert notes.is_measured.tolist() == [*FLAGS]
    assert notes.frame.tolist() == [0, 1, 2]
    assert set(notes.object.tolist()) == {"3"}


def test_copy_that_lacks_the_word_is_interpolated_too(maker: Any) -> None:
    """One row in two files of a camera, of which one knows that nobody set it, in either order."""
    said = '<attribute name="object">P1</attribute>'
    flagged = f'<track id="3" label="202"><points frame="1" keyframe="0" points="5,9">{said}</points></track>'
    files = {"a": flagged, "b": flagged.replace('keyframe="0" ', "")}
    rig = rig_from_document(maker.rig(), "car.json")
    for order in ("ab", "ba"):
        read = [(read_cvat(maker.cvat(files[one]).encode(), f"{WIDE}/{one}.xml"), None) for one in order]
        assert gather(read, rig).annotations.is_measured.tolist() == [False]


def test_drive_parts_what_was_seen_from_what_was_measured(maker: Any, tmp_path: Path) -> None:
    """By file and count in both commands; an object without a key frame is named, with the cure."""
    half = '<points frame="21" keyframe="0" points="705,505"/>'
    tracks = maker.annotations().replace("</track>", f"{half}</track>", 1)
    only = (
        '<track id="9" label="204"><points frame="22" keyframe="0" points="300,505"/></track></annotations>'
    )
    files = maker.files(**{f"{WIDE}.xml": tracks.replace("</annotations>", only)})
    drive = read_drive(maker.write(tmp_path, files))
    assert drive.annotations.frame.tolist() == [20, 23, 30]
    assert drive.interpolated.frame.tolist() == [21, 22]
    why = "interpolated between key frames: the object was seen there, but not measured"
    assert counts(drive.skipped)[why] == 2
    (doubt,) = (str(one) for one in drive.warnings if "key frame" in str(one))
    assert doubt.startswith(
        "Annotated objects without a key frame: 1 (such as 9); all that there is of them, 1"
    )
    seen = inspect_drive(tmp_path)
    assert counts(seen.skipped)[why] == 2
    assert doubt in seen.warnings
