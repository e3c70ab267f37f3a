"""Pictures of flat (or bent) textured plates, taken by a camera model: boards and tags with known truth.

Every pixel asks its *ray* which plate it hits, by the model's inverse (`CameraModel.rays`). Estimators
project points into the image, so that a formula which is wrong in one direction does not excuse itself in the
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import ByteArray, FloatArray
from geoloc.cameras.base import CameraModel

Float32Array = NDArray[np.float32]

_SEARCH_STEP_PX = 8
"""Grid of rays that finds where in the image a plane is: one that is smaller may be missed."""
_BLUR_REACH = 4.0
"""Sigmas of blur around a plane that are rendered with it."""
_BEND_ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Plane:
    """One printed plate.

    Its own frame: origin at the top-left corner of the texture, x right along the rows, y down along the
    columns, z away from whoever reads it. It is seen from the front alone.

    Attributes
    ----------
    texture : uint8 (rows, columns)
        Grey values.
    size_m : (float, float)
        Width and height of the texture.
    camera_R_plane : float64 (3, 3)
    camera_t_plane_m : float64 (3,)
        Pose in the camera frame (RDF).
    sagitta_m : float
        How far the middle of a plate that is bent about its y axis stands back from its left and right edges
        (parabola); negative towards the reader. 0 is flat.
    """

    texture: ByteArray
    size_m: tuple[float, float]
    camera_R_plane: FloatArray
    camera_t_plane_m: FloatArray
    sagitta_m: float = 0.0

    def surface_z_m(self, x_m: FloatArray) -> FloatArray:
        """Depth of the bent surface at x, in the plane's frame."""
        part = x_m / self.size_m[0]
        return np.asarray(4.0 * self.sagitta_m * part * (1.0 - part))


@dataclass(frozen=True, slots=True)
class _Window:
    """Rows and columns of the image that are rendered: first and one past the last."""

    top: int
    bottom: int
    left: int
    right: int


def render_planes(
    model: CameraModel,
    planes: Sequence[Plane],
    *,
    rng: np.random.Generator,
    supersample: int = 3,
    blur_px: float = 0.6,
    noise: float = 2.0,
    light: float = 0.3,
    background: float | ByteArray = 95.0,
) -> ByteArray:
    """Render plates as the camera sees them.

    Parameters
    ----------
    model : CameraModel
        The true camera.
    planes : sequence of Plane
        Where several are in the way of a ray, the nearest is seen.
    rng : numpy Generator
        Draws the noise and the direction of the light.
    supersample : int
        Samples a pixel and axis, averaged: the pixel's area.
    blur_px : float
        Sigma of the lens's Gaussian blur.
    noise : float
        Sigma of white noise, grey values.
    light : float
        Unevenness: brightness falls by this part across the image (in a random direction), and by the same
        part towards its corners (vignetting).
    background : float or uint8 (height, width)
        Grey value, or a picture, of what is behind the plates.

    Returns
    -------
    uint8 (height, width)
    """
    shape = (model.height_px, model.width_px)
    image = np.broadcast_to(np.asarray(background, dtype=np.float64), shape).copy()
    windows = [_window(model, plane, 1 + round(_BLUR_REACH * blur_px)) for plane in planes]
    seen = [(plane, window) for plane, window in zip(planes, windows, strict=True) if window is not None]
    if seen:
        whole = _union([window for _, window in seen])
        rows, columns = slice(whole.top, whole.bottom), slice(whole.left, whole.right)
        canvas = _upsampled_blocks(image[rows, columns].astype(np.float32), supersample)
        depth = np.full(canvas.shape, np.inf, dtype=np.float32)
        for plane, window in seen:
            _paint(canvas, depth, model, plane, window, whole, supersample)
        image[rows, columns] = _filtered(canvas, supersample, blur_px)
    image *= _light(model, light, rng)
    if noise > 0.0:
        image += rng.normal(scale=noise, size=shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _paint(
    canvas: Float32Array,
    depth: Float32Array,
    model: CameraModel,
    plane: Plane,
    window: _Window,
    whole: _Window,
    supersample: int,
) -> None:
    """Put the samples of one plane on the canvas where nothing nearer is.

    Where a ray meets the plane is worked out at every pixel's centre, and interpolated between them: over a
    pixel that map is straight to about 1e-5 of it.
    """
    v, u = np.mgrid[window.top : window.bottom, window.left : window.right].astype(np.float64)
    x, y, distance = (_upsampled(values, supersample) for values in _hits(model, plane, u, v))
    width, height = plane.size_m
    hit = (x >= 0.0) & (x <= width) & (y >= 0.0) & (y <= height)
    rows = slice((window.top - whole.top) * supersample, (window.bottom - whole.top) * supersample)
    columns = slice((window.left - whole.left) * supersample, (window.right - whole.left) * supersample)
    hit &= distance < depth[rows, columns]
    texels = plane.texture.shape
    x, y = x * np.float32(texels[1] / width), y * np.float32(texels[0] / height)
    if hit.any():
        canvas[rows, columns][hit] = _sampled(plane.texture, x, y, hit)
        depth[rows, columns][hit] = distance[hit]


def _hits(
    model: CameraModel, plane: Plane, u_px: FloatArray, v_px: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the rays of pixels meet the plane's surface: x, y in its frame, and the distance; NaN if not."""
    rays = model.rays(u_px, v_px)
    direction = np.stack(rays.ray, axis=-1) @ plane.camera_R_plane
    eye = -plane.camera_R_plane.T @ plane.camera_t_plane_m
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -eye[2] / direction[..., 2]
        for _ in range(_BEND_ROUNDS if plane.sagitta_m else 0):
            x = eye[0] + distance * direction[..., 0]
            # Outside the plate the parabola goes on for ever, and its rounds would not settle.
            back = plane.surface_z_m(np.clip(x, 0.0, plane.size_m[0]))
            distance = (back - eye[2]) / direction[..., 2]
    front = rays.inside & (direction[..., 2] > 0.0) & (distance > 0.0)
    distance = np.where(front, distance, np.nan)
    return eye[0] + distance * direction[..., 0], eye[1] + distance * direction[..., 1], distance


def _window(model: CameraModel, plane: Plane, margin_px: int) -> _Window | None:
    """Part of the image that shows the plane, found with a coarse grid of rays; None if it is not seen."""
    height, width = model.height_px, model.width_px
    rows = np.unique(np.append(np.arange(0, height, _SEARCH_STEP_PX), height - 1))
    columns = np.unique(np.append(np.arange(0, width, _SEARCH_STEP_PX), width - 1))
    u, v = np.meshgrid(columns.astype(np.float64), rows.astype(np.float64))
    x, y, _ = _hits(model, plane, u, v)
    hit = (x >= 0.0) & (x <= plane.size_m[0]) & (y >= 0.0) & (y <= plane.size_m[1])
    if not hit.any():
        return None
    margin = _SEARCH_STEP_PX + margin_px
    v_hit, u_hit = rows[hit.any(axis=1)], columns[hit.any(axis=0)]
    return _Window(
        max(int(v_hit[0]) - margin, 0),
        min(int(v_hit[-1]) + margin + 1, height),
        max(int(u_hit[0]) - margin, 0),
        min(int(u_hit[-1]) + margin + 1, width),
    )


def _union(windows: Sequence[_Window]) -> _Window:
    return _Window(
        min(w.top for w in windows),
        max(w.bottom for w in windows),
        min(w.left for w in windows),
        max(w.right for w in windows),
    )


def _upsampled_blocks(values: Float32Array, supersample: int) -> Float32Array:
    return np.repeat(np.repeat(values, supersample, axis=0), supersample, axis=1)


def _upsampled(values: FloatArray, supersample: int) -> Float32Array:
    """Values at the samples inside each pixel, from those at the pixels' centres, along straight lines."""
    single = values.astype(np.float32)
    for axis in (0, 1):
        slope = np.diff(single, axis=axis)
        ends = [np.take(slope, [end], axis=axis) if slope.size else 0.0 * single for end in (0, -1)]
        before, after = (np.concatenate(s, axis=axis) for s in ((ends[0], slope), (slope, ends[1])))
        shape = list(single.shape)
        shape[axis] *= supersample
        finer = np.empty(shape, dtype=np.float32)
        for part in range(supersample):
            offset = np.float32((part + 0.5) / supersample - 0.5)
            where = [slice(None), slice(None)]
            where[axis] = slice(part, None, supersample)
            finer[tuple(where)] = single + offset * (after if offset >= 0.0 else before)
        single = finer
    return single


def _sampled(texture: ByteArray, x: Float32Array, y: Float32Array, hit: NDArray[np.bool_]) -> Float32Array:
    """Texture where `hit`, at positions in texels from its corner; averaged first if samples are sparser."""
    from scipy.ndimage import map_coordinates

    coarseness = np.hypot(np.diff(x, axis=1)[1:], np.diff(x, axis=0)[:, 1:])
    steps = coarseness[hit[1:, 1:] & np.isfinite(coarseness)]
    factor = max(1, int(np.median(steps))) if steps.size else 1
    rows, columns = texture.shape
    padded = np.pad(texture, ((0, -rows % factor), (0, -columns % factor)), mode="edge").astype(np.float32)
    small = padded.reshape(padded.shape[0] // factor, factor, -1, factor).mean(axis=(1, 3))
    place = np.stack([y[hit] / factor - 0.5, x[hit] / factor - 0.5])
    return np.asarray(map_coordinates(small, place, output=np.float32, order=1, mode="nearest"))


def _filtered(canvas: Float32Array, supersample: int, blur_px: float) -> FloatArray:
    """Blur of the lens, then the mean over each pixel's area."""
    from scipy.ndimage import gaussian_filter

    if blur_px > 0.0:
        canvas = gaussian_filter(canvas, blur_px * supersample, mode="nearest", truncate=_BLUR_REACH)
    rows, columns = (n // supersample for n in canvas.shape)
    blocks = canvas.reshape(rows, supersample, columns, supersample)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float64)


def _light(model: CameraModel, unevenness: float, rng: np.random.Generator) -> FloatArray:
    """Brightness over the image, at most 1: a slope in a random direction times vignetting."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    if unevenness == 0.0:
        return np.ones((model.height_px, model.width_px))
    v = np.linspace(-1.0, 1.0, model.height_px)[:, np.newaxis]
    u = np.linspace(-1.0, 1.0, model.width_px)
    slope = 0.5 * (1.0 + (np.cos(angle) * u + np.sin(angle) * v) / np.sqrt(2.0))
    return np.asarray((1.0 - unevenness * slope) * (1.0 - unevenness * 0.5 * (u**2 + v**2)))
