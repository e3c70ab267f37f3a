"""Tracks that the geometry joins or parts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoloc.trajectory.trajectory import Trajectory
from twin.drives.detection.run import DetectorOptions
from twin.drives.drive import Drive
from twin.drives.objects.join_tracks import with_joined_tracks
from twin.drives.read import read_drive
from twin.ingest.locate import trajectory_of


@pytest.fixture(scope="module")
def detected(
    board_drive: tuple[Any, Path], networks: Any, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Drive, Trajectory]:
    """The drive past two boards as the tracker sees it, and its trajectory."""
    model = networks.boards(tmp_path_factory.mktemp("model") / "boards.onnx")
    drive = read_drive(board_drive[1], detector=DetectorOptions(model, every=2))
    return drive, trajectory_of(drive)


def test_tracks_that_are_right_stay(detected: tuple[Drive, Trajectory]) -> None:
    """Two boards, two tracks: nothing is changed, nothing said."""
    assert with_joined_tracks(*detected) is detected[0]


def test_tracks_of_one_sign_are_joined(detected: tuple[Drive, Trajectory]) -> None:
    """A track that broke in the middle, as behind a lorry, is one object by where it stands."""
    drive, trajectory = detected
    notes = drive.annotations
    late = (notes.object == "d1") & (notes.frame > np.median(notes.frame[notes.object == "d1"]))
    broken = replace(drive, annotations=replace(notes, object=np.where(late, "d9", notes.object)))
    joined = with_joined_tracks(broken, trajectory)
    assert np.array_equal(joined.annotations.object, notes.object)
    assert "3 tracks are 2 objects" in joined.warnings[-1].sentence


def test_track_that_jumped_is_parted(detected: tuple[Drive, Trajectory]) -> None:
    """One track that goes over from one board to the other is two objects."""
    drive, trajectory = detected
    notes = drive.annotations
    keep = np.where(notes.frame % 4 == 0, notes.object == "d1", notes.object == "d2")
    mixed = {name: getattr(notes, name)[keep] for name in type(notes).__slots__}
    jumped = replace(drive, annotations=type(notes)(**mixed | {"object": np.full(int(keep.sum()), "d1")}))
    parted = with_joined_tracks(jumped, trajectory).annotations.object
    first = notes.object[keep] == "d1"
    assert np.unique(parted).size == 2
    assert np.unique(parted[first]).size == np.unique(parted[~first]).size == 1


def test_two_signs_in_one_picture_are_never_joined(detected: tuple[Drive, Trajectory]) -> None:
    """Whatever the geometry says of their tracks: one thing has one box in a picture."""
    drive, trajectory = detected
    twice = replace(
        drive,
        annotations=type(drive.annotations)(
            **{
                name: np.concatenate([getattr(drive.annotations, name)] * 2)
                for name in type(drive.annotations).__slots__
            }
        ),
    )
    again = np.char.add(drive.annotations.object, "b")
    names = np.concatenate([drive.annotations.object, again])
    doubled = replace(twice, annotations=replace(twice.annotations, object=names))
    assert np.unique(with_joined_tracks(doubled, trajectory).annotations.object).size == 4


def test_drive_without_boxes_stays_as_it_is(detected: tuple[Drive, Trajectory]) -> None:
    """A detector that found nothing leaves nothing to join."""
    drive, trajectory = detected
    none = {name: getattr(drive.annotations, name)[:0] for name in type(drive.annotations).__slots__}
    empty = replace(drive, annotations=type(drive.annotations)(**none))
    assert with_joined_tracks(empty, trajectory) is empty
