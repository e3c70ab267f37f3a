"""The sample's drive with pictures about its findings, rendered with a mask of people, vehicles and signs."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.earth.geodesy import utm33_from_geographic
from twin.samples.pictures import EVERY, Studio
from twin.samples.sample import TRIP, sample_drives
from twin.store import schema
from twin.store.kinds import QUIET
from twin.store.poses import poses_from_blob
from twin.store.store import Store

NEAR_M = 22.0
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Filmed:
    """A matched store, and the folder of its drive, which has pictures near the findings.

    ``masks`` says of each pixel: 0 other, 1 person, 2 vehicle, 3 sign face.
    """

    store: Path
    folder: Path
    masks: dict[tuple[str, int], Image]

    def frame(self, camera: str, number: int) -> Image:
        """One picture as it lies in the folder."""
        image = cv2.imread(str(self.folder / camera / f"{number:06d}.jpg"))
        return np.ascontiguousarray(image[..., ::-1])


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
    store = Path(shutil.copy(matched_store, root / "twin.db"))
    point_to(store, folder)
    return Filmed(store, folder, masks)


@pytest.fixture
def filmed(rendered: Filmed, tmp_path: Path) -> Filmed:
    """A store of its own for one test; the pictures are shared."""
    return Filmed(Path(shutil.copy(rendered.store, tmp_path / "twin.db")), rendered.folder, rendered.masks)


@pytest.fixture
def own(filmed: Filmed, tmp_path: Path) -> Filmed:
    """A store and pictures of their own, to damage."""
    folder = Path(shutil.copytree(filmed.folder, tmp_path / TRIP))
    point_to(filmed.store, folder)
    return Filmed(filmed.store, folder, filmed.masks)


def point_to(path: Path, folder: Path) -> None:
    """Let the store take a folder for the one that its drive was read from."""
    with Store.open(path) as store, store.transaction() as connection:
        connection.execute(sa.update(schema.annotation_set).values(folder=str(folder)))


def _frames_near_findings(path: Path, epoch_ns: NDArray[np.int64]) -> Iterator[int]:
    with Store.open(path) as store:
        (drive,) = store.rows(sa.select(schema.drive.c.poses))
        quiet = schema.change.c.verdict.in_([verdict.value for verdict in QUIET])
        found = store.rows(sa.select(schema.change).where(~quiet))
    poses = poses_from_blob(drive["poses"])
    way = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=1)
    places = np.array([(row["east_m"], row["north_m"]) for row in found])
    for number in range(0, epoch_ns.size, EVERY):
        here = way[np.argmin(np.abs(poses.epoch_ns - epoch_ns[number]))]
        if np.hypot(*(places - here).T).min() < NEAR_M:
            yield number
