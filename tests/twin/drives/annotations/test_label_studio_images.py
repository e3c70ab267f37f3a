"""Which image a Label Studio region is of where a task has several, and exports that do not say it."""

from __future__ import annotations

import json
from typing import Any

import pytest
from left_out import counts

from twin.drives.annotations.formats.labelstudio import read_labelstudio
from twin.drives.annotations.formats.table import read_annotation_json
from twin.errors import DriveError


def mark(label: str, **told: Any) -> dict[str, Any]:
    """One keypoint, and what was written about it in a box that belongs to no image."""
    value = {"x": 1, "y": 1, "keypointlabels": [label]}
    size = {"original_width": 1000, "original_height": 500}
    return {"id": label, "type": "keypointlabels", "value": value} | size | told


NOTE = {"id": "note", "type": "textarea", "to_name": "notes", "value": {"text": ["near Åre."]}}


@pytest.mark.parametrize(
    ("data", "told", "images"),
    [
        ({"left": "l/1.jpg", "right": "r/1.jpg"}, {"to_name": "right"}, ["r/1.jpg", "l/1.jpg"]),
        ({"one": "l/1.jpg", "other": "r/1.jpg"}, {"to_name": "img"}, []),
        ({"pages": ["l/1.jpg", "r/1.jpg"]}, {"to_name": "left", "item_index": 1}, ["r/1.jpg", "l/1.jpg"]),
        ({"image": "l/1.jpg", "notes": "E6. Åre."}, {"to_name": "left"}, ["l/1.jpg", "l/1.jpg"]),
    ],
)
def test_region_of_a_task_with_several_images_is_of_one(
    data: dict[str, Any], told: dict[str, Any], images: list[str]
) -> None:
    """By a tag that is called as its column, or a place in a list; else neither is taken for granted."""
    marks = [mark("202", **told), mark("204", to_name="left", item_index=0), NOTE]
    file = read_labelstudio([{"id": 7, "data": data, "annotations": [{"result": marks}]}], "a.json")
    assert [shape.image for shape in file.shapes] == images
    assert len(images) + sum(counts(file.skipped).values()) == 2


def test_export_as_json_min_is_refused() -> None:
    """What was said of a region stands beside it there, and not whose it is."""
    task = {"image": "12.jpg", "id": 1, "label": [{"x": 1, "y": 2}], "annotator": 1, "annotation_id": 1}
    with pytest.raises(DriveError, match=r"a\.json is Label Studio's JSON-MIN.* export it as JSON\."):
        read_annotation_json(json.dumps([task]).encode(), "a.json")
