"""Pictures of a board to try a calibration on, rendered through a camera that is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from geoloc.arrays import ByteArray
from geoloc.cameras import CameraModel, FThetaCamera
from geoloc.simulation.car import CAMERAS
from geoloc.simulation.pictures.board_views import draw_board_poses
from geoloc.simulation.pictures.render import Plane, render_planes
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.boards.pictures import Progress
from twin.calibrate.camera_files import new_rig_document, rig_text
from twin.errors import ConfigError, RefusedError
from twin.store.folders import make_folder

EXAMPLE_BOARD = "charuco:12x9:0.06:0.045"
EXAMPLE_CAMERA = "C3_tricam120"
N_PICTURES = 24
TRUE_RIG, PICTURES = "true_rig.json", "pictures"


def example_camera(name: str = EXAMPLE_CAMERA) -> FThetaCamera:
    """Return a camera of the simulated car at half its resolution.

    Raises
    ------
    ConfigError
        If the car has no such camera.
    """
    if name not in CAMERAS:
        raise ConfigError(f"There is no camera {name} on the simulated car: it has {', '.join(CAMERAS)}.")
    model = CAMERAS[name][0]
    return replace(
        model,
        width_px=model.width_px // 2,
        height_px=model.height_px // 2,
        # The middle of the first of two pixels lies a quarter of the new pixel before its middle.
        cx_px=(model.cx_px + 0.5) / 2.0 - 0.5,
        cy_px=(model.cy_px + 0.5) / 2.0 - 0.5,
        theta_from_r=tuple(k * 2.0**power for power, k in enumerate(model.theta_from_r or ())),
    )


def write_example(
    out: Path,
    *,
    camera: str = EXAMPLE_CAMERA,
    n_pictures: int = N_PICTURES,
    seed: int = 0,
    progress: Progress = lambda _what, _done, _total: None,
) -> list[Path]:
    """Write pictures of a ChArUco board, and the rig that they were rendered by.

    Parameters
    ----------
    out : Path
        A new or an empty folder.
    camera : str
        One of the simulated car's.
    n_pictures : int
    seed : int
        Draws the board's poses, light and noise; the same seed, the same pictures.

    Raises
    ------
    ConfigError, RefusedError
        If the car has no such camera, or the folder holds something.
    """
    model = example_camera(camera)
    folder = picture_folder(out)
    board, rng = board_from_text(EXAMPLE_BOARD), np.random.default_rng(seed)
    files = []
    for number, picture in enumerate(rendered(model, board, n_pictures, rng)):
        files.append(write_picture(folder / f"board_{number + 1:02d}.png", picture))
        progress("rendering", number + 1, n_pictures)
    rig = out / TRUE_RIG
    rig.write_text(rig_text(new_rig_document({camera: model})), encoding="utf-8")
    return [*files, rig]


def picture_folder(out: Path) -> Path:
    """Make the folder of an example's pictures in a new or an empty folder.

    Raises
    ------
    RefusedError
        If the folder holds something.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RefusedError(f"{out} is not an empty folder: name a new one, or remove what it holds.")
    return make_folder(out / PICTURES)


def write_picture(path: Path, grey: ByteArray) -> Path:
    """Write a grey picture as PNG, and return its path."""
    import cv2

    # Not imwrite: on Windows it cannot write names outside of ASCII.
    path.write_bytes(cv2.imencode(".png", grey)[1].tobytes())
    return path


def rendered(
    camera: CameraModel,
    board: Board,
    n: int,
    rng: np.random.Generator,
    *,
    fill: tuple[float, float] = (0.4, 0.9),
    tilt_deg: tuple[float, float] = (10.0, 50.0),
    inside: float = 0.75,
    sagitta_m: float = 0.0,
    blur_px: float = 0.6,
    noise: float = 2.0,
    supersample: int = 2,
) -> Iterator[ByteArray]:
    """Render n pictures of a board: poses as in `draw_board_poses`, a bend as in `Plane`."""
    texture, size_m = board.texture()
    for rotation, position in draw_board_poses(
        camera, size_m, n, rng, fill=fill, tilt_deg=tilt_deg, inside=inside
    ):
        plane = Plane(texture, size_m, rotation, position, sagitta_m)
        yield render_planes(camera, [plane], rng=rng, blur_px=blur_px, noise=noise, supersample=supersample)
