"""Signs that a detector boxed in a video: the frames come out of it, and what it lacks is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import sqlalchemy as sa
from board_drive import BoardDrive, Networks

from twin.drives.detection.run import DetectorOptions
from twin.evidence import GapKind, Role, crop_file, crops_of, gaps_of, make_evidence
from twin.evidence.crops import FaceFrom
from twin.ingest.ingest import ingest_drive
from twin.matching import match
from twin.store import schema
from twin.store.store import Store

DRIVE = BoardDrive()


@pytest.fixture
def video(tmp_path: Path) -> tuple[Path, Path]:
    """A store with both boards of a video as findings, and the drive's folder."""
    folder = DRIVE.write(tmp_path / "drive")
    model = Networks().boards(tmp_path / "boards.onnx")
    with Store.open(tmp_path / "twin.db") as store:
        ingest_drive(store, folder, detector=DetectorOptions(model))
        with store.transaction() as connection:
            store.put_fact(connection, "mirror", {"area": "none"})
        match(store)
    return tmp_path / "twin.db", folder


def of_code(store: Store, code: str) -> str:
    """The finding of the board with this code."""
    change = schema.change.c
    (row,) = store.rows(sa.select(change.change_id).where(change.skiltnummer_seen == code))
    return str(row["change_id"])


def test_boxes_of_a_detector_are_the_faces(video: tuple[Path, Path]) -> None:
    """The face crop is the board as the video has it: inside the outline of its code, or else the box."""
    with Store.open(video[0]) as store:
        assert make_evidence(store).n_with_crops == 2
        for code, colour in (("362.50", 0), ("", 2)):
            faces = [c for c in crops_of(store.rows, of_code(store, code)) if c.role is Role.FACE]
            assert len(faces) >= 2
            assert faces[0].range_m < faces[-1].range_m
            for crop in faces:
                assert crop.proof.face_from is FaceFrom.BOX
                shown = cv2.imread(str(crop_file(store, crop.sha256)))[..., ::-1].astype(int)
                (polygon,) = crop.proof.faces_px
                inside = np.zeros(shown.shape[:2], np.uint8)
                cv2.fillPoly(inside, [np.round(np.array(polygon)).astype(np.int32)], 1)
                inside = cv2.erode(inside, np.ones((13, 13), np.uint8))  # colours of a video run over edges
                assert (len(polygon) > 4) == (code != "")
                assert (shown[inside > 0][:, colour] > 150).all()
                others = np.delete(shown[inside > 0], colour, axis=1)
                assert (others < 110).all()


def test_video_that_ends_early_costs_the_late_frames_alone(video: tuple[Path, Path]) -> None:
    """Cut before the car was near: near views are told as lost, the far one is made."""
    store_path, folder = video
    n_frames = 40
    replace(DRIVE, n_frames=n_frames).encode(folder / "front.mp4")
    with Store.open(store_path) as store:
        make_evidence(store)
        change_id = of_code(store, "362.50")
        crops = crops_of(store.rows, change_id)
        assert [(crop.number, crop.role) for crop in crops] == [(0, Role.FACE), (0, Role.WIDE)]
        assert max(crop.frame for crop in crops) < n_frames
        (gap,) = gaps_of(store.rows, change_id)
        assert gap.kind is GapKind.FRAME_LOST
        assert "front.mp4" in gap.sentence


def test_video_that_holds_nothing_is_a_gap(video: tuple[Path, Path]) -> None:
    """The finding is told, and nothing breaks."""
    (video[1] / "front.mp4").write_bytes(b"\0" * 100)
    with Store.open(video[0]) as store:
        assert make_evidence(store).n_with_crops == 0
        (gap,) = gaps_of(store.rows, of_code(store, ""))
        assert gap.kind is GapKind.UNREADABLE
        assert "front.mp4" in gap.sentence


def test_each_frame_is_decoded_once(video: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Two findings in one video: it is opened once to count its frames, and once to decode them."""
    opened = []
    real = av.open

    def counted(*arguments: object, **options: object) -> object:
        opened.append(arguments)
        return real(*arguments, **options)

    monkeypatch.setattr(av, "open", counted)
    with Store.open(video[0]) as store:
        assert make_evidence(store).n_with_crops == 2
    assert len(opened) == 2
