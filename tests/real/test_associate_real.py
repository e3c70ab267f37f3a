"""Association against ids that people and trackers gave: KITTI's sign boxes and Argoverse's bollards."""

from __future__ import annotations

import csv
from typing import Any

import numpy as np
import pytest
from checkout import REAL
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.association.associate import associate, check_ids
from geoloc.locate.observations import Observations
from geoloc.locate.records import Sightings
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.ingest.locate import trajectory_of

BOXES = REAL / "kitti_signs" / "associated_boxes.csv"


def _pair_score(truth: NDArray[np.str_], found: IntArray) -> tuple[float, float]:
    """Precision and recall over pairs of sightings."""
    _, number = np.unique(truth, return_inverse=True)
    table = np.zeros((number.max() + 1, found.max() + 1))
    np.add.at(table, (number[found >= 0], found[found >= 0]), 1)
    together, put, are = (
        float((n * (n - 1.0) / 2.0).sum())
        for n in (table, table.sum(axis=0), np.bincount(number).astype(float))
    )
    return together / put, together / are


def _given(
    drive: Drive,
    camera: NDArray[np.str_],
    frame: IntArray,
    pixel_px: NDArray[np.float64],
    kind: NDArray[np.str_],
) -> tuple[Any, ...]:
    """Observations without labels."""
    epoch = np.array([drive.frame_epoch_ns[c][f] for c, f in zip(camera.tolist(), frame, strict=True)])
    unknown = np.full(frame.shape, -1)
    sightings = Sightings(camera, pixel_px)
    observations = Observations(drive.rig, sightings, kind, unknown, epoch, trajectory_of(drive))
    return observations, np.full(frame.shape, "")


@pytest.mark.parametrize("sequence", ["00", "02", "04", "07", "10"])
def test_kitti_boxes_become_their_signs(kitti_folders: list[Any], sequence: str) -> None:
    """All human boxes, of repeated passages too, become exactly their signs, and no id is doubted."""
    (folder,) = (made.folder for made in kitti_folders if made.folder.name == f"kitti-{sequence}")
    drive = read_drive(folder)
    with BOXES.open(encoding="utf-8") as file:
        boxes = [row for row in csv.DictReader(file) if row["seq"] == sequence]
    corners = np.array([[float(row[k]) for k in ("x1", "y1", "x3", "y3")] for row in boxes])
    sign = np.array([row["gt_id"] for row in boxes])
    n = sign.size
    given = _given(
        drive,
        np.full(n, str(drive.annotations.camera[0])),
        np.array([int(row["frame"]) for row in boxes]),
        (corners[:, :2] + corners[:, 2:]) / 2.0,
        np.full(n, "box"),
    )
    found = associate(*given)
    assert _pair_score(sign, found.object) == (1.0, 1.0)
    assert len(found.objects) == np.unique(sign).size
    assert check_ids(*given, sign) == ()


def test_argoverse_feet_become_their_objects(av2_near_trondheim: list[Any]) -> None:
    """Feet seen by nine cameras on a hilly street become exactly their bollards and cones."""
    drive = read_drive(av2_near_trondheim[0].folder)
    notes = drive.annotations
    given = _given(drive, notes.camera, notes.frame, notes.pixel_px, notes.kind)
    found = associate(*given)
    assert _pair_score(notes.object, found.object) == (1.0, 1.0)
    assert len(found.objects) == np.unique(notes.object).size
    assert check_ids(*given, notes.object) == ()
