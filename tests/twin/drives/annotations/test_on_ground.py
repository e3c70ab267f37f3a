"""What lies on the ground: polygons keep their corners, lines count where ``labels.toml`` says so."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from twin.drives.annotations.formats.cvat import read_cvat
from twin.drives.annotations.formats.shapes import NO_HINTS, AnnotationFile, Hints
from twin.drives.annotations.formats.table import read_annotation_json

GROUND = Hints(on_ground=lambda label: label == "kerb")
LINE, AREA = ((9.5, 19.5), (29.5, 24.5)), ((9.5, 19.5), (29.5, 24.5), (19.5, 39.5))
"""From the centre of the first pixel; tools count from its corner."""


def cvat(tag: str, points: str) -> bytes:
    """An image task with one shape."""
    return (
        "<annotations><version>1.1</version>"
        f'<image id="0" name="0.png" width="100" height="50"><{tag} label="kerb" points="{points}"/></image>'
        "</annotations>"
    ).encode()


def labelme(kind: str, points: list[list[int]]) -> dict[str, Any]:
    """A picture with one shape."""
    return {"imagePath": "0.png", "shapes": [{"label": "kerb", "shape_type": kind, "points": points}]}


def coco() -> dict[str, Any]:
    """A picture with one polygon, and the box around it."""
    annotation = {
        "image_id": 1,
        "category_id": 1,
        "bbox": [0, 0, 5, 5],
        "segmentation": [[10, 20, 30, 25, 20, 40]],
    }
    images, categories = [{"id": 1, "file_name": "0.png"}], [{"id": 1, "name": "kerb"}]
    return {"images": images, "categories": categories, "annotations": [annotation]}


def labelstudio() -> list[dict[str, Any]]:
    """A task with one polygon, in percent."""
    value = {"points": [[10, 40], [30, 50], [20, 80]], "polygonlabels": ["kerb"]}
    result = {
        "id": "a",
        "type": "polygonlabels",
        "value": value,
        "original_width": 100,
        "original_height": 50,
    }
    return [{"id": 1, "data": {"image": "0.png"}, "annotations": [{"result": [result]}]}]


def of_json(document: Any, hints: Hints) -> AnnotationFile:
    """Read a JSON document."""
    file = read_annotation_json(json.dumps(document).encode(), "a.json", hints)
    assert file is not None
    return file


@pytest.mark.parametrize(
    ("document", "outline"),
    [
        (cvat("polyline", "10,20;30,25"), LINE),
        (cvat("polygon", "10,20;30,25;20,40"), AREA),
        (labelme("linestrip", [[10, 20], [30, 25]]), LINE),
        # Closed by its first corner again, as some tools write it.
        (labelme("polygon", [[10, 20], [30, 25], [20, 40], [10, 20]]), AREA),
        (coco(), AREA),
        (labelstudio(), AREA),
    ],
)
def test_corners_of_what_lies_on_the_ground_are_read_from_each_tool(
    document: Any, outline: tuple[tuple[float, float], ...]
) -> None:
    """In their order, from the centre of the first pixel, none twice."""
    file = read_cvat(document, "a.xml", GROUND) if isinstance(document, bytes) else of_json(document, GROUND)
    (shape,) = file.shapes
    assert np.array(shape.outline_px) == pytest.approx(np.array(outline))
    assert (shape.label, shape.kind) == ("kerb", "line" if len(outline) == 2 else "box")


@pytest.mark.parametrize("document", [cvat("polyline", "1,2;3,4"), labelme("line", [[1, 2], [3, 4]])])
def test_lines_of_other_labels_are_left_out_as_ever(document: Any) -> None:
    """They stand for no foot and no face."""
    file = (
        read_cvat(document, "a.xml", NO_HINTS) if isinstance(document, bytes) else of_json(document, NO_HINTS)
    )
    assert not file.shapes
    assert sum(file.left_out.values()) == 1


def test_coco_masks_and_areas_in_parts_are_counted() -> None:
    """A mask has no corners; parts are objects of their own."""
    for segmentation in ({"counts": "abc", "size": [50, 100]}, [[1, 2, 3, 4, 5, 9], [11, 2, 13, 4, 15, 9]]):
        document = coco()
        document["annotations"][0]["segmentation"] = segmentation
        file = of_json(document, GROUND)
        assert not file.shapes
        ((reason, _),) = file.left_out
        assert reason.startswith("what lies on the ground without one polygon")
