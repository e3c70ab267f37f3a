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


def beneath(filmed: Any, crop: Crop) -> tuple[Image, Image, Image]:
    """The part of the frame that a crop shows, that of the mask, and the protected faces in it."""
    left, top, right, low = crop.proof.place_px
    there = np.s_[top:low, left:right]
    frame, mask = filmed.frame(crop.camera, crop.frame), filmed.masks[crop.camera, crop.frame]
    faces = np.zeros((low - top, right - left), np.uint8)
    for polygon in crop.proof.faces_px:
        cv2.fillPoly(faces, [np.round(np.array(polygon)).astype(np.int32)], 1)
    return frame[there], mask[there], faces


def unmasked_people(filmed: Any, crop: Crop, shown: Image) -> tuple[int, int]:
    """How many pixels of people and vehicles beside the faces a crop has, and how many are as they were."""
    before, mask, faces = beneath(filmed, crop)
    assert shown.shape == before.shape
    away = cv2.dilate(faces, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) == 0
    people = np.isin(mask, (Kind.PERSON, Kind.VEHICLE)) & away
    return int(people.sum()), int((shown == before).all(axis=2)[people].sum())


def test_people_and_vehicles_are_changed_and_signs_are_not(made: Any) -> None:
    """Without a network: every pixel of people and vehicles beside the faces differs, none inside them."""
    people = protected = 0
    with Store.open(made.store) as store:
        found = crops(store)
        assert len(found) == 24
        for crop in found:
            shown = read(store, crop)
            n_people, n_same = unmasked_people(made, crop, shown)
            assert n_same == 0, crop
            people += n_people
            if crop.role is Role.FACE:
                before, _, faces = beneath(made, crop)
                inside = cv2.erode(faces, np.ones((3, 3), np.uint8)) > 0
                assert (shown == before).all(axis=2)[inside].all()
                protected += int(inside.sum())
    assert people > 100_000
    assert protected > 50_000


def test_faces_are_found_by_their_outline_alone(made: Any) -> None:
    """What is protected is the render's face, plates under it too: nearly all of it, and little else."""
    with Store.open(made.store) as store:
        found = [c for c in crops(store) if c.role is Role.FACE and c.change_id != MISSING]
        for crop in found:
            assert crop.proof.face_from is FaceFrom.OUTLINE
            _, mask, faces = beneath(made, crop)
            sign = mask == Kind.SIGN
            _, part = cv2.connectedComponents(sign.astype(np.uint8))
            face = np.isin(part, np.unique(part[(faces > 0) & sign]))
            both = np.count_nonzero(face & (faces > 0))
            assert both > 0.95 * face.sum(), crop
            assert both > 0.75 * faces.sum(), crop
    assert len(found) == 9


def test_place_where_nobody_saw_a_sign_is_shown_coarsely(made: Any) -> None:
    """Nothing is protected there, and nothing is finer than the squares that the proof states."""
    with Store.open(made.store) as store:
        for crop in (c for c in crops_of(store.rows, MISSING) if c.role is Role.FACE):
            assert (crop.proof.face_from, crop.proof.share_clear) == (FaceFrom.NOWHERE, 0.0)
            grey = cv2.cvtColor(read(store, crop), cv2.COLOR_RGB2GRAY).astype(np.float32)
            cell = crop.proof.window_px
            assert cell >= 3.0
            coarse = cv2.resize(grey, None, fx=1 / cell, fy=1 / cell, interpolation=cv2.INTER_AREA)
            again = cv2.resize(coarse, grey.shape[::-1], interpolation=cv2.INTER_LINEAR)
            # The edge between window and surroundings alone is sharp.
            assert np.median(np.abs(again - grey)) < 2.0


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> NetworkMasker:
    """A network that calls the same part of every picture a person and another one a kite."""
    boxes = [[[20, 5, 40, 60, 0.3, 0], [60, 5, 90, 60, 0.9, 1]]]
    folder = tmp_path_factory.mktemp("network")
    path = Networks().constant(folder / "people.onnx", np.array(boxes), "{0: 'person', 1: 'kite'}")
    return NetworkMasker(path)


@pytest.fixture(scope="module")
def by_network(rendered: Any, network: NetworkMasker, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Crops that were made with it; only read."""
    copy = rendered.copied(tmp_path_factory.mktemp("by_network"))
    with Store.open(copy.store) as store:
        make_evidence(store, masker=network)
    return copy


def test_boxes_of_a_network_are_hidden_but_for_the_faces(by_network: Any, network: NetworkMasker) -> None:
    """People are hidden, kites are not; and inside a face nothing changes, whatever box covers it."""
    with Store.open(by_network.store) as store:
        found = crops(store)
        assert len(found) == 24
        for crop in found:
            assert (crop.proof.masker, crop.proof.version) == ("people.onnx", network.version)
            assert set(crop.proof.labels) <= {"person"}
            if crop.role is Role.FACE:
                before, _, faces = beneath(by_network, crop)
                inside = cv2.erode(faces, np.ones((3, 3), np.uint8)) > 0
                assert (read(store, crop) == before).all(axis=2)[inside].all()
        assert any(crop.proof.share_hidden > 0.05 for crop in found)


def test_what_a_network_misses_is_not_shown_as_it_was(by_network: Any) -> None:
    """A network misses people: what shows them differs from the frame also where no box is.

    Wide crops are compressed with loss, which by chance gives a pixel in a hundred thousand its value back.
    """
    people = same = 0
    with Store.open(by_network.store) as store:
        for crop in crops(store):
            n_people, n_same = unmasked_people(by_network, crop, read(store, crop))
            assert n_same == 0 or crop.role is Role.WIDE
            people, same = people + n_people, same + n_same
            assert crop.proof.softened_px >= 2.0
    assert same < 1e-4 * people


def test_network_without_people_among_its_classes_is_refused(tmp_path: Path) -> None:
    """A sign detector is no masker: the sentence says what its classes are."""
    from twin.errors import ConfigError

    path = Networks().constant(tmp_path / "signs.onnx", np.zeros((1, 1, 6)), "{0: '362.50', 1: 'stop'}")
    with pytest.raises(ConfigError, match=r"No class of signs\.onnx is a person .*362\.50, stop"):
        NetworkMasker(path)


def test_people_at_the_edge_of_the_picture_are_masked(tmp_path: Path) -> None:
    """A detector of signs leaves out what the edge cuts, what is small, what overlaps; a masker must not."""
    boxes = [
        [[-5, 5, 30, 70, 0.9, 0], [50, 20, 52, 22, 0.2, 0], [0, 5, 33, 70, 0.8, 0], [9, 9, 20, 20, 0.05, 0]]
    ]
    path = Networks().constant(tmp_path / "people.onnx", np.array(boxes), "{0: 'person', 1: 'car'}")
    found = NetworkMasker(path).find(np.zeros((64, 96, 3), np.uint8), (0, 0, 96, 64))
    assert len(found.boxes_px) == 3
