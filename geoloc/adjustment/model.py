"""Residuals of rays and ground, and their analytic derivatives by every unknown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.ground import Ground, MeasuredGround
from geoloc.adjustment.rotations import (
    cross_matrix,
    into,
    rotated,
    rotation_derivative,
    rotation_matrix_back,
    turned_back,
    turned_matrix,
)
from geoloc.adjustment.scene import Bodies, Scene
from geoloc.adjustment.unknowns import (
    AXLES,
    FALL_LEFT,
    FALL_RIGHT,
    LEAN,
    PITCHING,
    READOUT,
    RISE,
    ROLL,
    SLIP,
    TIME,
    Layout,
)
from geoloc.arrays import FloatArray, IntArray
from geoloc.cameras.nominal import moves_at

# A node's first unknowns are those of the pose.
_POSE = 6


class Linear(NamedTuple):
    """Residuals of unit variance ``(k,)``, their derivatives ``(k, j)`` and by which unknowns ``(k, j)``."""

    residual: FloatArray
    derivative: FloatArray
    column: IntArray


class _Seen(NamedTuple):
    """Points as the cameras should see them, and the steps on the way there."""

    ray: FloatArray
    distance: FloatArray
    c: FloatArray
    """In the camera frame."""
    q: FloatArray
    """In the rig frame, after all corrections of its attitude."""
    in_rig: FloatArray
    """In the rig frame before them."""
    back: FloatArray
    camera_R_rig: FloatArray
    beta: FloatArray
    attitude: FloatArray
    turn: FloatArray


@dataclass(frozen=True, slots=True)
class Model:
    """Everything that stays the same while the unknowns change.

    Attributes
    ----------
    scene : Scene
    layout : Layout
    origin_m : float64 (n, 3)
        The rig's origin of each sighting in its point's local frame.
    left, share : int64, float64 (n,)
        Node before each sighting, and how far on the way to the next.
    node_ns : int64 (nodes,)
        Epochs of the nodes.
    node_age_s : float64 (nodes,)
        The same on a clock that almost stops with the car: errors of the pose fade by it.
    readout_s : float
        Rolling shutter's readout that the drive states.
    radius_m : float64 (n,)
        How far before the point its visible front stands; 0 for faces.
    eye_m : float64 (n, 2)
        The camera from the rig's origin, east and north.
    measured_at_m : float64 (3,)
        Where on the rig the trajectory's place was measured: about this point its tilt is corrected.
    ground : Ground
    terrain : MeasuredGround or None
    """

    scene: Scene
    layout: Layout
    origin_m: FloatArray
    left: IntArray
    share: FloatArray
    node_ns: IntArray
    node_age_s: FloatArray
    readout_s: float
    radius_m: FloatArray
    eye_m: FloatArray
    measured_at_m: FloatArray
    ground: Ground
    terrain: MeasuredGround | None = None

    def points_m(self, x: FloatArray) -> FloatArray:
        """Points (m, 3) in their local frames."""
        places = self.layout.point(np.arange(self.layout.n_points))
        return self.scene.start_m + x[places]

    def with_expected_pixels(self, x: FloatArray) -> Model:
        """Take the rows that the shutter reads, and places in lenses, from where points should be seen.

        The noise of an annotated pixel is also in its residual: over thousands of sightings the two together
        look like a slower shutter (3 ms of 31 at 1.5 px), and like a lens of 2 % less focal length.
        """
        off_px = self.ray_residuals(x) * self.scene.sigma_px[:, None]
        rows = self.scene.readout + off_px[:, 1] / self.scene.height_px
        away = self.scene.lens_away_px
        seen_at = None if away is None else away + off_px
        return replace(self, scene=replace(self.scene, readout=rows, lens_away_px=seen_at))

    def with_ground_weighed(self, x: FloatArray, weight: Callable[[FloatArray], FloatArray]) -> Model:
        """Let the ground of each foot count by the square of how far it is off, in sigmas."""
        ground = replace(self.ground, weight=np.ones_like(self.ground.weight))
        terrain = self.terrain and replace(self.terrain, weight=np.ones_like(self.terrain.weight))
        plain = replace(self, ground=ground, terrain=terrain)
        ground = replace(ground, weight=weight(plain.heights(x).residual ** 2))
        raster = plain.terrain_heights(x)
        if terrain is not None and raster is not None:
            terrain = replace(terrain, weight=weight(raster.residual**2))
        return replace(self, ground=ground, terrain=terrain)

    def ray_residuals(self, x: FloatArray) -> FloatArray:
        """Pixels (n, 2) between where rays were seen and where they should be, over `sigma_px`.

        The difference of unit rays, measured in pixels at the ray that was seen: to first order that of
        pixels, for every camera model alike.
        """
        seen = self._seen(x)
        off = (self._pixels @ (seen.ray - self.scene.ray)[:, :, None])[:, :, 0]
        return np.asarray(off - self._lens_shift(x))

    def rays(self, x: FloatArray) -> Linear:
        """`ray_residuals`, two rows a sighting, with their derivatives."""
        scene, body = self.scene, self.scene.body
        s = self._seen(x)
        by_ray = self._pixels
        residual = (by_ray @ (s.ray - scene.ray)[:, :, None])[:, :, 0] - self._lens_shift(x)
        # By the point in the camera frame: what turns the ray, over the distance.
        along = by_ray @ s.ray[:, :, None]
        by_c = (by_ray - along * s.ray[:, None, :]) / s.distance[:, None, None]
        by_beta = by_c @ rotation_derivative(s.c, s.beta)
        by_q = by_c @ s.camera_R_rig
        by_attitude = by_q @ rotation_derivative(s.q, s.attitude)
        by_pitching = by_attitude[:, :, 2:] * s.attitude[:, 1, None, None]
        by_attitude[:, :, 1] += x[PITCHING] * by_attitude[:, :, 2]
        by_rig = by_q @ s.back
        enu_R = turned_matrix(body.enu_R_rig, s.turn)
        by_point = by_rig @ np.swapaxes(enu_R, 1, 2)
        drift = -into(enu_R, body.velocity_mps)
        drift[:, 0] += body.yaw_rate_radps * s.in_rig[:, 1]
        drift[:, 1] -= body.yaw_rate_radps * s.in_rig[:, 0]
        by_time = by_rig @ drift[:, :, None]
        by_node = np.concatenate([by_attitude - by_point @ self._swing(body.enu_R_rig), -by_point], axis=2)
        left, right = (1.0 - self.share)[:, None, None], self.share[:, None, None]
        derivative = np.concatenate(
            [
                by_point,
                by_node * left,
                by_node * right,
                by_attitude,
                by_time,
                by_time * scene.readout[:, None, None],
                by_attitude[:, :, 2:] * body.lateral_mps2[:, None, None],
                by_node[:, :, :1],
                by_node[:, :, :1] * body.lateral_mps2[:, None, None],
                by_node[:, :, 1:2] * body.pitch_per_m[:, None, None],
                by_pitching,
                by_beta,
                -by_q,
                *([] if self._lens is None else [-self._lens]),
            ],
            axis=2,
        )
        width = derivative.shape[2]
        return Linear(residual.ravel(), derivative.reshape(-1, width), np.repeat(self._ray_columns(), 2, 0))

    def corrections(self, x: FloatArray) -> FloatArray:
        """What the trajectory's pose lacks at each sighting (n, 6).

        A rotation vector about the rig's axes (rad), and a shift of its origin east, north and up (m).
        """
        body, late = self.scene.body, self._late(x)
        slow = self._slow(x, self.left, self.share, self.scene.body)
        turn = self._attitude(x, slow)
        turn[:, 2] += late * body.yaw_rate_radps
        return np.concatenate(
            [turn, late[:, None] * body.velocity_mps + self._shift(slow, body.enu_R_rig)], axis=1
        )

    def _ray_columns(self) -> IntArray:
        """Which unknowns a sighting depends on, in the order of `rays`."""
        layout, scene = self.layout, self.scene
        return np.concatenate(
            [
                layout.point(scene.point),
                layout.node(self.left)[:, :_POSE],
                layout.node(self.left + 1)[:, :_POSE],
                layout.bounce(scene.instant),
                np.broadcast_to([TIME, READOUT, SLIP, ROLL, LEAN, AXLES, PITCHING], (scene.point.size, 7)),
                layout.boresight(scene.camera),
                layout.camera_position(scene.camera),
                *([] if not layout.has_lenses else [layout.lens(scene.camera)]),
            ],
            axis=1,
        )

    @property
    def lens_moves(self) -> FloatArray | None:
        """How far errors of lenses move pixels (n, 2, 5); None where all lenses are exact."""
        away, half = self.scene.lens_away_px, self.scene.lens_half_px
        return None if away is None or half is None else moves_at(away, half)

    @property
    def _lens(self) -> FloatArray | None:
        """Residuals (n, 2, 5) a unit of each error of the lens that is taken off the pixel."""
        moves = self.lens_moves
        return None if moves is None else moves / self.scene.sigma_px[:, None, None]

    def _lens_shift(self, x: FloatArray) -> FloatArray | float:
        """What the errors of lenses take off the pixels that were seen (n, 2), over `sigma_px`."""
        if self._lens is None:
            return 0.0
        error = x[self.layout.lens(self.scene.camera)]
        return np.asarray((self._lens @ error[:, :, None])[:, :, 0])

    @property
    def _pixels(self) -> FloatArray:
        """Residuals a unit that the end of a ray moves (n, 2, 3)."""
        return self.scene.pixel_from_ray / self.scene.sigma_px[:, None, None]

    def _seen(self, x: FloatArray) -> _Seen:
        """From the unknowns to the unit ray on which each point should be seen."""
        scene, layout, body = self.scene, self.layout, self.scene.body
        late = self._late(x)
        slow = self._slow(x, self.left, self.share, self.scene.body)
        origin = self.origin_m + late[:, None] * body.velocity_mps + self._shift(slow, body.enu_R_rig)
        delta = self.points_m(x)[scene.point] - origin
        sight = delta[:, :2] - self.eye_m
        away = np.maximum(np.hypot(sight[:, 0], sight[:, 1]), 1.0)
        delta[:, :2] -= (self.radius_m / away)[:, None] * sight
        turn = late * body.yaw_rate_radps
        in_rig = turned_back(into(body.enu_R_rig, delta), turn)
        attitude = self._attitude(x, slow)
        back = rotation_matrix_back(attitude)
        q = (back @ in_rig[:, :, None])[:, :, 0]
        # A handful of cameras: their matrices are made once and handed out.
        cameras = np.arange(layout.n_cameras)
        beta = x[layout.boresight(cameras)]
        arm = scene.rig_t_camera_m + x[layout.camera_position(cameras)]
        camera_R_rig = (rotation_matrix_back(beta) @ np.swapaxes(scene.rig_R_camera, 1, 2))[scene.camera]
        c = (camera_R_rig @ (q - arm[scene.camera])[:, :, None])[:, :, 0]
        distance = np.linalg.norm(c, axis=1)
        return _Seen(
            c / distance[:, None],
            distance,
            c,
            q,
            in_rig,
            back,
            camera_R_rig,
            beta[scene.camera],
            attitude,
            turn,
        )

    def heights(self, x: FloatArray) -> Linear:
        """Height of each foot above the plane of the road and its falls to the sides, over its sigma.

        Weighed, as is its derivative.
        """
        g = self.ground
        slow = self._slow(x, g.left, g.share, g.body)
        delta = self.points_m(x)[g.point] - g.origin_m - self._shift(slow, g.body.enu_R_rig)
        in_rig = into(g.body.enu_R_rig, delta)
        attitude = slow[:, :3]
        q = rotated(in_rig, attitude)
        by_point = np.einsum("nj,nij->ni", rotation_matrix_back(attitude)[:, 2], g.body.enu_R_rig)
        by_swing = np.einsum("ni,nij->nj", by_point, self._swing(g.body.enu_R_rig))
        by_attitude = rotation_derivative(q, attitude)[:, 2] - by_swing
        beside = g.beside_m
        fall = self._between(x, g.left, g.share)[:, _POSE:] + x[[FALL_LEFT, FALL_RIGHT]]
        above = q[:, 2] - (beside * fall).sum(axis=1) - x[RISE]
        by_node = np.concatenate([by_attitude, -by_point, -beside], axis=1)
        derivative = np.concatenate(
            [
                by_point,
                by_node * (1.0 - g.share)[:, None],
                by_node * g.share[:, None],
                by_attitude[:, :1],
                by_attitude[:, :1] * g.body.lateral_mps2[:, None],
                by_attitude[:, 1:2] * g.body.pitch_per_m[:, None],
                -beside,
                -np.ones((g.point.size, 1)),
            ],
            axis=1,
        )
        column = np.concatenate(
            [
                self.layout.point(g.point),
                self.layout.node(g.left),
                self.layout.node(g.left + 1),
                np.broadcast_to([ROLL, LEAN, AXLES, FALL_LEFT, FALL_RIGHT, RISE], (g.point.size, 6)),
            ],
            axis=1,
        )
        counts = np.sqrt(g.weight) / g.sigma_m
        return Linear(above * counts, derivative * counts[:, None], column)

    def terrain_heights(self, x: FloatArray) -> Linear | None:
        """Height of each foot above the terrain, over its sigma, weighed; None without a terrain."""
        t = self.terrain
        if t is None:
            return None
        offset = x[self.layout.point(t.point)]
        height, slope = t.height_and_slope(offset[:, :2])
        above = self.scene.start_m[t.point, 2] + offset[:, 2] - height
        derivative = np.concatenate([-slope, np.ones((t.point.size, 1))], axis=1)
        # A point that has left the raster has no ground for this round.
        inside = np.isfinite(above) & np.isfinite(slope).all(axis=1)
        counts = np.sqrt(t.weight) / t.sigma_m
        residual = np.where(inside, above * counts, 0.0)
        derivative = np.where(inside[:, None], derivative * counts[:, None], 0.0)
        return Linear(residual, derivative, self.layout.point(t.point))

    def _late(self, x: FloatArray) -> FloatArray:
        """How much later than its epoch each sighting was exposed (n,), seconds."""
        return np.asarray(x[TIME] + self.scene.readout * (self.readout_s + x[READOUT]))

    def _attitude(self, x: FloatArray, slow: FloatArray) -> FloatArray:
        """Rotation vectors (n, 3) of the body at each sighting: slow errors, bounce and slip."""
        attitude = slow[:, :3] + x[self.layout.bounce(self.scene.instant)]
        attitude[:, 2] += x[SLIP] * self.scene.body.lateral_mps2 + x[PITCHING] * attitude[:, 1]
        return np.asarray(attitude)

    def _shift(self, slow: FloatArray, enu_R_rig: FloatArray) -> FloatArray:
        """How far the rig's origin moves (n, 3): with its place, and below an antenna that stays."""
        return np.asarray(slow[:, 3:] + (self._swing(enu_R_rig) @ slow[:, :3, None])[:, :, 0])

    def _swing(self, enu_R_rig: FloatArray) -> FloatArray:
        """Move of the rig's origin, east, north and up, by a turn about the antennas (n, 3, 3)."""
        return np.asarray(enu_R_rig @ cross_matrix(self.measured_at_m[None])[0])

    def _slow(self, x: FloatArray, left: IntArray, share: FloatArray, body: Bodies) -> FloatArray:
        """Corrections (n, 6) of the pose: a rotation vector about the rig's axes, and a shift."""
        slow = self._between(x, left, share)[:, :_POSE]
        slow[:, 0] += x[ROLL] + x[LEAN] * body.lateral_mps2
        slow[:, 1] += x[AXLES] * body.pitch_per_m
        return slow

    def _between(self, x: FloatArray, left: IntArray, share: FloatArray) -> FloatArray:
        """Unknowns of nodes (n, 8) in between."""
        before, after = x[self.layout.node(left)], x[self.layout.node(left + 1)]
        return np.asarray(before + share[:, None] * (after - before))
