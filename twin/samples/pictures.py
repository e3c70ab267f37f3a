"""Pictures of the sample's drives: rendered when they are wanted, the same bytes every time.

``python -m twin.samples.pictures data/trip_trondheim demo-out/trip_trondheim`` copies a drive of the sample
and puts pictures beside it.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray
from geoloc.rig.rig import RigCamera
from geoloc.simulation.car import true_camera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import stream
from geoloc.simulation.pictures.scene import Eye, Lens, Painter, Picture
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive
from twin.errors import RefusedError, TwinError
from twin.samples.ground import ground, sky
from twin.samples.sample import SEED, sample_drives
from twin.samples.street import street
from twin.store.folders import make_folder

EVERY = 15
"""Every so many frames has a picture: a multiple of what is annotated, so that each is an annotated one."""
QUALITY = 85
_BONNET = (34, 36, 40)
_NEAR_M, _FAR_M = 8.0, 110.0
"""How far behind and ahead of the car things are painted."""


@dataclass(frozen=True, slots=True)
class PicturesReport:
    """What was written.

    Attributes
    ----------
    folder : Path
        The drive with its pictures.
    n_pictures : int
    n_bytes : int
        Of the pictures.
    """

    folder: Path
    n_pictures: int
    n_bytes: int


class Studio:
    """One drive's world, ready to be painted.

    Parameters
    ----------
    drive : SimulatedDrive
        Its drawn errors are true here: pictures show what the cameras truly saw, not what the rig file says.
    """

    def __init__(self, drive: SimulatedDrive) -> None:
        world = drive.scenario
        self._drive = drive
        self._road = Road(world.road, drive.seed)
        self._motion = TrueMotion(self._road, world.motion, world.noise, drive.seed)
        # The street is built once: every drive passes the same houses, cars and people.
        self._things = street(drive, self._road, stream(SEED, "street"))
        self._places = np.array([thing.place_m[:2] for thing in self._things])
        self._cameras = {name: true_camera(drive.rig.camera(name), drive.drawn) for name in world.cameras}
        self._lenses = {name: Lens(camera.model) for name, camera in self._cameras.items()}
        self._skies = {
            name: sky(camera.model.height_px, camera.model.width_px) for name, camera in self._cameras.items()
        }

        self._bonnets = {
            name: _on_picture(camera, camera.ego_mask)
            for name, camera in self._cameras.items()
            if camera.ego_mask is not None
        }

    def picture(self, camera: str, frame: int) -> Picture:
        """Paint one frame of one camera: RGB, and a mask of people, vehicles and sign faces."""
        time_s = frame / self._drive.scenario.motion.frame_rate_hz
        seen_by = self._cameras[camera]
        eye = self._eye(seen_by, time_s)
        axis = eye.world_R_camera[0][:, 2]
        painter = Painter(eye, self._lenses[camera], self._skies[camera])
        station = float(self._motion.station_m(np.array([time_s]))[0])
        heading = float(np.arctan2(axis[1], axis[0]))
        painter.ground(ground(self._road, eye.position_m.mean(axis=0), heading, station))
        away = self._places - eye.position_m[0, :2]
        ahead = away @ (axis[:2] / np.linalg.norm(axis[:2]))
        near = np.flatnonzero((ahead > -_NEAR_M) & (np.linalg.norm(away, axis=-1) < _FAR_M))
        painter.things([self._things[k] for k in near], time_s)
        picture = painter.picture()
        if camera in self._bonnets:
            picture.rgb[self._bonnets[camera]] = _BONNET
            picture.mask[self._bonnets[camera]] = 0
        return picture

    def _eye(self, camera: RigCamera, time_s: float) -> Eye:
        readout_s = self._drive.scenario.noise.row_delay_us * 1e-6 * (camera.model.height_px - 1)
        body = self._motion.at(time_s + readout_s * np.array([-0.5, 0.5]))
        return Eye(
            camera.model,
            body.position_m + body.enu_R_rig @ camera.rig_t_camera_m,
            body.enu_R_rig @ camera.rig_R_camera,
        )


def _on_picture(camera: RigCamera, mask: BoolArray) -> BoolArray:
    """A mask of the rig file in the picture's own size."""
    import cv2

    size = (camera.model.width_px, camera.model.height_px)
    return np.asarray(cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_LINEAR) > 0)


def with_pictures(
    trip: Path | str,
    out: Path | str,
    *,
    every: int = EVERY,
    masks: Path | str | None = None,
    progress: Callable[[str], None] | None = None,
) -> PicturesReport:
    """Copy a drive of the sample and add pictures of every so many frames.

    ``CAMERA/000012.jpg`` is frame 12, and ``drive.toml`` says so under ``[frames]``.

    Parameters
    ----------
    trip : Path or str
        A drive of the sample; its name says which.
    out : Path or str
        Where to; pictures of an earlier call are replaced.
    every : int
    masks : Path or str, optional
        Where to put the masks, ``CAMERA/000012.png``: 0 other, 1 person, 2 vehicle, 3 sign face.

    Raises
    ------
    TwinError
        It is no drive of the sample, or the folder cannot be written.
    """
    trip, drives = Path(trip), sample_drives()
    drive = drives.get(trip.name)
    if drive is None or not (trip / "drive.toml").is_file():
        raise TwinError(
            f"{trip} is no drive of the sample: only these can be rendered: {', '.join(drives)} in data/."
        )
    out = make_folder(out)
    say = progress or (lambda _text: None)
    cameras = drive.scenario.cameras
    n_pictures, n_bytes = 0, 0
    try:
        for file in sorted(trip.iterdir()):
            if file.is_file():
                shutil.copyfile(file, out / file.name)
        with (out / "drive.toml").open("a", encoding="utf-8") as settings:
            settings.write(
                "".join(f'[frames.{name}]\nfile = "{name}/"\nnumbered = true\n' for name in cameras)
            )
        for camera in cameras:
            make_folder(out / camera)
        for camera, frame, picture in paintings(drive, every):
            if frame % (10 * every) == 0:
                say(f"painting {trip.name}: {camera}, frame {frame:,} of {drive.frame_epoch_ns.size:,}")
            n_bytes += _write(out / camera / f"{frame:06d}.jpg", picture.rgb)
            n_pictures += 1
            if masks is not None:
                _write(make_folder(Path(masks) / camera) / f"{frame:06d}.png", picture.mask)
    except OSError as error:
        raise RefusedError(
            f"The pictures cannot be written to {out}: {error.strerror or error}; free space or name another."
        ) from error
    return PicturesReport(out, n_pictures, n_bytes)


def paintings(drive: SimulatedDrive, every: int = EVERY) -> Iterator[tuple[str, int, Picture]]:
    """Paint every so many frames of a drive's annotated cameras."""
    studio = Studio(drive)
    for camera in drive.scenario.cameras:
        for frame in range(0, drive.frame_epoch_ns.size, every):
            yield camera, frame, studio.picture(camera, frame)


def _write(path: Path, image: NDArray[np.uint8]) -> int:
    import cv2

    bgr = image[..., ::-1] if image.ndim == 3 else image
    done, data = cv2.imencode(path.suffix, bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise TwinError(f"OpenCV cannot write {path}: its build lacks {path.suffix}; install opencv-python.")
    return path.write_bytes(data.tobytes())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``python -m twin.samples.pictures DRIVE OUT``."""
    parser = argparse.ArgumentParser(
        prog="python -m twin.samples.pictures", description="A drive of the sample, with pictures."
    )
    parser.add_argument("drive", type=Path, help="e.g. data/trip_trondheim")
    parser.add_argument("out", type=Path, help="where to, e.g. demo-out/trip_trondheim")
    parser.add_argument("--every", type=int, default=EVERY, help="frames a picture; default: %(default)s")
    parser.add_argument("--masks", type=Path, help="where to put masks of people, vehicles and signs")
    options = parser.parse_args(arguments)
    try:
        report = with_pictures(options.drive, options.out, every=options.every, masks=options.masks)
    except TwinError as error:
        parser.exit(1, f"{error}\n")
    sys.stdout.write(f"{report.n_pictures} pictures, {report.n_bytes / 1e6:.1f} MB in {report.folder}\n")


if __name__ == "__main__":
    main()
