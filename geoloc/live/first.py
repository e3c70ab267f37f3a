"""Where an object is by the first frame that shows it, with an ellipse that holds far ahead too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoloc.adjustment.build_model import Place
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import locate_single_frame
from geoloc.rig.rig import Rig
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.smoother.tilt import climb_ahead

# Beyond this share of the distance its sigma says no more how far the far side lies.
_MOST = 0.6


def placed_by_one_frame(
    rig: Rig, camera: str, pixel_px: tuple[float, float], pose: Poses, budget: ErrorBudget
) -> tuple[Place, FloatArray] | None:
    """Locate a foot by one frame, before any other has shown it.

    Its distance is that at which the ray meets the plane under the car. Two things are added to the budget of
    single frames (`locate_single_frame`), which is one for signs 15 m away. Over 40 m a road's climb changes
    by more than the ground's slope beside it, by what the trajectory takes it to (`climb_ahead`). And as the
    distance is the inverse of an angle, it errs further outward than inward: the ellipse is as long as its
    farther side.

    Parameters
    ----------
    rig : Rig
    camera : str
    pixel_px : (float, float)
    pose : Poses (1,)
    budget : ErrorBudget

    Returns
    -------
    (Place, float64 (2, 2)) or None
        Covariance east and true north, m². None where the ray meets no ground in reach.
    """
    sighting = Sightings(np.array([camera]), np.array([pixel_px]))
    located = locate_single_frame(rig, sighting, pose, budget)
    if not located.valid[0]:
        return None
    slope_deg = float(np.degrees(np.arctan(climb_ahead(located.range_m)[0])))
    steeper = replace(budget, ground_slope_deg=max(budget.ground_slope_deg, slope_deg))
    covariance = locate_single_frame(rig, sighting, pose, steeper).covariance_m2[0]
    place = Place(float(located.latitude_deg[0]), float(located.longitude_deg[0]), float(located.height_m[0]))
    east, north = enu_offset(float(pose.latitude_deg[0]), float(pose.longitude_deg[0]), *place[:2])
    sight = np.array([float(east), float(north)]) / np.hypot(east, north)
    along_m = float(np.sqrt(sight @ covariance @ sight))
    share = min(along_m / float(located.range_m[0]), _MOST)
    farther = along_m**2 * (1.0 / (1.0 - share) ** 2 - 1.0)
    return place, covariance + farther * np.outer(sight, sight)
