"""Where an object is by the first frame that shows it, with an ellipse that holds far ahead too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoloc.adjustment.build_model import Place
from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, rotation_enu_from_rig
from geoloc.locate.error_budget import ErrorBudget
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import locate_single_frame
from geoloc.rig.rig import Rig
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.smoother.tilt import climb_ahead

# In sigmas: how far an ellipse of 95 % reaches, and a distance that one sight of seventy exceeds. With that
# the ellipse holds 94 to 97 of 100 feet from 12 to 40 m ahead: inward next to none are outside.
_ELLIPSE, _SELDOM = float(np.sqrt(-2.0 * np.log(0.05))), 2.2
# A steel pole of 60 mm is a pixel wide there: nobody sees where it meets the ground.
_FARTHEST_M = 100.0
# The climb of a road to the far end decides where that is.
_ROUNDS = 3


def placed_by_one_frame(
    rig: Rig, camera: str, pixel_px: tuple[float, float], pose: Poses, budget: ErrorBudget
) -> tuple[Place, FloatArray] | None:
    """Locate a foot by one frame, before any other has shown it.

    Its distance is that at which the ray meets the plane under the car. Two things are added to the budget of
    single frames (`locate_single_frame`), which is one for signs 15 m away. Over 40 m a road's climb changes
    by more than the ground's slope beside it, by what the trajectory takes it to (`climb_ahead`). And the
    distance is the inverse of an angle: what seems to stand 22 m ahead may well stand at 40, hardly at 10.
    The ellipse of 95 % therefore reaches as far as only one sight of seventy goes beyond, but no farther than
    feet can be seen, and is as much wider.

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
    place = Place(float(located.latitude_deg[0]), float(located.longitude_deg[0]), float(located.height_m[0]))
    sight = _sight(rig, camera, pose, place)
    range_m = float(np.hypot(*sight))
    # The variance grows with the square of the slope: by two of them that of all.
    steeper = replace(budget, ground_slope_deg=budget.ground_slope_deg + 1.0)
    steep = locate_single_frame(rig, sighting, pose, steeper).covariance_m2[0]
    own_deg2, covariance, reach = budget.ground_slope_deg**2, located.covariance_m2[0], 0.0
    by_slope = (steep - covariance) / (steeper.ground_slope_deg**2 - own_deg2)
    for _ in range(_ROUNDS):
        climb_deg = float(np.degrees(climb_ahead(np.array([(1.0 + reach) * range_m]))[0]))
        covariance = located.covariance_m2[0] + max(climb_deg**2 - own_deg2, 0.0) * by_slope
        sigma = float(np.sqrt(sight @ covariance @ sight)) / range_m**2
        reach = _reach(sigma, _FARTHEST_M / range_m - 1.0)
    longer = reach / (_ELLIPSE * sigma)
    wider = max(longer, 1.0)
    scale = wider * np.eye(2) + (longer - wider) * np.outer(sight, sight) / range_m**2
    return place, scale @ covariance @ scale


def _reach(sigma: float, most: float) -> float:
    """Half the length of an ellipse of 95 %, all in shares of the distance; `sigma` where it is."""
    outward = _SELDOM * sigma
    outward = outward / (1.0 - outward) if outward < 1.0 else np.inf
    return float(min(max(outward, _ELLIPSE * sigma), most))


def _sight(rig: Rig, camera: str, pose: Poses, place: Place) -> FloatArray:
    """From the camera to a place, east and north."""
    east, north = enu_offset(float(pose.latitude_deg[0]), float(pose.longitude_deg[0]), *place[:2])
    turn = rotation_enu_from_rig(pose.heading_deg, pose.pitch_deg, pose.roll_deg)[0]
    return np.asarray([float(east), float(north)] - (turn @ rig.camera(camera).rig_t_camera_m)[:2])
