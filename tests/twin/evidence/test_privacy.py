"""What a crop shows of people, of vehicles and of signs, against the render's own mask of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from board_drive import Networks
from numpy.typing import NDArray

from geoloc.simulation.pictures.scene import Kind
from twin.evidence import Crop, Role, crop_file, crops_of, exportable_crops, make_evidence
from twin.evidence.crops import FaceFrom
from twin.evidence.masker import NetworkMasker
from twin.store.store import Store

MISSING = "e679cb267742"
RIM_PX = 4
"""Outlines are protected with their edge: a pixel or two of what stands behind it is let through there."""
Image = NDArray[np.uint8]


def read(store: Store, crop: Crop) -> Image:
    """The crop as it was written."""
    image = cv2.imread(str(crop_file(store, crop.sha256)), cv2.IMREAD_COLOR)
    return np.ascontiguousarray(image[..., ::-1])


def crops(store: Store) -> list[Crop]:
    """Every crop of the store."""
    return list(exportable_crops(store.rows))


def beneath(filmed: Any, crop: Crop, shown: Image) -> tuple[Image, Image, Image]:
    """The part of the frame that a face crop shows, that of the mask, and the protected faces in it.

    Found by what the faces show, which is as it was: nothing here knows how crops are cut.
    """
    frame, mask = filmed.frame(crop.camera, crop.frame), filmed.masks[crop.camera, crop.frame]
    faces = np.zeros(shown.shape[:2], np.uint8)
    for polygon in crop.proof.faces_px:
        cv2.fillPoly(faces, [np.round(np.array(polygon)).astype(np.int32)], 1)
    sure = cv2.erode(faces, np.ones((3, 3), np.uint8))
    off = cv2.matchTemplate(frame, shown, cv2.TM_SQDIFF, mask=np.repeat(sure[..., None] * 255, 3, axis=2))
    _, _, (left, top), _ = cv2.minMaxLoc(off)
    there = np.s_[top : top + shown.shape[0], left : left + shown.shape[1]]
    return frame[there], mask[there], faces


def test_people_and_vehicles_are_changed_and_signs_are_not(filmed: Any) -> None:
    """Without a network: every pixel of people and vehicles beside the faces differs, none inside them."""
    hidden = protected = 0
    with Store.open(filmed.store) as store:
        make_evidence(store)
        found = [c for c in crops(store) if c.role is Role.FACE and c.proof.faces_px]
        assert len(found) == 9
        for crop in found:
            shown = read(store, crop)
            before, mask, faces = beneath(filmed, crop, shown)
            same = (shown == before).all(axis=2)
            sign = (mask == Kind.SIGN).astype(np.uint8)
            away = cv2.dilate(np.maximum(sign, faces), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) == 0
            others = np.isin(mask, (Kind.PERSON, Kind.VEHICLE)) & away
            assert not same[others].any()
            inside = cv2.erode(faces, np.ones((3, 3), np.uint8)) > 0
            assert same[inside].all()
            hidden, protected = hidden + int(others.sum()), protected + int(inside.sum())
    assert hidden > 300
    assert protected > 50_000


def test_faces_are_found_by_their_outline_alone(filmed: Any) -> None:
    """What is protected is the render's face: nearly all of it, and nearly nothing else."""
    with Store.open(filmed.store) as store:
        make_evidence(store)
        for crop in (c for c in crops(store) if c.role is Role.FACE and c.proof.faces_px):
            assert crop.proof.face_from is FaceFrom.OUTLINE
            _, mask, faces = beneath(filmed, crop, read(store, crop))
            # Of several plates on the pole the lower ones are signs too.
            sign = (mask == Kind.SIGN) & (faces > 0)
            assert sign.sum() > 0.85 * faces.sum(), crop


def test_detail_that_tells_people_apart_is_gone_everywhere_else(filmed: Any) -> None:
    """A wide crop holds, outside the faces, nothing finer than the squares that its proof states."""
    with Store.open(filmed.store) as store:
        make_evidence(store)
        for crop in (c for c in crops_of(store.rows, MISSING) if c.role is Role.FACE):
            grey = cv2.cvtColor(read(store, crop), cv2.COLOR_RGB2GRAY).astype(np.float32)
            cell = min(crop.proof.hidden_px, crop.proof.window_px)
            assert cell >= 3.0
            coarse = cv2.resize(grey, None, fx=1 / cell, fy=1 / cell, interpolation=cv2.INTER_AREA)
            again = cv2.resize(coarse, grey.shape[::-1], interpolation=cv2.INTER_LINEAR)
            # Only the edge between window and surroundings is sharp.
            assert np.median(np.abs(again - grey)) < 2.0
            assert crop.proof.share_clear == 0.0


@pytest.fixture
def network(tmp_path: Path) -> NetworkMasker:
    """A network that calls the same part of every picture a person and another one a kite."""
    boxes = [[[20, 5, 40, 60, 0.3, 0], [60, 5, 90, 60, 0.9, 1]]]
    path = Networks().constant(tmp_path / "people.onnx", np.array(boxes), "{0: 'person', 1: 'kite'}")
    return NetworkMasker(path)


def test_boxes_of_a_network_are_hidden_but_for_the_faces(filmed: Any, network: NetworkMasker) -> None:
    """People are hidden, other classes are not; what lies inside a face is kept also where a box covers it."""
    with Store.open(filmed.store) as store:
        make_evidence(store)
        bare = {(c.change_id, c.number): c for c in crops(store) if c.role is Role.FACE}
        plain = {key: read(store, crop) for key, crop in bare.items()}
        make_evidence(store, masker=network)
        for crop in (c for c in crops(store) if c.role is Role.FACE and c.proof.faces_px):
            assert (crop.proof.masker, crop.proof.version) == ("people.onnx", network.version)
            assert set(crop.proof.labels) <= {"person"}
            before, _, faces = beneath(filmed, crop, read(store, crop))
            inside = cv2.erode(faces, np.ones((3, 3), np.uint8)) > 0
            assert (read(store, crop) == before).all(axis=2)[inside].all()
            assert plain[crop.change_id, crop.number].shape == read(store, crop).shape
        assert any(crop.proof.share_hidden > 0 for crop in crops(store))
        assert all(crop.proof.share_softened > 0 for crop in crops(store))


def test_what_a_network_misses_is_not_shown_finer_than_its_proof_says(
    filmed: Any, network: NetworkMasker
) -> None:
    """Every pixel outside the faces differs from the frame also where no box is: a network misses people."""
    with Store.open(filmed.store) as store:
        make_evidence(store, masker=network)
        for crop in (c for c in crops(store) if c.role is Role.FACE and c.proof.faces_px):
            shown = read(store, crop)
            before, mask, faces = beneath(filmed, crop, shown)
            away = cv2.dilate(faces, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) == 0
            others = np.isin(mask, (Kind.PERSON, Kind.VEHICLE)) & away
            assert not (shown == before).all(axis=2)[others].any()
            assert crop.proof.softened_px >= 2.0


def test_network_without_people_among_its_classes_is_refused(tmp_path: Path) -> None:
    """A sign detector is no masker: the sentence says what its classes are."""
    from twin.errors import ConfigError

    path = Networks().constant(tmp_path / "signs.onnx", np.zeros((1, 1, 6)), "{0: '362.50', 1: 'stop'}")
    with pytest.raises(ConfigError, match=r"No class of signs\.onnx is a person .*362\.50, stop"):
        NetworkMasker(path)


def test_people_at_the_edge_of_the_picture_are_masked(tmp_path: Path) -> None:
    """A detector of signs leaves out what the edge cuts, what is small and what overlaps; a masker must not."""
    boxes = [[[-5, 5, 30, 70, 0.9, 0], [50, 20, 52, 22, 0.2, 0], [0, 5, 33, 70, 0.8, 0], [9, 9, 20, 20, 0.05, 0]]]
    path = Networks().constant(tmp_path / "people.onnx", np.array(boxes), "{0: 'person', 1: 'car'}")
    found = NetworkMasker(path).find(np.zeros((64, 96, 3), np.uint8), (0, 0, 96, 64))
    assert len(found.boxes_px) == 3
