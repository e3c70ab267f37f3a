"""The sample's drive, annotated with other tools than CVAT: the same annotations come out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.drives.drive import Annotations
from twin.drives.read import read_drive

Rows = list[dict[str, Any]]
SIZE = {"width": 1920, "height": 1208}


def rows_of(notes: Annotations, camera: str) -> Rows:
    """One camera's feet, as a tool counts pixels."""
    keys = ("frame", "object", "label", "skiltnummer")
    return [
        {key: getattr(notes, key)[i] for key in keys}
        | {"x": float(notes.pixel_px[i, 0]) + 0.5, "y": float(notes.pixel_px[i, 1]) + 0.5}
        for i in np.flatnonzero(notes.camera == camera)
    ]


def as_csv(rows: Rows) -> tuple[str, str]:
    """A table."""
    head = "frame,object,label,skiltnummer,x_px,y_px\n"
    lines = (
        f"{r['frame']},{r['object']},{r['label']},{r['skiltnummer']},{r['x']!r},{r['y']!r}\n" for r in rows
    )
    return "csv", head + "".join(lines)


def as_coco(rows: Rows) -> tuple[str, str]:
    """Objects of one keypoint."""
    images = [{"id": int(f), "file_name": f"{f:06d}.png"} | SIZE for f in sorted({r["frame"] for r in rows})]
    annotations = [
        {
            "image_id": int(r["frame"]),
            "category_id": 1,
            "bbox": [r["x"] - 9, r["y"] - 90, 18, 90],
            "keypoints": [r["x"], r["y"], 2],
            "attributes": {"object": str(r["object"]), "skiltnummer": str(r["skiltnummer"])},
        }
        for r in rows
    ]
    categories = [{"id": 1, "name": "skilt", "keypoints": ["foot"]}]
    return "json", json.dumps({"images": images, "annotations": annotations, "categories": categories})


def as_label_studio(rows: Rows) -> tuple[str, str]:
    """A task for each image; object and sign code are said of each region."""
    tasks = []
    for frame in sorted({r["frame"] for r in rows}):
        results: list[dict[str, Any]] = []
        for number, r in enumerate(row for row in rows if row["frame"] == frame):
            size = {"original_width": SIZE["width"], "original_height": SIZE["height"]}
            value = {"x": r["x"] / 19.20, "y": r["y"] / 12.08, "width": 0.2, "keypointlabels": ["skilt"]}
            results.append({"id": str(number), "type": "keypointlabels", "value": value} | size)
            results += (
                {"id": str(number), "type": "textarea", "from_name": k, "value": {"text": [str(r[k])]}}
                for k in ("object", "skiltnummer")
            )
        image = f"/data/upload/3/0a1b2c3d-{frame:06d}.png"
        tasks.append({"id": 7, "data": {"image": image}, "annotations": [{"result": results}]})
    return "json", json.dumps(tasks)


@pytest.mark.parametrize("tool", [as_csv, as_coco, as_label_studio])
def test_sample_annotated_with_another_tool_is_the_same_drive(
    tool: Callable[[Rows], tuple[str, str]], trip: Path
) -> None:
    """Camera, frame, object, label, code, kind and pixel of every row."""
    before = read_drive(trip)
    for camera in ("C2_tricam60", "C3_tricam120"):
        (trip / f"{camera}.xml").unlink()
        suffix, text = tool(rows_of(before.annotations, camera))
        (trip / f"{camera}.{suffix}").write_text(text)
    after = read_drive(trip)
    assert after.drive_id == before.drive_id
    assert after.warnings == before.warnings
    for name in ("camera", "frame", "object", "label", "skiltnummer", "kind", "has_id"):
        assert np.array_equal(getattr(after.annotations, name), getattr(before.annotations, name))
    np.testing.assert_allclose(after.annotations.pixel_px, before.annotations.pixel_px, atol=1e-9)
