"""Where a sign's face lies in a picture, by hand for a level camera that looks north."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa

from geoloc.earth.geodesy import geographic_from_enu, utm33_from_geographic
from geoloc.trajectory.poses import Poses, part
from twin.evidence.faces import find_faces, outline_of
from twin.evidence.sights import Marked, Place, poses_at, sight_of
from twin.evidence.subjects import drives_of
from twin.store import schema
from twin.store.store import Store

UP_M, FORWARD_M, FOCAL_PX = 1.4, 1.8, 500.0


@pytest.fixture
def camera() -> Any:
    """640 x 400 pixels, 1.4 m above the road, 1.8 m before the rear axle."""
    from geoloc.rig.rig import rig_from_document

    names = {"width": 640, "height": 400, "fx": 500, "fy": 500, "cx": 319.5, "cy": 199.5}
    sensor = {
        "name": "front",
        "protocol": "camera.virtual",
        "properties": {"Model": "pinhole", **{name: str(value) for name, value in names.items()}},
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [FORWARD_M, 0.0, UP_M]},
    }
    document = json.loads(json.dumps({"version": 7, "rig": {"sensors": [sensor]}}))
    return rig_from_document(document, "test").camera("front")


def pose(epochs: tuple[int, ...] = (0,), north_m: tuple[float, ...] = (0.0,)) -> Poses:
    """Level poses that look to true north."""
    n = len(epochs)
    lat, lon = geographic_from_enu(np.full(n, 63.42), np.full(n, 10.4), np.zeros(n), np.array(north_m))
    zero = np.zeros(n)
    return Poses(np.array(epochs), lat, lon, zero + 80.0, *([zero] * 9), np.ones(n, np.bool_), np.full(n, ""))


def place(east_m: float, north_m: float) -> Place:
    """A place by its offset from the first pose."""
    lat, lon = geographic_from_enu(
        np.array([63.42]), np.array([10.4]), np.array([east_m]), np.array([north_m])
    )
    east, north = utm33_from_geographic(lat, lon)
    return Place(float(east[0]), float(north[0]))


def test_foot_and_face_are_where_the_pinhole_says(camera: Any) -> None:
    """3 m to the right and 12 m ahead of the camera: 125 px right of the middle, 41.7 px a metre."""
    sight = sight_of(camera, pose(), place(3.0, 12.0 + FORWARD_M), nvdb=place(2.0, 12.0 + FORWARD_M))
    assert sight is not None
    scale = FOCAL_PX / 12.0
    assert sight.foot_px == pytest.approx([319.5 + 3.0 * scale, 199.5 + UP_M * scale], abs=0.1)
    assert sight.nvdb_px == pytest.approx([319.5 + 2.0 * scale, 199.5 + UP_M * scale], abs=0.1)
    assert sight.window_px[:, 1].min() == pytest.approx(199.5 - (3.6 - UP_M) * scale, abs=2.0)
    # Of a face that looks back along the road a metre is as wide as the camera's own scale.
    assert sight.metre_px[1] == pytest.approx(np.array([[scale, 0.0], [0.0, scale]]), abs=0.3)
    assert sight.range_m == pytest.approx(np.hypot(3.0, 12.0), abs=0.01)


@pytest.mark.parametrize(("east_m", "north_m"), [(0.0, -12.0), (30.0, 5.0), (0.5, 2.0)])
def test_face_behind_beside_or_above_the_picture_is_none(camera: Any, east_m: float, north_m: float) -> None:
    """Nothing is cut of what is not in the picture."""
    assert sight_of(camera, pose(), place(east_m, north_m)) is None


def test_everything_moves_by_what_the_annotation_is_off(camera: Any) -> None:
    """A foot that was clicked 7 px beside the projection moves face and NVDB's place along."""
    there = place(3.0, 14.0)
    plain = sight_of(camera, pose(), there, nvdb=there)
    assert plain is not None
    foot = (float(plain.foot_px[0]) + 7.0, float(plain.foot_px[1]) - 3.0)
    moved = sight_of(camera, pose(), there, nvdb=there, marked=Marked(foot_px=foot))
    assert moved is not None
    assert moved.window_px - plain.window_px == pytest.approx(np.tile([7.0, -3.0], (len(plain.window_px), 1)))
    assert moved.nvdb_px - plain.nvdb_px == pytest.approx([7.0, -3.0])


def test_pose_between_two_frames_lies_between_them_and_none_in_a_gap() -> None:
    """Poses are kept every 0.3 m; over a gap of the track nothing is made up, unless the car stood."""
    track = pose((0, 100_000_000, 3_000_000_000, 9_000_000_000), (0.0, 1.0, 20.0, 20.2))
    asked = poses_at(track, np.array([50_000_000, 1_000_000_000, 5_000_000_000, 10_000_000_000]))
    assert asked.valid.tolist() == [True, False, True, False]
    middle = geographic_from_enu(np.array([63.42]), np.array([10.4]), np.zeros(1), np.array([0.5]))[0]
    assert part(asked, slice(0, 1)).latitude_deg == pytest.approx(middle, abs=1e-8)


def test_outlines_have_the_form_of_their_family() -> None:
    """A speed limit is round; direction signs and plates under others have none of their own."""
    rounds = outline_of("362.50")
    assert rounds is not None
    assert np.hypot(*rounds.T) == pytest.approx(0.5, abs=0.01)
    assert [outline_of(code) for code in ("808.105", "707", "906H", "")] == [None] * 4


def test_no_face_is_found_where_there_is_none() -> None:
    """Noise, a person's head, a car's side: none has the outline of a speed limit."""
    import cv2

    image = np.random.default_rng(5).integers(90, 120, (400, 300, 3)).astype(np.uint8)
    cv2.circle(image, (150, 330), 12, (220, 170, 140), -1)
    cv2.rectangle(image, (20, 120), (260, 260), (150, 30, 120), -1)
    window = np.array([[90.0, 20.0], [210.0, 20.0], [210.0, 370.0], [90.0, 370.0]])
    scale = np.tile(np.array([[100.0, 0.0], [0.0, 100.0]]), (2, 1, 1))
    assert find_faces(image, window, ["362.50", "142"], scale) == ()
    cv2.circle(image, (160, 190), 30, (200, 20, 30), -1)
    (found,) = find_faces(image, window, ["362.50", "142"], scale)
    assert found.mean(axis=0) == pytest.approx([160.0, 190.0], abs=1.0)
    assert np.ptp(found, axis=0) == pytest.approx([63.0, 63.0], abs=4.0)


def test_rig_and_folder_of_a_drive_are_those_of_the_store(opened: Store) -> None:
    """As ingested."""
    (row,) = opened.rows(sa.select(schema.drive.c.drive_id))
    with opened.snapshot() as view:
        drive = drives_of(view, [row["drive_id"]])[row["drive_id"]]
    assert drive.folder.endswith("trip_trondheim")
    assert set(drive.cameras) <= set(drive.rig.cameras)
