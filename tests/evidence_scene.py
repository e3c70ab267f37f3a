"""The sample's drive with pictures: signs, people and cars drawn where they stand, and a mask of these.

Nothing here knows how evidence is cut: places are those of the sample's truth, seen by the rig's own cameras.
"""

from __future__ import annotations

import csv
import json
import shutil
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.earth.geodesy import geographic_from_utm33, metres_per_degree, rotation_enu_from_rig
from geoloc.rig.rig import Rig, rig_from_document
from geoloc.trajectory.poses import Poses
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Store

CAMERAS = ("C2_tricam60", "C3_tricam120")
FACE_UP_M, FACE_M = 2.5, 0.6
MISSING = 1042500115
RED, WHITE, SKIN, JACKET, CAR = (200, 20, 30), (245, 245, 245), (224, 172, 140), (30, 90, 40), (150, 30, 120)
_STEP = 2.0
Image = NDArray[np.uint8]
_UPWARDS, _DOWNWARDS, _SQUARE, _CIRCLE = (
    [(-0.5, -0.433), (0.0, 0.433), (0.5, -0.433)],
    [(-0.5, 0.433), (0.5, 0.433), (0.0, -0.433)],
    [(-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)],
    [(0.5 * np.cos(a), 0.5 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)],
)
_SHAPES = {
    "516": _SQUARE,
    "512": _SQUARE,
    "522": _SQUARE,
    "202": _DOWNWARDS,
    "142": _UPWARDS,
    "108": _UPWARDS,
}


@dataclass
class Scene:
    """A store that has been matched, and its drive's folder, to be filled with pictures.

    People stand beside, behind and before every pole, a car behind each; their pixels are in ``people``.
    """

    store: Path
    folder: Path
    rig: Rig = field(init=False)
    poses: Poses = field(init=False)
    signs: list[tuple[float, float, str]] = field(init=False)

    def __post_init__(self) -> None:
        with Store.open(self.store) as store:
            (row,) = store.rows(sa.select(schema.drive))
            truth = self.folder.parent / "truth.csv"
            places = {
                r["object"]: (float(r["easting"]), float(r["northing"])) for r in csv.DictReader(truth.open())
            }
            asked = sa.select(schema.estimate.c.object, schema.estimate.c.skiltnummer)
            codes = {r["object"]: r["skiltnummer"].split(";")[0] for r in store.rows(asked)}
            with store.transaction() as connection:
                connection.execute(sa.update(schema.annotation_set).values(folder=str(self.folder)))
        self.rig = rig_from_document(json.loads(zlib.decompress(row["rig"])), "sample")
        self.poses = poses_from_blob(row["poses"])
        self.signs = [(*place, codes[name]) for name, place in places.items() if name in codes]

    def frame(self, camera: str, epoch_ns: int) -> tuple[Image, Image]:
        """What a camera saw, and which of its pixels show people (1), cars (1) or faces of signs (2)."""
        model = self.rig.cameras[camera].model
        image = np.full((model.height_px, model.width_px, 3), (170, 195, 225), np.uint8)
        noise = np.random.default_rng(1).integers(-12, 13, image.shape)
        image[model.height_px // 2 :] = (105, 105, 100)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
        what = np.zeros(image.shape[:2], np.uint8)
        pose = self._pose(epoch_ns)
        things = []
        for east, north, code in self.signs:
            distance = self._distance(pose, east, north)
            if not 2.0 < distance < 45.0:
                continue
            things.append((distance, "sign", east, north, code))
            for ahead, beside in ((4.0, 0.3), (0.4, -0.25), (-1.0, 0.9)):
                things.append(
                    (distance + ahead, "person", *self._beside(pose, east, north, ahead, beside), "")
                )
            things.append((distance + 7.0, "car", *self._beside(pose, east, north, 7.0, 0.0), ""))
        for _, kind, east, north, code in sorted(things, key=lambda t: -t[0]):
            getattr(self, f"_{kind}")(image, what, camera, pose, east, north, code)
        return image, what

    def _pose(self, epoch_ns: int) -> int:
        return int(np.argmin(np.abs(self.poses.epoch_ns - epoch_ns)))

    def _distance(self, pose: int, east: float, north: float) -> float:
        de, dn = self._offset(pose, east, north)
        heading = np.deg2rad(self.poses.heading_deg[pose])
        return float(de * np.sin(heading) + dn * np.cos(heading)) - 1.8

    def _offset(self, pose: int, east: float, north: float) -> tuple[float, float]:
        lat, lon = geographic_from_utm33(east, north)
        per_east, per_north = metres_per_degree(self.poses.latitude_deg[pose])
        return (
            float((lon - self.poses.longitude_deg[pose]) * per_east),
            float((lat - self.poses.latitude_deg[pose]) * per_north),
        )

    def _beside(
        self, pose: int, east: float, north: float, ahead: float, right: float
    ) -> tuple[float, float]:
        """A place further along the way and to the right, on the grid."""
        h = np.deg2rad(
            self.poses.heading_deg[pose] + 4.1
        )  # grid north is 4.1 degrees west of true north here
        return east + ahead * np.sin(h) + right * np.cos(h), north + ahead * np.cos(h) - right * np.sin(h)

    def _pixels(self, camera: str, pose: int, east: float, north: float, shape: Any) -> NDArray[np.float64]:
        """Pixels of points (right, up) [m] of an upright plane that faces the car's heading."""
        p, one = self.poses, self.rig.cameras[camera]
        enu_R_rig = rotation_enu_from_rig(p.heading_deg[pose], p.pitch_deg[pose], p.roll_deg[pose])
        de, dn = self._offset(pose, east, north)
        ground = -(enu_R_rig[0, 2] * de + enu_R_rig[1, 2] * dn) / enu_R_rig[2, 2]
        h = np.deg2rad(p.heading_deg[pose])
        points = np.array([(de + r * np.cos(h), dn - r * np.sin(h), ground + up) for r, up in shape])
        pixel, _ = one.model.pixel_from_camera_point(
            (points @ enu_R_rig - one.rig_t_camera_m) @ one.rig_R_camera
        )
        return pixel

    def _paint(self, image: Image, pixel: NDArray[np.float64], colour: tuple[int, int, int]) -> Image:
        mask = np.zeros(image.shape[:2], np.uint8)
        if np.isfinite(pixel).all():
            cv2.fillPoly(mask, [np.round(pixel * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
        image[mask > 0] = colour
        return mask

    def _sign(
        self, image: Image, what: Image, camera: str, pose: int, east: float, north: float, code: str
    ) -> None:
        pole = [(-0.03, 0.0), (-0.03, FACE_UP_M), (0.03, FACE_UP_M), (0.03, 0.0)]
        what[self._paint(image, self._pixels(camera, pose, east, north, pole), (120, 125, 130)) > 0] = 0
        shape = np.array(_SHAPES.get(code, _CIRCLE))
        for size, colour in ((FACE_M, RED), (0.72 * FACE_M, WHITE), (0.25 * FACE_M, (20, 20, 20))):
            face = shape * size + [0.0, FACE_UP_M]
            what[self._paint(image, self._pixels(camera, pose, east, north, face), colour) > 0] = 2

    def _person(
        self, image: Image, what: Image, camera: str, pose: int, east: float, north: float, _: str
    ) -> None:
        body = [(-0.25, 0.0), (-0.25, 1.5), (0.25, 1.5), (0.25, 0.0)]
        head = [(0.12 * np.cos(a), 1.68 + 0.14 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 24)]
        eyes = [(-0.06, 1.68), (-0.06, 1.72), (0.06, 1.72), (0.06, 1.68)]
        for shape, colour in ((body, JACKET), (head, SKIN), (eyes, (40, 30, 30))):
            what[self._paint(image, self._pixels(camera, pose, east, north, shape), colour) > 0] = 1

    def _car(
        self, image: Image, what: Image, camera: str, pose: int, east: float, north: float, _: str
    ) -> None:
        body = [(-0.9, 0.2), (-0.9, 1.5), (0.9, 1.5), (0.9, 0.2)]
        plate = [(-0.26, 0.5), (-0.26, 0.61), (0.26, 0.61), (0.26, 0.5)]
        for shape, colour in ((body, CAR), (plate, WHITE)):
            what[self._paint(image, self._pixels(camera, pose, east, north, shape), colour) > 0] = 1


def scene_of(matched: Path, sample: Path, folder: Path) -> Scene:
    """Copy the matched store and the sample's drive; its pictures are still empty files."""
    trip = Path(shutil.copytree(sample / "trip_trondheim", folder / "trip_trondheim"))
    shutil.copy(sample / "truth.csv", folder / "truth.csv")
    store = Path(shutil.copy(matched, folder / "twin.db"))
    lines = [f'[frames]\n{camera} = "{camera}"\n' for camera in ()]
    (trip / "drive.toml").write_text((trip / "drive.toml").read_text() + "".join(lines))
    for camera in CAMERAS:
        (trip / f"{camera}_images").mkdir()
    frames = "".join(f'{camera} = "{camera}_images"\n' for camera in CAMERAS)
    (trip / "drive.toml").write_text((trip / "drive.toml").read_text() + f"[frames]\n{frames}")
    return Scene(store, trip)


def stamps(folder: Path, camera: str) -> NDArray[np.int64]:
    """Epochs of a camera's frames."""
    return np.loadtxt(folder / f"{camera}.h264.timestamps", dtype=np.int64)[:, 1] * 1000
