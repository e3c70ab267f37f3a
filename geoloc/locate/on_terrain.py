"""One sighting → position and covariance where the ground is known: the true ray, cut with the terrain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray, TextArray
from geoloc.cameras.base import Columns
from geoloc.cameras.nominal import LENS_ERRORS, lens_moves
from geoloc.earth.geodesy import (
    geographic_from_utm33,
    grid_convergence_deg,
    rotation_enu_from_rig,
    utm33_from_geographic,
    utm33_scale,
)
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import LENS_SOURCES
from geoloc.locate.records import Located, Sightings
from geoloc.locate.single_frame import ErrorBudget
from geoloc.locate.visibility import on_the_car_itself
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.rig.rig import Rig
from geoloc.trajectory.poses import Poses

WHEELBASE_M, TRACK_M = 2.7, 1.55
"""Of an ordinary passenger car: the terrain under its wheels says how it stands."""

MAX_STEP_M = 2.0
"""A terrain model that lies further from the car's height is not the ground that it drives on."""
_DEFAULT_BUDGET = ErrorBudget()
# Where the terrain is sampled under the car, rig frame: rear axle to front axle, right wheel to left wheel.
_FOOTPRINT = np.stack(
    np.meshgrid(np.linspace(0.0, WHEELBASE_M, 7), np.linspace(-0.5, 0.5, 5) * TRACK_M), axis=-1
).reshape(-1, 2)
_PLANE_FIT = np.linalg.pinv(np.column_stack([np.ones(len(_FOOTPRINT)), _FOOTPRINT]))


@dataclass(frozen=True, slots=True)
class _Stand:
    """How the car stands on the terrain. Axes: grid east, grid north, up (EPSG:25833, ellipsoidal).

    Attributes
    ----------
    origin_m : float64 (n, 3)
        The rig's origin, on the terrain.
    R_rig : float64 (n, 3, 3)
        From the rig.
    pose_rad, terrain_rad : float64 (n, 2)
        What is left of the errors of pitch and roll: of the pose, and of the wheels on the terrain.
    """

    origin_m: FloatArray
    R_rig: FloatArray
    pose_rad: FloatArray
    terrain_rad: FloatArray


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays of all sightings in the axes of `_Stand`, unit length on the ground: float64 (n, 3) each.

    Attributes
    ----------
    by_pixel : float64 (n, 3, 2)
        Derivative of the ray by u and v.
    R_camera : float64 (n, 3, 3)
        From the camera.
    lens_px : float64 (n, 2, 5)
        How far one sigma of each of the lens's errors moves the pixel.
    """

    camera_m: FloatArray
    ray: FloatArray
    by_pixel: FloatArray
    R_camera: FloatArray
    lens_px: FloatArray


def locate_on_terrain(
    rig: Rig,
    sightings: Sightings,
    poses: Poses,
    terrain: Terrain,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    max_range_m: float = MAX_RANGE_M,
) -> Located:
    """Locate each sighting from its own frame: the true ray of its pixel, cut with the terrain.

    The car is set down on the terrain where the pose says that it is, so an error of height that the whole
    raster shares does no harm to the position. Pitch and roll are the mean, by inverse variance, of the
    pose's and of those that the wheels have on the terrain.

    Parameters
    ----------
    rig : Rig
    sightings : Sightings (n,)
    poses : Poses (n,)
        The rig's pose at the epoch of each sighting.
    terrain : Terrain
    budget : ErrorBudget
        ``ground_height_m`` is what a kerb that the raster does not show adds; ``ground_slope_deg`` is not
        used, as the terrain knows the slope.
    max_range_m : float
        Hits further from the camera are refused.

    Returns
    -------
    Located
        `height_m` is the terrain's. Rejected, with the reason: as in `locate_single_frame`, and where the
        terrain is not known, or not at the car's height: on a bridge, which a terrain model leaves out.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    stand = _stand(poses, terrain, budget)
    scale = utm33_scale(poses.latitude_deg, poses.longitude_deg)[:, None]
    rays, rejected = _rays(rig, sightings, poses, stand, scale, budget)
    rejected = np.where(rejected == "", _off_the_ground(poses, stand), rejected)
    hits = terrain.intersect(rays.camera_m, rays.ray, max_range_m)
    rejected = np.where(rejected == "", hits.reason, rejected)
    # At the edge of the known ground, where the slope is not known, level ground stands in for it.
    gradient = np.nan_to_num(terrain.slope(hits.point_m[:, 0], hits.point_m[:, 1]))
    normal = np.concatenate([-gradient, np.ones((len(gradient), 1))], axis=1)
    slide = _Slide(rays.ray, normal)
    random, systematic = _moves(sightings, poses, terrain, budget, stand, rays, hits.point_m, slide)
    true_R_grid = _true_from_grid(poses, scale)
    reach_m = np.hypot(*(hits.point_m - rays.camera_m)[:, :2].T) / scale[:, 0]
    return _located(
        hits.point_m,
        true_R_grid @ np.stack([move[:, :2] for move in random], axis=2),
        true_R_grid @ np.stack([move[:, :2] for move in systematic.values()], axis=2),
        tuple(systematic),
        reach_m,
        rejected,
    )


def _located(
    point_m: FloatArray,
    spread_m: FloatArray,
    systematic_m: FloatArray,
    source: tuple[str, ...],
    range_m: FloatArray,
    rejected: TextArray,
) -> Located:
    """Put positions and moves together; rejected rows become NaN throughout."""
    lost = rejected != ""
    lat, lon = geographic_from_utm33(point_m[:, 0], point_m[:, 1])
    random_m2 = spread_m @ np.swapaxes(spread_m, 1, 2)
    systematic_m = systematic_m.copy()
    random_m2[lost], systematic_m[lost] = np.nan, np.nan
    return Located(
        latitude_deg=np.where(lost, np.nan, lat),
        longitude_deg=np.where(lost, np.nan, lon),
        height_m=np.where(lost, np.nan, point_m[:, 2]),
        covariance_m2=random_m2 + systematic_m @ np.swapaxes(systematic_m, 1, 2),
        random_m2=random_m2,
        systematic_m=systematic_m,
        source=source,
        range_m=np.where(lost, np.nan, range_m),
        rejected=rejected,
    )


def _stand(poses: Poses, terrain: Terrain, budget: ErrorBudget) -> _Stand:
    """Set the car down on the terrain."""
    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    heading = poses.heading_deg - grid_convergence_deg(poses.latitude_deg, poses.longitude_deg)
    sin, cos = np.sin(np.radians(heading))[:, None], np.cos(np.radians(heading))[:, None]
    ahead, left = _FOOTPRINT.T
    under = terrain.height_m(
        east[:, None] + ahead * sin - left * cos, north[:, None] + ahead * cos + left * sin
    )
    up, rise_ahead, rise_left = (under @ _PLANE_FIT.T).T
    own = np.degrees(np.stack([-np.arctan(rise_ahead), np.arctan(rise_left)], axis=1))
    posed = np.stack([poses.pitch_deg, poses.roll_deg], axis=1)
    posed_sigma = np.radians(np.stack([poses.sigma_pitch_deg, poses.sigma_roll_deg], axis=1))
    own_sigma = np.hypot(
        _tilt_noise_rad(terrain), np.radians([budget.pitch_jitter_deg, budget.roll_jitter_deg])
    )
    # Both exact would leave nothing to weigh by: then the pose counts.
    weight = own_sigma**2 / np.maximum(own_sigma**2 + posed_sigma**2, 1e-30)
    weight = np.where((own_sigma == 0.0) & (posed_sigma == 0.0), 1.0, weight)
    pitch, roll = (weight * posed + (1.0 - weight) * own).T
    return _Stand(
        origin_m=np.stack([east, north, up], axis=1),
        R_rig=rotation_enu_from_rig(heading, pitch, roll),
        pose_rad=weight * posed_sigma,
        terrain_rad=(1.0 - weight) * own_sigma,
    )


def _off_the_ground(poses: Poses, stand: _Stand) -> TextArray:
    """Why the terrain under the car is not what it stands on; "" where it is."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(stand.origin_m[:, 2] - poses.height_m)
        elsewhere = apart > np.maximum(MAX_STEP_M, 4.0 * poses.sigma_vertical_m)
    return np.select(
        [np.isnan(stand.R_rig[:, 0, 0] + stand.origin_m[:, 2]), elsewhere],
        [Reason.TERRAIN_UNKNOWN_AT_CAR, Reason.OTHER_GROUND],
        default="",
    )


def _tilt_noise_rad(terrain: Terrain) -> FloatArray:
    """What the noise of the nodes under the car does to its pitch and roll, one sigma, float64 (2,)."""
    length = np.array([WHEELBASE_M, TRACK_M])
    nodes = np.prod(length / terrain.step_m + 1.0)
    # Spread of the nodes along each axis: uniform under the car, at least that of one pair of nodes.
    spread = np.hypot(length / np.sqrt(12.0), terrain.step_m / 2.0)
    return np.asarray(terrain.noise_m / (np.sqrt(nodes) * spread))


def _rays(
    rig: Rig,
    sightings: Sightings,
    poses: Poses,
    stand: _Stand,
    scale: FloatArray,
    budget: ErrorBudget,
) -> tuple[_Rays, TextArray]:
    """Rays of all sightings, a camera at a time, and why some have none."""
    n = sightings.camera.size
    camera_m, ray = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    by_pixel, R_camera = np.full((n, 3, 2), np.nan), np.full((n, 3, 3), np.nan)
    lens_px = np.zeros((n, 2, LENS_ERRORS))
    rejected = poses.reason.astype(REASON_TYPE)
    rejected[~poses.valid & (rejected == "")] = Reason.NO_POSE
    # Metres of the world to metres of the grid, which stretches sideways alone.
    stretch = np.concatenate([scale, scale, np.ones_like(scale)], axis=1)
    for name in np.unique(sightings.camera):
        rows = np.flatnonzero(sightings.camera == name)
        camera = rig.camera(str(name))
        pixel = sightings.pixel_px[rows]
        with np.errstate(all="ignore"):  # outside the model's domain anything may come out
            seen = camera.model.rays(pixel[:, 0], pixel[:, 1], slopes=True)
        R_camera[rows] = stretch[rows, :, None] * (stand.R_rig[rows] @ camera.rig_R_camera)
        camera_m[rows] = stretch[rows] * (stand.R_rig[rows] @ camera.rig_t_camera_m)
        ray[rows] = np.where(seen.inside[:, None], _turned(R_camera[rows], seen.ray), np.nan)
        for axis, slope in enumerate((seen.by_u, seen.by_v)):
            by_pixel[rows, :, axis] = _turned(R_camera[rows], slope)
        lens = budget.lens_of(camera)
        if not lens.is_exact:
            lens_px[rows] = lens_moves(camera.model, pixel) * lens.of_errors()
        reason = np.where(seen.inside, "", Reason.OUTSIDE_CAMERA)
        reason = np.where(on_the_car_itself(camera, pixel), Reason.ON_CAR, reason)
        rejected[rows] = np.where(rejected[rows] == "", reason, rejected[rows])
    return _Rays(stand.origin_m + camera_m, ray, by_pixel, R_camera, lens_px), rejected


def _turned(rotation: FloatArray, vectors: Columns | None) -> FloatArray:
    if vectors is None:
        raise ValueError("the rays were made without their slopes")
    return np.asarray(np.einsum("nij,nj->ni", rotation, np.stack(vectors, axis=1)))


@dataclass(frozen=True, slots=True)
class _Slide:
    """Brings displaced points back to the tangent plane of the terrain along their rays."""

    ray: FloatArray
    normal: FloatArray

    def __call__(self, displacement_m: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.einsum("ni,ni->n", self.normal, displacement_m)
            back = off / np.einsum("ni,ni->n", self.normal, self.ray)
        return np.asarray(displacement_m - back[:, None] * self.ray)

    def raised(self) -> FloatArray:
        """Move of the foot a metre that the ground there is higher."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.ray / np.einsum("ni,ni->n", self.normal, self.ray)[:, None])


def _moves(
    sightings: Sightings,
    poses: Poses,
    terrain: Terrain,
    budget: ErrorBudget,
    stand: _Stand,
    rays: _Rays,
    point_m: FloatArray,
    slide: _Slide,
) -> tuple[list[FloatArray], dict[str, FloatArray]]:
    """How far one sigma of each source moves the points: random and systematic, float64 (n, 3) each.

    Sources bear the names that they have in `locate_single_frame`.
    """
    n = len(point_m)
    forward, left = stand.R_rig[:, :, 0], stand.R_rig[:, :, 1]
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (n, 3))
    arm, reach = point_m - stand.origin_m, point_m - rays.camera_m
    length = np.linalg.norm(reach, axis=1)[:, None]
    pitched, rolled = slide(np.cross(left, arm)), slide(np.cross(forward, arm))
    raised = slide.raised()
    random = [
        budget.pixel_px * slide(length * rays.by_pixel[:, :, 0]),
        budget.pixel_px * slide(length * rays.by_pixel[:, :, 1]),
        stand.terrain_rad[:, :1] * pitched,
        stand.terrain_rad[:, 1:] * rolled,
        terrain.noise_m * raised,
    ]
    gnss, still = poses.sigma_horizontal_m, np.zeros(n)
    lever = budget.lever_arm_m
    shared = {
        "time": forward * (poses.speed_mps * budget.time_ms * 1e-3)[:, None],
        "gnss east": np.stack([gnss, still, still], axis=1),
        "gnss north": np.stack([still, gnss, still], axis=1),
        "heading": np.radians(poses.sigma_heading_deg)[:, None] * slide(-np.cross(up, arm)),
        "pose pitch": stand.pose_rad[:, :1] * pitched,
        "pose roll": stand.pose_rad[:, 1:] * rolled,
        "lever arm x": lever * forward,
        "lever arm y": lever * left,
        "ground height": float(np.hypot(budget.ground_height_m, terrain.noise_m)) * raised,
    }
    boresight = np.radians(budget.boresight_deg)
    of_camera = {
        f"boresight {what}": boresight * slide(np.cross(rays.R_camera[:, :, axis], reach))
        for axis, what in enumerate(("pitch", "yaw", "roll"))
    }
    of_camera |= {"camera height": budget.camera_position_m * slide(stand.R_rig[:, :, 2])}
    if rays.lens_px.any():
        turned = length[:, :, None] * (rays.by_pixel @ rays.lens_px)
        of_camera |= {what: slide(turned[:, :, k]) for k, what in enumerate(LENS_SOURCES)}
    per_camera = {
        f"{source} {name}": np.where((sightings.camera == name)[:, None], move, 0.0)
        for name in np.unique(sightings.camera)
        for source, move in of_camera.items()
    }
    return random, {**per_camera, **shared}


def _true_from_grid(poses: Poses, scale: FloatArray) -> FloatArray:
    """From metres on the grid to metres east and true north, float64 (n, 2, 2)."""
    gamma = np.radians(grid_convergence_deg(poses.latitude_deg, poses.longitude_deg))
    cos, sin = np.cos(gamma) / scale[:, 0], np.sin(gamma) / scale[:, 0]
    return np.stack([np.stack([cos, sin], axis=-1), np.stack([-sin, cos], axis=-1)], axis=-2)
