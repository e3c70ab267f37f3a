"""Poses of the rig as an adjustment corrected them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoloc.adjustment.model import Model
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_enu, rotation_enu_from_rig
from geoloc.trajectory.poses import Poses


def corrected_poses(model: Model, x: FloatArray, poses: Poses) -> Poses:
    """Give the poses at which a drive's sightings were made, with what the adjustment found out.

    Parameters
    ----------
    model : Model
    x : float64 (u,)
        The unknowns, solved for.
    poses : Poses (n,)
        The trajectory's, of all sightings. One that took no part is corrected as its neighbours in time are.

    Returns
    -------
    Poses (n,)
        Sigmas are those of `poses`.
    """
    known = np.flatnonzero(poses.valid)
    correction = _at(model, x, poses)[known]
    latitude, longitude, height = (
        column.copy() for column in (poses.latitude_deg, poses.longitude_deg, poses.height_m)
    )
    latitude[known], longitude[known] = geographic_from_enu(
        latitude[known], longitude[known], correction[:, 3], correction[:, 4]
    )
    height[known] += correction[:, 5]
    angles = np.stack([poses.heading_deg, poses.pitch_deg, poses.roll_deg], axis=1)
    angles[known] = _turned(angles[known], correction[:, :3])
    heading, pitch, roll = angles.T
    return replace(
        poses,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=heading,
        pitch_deg=pitch,
        roll_deg=roll,
    )


def _at(model: Model, x: FloatArray, poses: Poses) -> FloatArray:
    """Corrections (n, 6) of all poses: of sightings in the model their own, of others in between."""
    scene, own = model.scene, model.corrections(x)
    order = np.argsort(scene.epoch_ns, kind="stable")
    first_ns = scene.epoch_ns[order[0]]
    when, asked = scene.epoch_ns[order] - first_ns, poses.epoch_ns - first_ns
    every = np.stack([np.interp(asked, when, column) for column in own[order].T], axis=1)
    every[scene.row] = own
    return every


def _turned(angles_deg: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Heading, pitch and roll (n, 3) after rotation vectors (n, 3) about the rig's axes."""
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_matrix(rotation_enu_from_rig(*angles_deg.T)) * Rotation.from_rotvec(turn_rad)
    yaw, pitch, roll = attitude.as_euler("ZYX", degrees=True).T
    return np.stack([np.mod(90.0 - yaw, 360.0), pitch, roll], axis=1)
