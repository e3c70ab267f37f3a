"""Poses of a board in front of a camera, as somebody who calibrates well would show it."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.base import CameraModel

_TRIES = 400
_OUTLINE = 9
# Steps of the plastic number: each further point falls into the largest gap (Roberts 2018).
_STEPS = (0.7548776662466927, 0.5698402909980532)


def draw_board_poses(
    model: CameraModel,
    size_m: tuple[float, float],
    n: int,
    rng: np.random.Generator,
    *,
    fill: tuple[float, float] = (0.35, 0.7),
    tilt_deg: tuple[float, float] = (10.0, 50.0),
    inside: float = 1.0,
) -> list[tuple[FloatArray, FloatArray]]:
    """Draw poses of a board: spread over the image, near, tilted in all directions, turned about its normal.

    Parameters
    ----------
    model : CameraModel
    size_m : (float, float)
        Width and height of the board.
    n : int
    rng : numpy Generator
    fill : (float, float)
        Range of the board's width as part of the image's, seen straight on.
    tilt_deg : (float, float)
        Range of the angle between the board's normal and the line of sight.
    inside : float
        Least part of the board's outline that is on the image.

    Returns
    -------
    list of (float64 (3, 3), float64 (3,))
        ``camera_R_board`` and ``camera_t_board_m``: origin at the board's top-left corner, x right, y down.

    Raises
    ------
    ValueError
        If no pose shows that much of the board.
    """
    place, made = rng.uniform(size=2), list[tuple[FloatArray, FloatArray]]()
    image = np.array([model.width_px - 1.0, model.height_px - 1.0])
    for _ in range(_TRIES * n):
        if len(made) == n:
            return made
        place = (place + _STEPS) % 1.0
        ray, known = model.camera_ray_from_pixel(place * image)
        pose = _pose(model, ray, size_m, rng, fill, tilt_deg)
        if known and _part_inside(model, pose, size_m) >= inside:
            made.append(pose)
    if len(made) == n:
        return made
    raise ValueError(f"only {len(made)} of {n} poses show {inside:.0%} of the board: show it smaller")


def _pose(
    model: CameraModel,
    ray: FloatArray,
    size_m: tuple[float, float],
    rng: np.random.Generator,
    fill: tuple[float, float],
    tilt_deg: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Board whose middle lies on a ray."""
    from scipy.spatial.transform import Rotation

    azimuth, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(*tilt_deg))
    lean = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
    right = np.cross((0.0, 1.0, 0.0), ray)
    right /= np.linalg.norm(right)
    towards = np.column_stack([right, np.cross(ray, right), ray])
    rotation = towards @ (lean * turn).as_matrix()
    # A pixel's angle in the middle of the image: what fills half of it does so by eye, not by formula.
    middle = np.array([[0.5 * model.width_px, 0.5 * model.height_px], [0.5 * model.width_px + 1.0] * 2])
    middle[1, 1] = middle[0, 1]
    rays, _ = model.camera_ray_from_pixel(middle)
    focal_px = 1.0 / float(np.linalg.norm(rays[1] - rays[0]))
    distance = focal_px * size_m[0] / (rng.uniform(*fill) * model.width_px)
    return rotation, distance * ray - rotation @ np.array([0.5 * size_m[0], 0.5 * size_m[1], 0.0])


def _part_inside(
    model: CameraModel, pose: tuple[FloatArray, FloatArray], size_m: tuple[float, float]
) -> float:
    """Part of a grid over the board that is on the image, seen from the front and nowhere from behind."""
    along = np.linspace(0.0, 1.0, _OUTLINE)
    x, y = np.meshgrid(along * size_m[0], along * size_m[1])
    rotation, position = pose
    point = np.stack([x, y, np.zeros_like(x)], axis=-1) @ rotation.T + position
    front = (point @ rotation[:, 2] > 0.0) & (np.linalg.norm(point, axis=-1) > 0.02)
    return float(model.pixel_from_camera_point(point)[1].mean()) if front.all() else 0.0
