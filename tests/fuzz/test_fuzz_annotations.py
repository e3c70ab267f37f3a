"""Annotation files of every tool, damaged."""

from __future__ import annotations

import json
import math
from functools import cache

import numpy as np
import pytest
from mutate import Draw, either, fuzzed, mutated, mutated_json, real_files

from geoloc.cameras import PinholeCamera
from geoloc.rig.rig import Rig, RigCamera
from twin.drives.annotations.formats.labelme_xml import looks_like_labelme_xml, read_labelme_xml
from twin.drives.annotations.formats.plain_csv import looks_like_annotations_csv, read_annotations_csv
from twin.drives.annotations.formats.shapes import AnnotationFile, Hints, YoloClasses
from twin.drives.annotations.formats.table import read_annotation_json
from twin.drives.annotations.formats.yolo import looks_like_yolo, read_yolo, read_yolo_classes
from twin.drives.annotations.gather import gather
from twin.drives.annotations.labels import read_label_map
from twin.errors import DriveError

COCO = {
    "images": [{"id": 1, "file_name": "a_12.png", "width": 1280, "height": 800}],
    "categories": [{"id": 1, "name": "202", "keypoints": ["top", "foot"]}],
    "annotations": [
        {"image_id": 1, "category_id": 1, "bbox": [1.5, 2, 30, 40], "iscrowd": 0, "track_id": 3},
        {
            "image_id": 1,
            "category_id": 1,
            "keypoints": [1, 2, 2, 3, 4, 2],
            "attributes": {"skiltnummer": "204"},
        },
        {"image_id": 1, "category_id": 1, "segmentation": [[1, 2, 3, 4, 5, 9]], "bbox": []},
    ],
}
LABEL_STUDIO = [
    {
        "id": 7,
        "data": {"image": "/data/local-files/?d=a/12.png"},
        "annotations": [
            {
                "result": [
                    {
                        "id": "r",
                        "type": "rectanglelabels",
                        "original_width": 1280,
                        "original_height": 800,
                        "image_rotation": 0,
                        "value": {
                            "x": 1,
                            "y": 2,
                            "width": 3,
                            "height": 4,
                            "rotation": 12.5,
                            "rectanglelabels": ["202"],
                        },
                    },
                    {"id": "r", "type": "textarea", "from_name": "skiltnummer", "value": {"text": ["202"]}},
                    {
                        "id": "v",
                        "type": "videorectangle",
                        "value": {
                            "labels": ["204"],
                            "sequence": [
                                {"frame": 1, "x": 1, "y": 2, "width": 3, "height": 4, "enabled": True}
                            ],
                        },
                    },
                    {
                        "id": "e",
                        "type": "ellipselabels",
                        "value": {"x": 9, "y": 9, "radiusX": 2, "radiusY": 1, "rotation": 3},
                    },
                    {"id": "p", "type": "polygonlabels", "value": {"points": [[1, 2], [3, 4], [5, 2]]}},
                ]
            }
        ],
    }
]
LABELME = {
    "version": "5.5.0",
    "imagePath": "a_12.png",
    "imageHeight": 800,
    "imageWidth": 1280,
    "imageData": "AAAA",
    "shapes": [
        {"label": "202", "points": [[1, 2], [30, 40]], "shape_type": "rectangle", "group_id": 3},
        {"label": "202", "points": [[1, 2]], "shape_type": "point", "flags": {"object": "a"}},
        {"label": "202", "points": [[9, 9], [11, 9]], "shape_type": "circle"},
    ],
}
DATUMARO = {
    "categories": {
        "label": {"labels": [{"name": "202"}]},
        "points": {"items": [{"label_id": 0, "labels": ["top", "foot"]}]},
    },
    "items": [
        {
            "id": "12",
            "attr": {"frame": 12},
            "image": {"path": "a.png", "size": [800, 1280]},
            "annotations": [
                {"type": "bbox", "bbox": [1, 2, 3, 4], "label_id": 0, "attributes": {"track_id": 1}},
                {"type": "points", "points": [1, 2, 3, 4], "label_id": 0},
                {"type": "skeleton", "points": [1, 2, 2, 3, 4, 2], "label_id": 0},
                {"type": "polygon", "points": [1, 2, 3, 4, 5, 9], "label_id": 0},
            ],
        }
    ],
}
VISTAS = {
    "width": 1280,
    "heigth": 800,
    "objects": [{"label": "object--sign", "polygon": [[1, 2], [3, 2], [3, 9]]}],
}
JSON = {
    "coco": COCO,
    "labelstudio": LABEL_STUDIO,
    "labelme": LABELME,
    "datumaro": DATUMARO,
    "mapillary": VISTAS,
}
CSV = b"""frame,image,camera,track,label,skiltnummer,x_px,y_px,left_px,top_px,right_px,bottom_px
12,,front,3,202,202,700.5,500.5,,,,
,a_13.png,,,202,,,,1,2,3,4
"""
XML = b"""<annotation><filename>a_12.png</filename>
<imagesize><nrows>800</nrows><ncols>1280</ncols></imagesize>
<object><name>202</name><deleted>0</deleted><polygon><pt><x>1</x><y>2</y></pt><pt><x>3</x><y>9</y></pt></polygon>
</object><object><name>204</name><segm><box><xmin>1</xmin><ymin>2</ymin><xmax>3</xmax><ymax>4</ymax></box></segm>
</object></annotation>"""
YOLO = [b"2 0.1 0.3 0.2 0.2\n4 0.2 0.4 0.1 0.3 7\n", b"0 0.1 0.3 0.2 0.2 0.1 0.2 2 0.3 0.4 2\n"]
CLASSES = [b"path: .\nkpt_shape: [2, 3]\nkpt_names: {0: [top, foot]}\nnames:\n  0: '202'\n", b"202\n204\n"]
LABELS = b"""foot_keypoints = ["fundament"]
[labels]
"Speed 50" = "362.50"
"both" = ["362.50", "808.1"]
"lamp" = { type = 14 }
"object--*" = "ignore"
"""


def json_of(tool: str) -> Draw:
    """Damaged files of a tool, most of them sound JSON."""
    small = json.dumps(JSON[tool]).encode()
    bent = mutated_json([JSON[tool]])
    return either(bent, bent, mutated([small, *real_files(f"annotations/{tool}", ".json")]))


@cache
def rig() -> Rig:
    """Return a car with one camera of 1280 x 800."""
    model = PinholeCamera(1280, 800, fx_px=1000.0, fy_px=1000.0, cx_px=639.5, cy_px=399.5)
    return Rig(
        cameras={"front": RigCamera("front", model, np.eye(3), np.zeros(3))}, antennas={}, source="car.json"
    )


def check(file: AnnotationFile | None) -> None:
    """Whatever was read has finite pixels, text that can be stored, and can be gathered into a drive."""
    if file is None:
        return
    for shape in file.shapes:
        assert all(math.isfinite(value) for value in shape.pixel_px)
        "".join([shape.label, shape.image, shape.track, *shape.attributes.values()]).encode()
    try:
        found = gather([(file, "front")], rig())
    except DriveError:
        return
    assert (found.annotations.frame >= 0).all()
    assert found.annotations.label.dtype.itemsize <= 4 * 200


@fuzzed(either(*map(json_of, JSON)), parsers=len(JSON))
def test_json_readers_raise_nothing_but_drive_errors(content: bytes) -> None:
    """COCO, Label Studio, labelme, Datumaro and Vistas: a DriveError, or shapes."""
    try:
        file = read_annotation_json(content, "labels/a_12.json", Hints(["fundament"]))
    except DriveError:
        return
    check(file)


@fuzzed(mutated([XML, *real_files("annotations/labelme", ".xml")]))
def test_labelme_xml_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or shapes."""
    looks_like_labelme_xml(content)
    try:
        file = read_labelme_xml(content, "a_12.xml")
    except DriveError:
        return
    check(file)


@fuzzed(mutated([CSV]))
def test_csv_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or shapes."""
    looks_like_annotations_csv(content)
    try:
        file = read_annotations_csv(content, "signs.csv")
    except DriveError:
        return
    check(file)


@pytest.mark.parametrize("classes", [None, YoloClasses({0: "202"}, 2, 3, ("top", "foot"))])
@fuzzed(mutated([*YOLO, *real_files("annotations/yolo", ".txt")]))
def test_yolo_reader_raises_nothing(classes: YoloClasses | None, content: bytes) -> None:
    """Lines that are no labels are counted, whatever their bytes."""
    looks_like_yolo(content)
    check(read_yolo(content, "labels/a_12.txt", Hints(classes=classes)))


@pytest.mark.parametrize("name", ["data.yaml", "obj.names"])
@fuzzed(mutated([*CLASSES, *real_files("annotations/yolo", ".yaml", ".names")]))
def test_yolo_class_reader_raises_nothing_but_drive_errors(name: str, content: bytes) -> None:
    """A DriveError, or names by class number."""
    try:
        classes = read_yolo_classes(content, name)
    except DriveError:
        return
    assert all(isinstance(number, int) for number in classes.labels)
    check(read_yolo(YOLO[1], "a_12.txt", Hints(classes=classes)))


@fuzzed(mutated([LABELS]))
def test_label_map_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or a map that answers for any label."""
    try:
        labels = read_label_map(content)
    except DriveError:
        return
    labels.of("object--vehicle--car")
