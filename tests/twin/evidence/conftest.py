"""The sample's drive with pictures about its findings, rendered with a mask of people, vehicles and signs."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.earth.geodesy import utm33_from_geographic
from twin.evidence import EvidenceReport, make_evidence
from twin.samples.pictures import Studio
from twin.samples.sample import TRIP, sample_drives
from twin.store import schema
from twin.store.kinds import QUIET
from twin.store.poses import poses_from_blob
from twin.store.store import Store

PAST_M, NEAR_M, STEP = 4.0, 22.0, 12
"""Pictures are painted from so near to so far before a finding, every so many frames."""
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Filmed:
    """A matched store, and the folder of its drive, which has pictures near the findings.

    ``masks`` says of each pixel: 0 other, 1 person, 2 vehicle, 3 sign face; ``report`` is of the run that
    made the crops, where there are any.
    """

    store: Path
    folder: Path
    masks: dict[tuple[str, int], Image]
    report: EvidenceReport | None = None

    def frame(self, camera: str, number: int) -> Image:
        """One picture as it lies in the folder."""
        image = cv2.imread(str(self.folder / camera / f"{number:06d}.jpg"))
        return np.ascontiguousarray(image[..., ::-1])

    def point_to(self, folder: Path) -> None:
        """Let the store take a folder for the one that its drive was read from."""
        with Store.open(self.store) as store, store.transaction() as connection:
            connection.execute(sa.update(schema.annotation_set).values(folder=str(folder)))

    def only(self, *change_ids: str) -> None:
        """Leave no other findings in the store, for tests that are not about their number."""
        with Store.open(self.store) as store, store.transaction() as connection:
            connection.execute(sa.delete(schema.change).where(~schema.change.c.change_id.in_(change_ids)))

    def copied(self, folder: Path) -> Filmed:
        """A store of its own, with its crops; the pictures are shared."""
        crops = self.store.with_name("twin.db.evidence")
        if crops.exists():
            shutil.copytree(crops, folder / crops.name)
        return replace(self, store=Path(shutil.copy(self.store, folder / "twin.db")))


@pytest.fixture(scope="session")
def rendered(sample: Path, matched_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Filmed:
    """Render once; copy before writing."""
    root = tmp_path_factory.mktemp("filmed")
    folder = Path(shutil.copytree(sample / TRIP, root / TRIP))
    drive = sample_drives()[TRIP]
    studio, masks = Studio(drive), {}
    cameras = drive.scenario.cameras
    for camera in cameras:
        (folder / camera).mkdir()
    for number in _frames_near_findings(matched_store, drive.frame_epoch_ns):
        for camera in cameras:
            picture = studio.picture(camera, number)
            cv2.imwrite(str(folder / camera / f"{number:06d}.jpg"), picture.rgb[..., ::-1])
            masks[camera, number] = picture.mask
    with (folder / "drive.toml").open("a") as settings:
        settings.writelines(f'[frames.{name}]\nfile = "{name}"\nnumbered = true\n' for name in cameras)
    made = Filmed(Path(shutil.copy(matched_store, root / "twin.db")), folder, masks)
    made.point_to(folder)
    return made


@pytest.fixture(scope="session")
def with_crops(rendered: Filmed, tmp_path_factory: pytest.TempPathFactory) -> Filmed:
    """The same with crops, made without a network; copy before writing."""
    made = rendered.copied(tmp_path_factory.mktemp("crops"))
    with Store.open(made.store) as store:
        return replace(made, report=make_evidence(store))


@pytest.fixture
def filmed(rendered: Filmed, tmp_path: Path) -> Filmed:
    """A store of its own for one test; the pictures are shared."""
    return rendered.copied(tmp_path)


@pytest.fixture
def made(with_crops: Filmed, tmp_path: Path) -> Filmed:
    """A store and crops of their own for one test."""
    return with_crops.copied(tmp_path)


@pytest.fixture
def own(filmed: Filmed, tmp_path: Path) -> Filmed:
    """A store and pictures of their own, to damage."""
    folder = Path(shutil.copytree(filmed.folder, tmp_path / TRIP))
    filmed.point_to(folder)
    return replace(filmed, folder=folder)


def _frames_near_findings(path: Path, epoch_ns: NDArray[np.int64]) -> Iterator[int]:
    with Store.open(path) as store:
        (drive,) = store.rows(sa.select(schema.drive.c.poses))
        quiet = schema.change.c.verdict.in_([verdict.value for verdict in QUIET])
        found = store.rows(sa.select(schema.change).where(~quiet))
    poses = poses_from_blob(drive["poses"])
    way = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=1)
    places = np.array([(row["east_m"], row["north_m"]) for row in found])
    for number in range(0, epoch_ns.size, STEP):
        k = int(np.argmin(np.abs(poses.epoch_ns - epoch_ns[number])))
        direction = way[min(k + 1, len(way) - 1)] - way[max(k - 1, 0)]
        away = places - way[k]
        ahead_m = away @ direction / np.hypot(*direction)
        if ((ahead_m > PAST_M) & (np.hypot(*away.T) < NEAR_M)).any():
            yield number
