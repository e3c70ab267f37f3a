"""A yard with AprilTags around a standing car: what `twin calibrate extrinsics` is tried and measured on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from geoloc.arrays import ByteArray, FloatArray
from geoloc.calibration.extrinsics.observations import Pose, Tag, TagPicture
from geoloc.calibration.extrinsics.tag_family import FAMILY, dictionary_of
from geoloc.rig.rig import RigCamera
from geoloc.simulation.pictures.render import Plane, render_planes

TAG_M = 0.6
_RINGS = ((5.0, 6, 0.65), (7.5, 8, 1.35), (10.5, 9, 2.4))
"""Distance from the windshield, how many tags stand on an arc of 110° there, how high: none hides another."""
_ARC_DEG = 55.0
_WINDSHIELD_M = 1.5
_HEIGHT_SPREAD_M = 0.1
_LEAN_SIGMA_DEG = 12.0
"""Tags stand on tripods and against walls: nobody turns them towards the car exactly."""
_FLOOR_M = tuple((x, y) for x in (3.4, 4.4, 5.4) for y in (-1.6, 0.0, 1.6))
_CELL_PX = 25
_CONCRETE = 150.0


@dataclass(frozen=True, slots=True)
class Yard:
    """Tags around the car.

    Attributes
    ----------
    tags : mapping of id to Tag
        As measured, errors included.
    poses : mapping of id to Pose
        As they stand, in the rig frame.
    """

    tags: Mapping[int, Tag]
    poses: Mapping[int, Pose]


def draw_yard(rng: np.random.Generator, *, sigma_m: float = 0.001, floor_lean_deg: float = 0.0) -> Yard:
    """Put tags on three arcs ahead of the car, measured to `sigma_m`, and nine on the floor, not measured.

    Parameters
    ----------
    rng : numpy Generator
    sigma_m : float
        Of the places of standing tags: 1 mm is a total station, 5 mm a tape.
    floor_lean_deg : float
        Slope of the floor, rising forward, against what the car stands on.
    """
    tags: dict[int, Tag] = {}
    poses: dict[int, Pose] = {}
    for distance, n, height in _RINGS:
        for azimuth in np.radians(np.linspace(-_ARC_DEG, _ARC_DEG, n)):
            place = [
                _WINDSHIELD_M + distance * np.cos(azimuth),
                distance * np.sin(azimuth),
                height + rng.uniform(-_HEIGHT_SPREAD_M, _HEIGHT_SPREAD_M),
            ]
            into = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            down = np.array([0.0, 0.0, -1.0])
            upright = np.stack([np.cross(down, into), down, into], axis=1)
            lean = Rotation.from_rotvec(np.radians(rng.normal(scale=_LEAN_SIGMA_DEG, size=3))).as_matrix()
            poses[len(tags)] = Pose(lean @ upright, np.array(place))
            measured = np.array(place) + rng.normal(scale=sigma_m, size=3)
            tags[len(tags)] = Tag(len(tags), TAG_M, measured, sigma_m)
    lean = Rotation.from_euler("y", -floor_lean_deg, degrees=True).as_matrix()
    flat = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for x, y in _FLOOR_M:
        poses[len(tags)] = Pose(lean @ flat, lean @ np.array([x, y, 0.0]))
        tags[len(tags)] = Tag(len(tags), TAG_M, on_floor=True)
    return Yard(tags, poses)


def seen_tags(
    yard: Yard, camera: RigCamera, rng: np.random.Generator, *, sigma_px: float = 0.05
) -> TagPicture:
    """Project the tags that face the camera, with noise, without a picture."""
    ids, corners = [], []
    for tag, pose in yard.poses.items():
        if pose.R[:, 2] @ (pose.t_m - camera.rig_t_camera_m) <= 0.0:
            continue
        points = yard.tags[tag].corners_m() @ pose.R.T + pose.t_m
        pixel, inside = camera.model.pixel_from_camera_point(
            (points - camera.rig_t_camera_m) @ camera.rig_R_camera
        )
        if inside.all():
            ids.append(tag)
            corners.append(pixel + rng.normal(scale=sigma_px, size=pixel.shape))
    shape = (-1, 4, 2)
    return TagPicture(
        f"{camera.name}.png", camera.name, True, np.array(ids, np.int64), np.array(corners).reshape(shape)
    )


def yard_picture(
    yard: Yard, camera: RigCamera, rng: np.random.Generator, *, blur_px: float = 0.6, noise: float = 2.0
) -> ByteArray:
    """Render what a camera of the standing car sees of the tags."""
    planes = [_plane(tag, yard, camera) for tag in yard.tags]
    return render_planes(camera.model, planes, rng=rng, blur_px=blur_px, noise=noise, background=_CONCRETE)


def turned_camera(camera: RigCamera, rotvec_deg: FloatArray, moved_m: FloatArray) -> RigCamera:
    """The camera turned about the rig's axes, and moved: a rig file that is not true."""
    turn = Rotation.from_rotvec(np.radians(rotvec_deg)).as_matrix()
    return replace(
        camera,
        rig_R_camera=turn @ camera.rig_R_camera,
        rig_t_camera_m=camera.rig_t_camera_m + moved_m,
    )


def tag_texture(tag: int) -> ByteArray:
    """Print of a 36h11 tag with a white margin of one cell: ten cells across, the black square eight."""
    import cv2

    ink = cv2.aruco.generateImageMarker(dictionary_of(FAMILY), tag, 8 * _CELL_PX, borderBits=1)
    return np.pad(np.asarray(ink, dtype=np.uint8), _CELL_PX, constant_values=255)


def _plane(tag: int, yard: Yard, camera: RigCamera) -> Plane:
    pose = yard.poses[tag]
    # The print reaches a cell beyond the black square.
    side = yard.tags[tag].size_m * 10.0 / 8.0
    corner = pose.t_m + pose.R @ np.array([-side / 2.0, -side / 2.0, 0.0])
    return Plane(
        texture=tag_texture(tag),
        size_m=(side, side),
        camera_R_plane=camera.rig_R_camera.T @ pose.R,
        camera_t_plane_m=camera.rig_R_camera.T @ (corner - camera.rig_t_camera_m),
    )
