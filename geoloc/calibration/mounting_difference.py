"""Two fits of where one camera sits on the car, compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.rig.rig import RigCamera


@dataclass(frozen=True, slots=True)
class MountingDifference:
    """How the second mounting differs from the first.

    Attributes
    ----------
    turn_rad : float64 (3,)
        Rotation vector in the rig frame: about x (roll), y (pitch, positive is nose down), z (yaw, left).
    moved_m : float64 (3,)
        Along the rig's x, y, z.
    covariance : float64 (6, 6) or None
        Of both, if both fits are right; None where a fit has none.
    by_chance : float or None
        Probability that chance alone makes a difference as large, in units of its covariance.
    """

    turn_rad: FloatArray
    moved_m: FloatArray
    covariance: FloatArray | None = None
    by_chance: float | None = None

    @property
    def angle_rad(self) -> float:
        """By how much the camera is turned."""
        return float(np.linalg.norm(self.turn_rad))


def mounting_difference(
    first: RigCamera,
    second: RigCamera,
    lens_rotation: FloatArray,
    covariances: tuple[FloatArray, FloatArray] | None = None,
) -> MountingDifference:
    """Compare where a camera looks and where it sits.

    Parameters
    ----------
    first, second : RigCamera
    lens_rotation : float64 (3, 3)
        From the axes of the first lens to those of the second (`lens_difference`): what a mounting's angles
        have to make up for.
    covariances : pair of float64 (6, 6), optional
        Of a small rotation about the rig's axes (radians) and of the position (metres), from independent
        data.
    """
    from scipy.spatial.transform import Rotation
    from scipy.stats import chi2

    whole = second.rig_R_camera @ lens_rotation @ first.rig_R_camera.T
    turn = Rotation.from_matrix(whole).as_rotvec()
    moved = second.rig_t_camera_m - first.rig_t_camera_m
    if covariances is None:
        return MountingDifference(turn, moved)
    joint = np.asarray(covariances[0] + covariances[1])
    off = np.concatenate([turn, moved])
    square = float(off @ np.linalg.solve(joint, off))
    return MountingDifference(turn, moved, joint, float(chi2.sf(square, 6)))
