"""Where to begin when a camera clock is seconds off: by which shift of it rays cross best.

The adjustment takes the car's speed and turning as constant over what the clock is off, so that it finds its
way over some tenths of a second only.
"""

from __future__ import annotations

import numpy as np

from geoloc.adjustment.build_model import Placed
from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.earth.geodesy import enu_offset, rotation_enu_from_rig
from geoloc.rig.rig import Rig
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.trajectory import Trajectory

_TRIED_S = np.arange(-3.0, 3.01, 0.25)
# Rays that miss by more are slips of the hand or cross behind the car.
_FAR_RAD = np.radians(3.0)
# Honest clocks stay where they are: their rays cross better by another one by chance alone.
_MUCH_BETTER = 0.5
_ENOUGH, _FEWEST_POINTS, _MOST_POINTS = 6, 5, 60
_MOST = 0.8


def first_shift_s(rig: Rig, camera: TextArray, placed: Placed, trajectory: Trajectory) -> float:
    """Shift of the camera clock by which rays cross much better than by none; 0 where none does.

    Parameters
    ----------
    camera : str (n,)
        Of all sightings.
    placed : Placed
        Sightings that have a ray and a pose by the clock as it is stated.
    """
    count = np.bincount(placed.point, minlength=placed.object.size)
    known = np.flatnonzero(count >= _ENOUGH)
    if known.size < _FEWEST_POINTS:
        return 0.0
    some = known[np.linspace(0, known.size - 1, min(known.size, _MOST_POINTS)).astype(np.int64)]
    keep = np.isin(placed.point, some)
    rows, point = placed.row[keep], np.searchsorted(some, placed.point[keep])
    cameras = [rig.camera(str(name)) for name in camera[rows]]
    turn = np.array([one.rig_R_camera for one in cameras])
    arm = np.array([one.rig_t_camera_m for one in cameras])
    ray = np.einsum("nij,nj->ni", turn, placed.rays.ray[rows])

    def miss(shift_s: float, of: BoolArray) -> tuple[float, BoolArray]:
        epoch_ns = placed.epoch_ns[rows[of]] + round(shift_s * NANOSECONDS)
        square, there = _miss(trajectory, epoch_ns, ray[of], arm[of], point[of])
        tried = of.copy()
        tried[of] = there
        return square, tried

    every = np.ones(rows.size, dtype=np.bool_)
    found = [miss(shift_s, every) for shift_s in _TRIED_S]
    best = int(np.argmin([square for square, _ in found]))
    # The same sightings by the stated clock: at the ends of a drive some have no pose by the other.
    stated, _ = miss(0.0, found[best][1])
    return float(_TRIED_S[best]) if found[best][0] < _MUCH_BETTER * stated else 0.0


def _miss(
    trajectory: Trajectory, epoch_ns: IntArray, ray: FloatArray, arm_m: FloatArray, point: IntArray
) -> tuple[float, BoolArray]:
    """By how much rays (n, 3) miss the places where those of each point cross best, and which have a pose.

    A mean square of angles; infinite where too few rays have one.
    """
    poses = trajectory.poses_at(epoch_ns)
    there = poses.valid
    if np.count_nonzero(there) < _MOST * there.size:
        return np.inf, there
    rotation = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)[there]
    point = point[there]
    away = np.einsum("nij,nj->ni", rotation, ray[there])
    home = np.full((point.max() + 1, 2), np.nan)
    home[point] = np.stack([poses.latitude_deg, poses.longitude_deg], axis=1)[there]
    latitude, longitude = poses.latitude_deg[there], poses.longitude_deg[there]
    east, north = enu_offset(home[point, 0], home[point, 1], latitude, longitude)
    eye = np.stack([east, north, poses.height_m[there]], axis=1)
    eye = eye + np.einsum("nij,nj->ni", rotation, arm_m[there])
    across = np.eye(3) - away[:, :, None] * away[:, None, :]
    normal, right = np.zeros((len(home), 3, 3)), np.zeros((len(home), 3))
    np.add.at(normal, point, across)
    np.add.at(right, point, np.einsum("nij,nj->ni", across, eye))
    # Rays without parallax, or none at all, cross anywhere.
    crossing = np.linalg.solve(normal + 1e-9 * np.eye(3), right[:, :, None])[:, :, 0]
    to_point = crossing[point] - eye
    off = np.einsum("nij,nj->ni", across, to_point)
    angle = np.linalg.norm(off, axis=1) / np.maximum(np.linalg.norm(to_point, axis=1), 1e-6)
    behind = np.einsum("ni,ni->n", to_point, away) <= 0.0
    return float(np.mean(np.minimum(np.where(behind, _FAR_RAD, angle), _FAR_RAD) ** 2)), there
