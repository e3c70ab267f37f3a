"""Sightings as bearings: where the camera was, which way the pixel looks, what is known of the depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.earth.geodesy import GRS80_E2, GRS80_SEMI_MAJOR_AXIS_M, rotation_enu_from_rig
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.locate.visibility import on_the_car_itself
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.rig.rig import Rig, RigCamera
from geoloc.trajectory.poses import Poses

_MIN_CAMERA_HEIGHT_M = 0.3
_LATE_NS = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class AssociationRules:
    """What decides whether two sightings are one object. One sigma where nothing else is said."""

    pixel_px: float = 2.0
    """Annotator and detector."""
    angle_deg: float = 0.25
    """Direction of a ray: body motion that poses do not show (0.15°) and mounting of the camera (0.2°)."""
    focal_share: float = 0.0
    """Focal length that nobody calibrated: directions err by this share of their angle off the axis."""
    time_ms: float = 12.0
    """Camera clock and rolling shutter: times the speed, how far the camera stands off its pose."""
    ground_deg: float = 0.7
    """Slope of the ground before the car (real streets: 0.3 to 0.9°): depth of a foot."""
    ground_m: float = 0.1
    """Kerb and camber: depth of a foot."""
    face_inverse_m: float = 0.06
    """Prior of one over the depth of a face, and its sigma `face_sigma_inverse_m`: 8 m to far away."""
    face_sigma_inverse_m: float = 0.06
    gate: float = 20.0
    """Largest squared Mahalanobis distance of a sighting from its object: refuses 1 right one in 22,000."""
    new_per_sr: float = 0.2
    """Density of new objects in the picture, against which every known one competes."""
    memory_s: float = 20.0
    """A track that was not seen for longer takes no part in tracking; merging may still find it."""
    place_m: float = 0.15
    """How far positions of one object from two passages differ beside their covariances, each axis: with
    the gate of merging, objects whose places are known to be 0.6 m apart are two."""
    lean_m: float = 0.3
    """How far a face stands off its pole's foot, level, each axis."""
    stray_deg: float = 6.0
    """A sighting of no known object, this near one that its picture lacks, is a slip of the hand."""


@dataclass(frozen=True, slots=True)
class Bearings:
    """Usable sightings in time order, in geocentric axes about their middle.

    Attributes
    ----------
    row : int64 (n,)
        Row of the sighting as given.
    centre_m, ray, up : float64 (n, 3)
        Camera's position; unit ray; unit vertical.
    camera, frame : int64 (n,)
        Number of the camera, and of the picture (camera and epoch), which does not decrease.
    time_s : float64 (n,)
        Since the first.
    label : int64 (n,)
        0 for "".
    face : bool (n,)
    inverse_m, sigma_inverse_m : float64 (n,)
        What one picture says about one over the distance along the ray.
    sigma_rad, sigma_m : float64 (n,)
        Noise of the direction, and of the camera's position across it.
    """

    row: IntArray
    centre_m: FloatArray
    ray: FloatArray
    up: FloatArray
    camera: IntArray
    frame: IntArray
    time_s: FloatArray
    label: IntArray
    face: BoolArray
    inverse_m: FloatArray
    sigma_inverse_m: FloatArray
    sigma_rad: FloatArray
    sigma_m: FloatArray

    def take(self, rows: IntArray | BoolArray | slice) -> Bearings:
        """Those rows alone."""
        return Bearings(*(getattr(self, name)[rows] for name in self.__slots__))


def bearings_from_sightings(
    observations: Observations,
    poses: Poses,
    label: IntArray,
    rules: AssociationRules,
    about_m: FloatArray | None = None,
) -> tuple[Bearings, TextArray]:
    """Turn sightings into bearings, and say which cannot be used.

    Parameters
    ----------
    observations : Observations (n,)
    poses : Poses (n,)
    label : int64 (n,)
    rules : AssociationRules
    about_m : float64 (3,), optional
        Origin of the geocentric axes. Default: the middle of the sightings.

    Returns
    -------
    bearings : Bearings (k,)
    reason : str (n,)
        "" for the k usable ones.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras.
    """
    sightings, epoch_ns = observations.sightings, observations.epoch_ns
    ray, offset, sigma_rad, reason = _in_rig(observations.rig, sightings, poses, rules)
    up, geocentric_R_enu = _axes(poses.latitude_deg, poses.longitude_deg)
    R = geocentric_R_enu @ rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    face = np.asarray(observations.kind == Kind.BOX)
    height = np.maximum(offset[:, 2], _MIN_CAMERA_HEIGHT_M)
    on_ground = -ray[:, 2] / height
    sigma_ground = np.hypot(np.radians(rules.ground_deg), on_ground * rules.ground_m) / height
    place = geocentric_m(poses.latitude_deg, poses.longitude_deg, poses.height_m)
    place = place + np.einsum("nij,nj->ni", R, offset)
    order = np.lexsort((*sightings.pixel_px.T[::-1], sightings.camera, epoch_ns))
    order = order[reason[order] == ""]
    if about_m is None:
        about_m = place[order].sum(axis=0) / max(order.size, 1)
    bearings = Bearings(
        row=np.arange(label.size),
        centre_m=place - about_m,
        ray=np.einsum("nij,nj->ni", R, ray),
        up=up,
        camera=np.unique(sightings.camera, return_inverse=True)[1].astype(np.int64),
        frame=_pictures(sightings.camera, epoch_ns, order),
        time_s=(epoch_ns - epoch_ns[order].min(initial=_LATE_NS)) * 1e-9,
        label=label,
        face=face,
        inverse_m=np.where(face, rules.face_inverse_m, on_ground),
        sigma_inverse_m=np.where(face, rules.face_sigma_inverse_m, sigma_ground),
        sigma_rad=sigma_rad,
        sigma_m=np.hypot(0.03, np.nan_to_num(poses.speed_mps) * rules.time_ms * 1e-3),
    )
    return bearings.take(order), reason


def _pictures(camera: TextArray, epoch_ns: IntArray, order: IntArray) -> IntArray:
    """Number of the picture of each sighting, in the order of `order`; 0 for those not in it."""
    number = np.zeros(camera.size, dtype=np.int64)
    before, after = order[:-1], order[1:]
    number[after] = np.cumsum((camera[after] != camera[before]) | (epoch_ns[after] != epoch_ns[before]))
    return number


def _in_rig(
    rig: Rig, sightings: Sightings, poses: Poses, rules: AssociationRules
) -> tuple[FloatArray, FloatArray, FloatArray, TextArray]:
    """Rays, camera positions and noise of directions in the rig frame, and why a sighting has none."""
    n = sightings.camera.size
    ray, offset, sigma = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full(n, np.nan)
    reason = np.where(poses.valid, "", np.where(poses.reason == "", Reason.NO_POSE, poses.reason))
    reason = reason.astype(REASON_TYPE)
    for name in np.unique(sightings.camera):
        rows = np.flatnonzero(sightings.camera == name)
        camera = rig.camera(str(name))
        pixel = sightings.pixel_px[rows]
        rays, known = camera.model.camera_ray_from_pixel(pixel)
        ray[rows], offset[rows] = rays @ camera.rig_R_camera.T, camera.rig_t_camera_m
        sigma[rows] = np.hypot(np.radians(rules.angle_deg), rules.pixel_px * _rad_per_px(camera, pixel, rays))
        off_axis = np.arccos(np.clip(rays[:, 2], -1.0, 1.0))
        sigma[rows] = np.hypot(sigma[rows], rules.focal_share * off_axis)
        why = np.where(known, "", Reason.OUTSIDE_CAMERA)
        why = np.where(known & on_the_car_itself(camera, pixel), Reason.ON_CAR, why)
        reason[rows] = np.where(reason[rows] == "", why, reason[rows])
    return ray, offset, sigma, reason


def _rad_per_px(camera: RigCamera, pixel_px: FloatArray, ray: FloatArray) -> FloatArray:
    """Angle that one pixel towards the middle of the image spans: there the model always answers."""
    middle = (np.array([camera.model.width_px, camera.model.height_px]) - 1.0) / 2.0
    step = np.where(pixel_px < middle, 1.0, -1.0)
    beside, _ = camera.model.camera_ray_from_pixel(pixel_px + step)
    return np.asarray(np.linalg.norm(beside - ray, axis=1) / np.sqrt(2.0))


def _axes(latitude_deg: FloatArray, longitude_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Up, and the rotation from east, north, up to geocentric axes."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lat)], axis=-1)
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    return up, np.stack([east, np.cross(up, east), up], axis=-1)


def geocentric_m(latitude_deg: FloatArray, longitude_deg: FloatArray, height_m: FloatArray) -> FloatArray:
    """Geocentric coordinates (n, 3): no map plane bends a drive of any length."""
    up, _ = _axes(latitude_deg, longitude_deg)
    curve = GRS80_SEMI_MAJOR_AXIS_M / np.sqrt(1.0 - GRS80_E2 * np.sin(np.radians(latitude_deg)) ** 2)
    scale = np.stack([curve, curve, curve * (1.0 - GRS80_E2)], axis=-1)
    return np.asarray(up * (scale + height_m[:, None]))
