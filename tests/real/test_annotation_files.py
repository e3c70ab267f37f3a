"""The exports of eight tools, as those tools publish them for their own tests."""

from __future__ import annotations

from collections import Counter

import pytest
from checkout import REAL

from twin.drives.annotations.formats.labelme_xml import looks_like_labelme_xml, read_labelme_xml
from twin.drives.annotations.formats.shapes import AnnotationFile, Hints
from twin.drives.annotations.formats.table import ONE_IMAGE, read_annotation_json
from twin.drives.annotations.formats.yolo import looks_like_yolo, read_yolo, read_yolo_classes
from twin.drives.annotations.labels import default_label_map

ANNOTATIONS = REAL / "annotations"
pytestmark = pytest.mark.skipif(
    not ANNOTATIONS.exists(), reason="no real annotation files beside the checkout"
)


def content(name: str) -> bytes:
    """Read one of them."""
    return (ANNOTATIONS / name).read_bytes()


def of_json(name: str) -> AnnotationFile:
    """Read one of the JSON exports."""
    file = read_annotation_json(content(name), name)
    assert file is not None
    return file


def left_out(file: AnnotationFile) -> dict[str, int]:
    """Reason → count."""
    return {skipped.reason: skipped.count for skipped in file.skipped}


def test_real_coco_instances_are_boxes() -> None:
    """One box from the first corner, 1 x 2 pixels, of class a; a crowd is no object."""
    file = of_json("coco/instances_val.json")
    (shape,) = file.shapes
    assert (file.tool, shape.label, shape.image, shape.image_id, shape.size_px) == (
        "COCO",
        "a",
        "b.jpg",
        40,
        (5, 10),
    )
    assert shape.box_px == (-0.5, -0.5, 0.5, 1.5)
    assert shape.attributes == {"x": "1", "y": "hello"}
    assert left_out(file) == {"a crowd, not one object": 1}


def test_real_coco_keypoints_without_names_are_left_out() -> None:
    """Three keypoints that the categories do not name: none can be said to be the foot."""
    file = of_json("coco/person_keypoints_val.json")
    assert file.shapes == []
    assert left_out(file) == {"a crowd, not one object": 1, "keypoints, none of them named foot": 1}


def test_real_label_studio_rectangles_are_pixels() -> None:
    """Percent of 2800 x 2800 pixels; of a task that two people annotated the first version counts."""
    file = of_json("labelstudio/yolo_data.json")
    assert [(s.label, s.image, s.image_id) for s in file.shapes] == [
        ("parasites", "/image1", 1),
        ("white", "/image1", 1),
        ("white", "/image2", 2),
        ("white", "/image2", 2),
    ]
    assert {s.size_px for s in file.shapes} == {(2800, 2800)}
    left, top, right, bottom = file.shapes[0].box_px
    assert left == pytest.approx(0.3715846994535519 * 2800 - 0.5)
    assert (right - left, bottom - top) == pytest.approx(
        (0.04189435336976321 * 2800, 0.04735883424408015 * 2800)
    )
    assert top == pytest.approx(0.7067395264116576 * 2800 - 0.5)
    assert left_out(file) == {"another annotator's version of the task": 2}


def test_real_label_studio_polygon_is_the_box_around_it() -> None:
    """An aeroplane of 33 corners on an image of 640 x 426 pixels."""
    (shape,) = of_json("labelstudio/data_polygons.json").shapes
    assert (shape.label, shape.kind, shape.size_px) == ("Airplane", "box", (640, 426))
    top, bottom = 0.14876033057851 * 426, 0.837465564738292 * 426
    assert shape.box_px == pytest.approx(
        (0.6 * 640 - 0.5, top - 0.5, 0.904587155963 * 640 - 0.5, bottom - 0.5)
    )


def test_real_labelme_rectangles_are_boxes() -> None:
    """Two people in 2011_000003.jpg."""
    file = of_json("labelme/labelme_sample.json")
    assert [(s.label, s.image, s.size_px) for s in file.shapes] == [
        ("person", "2011_000003.jpg", (500, 338))
    ] * 2
    assert file.shapes[1].box_px == (364.5, 82.5, 499.5, 332.5)
    assert file.tool in ONE_IMAGE


def test_real_labelme_primitives_are_told_apart() -> None:
    """Each kind that labelme draws: one point, five that have a box, and two lines that are left out."""
    file = of_json("labelme/primitives.json")
    assert Counter((s.kind, s.label) for s in file.shapes) == {
        ("box", "rectangle"): 2,
        ("box", "circle"): 1,
        ("box", "polygon"): 1,
        ("box", "octagon"): 1,
        ("foot", "point"): 1,
    }
    (point,) = (s for s in file.shapes if s.kind == "foot")
    assert point.pixel_px == (344.5, 173.5)
    assert left_out(file) == {"kind line": 1, "kind linestrip": 1}


def test_real_labelme_web_objects_are_boxes() -> None:
    """Seven objects of img1.png: polygons, and one segment with a box."""
    name = "labelme/labelme_mit_img1.xml"
    assert looks_like_labelme_xml(content(name))
    file = read_labelme_xml(content(name), name)
    assert [s.label for s in file.shapes] == ["window", "license plate", "o1", "q1", "b1", "m1", "hg"]
    assert {(s.image, s.size_px) for s in file.shapes} == {("img1.png", (102, 77))}
    assert file.shapes[0].box_px == (42.5, 33.5, 44.5, 36.5)
    assert file.shapes[1].box_px == (57.5, 65.5, 61.5, 67.5)
    assert file.skipped == ()


def test_real_yolo_rows_are_fractions_until_the_camera_is_known() -> None:
    """Two boxes of classes 2 and 4 of ten."""
    assert looks_like_yolo(content("yolo/1.txt"))
    classes = read_yolo_classes(content("yolo/obj.names"), "obj.names")
    assert classes.labels == {k: f"label_{k}" for k in range(10)}
    file = read_yolo(content("yolo/1.txt"), "1.txt", Hints(classes=classes))
    assert [s.label for s in file.shapes] == ["label_2", "label_4"]
    assert [s.pixel_px for s in file.shapes] == [
        pytest.approx((0.133333, 0.3)),
        pytest.approx((0.266667, 0.45)),
    ]
    assert file.shapes[1].in_pixels(15, 10).pixel_px == pytest.approx((3.5, 4.0), abs=1e-4)


def test_real_yolo_pose_without_names_is_left_out() -> None:
    """Three keypoints without names: none can be said to be the foot."""
    classes = read_yolo_classes(content("yolo/pose_data.yaml"), "pose_data.yaml")
    assert (classes.labels, classes.n_keypoints, classes.n_values) == ({0: "skeleton_label"}, 3, 3)
    file = read_yolo(content("yolo/pose_1.txt"), "pose_1.txt", Hints(classes=classes))
    assert left_out(file) == {"keypoints, none of them named foot": 1}


def test_real_datumaro_boxes_are_read() -> None:
    """Three boxes, one without a label; a mask and points of three are left out, captions are no shapes."""
    file = of_json("datumaro/train.json")
    assert [(s.label, s.image, s.size_px) for s in file.shapes] == [
        ("cat4", "100.jpg", (6, 10)),
        ("", "100.jpg", (6, 10)),
        ("", "21", None),
    ]
    assert file.shapes[0].box_px == (0.5, 1.5, 3.5, 5.5)
    assert left_out(file) == {"kind mask": 1, "points with 3 points, none of them named foot": 1}


def test_real_datumaro_skeleton_has_the_foot_that_labels_toml_names() -> None:
    """Its points are point1, point3 and point2: none is a foot, until one of the names is said to be."""
    assert left_out(of_json("datumaro/skeleton.json")) == {
        "skeleton with 3 points, none of them named foot": 1
    }
    file = read_annotation_json(content("datumaro/skeleton.json"), "skeleton.json", Hints(["point3-label"]))
    assert file is not None
    (shape,) = file.shapes
    assert (shape.kind, shape.label, shape.image) == ("foot", "skeleton-label", "100.jpg")
    assert shape.pixel_px == pytest.approx((2.45 - 0.5, 7.6 - 0.5))


def test_real_vistas_polygons_without_width_are_counted() -> None:
    """Five polygons one pixel wide: their corners enclose nothing."""
    file = of_json("mapillary/vistas_v2_polygons.json")
    assert file.shapes == []
    assert left_out(file) == {"box without area": 5}


def test_real_vistas_labels_are_no_signs() -> None:
    """The label list is no annotation file; animals and vehicles are ignored, a separator is not known."""
    name = "mapillary/config_v2.0.json"
    assert read_annotation_json(content(name), name) is None
    labels = default_label_map()
    meanings = {
        label: labels.of(label)
        for label in ("animal--bird", "object--vehicle--bicycle", "construction--barrier--separator")
    }
    assert all(label.encode() in content(name) for label in meanings)
    assert [m is not None and m.is_ignored for m in meanings.values()] == [True, True, False]
