"""Street scenes → pictures: coloured polygons in the world, painted from far to near through a true camera.

Fast rather than fine: OpenCV fills the projected polygons. The camera's pose and lens are exact, the shutter
rolls, and a polygon's edges are straight between its projected corners: cut long ones into pieces.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.cameras.base import CameraModel

NEAR_M = 0.3
"""Polygons are cut here: what is nearer lies in the car."""
_SHIFT = 4
_FINE_PX = 500
"""Things that cover less are painted finer than the pixels and then averaged."""
_FINER = 3
_SMALLEST_PX = 6
"""Margins of both sides included: less is not painted."""
_THETA_STEPS = 400
_FAR_PX = 20_000.0

Rgb = tuple[int, int, int]


class Kind(IntEnum):
    """What a pixel of the mask shows."""

    OTHER = 0
    PERSON = 1
    VEHICLE = 2
    SIGN = 3


@dataclass(frozen=True, slots=True)
class Patch:
    """A flat piece of something: rings ``(n, 3)`` in the world, filled at once by the even-odd rule."""

    rings: tuple[FloatArray, ...]
    rgb: Rgb
    kind: Kind = Kind.OTHER
    two_sided: bool = True
    """False: seen only from where its corners run clockwise, as the sides of a box."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Patches that are painted together, in their order, when it is their turn by distance.

    Attributes
    ----------
    place_m : float64 (3,)
        By which the distance is taken.
    patches : tuple of Patch
    velocity_mps : float64 (3,) or None
        Of what walks; None stands.
    """

    place_m: FloatArray
    patches: tuple[Patch, ...]
    velocity_mps: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera while its shutter opens row by row: its pose at the first and at the last row.

    Attributes
    ----------
    model : CameraModel
    position_m : float64 (2, 3)
        Of the optical centre, in the world.
    world_R_camera : float64 (2, 3, 3)
    """

    model: CameraModel
    position_m: FloatArray
    world_R_camera: FloatArray


@dataclass(frozen=True, slots=True)
class Picture:
    """What was painted.

    Attributes
    ----------
    rgb : uint8 (rows, columns, 3)
    mask : uint8 (rows, columns)
        `Kind` of each pixel.
    """

    rgb: NDArray[np.uint8]
    mask: NDArray[np.uint8]


class Lens:
    """Radius in the picture by the angle off the axis, as a table that goes on straight beyond the lens."""

    def __init__(self, model: CameraModel) -> None:
        theta = np.linspace(1e-6, np.radians(85.0), _THETA_STEPS)
        ray = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)
        pixel, seen = model.pixel_from_camera_point(ray)
        centre, _ = model.pixel_from_camera_point(np.array([[0.0, 0.0, 1.0]]))
        self.centre_px = centre[0]
        radius = np.linalg.norm(pixel - self.centre_px, axis=-1)
        last = int(np.argmin(seen)) - 1 if not seen.all() else theta.size - 1
        slope = (radius[last] - radius[last - 1]) / (theta[last] - theta[last - 1])
        self._theta = theta
        self._radius = np.where(theta > theta[last], radius[last] + slope * (theta - theta[last]), radius)

    def pixel(self, point_camera_m: FloatArray) -> FloatArray:
        """Pixels ``(n, 2)`` of points ``(n, 3)`` in front of the camera."""
        across = np.hypot(point_camera_m[:, 0], point_camera_m[:, 1])
        radius = np.interp(np.arctan2(across, point_camera_m[:, 2]), self._theta, self._radius)
        scale = radius / np.maximum(across, 1e-12)
        return np.asarray(self.centre_px + point_camera_m[:, :2] * scale[:, np.newaxis])


class Painter:
    """Paints one camera's picture, back to front.

    Parameters
    ----------
    eye : Eye
    lens : Lens
        Of `eye.model`.
    ground : uint8 (rows, columns, 3)
        The picture to begin with: the sky.
    """

    def __init__(self, eye: Eye, lens: Lens, ground: NDArray[np.uint8]) -> None:
        self._eye, self._lens = eye, lens
        self.rgb: NDArray[np.uint8] = ground.copy()
        self.mask: NDArray[np.uint8] = np.zeros(ground.shape[:2], dtype=np.uint8)

    def ground(self, patches: Sequence[Patch]) -> None:
        """Paint what lies on the ground, in the order given."""
        import cv2

        for patch, rings in self._projected(patches):
            for points in rings:
                cv2.fillPoly(self.rgb, [_fixed(points)], patch.rgb, lineType=cv2.LINE_8, shift=_SHIFT)

    def things(self, things: Iterable[Thing], time_s: float) -> None:
        """Paint what stands on the ground, the farthest first."""
        eye = self._eye.position_m.mean(axis=0)
        ahead = self._eye.world_R_camera[0][:, 2]
        moved = [(thing, _moved(thing, time_s)) for thing in things]
        order = sorted(moved, key=lambda pair: -float(np.linalg.norm(pair[0].place_m + pair[1] - eye)))
        for thing, way in order:
            if (thing.place_m + way - eye) @ ahead > -6.0:
                self._thing(self._projected(thing.patches, way))

    def picture(self) -> Picture:
        """Return the picture, a little soft as a lens leaves it."""
        import cv2

        return Picture(np.asarray(cv2.GaussianBlur(self.rgb, (3, 3), 0.6), dtype=np.uint8), self.mask)

    def _thing(self, projected: list[tuple[Patch, list[FloatArray]]]) -> None:
        import cv2

        every = [points for _, rings in projected for points in rings]
        if not every:
            return
        rows, columns = self.mask.shape
        points = np.concatenate(every)
        low = np.floor(points.min(axis=0)).astype(int) - 2
        high = np.ceil(points.max(axis=0)).astype(int) + 3
        left, top = max(int(low[0]), 0), max(int(low[1]), 0)
        right, bottom = min(int(high[0]), columns), min(int(high[1]), rows)
        if min(right - left, bottom - top) < _SMALLEST_PX:
            return
        finer = _FINER if max(right - left, bottom - top) <= _FINE_PX else 1
        size, corner = (right - left, bottom - top), np.array([left, top], dtype=np.float64)
        part = self.rgb[top:bottom, left:right]
        fine = cv2.resize(part, (size[0] * finer, size[1] * finer), interpolation=cv2.INTER_NEAREST)
        mask = np.ascontiguousarray(self.mask[top:bottom, left:right])
        line = cv2.LINE_8 if finer > 1 else cv2.LINE_AA
        for patch, rings in projected:
            # The centre of the first fine pixel lies before that of the pixel that it is a part of.
            placed = [_fixed((points - corner) * finer + 0.5 * (finer - 1)) for points in rings]
            cv2.fillPoly(fine, placed, patch.rgb, lineType=line, shift=_SHIFT)
            cv2.fillPoly(mask, [_fixed(points - corner) for points in rings], int(patch.kind), shift=_SHIFT)
        part[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        self.mask[top:bottom, left:right] = mask

    def _projected(
        self, patches: Sequence[Patch], way_m: FloatArray | None = None
    ) -> list[tuple[Patch, list[FloatArray]]]:
        """Project all rings at once; those that reach behind the camera are cut there."""
        rings = [ring for patch in patches for ring in patch.rings]
        if not rings:
            return []
        points = np.concatenate(rings)
        if way_m is not None:
            points = points + way_m
        first, last = ((points - self._eye.position_m[k]) @ self._eye.world_R_camera[k] for k in (0, 1))
        edges = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])])
        behind = (first[:, 2] < NEAR_M) | (last[:, 2] < NEAR_M)
        counts = np.add.reduceat(behind, edges[:-1])
        pixel = self._rolled(first, last)
        found, k = [], 0
        for patch in patches:
            own: list[FloatArray] = []
            for ring in patch.rings:
                here = slice(edges[k], edges[k + 1])
                if counts[k] == 0:
                    own.append(pixel[here])
                elif counts[k] < len(ring):
                    cut = _cut(first[here], last[here])
                    if len(cut[0]) > 2:
                        own.append(self._rolled(*cut))
                k += 1
            if own and (patch.two_sided or _clockwise(own[0])):
                found.append((patch, own))
        return found

    def _rolled(self, first: FloatArray, last: FloatArray) -> FloatArray:
        """Pixels of points, each when the shutter reads its row: between where both ends see it."""
        a, b = self._lens.pixel(first), self._lens.pixel(last)
        rows = self.mask.shape[0]
        share = np.clip((a[:, 1] + 0.5) / (rows - (b[:, 1] - a[:, 1])), 0.0, 1.0)
        return np.asarray(np.clip(a + share[:, np.newaxis] * (b - a), -_FAR_PX, _FAR_PX))


def _moved(thing: Thing, time_s: float) -> FloatArray:
    return np.zeros(3) if thing.velocity_mps is None else thing.velocity_mps * time_s


def _clockwise(points: FloatArray) -> bool:
    """Whether corners run clockwise as one sees them: the picture's y points down."""
    x, y = points[:, 0], points[:, 1]
    return bool(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0] > 0.0)


def _fixed(points: FloatArray) -> NDArray[np.int32]:
    return np.rint(points * 2.0**_SHIFT).astype(np.int32)


def _cut(first: FloatArray, last: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut a polygon at `NEAR_M` ahead of the camera (Sutherland and Hodgman)."""
    kept_first: list[FloatArray] = []
    kept_last: list[FloatArray] = []
    depth = np.minimum(first[:, 2], last[:, 2])
    for i in range(len(first)):
        before, inside = depth[i - 1] >= NEAR_M, depth[i] >= NEAR_M
        if before != inside:
            t = (NEAR_M - depth[i - 1]) / (depth[i] - depth[i - 1])
            for kept, points in ((kept_first, first), (kept_last, last)):
                corner = points[i - 1] + t * (points[i] - points[i - 1])
                corner[2] = max(corner[2], NEAR_M)
                kept.append(corner)
        if inside:
            kept_first.append(first[i])
            kept_last.append(last[i])
    return np.array(kept_first).reshape(-1, 3), np.array(kept_last).reshape(-1, 3)
