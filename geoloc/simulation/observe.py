"""What a true camera sees of true feet, and where an annotator clicks."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.rig.rig import RigCamera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.noise import NoiseSpec

SHUTTER_ITERATIONS = 4
"""A foot moves by less than 0.04 rows a row of readout, so that four rounds reach 1e-5 px."""


def horizontal_range_m(
    camera: RigCamera, motion: TrueMotion, feet_m: FloatArray, time_s: FloatArray
) -> FloatArray:
    """Horizontal distance from the camera to each foot, ``(n,)``, at times ``(n,)``."""
    body = motion.at(time_s)
    eye = body.position_m + body.enu_R_rig @ camera.rig_t_camera_m
    return np.asarray(np.linalg.norm((feet_m - eye)[:, :2], axis=-1))


def project(
    noise: NoiseSpec, camera: RigCamera, motion: TrueMotion, feet_m: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Pixels ``(n, 2)`` of feet ``(n, 3)``, each at the moment when the shutter reads the row it falls on."""
    middle = 0.5 * (camera.model.height_px - 1)
    row_time_s = time_s
    for _ in range(SHUTTER_ITERATIONS):
        body = motion.at(row_time_s)
        eye = body.position_m + body.enu_R_rig @ camera.rig_t_camera_m
        to_foot = feet_m - eye
        plan = to_foot[:, :2]
        to_foot[:, :2] -= noise.pole_radius_m * plan / np.linalg.norm(plan, axis=-1, keepdims=True)
        enu_R_camera = body.enu_R_rig @ camera.rig_R_camera
        # Row vector times matrix is the inverse rotation: from the world into the camera.
        point_camera = (to_foot[:, None, :] @ enu_R_camera)[:, 0, :]
        pixel, seen = camera.model.pixel_from_camera_point(point_camera)
        delay_s = (pixel[:, 1] - middle) * noise.row_delay_us * 1e-6
        row_time_s = time_s + np.where(np.isfinite(delay_s), delay_s, 0.0)
    return pixel, seen


def on_the_car(camera: RigCamera, pixel_px: FloatArray) -> BoolArray:
    """True where the camera sees its own car instead of the foot."""
    mask = camera.ego_mask
    if mask is None:
        return np.zeros(len(pixel_px), dtype=np.bool_)
    scale = np.array([mask.shape[1] / camera.model.width_px, mask.shape[0] / camera.model.height_px])
    cell = np.floor((np.nan_to_num(pixel_px) + 0.5) * scale).astype(int)
    column = np.clip(cell[:, 0], 0, mask.shape[1] - 1)
    row = np.clip(cell[:, 1], 0, mask.shape[0] - 1)
    return np.asarray(mask[row, column])


def annotate(
    noise: NoiseSpec, pixel_px: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Click on the pixels: with a trembling hand, and now and then on the wrong one."""
    count = len(pixel_px)
    tremble = rng.normal(size=(count, 2)) * noise.annotation_px
    blunder = rng.random(count) < noise.blunder_rate
    direction = rng.uniform(0.0, 2.0 * np.pi, count)
    jump = rng.uniform(0.5, 1.5, count)[:, None] * noise.blunder_px
    wrong = jump * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return pixel_px + tremble + np.where(blunder[:, None], wrong, 0.0), blunder
