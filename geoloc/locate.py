"""One sighting → position and covariance: the paper's method and the true ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.geodesy import geographic_from_enu, inverse_haversine, rotation_enu_from_rig
from geoloc.ground import MAX_RANGE_M, intersect_plane, miss_reason
from geoloc.poses import Poses
from geoloc.rig import Rig
from geoloc.sensitivity import Hits, ray_by_pixel
from geoloc.visibility import on_the_car_itself

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_STEP_PX = 0.25
_REASON_TYPE = "U160"


@dataclass(frozen=True, slots=True)
class Sightings:
    """Pixels of objects in frames.

    Attributes
    ----------
    camera : str (n,)
        Name of the camera in the rig.
    pixel_px : float64 (n, 2)
        Foot of the pole; (0, 0) is the centre of the first pixel.
    """

    camera: NDArray[np.str_]
    pixel_px: FloatArray


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """One-sigma noise of each source, and why (``docs/error-budget.md``).

    Random sources are independent from frame to frame; systematic ones are the same for all frames of a
    camera or of a drive, so that averaging does not remove them.
    """

    pixel_px: float = 1.5
    """Annotator and detector, random."""
    pitch_jitter_deg: float = 0.15
    """Body motion against the ground plane, random."""
    roll_jitter_deg: float = 0.15
    """Body motion against the ground plane, random."""
    ground_height_m: float = 0.05
    """Kerb and camber: the foot's height over the rig's plane, systematic for an object."""
    ground_slope_deg: float = 0.4
    """Grade of the road between car and object, systematic for an object."""
    boresight_deg: float = 0.2
    """Mounting error of a camera about each axis, systematic for a camera."""
    time_ms: float = 10.0
    """Camera clock against GNSS, systematic for a drive."""
    lever_arm_m: float = 0.03
    """Antenna and camera positions on the car, systematic for a drive."""


@dataclass(frozen=True, slots=True)
class Located:
    """Positions of sightings.

    Rows that could not be located are NaN, with the reason in `rejected`.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float64 (n,)
        Foot of the object; `height_m` ellipsoidal.
    covariance_m2 : float64 (n, 2, 2)
        Total, east and true north.
    random_m2 : float64 (n, 2, 2)
        The part that is independent from frame to frame.
    systematic_m : float64 (n, 2, k)
        One column a systematic source, scaled to one sigma: ``covariance = random + S Sᵀ``. The same column
        is the same error in every sighting.
    source : tuple of str
        Names of the k columns, e.g. ``boresight pitch C3_tricam120``, ``time``.
    range_m : float64 (n,)
        Horizontal distance from the camera to the foot.
    rejected : str (n,)
        "" where located.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    covariance_m2: FloatArray
    random_m2: FloatArray
    systematic_m: FloatArray
    source: tuple[str, ...]
    range_m: FloatArray
    rejected: NDArray[np.str_]

    @property
    def valid(self) -> BoolArray:
        """True where the sighting was located."""
        return np.asarray(self.rejected == "")


_DEFAULT_BUDGET = ErrorBudget()


def locate_single_frame(
    rig: Rig,
    sightings: Sightings,
    poses: Poses,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    max_range_m: float = MAX_RANGE_M,
) -> Located:
    """Locate each sighting from its own frame: the true ray of its pixel, cut with the road's plane.

    The ray of the camera model is turned into the rig frame and meets the plane z = 0 of the rig, on which
    the car's wheels stand. Pitch and roll of the pose say how that plane lies in the world; heading turns the
    point to east and north, and the ellipsoidal direct problem gives its coordinates.

    Parameters
    ----------
    rig : Rig
    sightings : Sightings (n,)
    poses : Poses (n,)
        The rig's pose at the epoch of each sighting.
    budget : ErrorBudget
    max_range_m : float
        Hits further from the camera are refused.

    Returns
    -------
    Located
        Rejected, with the reason: an invalid pose, a pixel outside the image or the model's domain or on the
        car itself, a ray that does not go down, a hit beyond `max_range_m`.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    hits, rejected = _hits(rig, sightings, poses, max_range_m)
    enu_R_rig = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    offset = np.einsum("nij,nj->ni", enu_R_rig, hits.point_m)
    lat, lon = geographic_from_enu(poses.latitude_deg, poses.longitude_deg, offset[:, 0], offset[:, 1])
    moves = _moves(sightings, hits, enu_R_rig, poses, budget)
    return _located(lat, lon, poses.height_m + offset[:, 2], moves, hits.range_m, rejected)


def locate_paper(
    rig: Rig,
    sightings: Sightings,
    nearest: Poses,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    fix_interval_s: float = 0.2,
    delay_ms: float = 78.0,
    max_range_m: float = MAX_RANGE_M,
) -> Located:
    """Locate each sighting as the paper does: the baseline that everything is compared with.

    The paper leaves some things open; they are read like this. The distance d is the horizontal length, from
    the rig's origin, of the point where the true ray meets the rig's ground plane. Equation 1 gives the
    azimuth ``θ = (FOV / w) (p_x - w/2) + ψ_camera + θ_car``, with p_x counted from the image's left edge
    (half a pixel more than ours), FOV the camera's horizontal field of view, ψ_camera the camera's yaw turned
    clockwise (the rig's is counter-clockwise), and θ_car the heading of the fix. Equations 2 and 3 are the
    inverse haversine on a sphere of 6371 km, starting from the fix whose host stamp is nearest to that of the
    frame: no interpolation, no lever arm, no correction for late stamps.

    Parameters
    ----------
    nearest : Poses (n,)
        From `Trajectory.nearest_fix`.
    fix_interval_s : float
        Time between fixes: the nearest one is off by a uniform ± half of it, random.
    delay_ms : float
        How late host stamps are (`Trajectory.delay_ms`): taken as one sigma, systematic.

    Returns
    -------
    Located
        Rejections as in `locate_single_frame`. The covariance is that of the exact model with the two terms
        of time added. It leaves out what the method itself gets wrong: the bearing that is linear in the
        pixel, the lever arm of antenna and camera, the sphere. `height_m` is that of the fix: the paper gives
        no height.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.

    Notes
    -----
    Shami, Kiss, Haakonsen and Lindseth (2024), arXiv:2401.07582.
    """
    hits, rejected = _hits(rig, sightings, nearest, max_range_m)
    azimuth = _paper_azimuth(rig, sightings) + nearest.heading_deg
    rejected = np.where(
        (rejected == "") & np.isnan(azimuth), "the camera's field of view leaves its model's domain", rejected
    )
    distance = np.hypot(hits.point_m[:, 0], hits.point_m[:, 1])
    lat, lon = inverse_haversine(nearest.latitude_deg, nearest.longitude_deg, azimuth, distance)
    enu_R_rig = rotation_enu_from_rig(nearest.heading_deg, nearest.pitch_deg, nearest.roll_deg)
    moves = _moves(sightings, hits, enu_R_rig, nearest, budget)
    along = enu_R_rig[:, :2, 0] * nearest.speed_mps[:, None]
    moves.random.append(along * fix_interval_s / np.sqrt(12.0))
    moves.systematic["link delay"] = along * delay_ms * 1e-3
    return _located(lat, lon, nearest.height_m, moves, hits.range_m, rejected)


class _Moves(NamedTuple):
    """Moves of the points, east and north, for one sigma of each source: float64 (n, 2) each."""

    random: list[FloatArray]
    systematic: dict[str, FloatArray]


def _paper_azimuth(rig: Rig, sightings: Sightings) -> FloatArray:
    """Equation 1 of the paper without the car's heading, degrees."""
    azimuth = np.full(sightings.camera.size, np.nan)
    for name in np.unique(sightings.camera):
        rows = np.flatnonzero(sightings.camera == name)
        camera = rig.camera(str(name))
        width = camera.model.width_px
        p_x = sightings.pixel_px[rows, 0] + 0.5
        axis = camera.rig_R_camera[:, 2]
        yaw = np.arctan2(axis[1], axis[0])
        angle = camera.model.horizontal_fov_rad / width * (p_x - width / 2.0) - yaw
        azimuth[rows] = np.degrees(angle)
    return azimuth


def _hits(rig: Rig, sightings: Sightings, poses: Poses, max_range_m: float) -> tuple[Hits, NDArray[np.str_]]:
    """Cut the ray of every sighting with the ground, a camera at a time."""
    n = sightings.camera.size
    point, ray, origin = (np.full((n, 3), np.nan) for _ in range(3))
    slope, rotation = np.full((n, 3, 2), np.nan), np.full((n, 3, 3), np.nan)
    rejected = poses.reason.astype(_REASON_TYPE)
    rejected[~poses.valid & (rejected == "")] = "no pose"
    for name in np.unique(sightings.camera):
        rows = np.flatnonzero(sightings.camera == name)
        camera = rig.camera(str(name))
        pixel = sightings.pixel_px[rows]
        rays, in_domain = camera.model.camera_ray_from_pixel(pixel)
        rig_ray = rays @ camera.rig_R_camera.T
        foot, _ = intersect_plane(camera.rig_t_camera_m, rig_ray, max_range_m=max_range_m)
        reason = np.where(
            in_domain,
            miss_reason(camera.rig_t_camera_m, rig_ray, max_range_m=max_range_m).astype(_REASON_TYPE),
            "outside the camera's image or model",
        )
        reason = np.where(on_the_car_itself(camera, pixel), "on the car itself", reason)
        rejected[rows] = np.where(rejected[rows] == "", reason, rejected[rows])
        ray[rows], origin[rows], rotation[rows] = rig_ray, camera.rig_t_camera_m, camera.rig_R_camera
        point[rows] = np.where((rejected[rows] == "")[:, None], foot, np.nan)
        for axis, step in enumerate(np.eye(2) * _STEP_PX):
            ahead = camera.model.camera_ray_from_pixel(pixel + step)
            behind = camera.model.camera_ray_from_pixel(pixel - step)
            slope[rows, :, axis] = ray_by_pixel(rays, ahead, behind, _STEP_PX) @ camera.rig_R_camera.T
    return Hits(point, ray, slope, origin, rotation), rejected


def _moves(
    sightings: Sightings, hits: Hits, enu_R_rig: FloatArray, poses: Poses, budget: ErrorBudget
) -> _Moves:
    """How far one sigma of each source moves the points."""

    def enu(move_rig: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nij,nj->ni", enu_R_rig[:, :2], move_rig))

    point = np.einsum("nij,nj->ni", enu_R_rig, hits.point_m)
    forward = enu_R_rig[:, :, 0]
    # The axis of pitch lies level, to the left of the heading; that of roll is the rig's own x.
    left = np.stack([-forward[:, 1], forward[:, 0], np.zeros(forward.shape[0])], axis=1)
    left /= np.hypot(forward[:, 0], forward[:, 1])[:, None]
    pitch, roll = np.radians(budget.pitch_jitter_deg), np.radians(budget.roll_jitter_deg)
    tilt = np.radians(poses.sigma_roll_pitch_deg)[:, None]
    heading = np.radians(poses.sigma_heading_deg)[:, None]
    gnss = poses.sigma_horizontal_m
    still = np.zeros_like(gnss)
    random = [
        budget.pixel_px * enu(hits.by_pixel(0)),
        budget.pixel_px * enu(hits.by_pixel(1)),
        pitch * enu(hits.by_body(1)),
        roll * enu(hits.by_body(0)),
    ]
    shared = {
        "time": forward[:, :2] * (poses.speed_mps * budget.time_ms * 1e-3)[:, None],
        "gnss east": np.stack([gnss, still], axis=1),
        "gnss north": np.stack([still, gnss], axis=1),
        "heading": heading * np.stack([point[:, 1], -point[:, 0]], axis=1),
        # The plane turns with the pose: no sliding along rays, the point keeps its place on the plane.
        "pose pitch": tilt * np.cross(left, point)[:, :2],
        "pose roll": tilt * np.cross(forward, point)[:, :2],
        "lever arm x": budget.lever_arm_m * forward[:, :2],
        "lever arm y": budget.lever_arm_m * enu_R_rig[:, :2, 1],
        "ground height": budget.ground_height_m * enu(hits.by_ground_height()),
        "ground slope": np.radians(budget.ground_slope_deg) * enu(hits.by_ground_slope()),
    }
    boresight = np.radians(budget.boresight_deg)
    of_camera = {
        "boresight pitch": boresight * enu(hits.by_boresight(0)),
        "boresight yaw": boresight * enu(hits.by_boresight(1)),
        "boresight roll": boresight * enu(hits.by_boresight(2)),
        "camera height": budget.lever_arm_m * enu(hits.by_camera_height()),
    }
    per_camera = {
        f"{source} {name}": np.where((sightings.camera == name)[:, None], move, 0.0)
        for name in np.unique(sightings.camera)
        for source, move in of_camera.items()
    }
    return _Moves(random, {**per_camera, **shared})


def _located(
    latitude_deg: FloatArray,
    longitude_deg: FloatArray,
    height_m: FloatArray,
    moves: _Moves,
    range_m: FloatArray,
    rejected: NDArray[np.str_],
) -> Located:
    """Put positions and moves together; rejected rows become NaN throughout."""
    good = rejected == ""
    spread = np.stack(moves.random, axis=2)
    random = spread @ np.swapaxes(spread, 1, 2)
    systematic = np.stack(list(moves.systematic.values()), axis=2)
    systematic[~good], random[~good] = np.nan, np.nan
    return Located(
        latitude_deg=np.where(good, latitude_deg, np.nan),
        longitude_deg=np.where(good, longitude_deg, np.nan),
        height_m=np.where(good, height_m, np.nan),
        covariance_m2=random + systematic @ np.swapaxes(systematic, 1, 2),
        random_m2=random,
        systematic_m=systematic,
        source=tuple(moves.systematic),
        range_m=np.where(good, range_m, np.nan),
        rejected=rejected,
    )
