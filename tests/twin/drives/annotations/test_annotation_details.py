"""What each annotation format has of its own: turned boxes, videos, versions, rows that are none."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from left_out import counts

from twin.drives.annotations.formats.coco import read_coco
from twin.drives.annotations.formats.datumaro import read_datumaro
from twin.drives.annotations.formats.labelme import read_labelme
from twin.drives.annotations.formats.labelme_xml import read_labelme_xml
from twin.drives.annotations.formats.labelstudio import read_labelstudio
from twin.drives.annotations.formats.plain_csv import read_annotations_csv
from twin.drives.annotations.formats.shapes import AnnotationFile, Hints, YoloClasses, foot_of
from twin.drives.annotations.formats.table import read_annotation_json
from twin.drives.annotations.formats.vistas import read_vistas
from twin.drives.annotations.formats.yolo import read_yolo, read_yolo_classes
from twin.errors import DriveError


def coco(*annotations: dict[str, Any], keypoints: list[str] | None = None) -> AnnotationFile:
    """Read annotations of one image and one class."""
    document = {
        "images": [{"id": 1, "file_name": "12.png"}],
        "categories": [{"id": 1, "name": "sign", "keypoints": keypoints or []}],
        "annotations": [{"image_id": 1, "category_id": 1} | one for one in annotations],
    }
    return read_coco(document, "a.json")


def test_coco_annotation_that_cannot_be_used_is_counted() -> None:
    """Each by its reason."""
    file = coco(
        {"image_id": 2, "bbox": [1, 1, 1, 1]},
        {"bbox": [1, 1, 0, 5]},
        {"bbox": [1, 1, -3, 5]},
        {"bbox": [1, 1, 10**400, 5]},
        {"bbox": [-1e308, 1, 1e308, 5]},
        {"bbox": [1, 1, "x", 5]},
        {"bbox": [1, 1, True, 5]},
        {"bbox": [1, 1]},
        {"segmentation": {"counts": [1], "size": [1, 1]}},
        {"segmentation": [[1, 2, 3]]},
        {"bbox": [1, 1, 5, 5], "iscrowd": 1},
    )
    assert file.shapes == []
    assert counts(file.skipped) == {
        "image that is not listed": 1,
        "box without area": 2,
        "coordinates not finite": 1,
        "coordinates beyond any image": 1,
        "coordinates unreadable": 3,
        "neither box nor keypoints": 2,
        "a crowd, not one object": 1,
    }


def test_coco_segment_without_a_box_counts_as_the_box_around_it() -> None:
    """All its parts together."""
    (shape,) = coco({"segmentation": [[1, 2, 3, 2, 3, 4], [8, 8, 9, 8, 9, 9]]}).shapes
    assert shape.box_px == (0.5, 1.5, 8.5, 8.5)


@pytest.mark.parametrize(
    ("names", "keypoints", "reason"),
    [
        (["top", "foot"], [1, 2, 2, 3, 4, 0], "foot not marked"),
        (["foot left", "foot right"], [1, 2, 2, 3, 4, 2], "keypoints, none of them named foot"),
        (["top", "foot"], [1, 2, 2], "keypoints, none of them named foot"),
    ],
)
def test_coco_object_without_a_clear_foot_is_left_out(
    names: list[str], keypoints: list[int], reason: str.skipped
) -> None:
    """Its box is of the whole object, pole and all, and is not taken for the face."""
    file = coco({"keypoints": keypoints, "bbox": [1, 1, 5, 5]}, keypoints=names)
    assert counts(file.skipped) == {reason: 1}


@pytest.mark.parametrize(
    ("names", "which"),
    [
        (["top", "foot"], 1),
        (["Pole_Base", "face"], 0),
        (["fot", "topp"], 0),
        (["football", "top"], None),
        (["foot", "base"], None),
        (["anything"], 0),
        (["top", "fundament"], 1),
        ([], None),
    ],
)
def test_foot_is_the_keypoint_that_is_named_so(names: list[str], which: int | None) -> None:
    """By a whole word, or by the drive's own name for it; a single keypoint is the foot whatever its name."""
    assert foot_of(names, ["Fundament"]) == which


def result(kind: str, label: str = "202", region: str = "r", **value: Any) -> dict[str, Any]:
    """One result of Label Studio on an image of 1000 x 500 pixels."""
    return {
        "id": region,
        "type": f"{kind}labels",
        "original_width": 1000,
        "original_height": 500,
        "value": value | {f"{kind}labels": [label]},
    }


def label_studio(*results: dict[str, Any], **task: Any) -> AnnotationFile:
    """Read the results of one task."""
    task = {"id": 7, "data": {"image": "12.png"}, "annotations": [{"result": list(results)}]} | task
    return read_labelstudio([task], "a.json")


def test_label_studio_rectangle_is_turned_about_its_first_corner() -> None:
    """By 90° clockwise about (100, 50), 200 wide and 40 high: 40 to the left of it and 200 below."""
    turned = result("rectangle", x=10, y=10, width=20, height=8, rotation=90)
    (shape,) = label_studio(turned).shapes
    assert shape.box_px == pytest.approx((59.5, 49.5, 99.5, 249.5))


def test_label_studio_ellipse_is_the_box_around_it() -> None:
    """Centre (500, 250), radii 100 and 50; turned by 90° they change places."""
    level = result("ellipse", x=50, y=50, radiusX=10, radiusY=10, rotation=0)
    upright = level | {"value": level["value"] | {"rotation": 90}}
    boxes = [shape.box_px for shape in label_studio(level, upright).shapes]
    assert boxes == [pytest.approx((399.5, 199.5, 599.5, 299.5)), pytest.approx((449.5, 149.5, 549.5, 349.5))]


def test_label_studio_image_that_was_turned_is_left_out() -> None:
    """Its coordinates are of another picture than the camera's."""
    turned = result("keypoint", x=1, y=1) | {"image_rotation": 90}
    file = label_studio(turned)
    assert file.shapes == []
    assert "turned in Label Studio" in next(iter(counts(file.skipped)))


def test_label_studio_region_keeps_what_was_said_of_it() -> None:
    """A text, a choice and a label of its own have the region's id."""
    shape = {k: v for k, v in result("rectangle", x=1, y=1, width=5, height=5).items() if k != "type"}
    shape |= {"type": "rectangle", "value": {"x": 1, "y": 1, "width": 5, "height": 5}}
    file = label_studio(
        shape,
        {"id": "r", "type": "labels", "value": {"labels": ["362.50"], "x": 1}},
        {"id": "r", "type": "textarea", "from_name": "skiltnummer", "value": {"text": ["362.50", "808.1"]}},
        {"id": "r", "type": "choices", "from_name": "object", "value": {"choices": ["pole 3"]}},
        {"id": "b", "type": "brushlabels", "value": {"rle": [1], "brushlabels": ["x"]}},
    )
    (kept,) = file.shapes
    assert (kept.label, kept.attributes) == ("362.50", {"skiltnummer": "362.50;808.1", "object": "pole 3"})
    assert counts(file.skipped) == {"kind brush": 1}


def test_label_studio_version_that_counts_is_the_ground_truth() -> None:
    """Of three versions one was cancelled and one is marked; the third is counted."""
    versions = [
        {"result": [result("keypoint", "204", x=1, y=1)], "was_cancelled": True},
        {"result": [result("keypoint", "206", x=1, y=1)]},
        {"result": [result("keypoint", "202", x=1, y=1)], "ground_truth": True},
    ]
    file = label_studio(annotations=versions)
    assert [shape.label for shape in file.shapes] == ["202"]
    assert counts(file.skipped) == {"another annotator's version of the task": 1}


def test_label_studio_video_counts_frames_from_one() -> None:
    """Key frames of a track, in fractions of a picture whose size the export does not say."""
    rows = [{"frame": f, "x": 10, "y": 20, "width": 2, "height": 4, "rotation": 0} for f in (1, 31, 0)]
    video = {"id": "t", "type": "videorectangle", "value": {"labels": ["202"], "sequence": rows}}
    file = label_studio(video, data={"video": "/data/front.mp4"})
    assert [(s.frame, s.track, s.label, s.image) for s in file.shapes] == [
        (0, "t", "202", "/data/front.mp4"),
        (30, "t", "202", "/data/front.mp4"),
    ]
    assert file.shapes[0].in_pixels(1000, 500).box_px == pytest.approx((99.5, 99.5, 119.5, 119.5))
    assert counts(file.skipped) == {"frame number unreadable": 1}


def test_labelme_shape_that_cannot_be_used_is_counted() -> None:
    """Lines, unreadable points and rectangles without area."""
    shapes = [
        {"label": "a", "shape_type": "line", "points": [[1, 2], [3, 4]]},
        {"label": "a", "shape_type": "point", "points": [[1, "x"]]},
        {"label": "a", "shape_type": "point", "points": [[1, 2], [3, 4]]},
        {"label": "a", "shape_type": "rectangle", "points": [[1, 2], [1, 4]]},
        {"label": "a", "shape_type": "polygon", "points": [[1, 2, 3], [1, 4]]},
        "noise",
    ]
    file = read_labelme({"shapes": shapes, "imagePath": None}, "labels/12.json")
    assert counts(file.skipped) == {
        "kind line": 1,
        "kind point": 1,
        "kind polygon": 1,
        "coordinates unreadable": 2,
        "box without area": 1,
    }


def test_text_of_a_sign_stands_where_each_tool_has_room_for_it() -> None:
    """COCO's and Datumaro's attributes, a column of a CSV, a text area, labelme's description."""
    document = {
        "categories": {"label": {"labels": [{"name": "808"}]}},
        "items": [
            {
                "id": "12",
                "annotations": [
                    {"type": "bbox", "bbox": [1, 1, 5, 5], "label_id": 0, "attributes": {"text": "200 m"}}
                ],
            }
        ],
    }
    point = {"label": "808", "shape_type": "point", "points": [[1, 1]], "description": "200 m", "flags": {}}
    area = {"id": "r", "type": "textarea", "from_name": "text", "value": {"text": ["200 m"]}}
    files = [
        coco({"bbox": [1, 1, 5, 5], "attributes": {"text": "200 m"}}),
        read_datumaro(document, "a.json"),
        read_annotations_csv(b"frame,label,text,x_px,y_px\n1,808,200 m,5,5\n", "a.csv"),
        label_studio(result("rectangle", x=1, y=1, width=5, height=5), area),
        read_labelme({"imagePath": "12.png", "shapes": [point]}, "12.json"),
    ]
    assert [file.shapes[0].attributes["text"] for file in files] == ["200 m"] * len(files)


def test_labelme_image_without_a_name_has_the_files() -> None:
    """The frame is then that of the file."""
    shapes = [{"label": "a", "shape_type": "point", "points": [[1, 2]]}]
    (shape,) = read_labelme({"shapes": shapes, "imagePath": None}, "labels/12.json").shapes
    assert shape.image == "labels/12.json"


def test_yolo_row_that_is_no_label_is_counted() -> None:
    """Words, pixels instead of fractions, negative classes, and rows of a length that means nothing."""
    rows = [
        "0 .5 .5 .1",
        "0 .5 .5 .1 .1 .1 .1 .1",
        "sign .5 .5 .1 .1",
        "0 640 400 60 40",
        "-1 0 0 1 1",
        "0 nan 0 1 1",
    ]
    file = read_yolo("\n".join(rows).encode(), "12.txt")
    assert file.shapes == []
    assert counts(file.skipped) == {
        "row of 4 numbers": 1,
        "row of 8 numbers: key points need kpt_shape = [points, 2 or 3] in data.yaml": 1,
        "coordinates unreadable": 1,
        "coordinates are no fractions of the image": 1,
        "class number unreadable": 1,
        "coordinates not finite": 1,
    }


def test_yolo_box_may_have_a_confidence_or_a_track() -> None:
    """A sixth number up to 1 is a confidence; a whole one above is the track."""
    file = read_yolo(b"0 0.5 0.5 0.1 0.1 0.87\n0 0.5 0.5 0.1 0.1 1\n0 0.5 0.5 0.1 0.1 17\n", "12.txt")
    assert [shape.track for shape in file.shapes] == ["", "", "17"]
    assert {shape.label for shape in file.shapes} == {"class 0"}


def test_yolo_segment_is_the_box_around_it() -> None:
    """A class and the corners of a polygon."""
    (shape,) = read_yolo(b"0 0.1 0.2 0.3 0.2 0.2 0.6\n", "12.txt").shapes
    assert shape.in_pixels(1000, 500).box_px == pytest.approx((99.5, 99.5, 299.5, 299.5))


def test_yolo_class_names_are_texts_as_written() -> None:
    """362.50 in YAML is no number: as one it would be sign 362.5."""
    classes = read_yolo_classes(b"names:\n  0: 362.50\n  1: 202\n  2: yes\n", "data.yaml")
    assert classes.labels == {0: "362.50", 1: "202", 2: "yes"}
    assert read_yolo_classes(b"names: [362.50, a]", "data.yaml").labels == {0: "362.50", 1: "a"}
    assert read_yolo_classes(b"362.50\n\na\n", "obj.names").labels == {0: "362.50", 2: "a"}


def test_yolo_pose_with_two_values_a_point_is_read() -> None:
    """``kpt_shape: [2, 2]``: no visibility."""
    classes = YoloClasses({0: "202"}, 2, 2, ("top", "foot"))
    (shape,) = read_yolo(b"0 0.5 0.5 0.1 0.1 0.4 0.2 0.4 0.6\n", "12.txt", Hints(classes=classes)).shapes
    assert (shape.kind, shape.pixel_px) == ("foot", pytest.approx((0.4, 0.6)))


def test_datumaro_frame_of_a_video_counts_where_the_name_has_no_number() -> None:
    """``attr.frame`` of an item; a label number that is none gives no label."""
    item = {
        "id": "frame",
        "attr": {"frame": 17},
        "annotations": [{"type": "bbox", "bbox": [1, 2, 3, 4], "label_id": 9}],
        "image": {"size": [1]},
    }
    (shape,) = read_datumaro({"items": [item], "categories": {}}, "a.json").shapes
    assert (shape.image_id, shape.label, shape.size_px) == (17, "", None)


def test_vistas_polygon_may_be_flat_or_in_corners() -> None:
    """The published files have both."""
    things = [
        {"polygon": [[1, 2, 5, 2, 5, 9]]},
        {"polygon": [[1, 2], [5, 2], [5, 9]]},
        {"polygon": [[[1, 2]]]},
    ]
    file = read_vistas({"objects": things}, "12.json")
    assert {shape.box_px for shape in file.shapes} == {(0.5, 1.5, 4.5, 8.5)}
    assert counts(file.skipped) == {"coordinates unreadable": 1}


def test_csv_takes_semicolons_and_names_cameras() -> None:
    """A column ``camera`` is the camera, as the task of a project is; any other column is an attribute."""
    text = "camera;image;label;skiltnummer;x_px;y_px\nfront;b_12.png;sign;362,50;10;20\n"
    file = read_annotations_csv(text.encode(), "signs.csv")
    (shape,) = file.shapes
    assert file.tasks == {"front": ("front",)}
    assert (shape.task, shape.image, shape.attributes) == ("front", "b_12.png", {"skiltnummer": "362,50"})
    assert shape.pixel_px == (9.5, 19.5)


def test_csv_row_may_hold_foot_and_face() -> None:
    """Both columns filled are two marks of one object."""
    text = "frame,label,track,x_px,y_px,left_px,top_px,right_px,bottom_px\n12,202,3,10,99,5,6,15,16\n"
    file = read_annotations_csv(text.encode(), "signs.csv")
    assert [(s.kind, s.track, s.frame) for s in file.shapes] == [("foot", "3", 12), ("box", "3", 12)]


def test_csv_row_that_cannot_be_used_is_counted() -> None:
    """Each by its reason; empty rows are none."""
    rows = [
        "frame,image,x_px,y_px",
        "1,,,",
        ",,1,2",
        "-1,,1,2",
        "²,,1,2",
        "1,,1,",
        "1,,1,inf",
        ",,,",
        "1,,1,2",
    ]
    file = read_annotations_csv("\n".join(rows).encode(), "signs.csv")
    assert len(file.shapes) == 1
    assert counts(file.skipped) == {
        "neither point nor box": 1,
        "neither frame nor image": 1,
        "frame number unreadable, such as '-1'": 2,
        "coordinates unreadable": 1,
        "coordinates not finite": 1,
    }


def test_json_texts_can_always_be_stored() -> None:
    """Half a surrogate pair, which JSON can spell, becomes a question mark."""
    shapes = [{"label": "a\ud800b", "shape_type": "point", "points": [[1, 2]]}]
    file = read_annotation_json(json.dumps({"shapes": shapes, "imagePath": "12.png"}).encode(), "a.json")
    assert file is not None
    assert file.shapes[0].label == "a?b"
    assert math.isnan(file.shapes[0].box_px[0])


LABELME, CLASSES, CSV, JSON = "a.xml", "data.yaml", "signs.csv", "a.json"
READERS: dict[str, Callable[[bytes, str], object]] = {
    LABELME: read_labelme_xml,
    CLASSES: read_yolo_classes,
    CSV: read_annotations_csv,
    JSON: read_annotation_json,
}


@pytest.mark.parametrize(
    ("where", "content", "message"),
    [
        (LABELME, b'<!DOCTYPE a [<!ENTITY x "y">]><annotation>&x;</annotation>', "document type or entities"),
        (LABELME, b"<annotation>", "not well-formed"),
        (LABELME, b"", "not well-formed"),
        (LABELME, b"<annotations/>", "no LabelMe annotation"),
        (CLASSES, b"names: [", "not YAML"),
        (CLASSES, b"a: &a [x]\nnames: [*a, *a]", "references"),
        (CLASSES, b"train: images", "has no names"),
        (CLASSES, b"names: [a]\nkpt_shape: [99999999, 3]", "kpt_shape"),
        (CLASSES, b"names: [a]\nkpt_shape: [2, 7]", "kpt_shape"),
        (CLASSES, b"\xff\xfe", "not UTF-8"),
        (CLASSES, b"a" * 1_000_001, "no list of class names"),
        (CSV, b"a,b\n1,2\n", "has the columns 'a,b'"),
        (CSV, b"frame,x_px,y_px\n\x00\x01", "not text"),
        (CSV, b"", "has the columns ''"),
        (JSON, b"[" * 100_000, "nested too deeply"),
        (JSON, b'{"images": [', "not JSON"),
        (JSON, b"\xff", "not JSON"),
        (JSON, b"9" * 5000, "not JSON"),
    ],
    ids=lambda value: "" if isinstance(value, bytes) else value,
)
def test_file_that_is_none_of_its_format_is_refused(where: str, content: bytes, message: str) -> None:
    """Entities, cut files, other encodings: the sentence names the file and what is wrong."""
    with pytest.raises(DriveError, match=rf"{re.escape(where)} .*{message}"):
        READERS[where](content, where)
