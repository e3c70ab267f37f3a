"""Corners of AprilTags in a picture, to some hundredths of a pixel.

A corner is where two edges of the black square cross, and edges are long: each is found as tens of points,
which are turned into rays by the camera's own model. Rays to a straight edge lie in one plane through the
camera, whatever the lens does to the edge in the picture, so a corner's ray is where two such planes cross.
OpenCV's own refinement looks at the corner alone, whose tip every blur rounds off: 0.15 px.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geoloc.arrays import ByteArray, FloatArray, IntArray
from geoloc.calibration.extrinsics.tag_family import FAMILY, dictionary_of
from geoloc.cameras import CameraModel
from twin.calibrate.boards.edges import LEAST_POINTS, edge_points, edge_width_px

_ROUNDS = 3
_PROJECTION_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class TagsFound:
    """AprilTags of one picture.

    Attributes
    ----------
    ids : int64 (n,)
    corners_px : float64 (n, 4, 2)
        Top left, top right, bottom right, bottom left as AprilTag's authors print it; (0, 0) is the centre of
        the first pixel.
    n_small : int
        Tags left out because they are too small or their edges too blurred.
    edge_px : float
        Width of the tags' edges, of a Gaussian's half height, median: how blurred the picture is. NaN
        without tags.
    mirrored : bool
        No tag was found, but the picture's mirror image shows some.
    """

    ids: IntArray
    corners_px: FloatArray
    n_small: int
    edge_px: float
    mirrored: bool


def find_tags(grey: ByteArray, model: CameraModel) -> TagsFound:
    """Find the AprilTags (36h11) of a grey picture.

    Parameters
    ----------
    grey : uint8 (height, width)
    model : CameraModel
        Of the camera that took it: its rays make the edges straight.
    """
    ids, rough = _detected(grey)
    if not len(ids):
        nothing = np.empty((0, 4, 2))
        mirrored = len(_detected(np.ascontiguousarray(grey[:, ::-1]))[0]) > 0
        return TagsFound(np.empty(0, np.int64), nothing, 0, np.nan, mirrored)
    refined = [_refined(grey, corners, model) for corners in rough]
    good = [i for i, corners in enumerate(refined) if corners is not None]
    found = [corners for corners in refined if corners is not None]
    corners_px = np.stack(found) if found else np.empty((0, 4, 2))
    widths = [edge_width_px(grey, corners) for corners in rough]
    edge_px = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
    return TagsFound(ids[good], corners_px, len(ids) - len(good), edge_px, False)


def _detected(grey: ByteArray) -> tuple[IntArray, FloatArray]:
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found: Any = cv2.aruco.ArucoDetector(dictionary_of(FAMILY), parameters).detectMarkers(grey)
    corners, ids, _ = found
    if ids is None:
        return np.empty(0, np.int64), np.empty((0, 4, 2))
    return ids.ravel().astype(np.int64), np.array(corners, dtype=np.float64).reshape(-1, 4, 2)


def _refined(grey: ByteArray, rough_px: FloatArray, model: CameraModel) -> FloatArray | None:
    """Corners (4, 2) as crossings of the edges' planes; None where an edge cannot be made out."""
    corners = rough_px
    for _ in range(_ROUNDS):
        planes = []
        for side in range(4):
            points = edge_points(grey, corners[side], corners[(side + 1) % 4])
            if points is None:
                return None
            normal = _plane(model, points)
            if normal is None:
                return None
            planes.append(normal)
        # Corner i is where the edges before and after it cross.
        rays = np.array([np.cross(planes[i - 1], planes[i]) for i in range(4)])
        seen = _pixels(model, rays, corners)
        if seen is None:
            return None
        corners = seen
    if np.abs(corners - rough_px).max() > 0.25 * _shortest_side(rough_px):
        return None
    return corners


def _shortest_side(corners_px: FloatArray) -> float:
    return float(np.linalg.norm(corners_px - np.roll(corners_px, -1, axis=0), axis=1).min())


def _plane(model: CameraModel, points_px: FloatArray) -> FloatArray | None:
    """Unit normal of the plane through the camera that the points' rays lie in, without outliers."""
    rays = model.rays(points_px[:, 0], points_px[:, 1])
    ray = np.stack(rays.ray, axis=-1)[rays.inside]
    for _ in range(_ROUNDS):
        if len(ray) < LEAST_POINTS:
            return None
        normal = np.linalg.svd(ray)[2][-1]
        off = np.abs(ray @ normal)
        keep = off <= max(3.0 * 1.4826 * float(np.median(off)), 1e-9)
        if keep.all():
            break
        ray = ray[keep]
    # The order of the points gives the side: planes of neighbouring edges then cross ahead of the camera.
    return np.asarray(normal * np.sign(np.cross(ray[0], ray[-1]) @ normal), dtype=np.float64)


def _pixels(model: CameraModel, rays: FloatArray, near_px: FloatArray) -> FloatArray | None:
    """Pixels (4, 2) of rays, by the model's own rays and their slopes (Newton), from pixels near them."""
    direction = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    pixel = near_px
    for _ in range(_PROJECTION_ROUNDS):
        here = model.rays(pixel[:, 0], pixel[:, 1], slopes=True)
        if not here.inside.all():
            return None
        ray = np.stack(here.ray, axis=-1)
        away = direction * np.sign((direction * ray).sum(axis=1))[:, np.newaxis] - ray
        pixel = pixel + np.einsum("nij,nj->ni", np.linalg.pinv(here.by_pixel()), away)
    return np.asarray(pixel, dtype=np.float64)
