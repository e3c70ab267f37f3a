"""The adjustment's equations: residuals and their derivatives by the poses of cameras and tags.

A pose moves by a small rotation in the outer frame and a translation: ``R <- exp([w]) R``, ``t <- t + d``.
With X a corner in the rig frame, ``p = R_c' (X - t_c)`` is where the camera has it, and the residual is the
difference of the unit ray to p and the ray of the observed pixel, in pixels. So no camera model is ever
asked for a projection, only for rays and their slopes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from geoloc.arrays import FloatArray, IntArray
from geoloc.calibration.extrinsics.observations import Pose, Sighting, Sigmas, Tag

WEAK_M, WEAK_RAD = 100.0, 30.0
"""Sigmas that say nothing: they keep the equations solvable where the tags leave something open."""


@dataclass(frozen=True, slots=True)
class NetworkState:
    """Everything that is estimated.

    Attributes
    ----------
    views, tags : mapping of name to Pose
        In the rig frame.
    scale : float
        Of all tags' sizes, minus one.
    """

    views: Mapping[str, Pose]
    tags: Mapping[int, Pose]
    scale: float = 0.0


@dataclass(frozen=True, slots=True)
class NetworkEquations:
    """Weighted residuals of one state.

    Attributes
    ----------
    residual : float64 (m,)
        In sigmas. The first ``8 n_sightings`` are the corners' (u, v each), the rest the priors'.
    jacobian : sparse (m, k)
        By the unknowns in the order of `Network.columns`.
    """

    residual: FloatArray
    jacobian: sparse.csr_matrix


class Network:
    """Unknowns and observations of one calibration.

    Parameters
    ----------
    sightings : sequence of Sighting
    tags : mapping of id to Tag
    sigmas : Sigmas
    corner_px : mapping of camera to float
        Sigma of a corner's coordinate.
    """

    def __init__(
        self,
        sightings: Sequence[Sighting],
        tags: Mapping[int, Tag],
        sigmas: Sigmas,
        corner_px: Mapping[str, float],
    ) -> None:
        self.sightings = tuple(sightings)
        self.tags = tags
        self.sigmas = sigmas
        self.corner_px = corner_px
        self.view_names = tuple(sorted({s.view for s in sightings}))
        self.tag_ids = tuple(sorted({s.tag for s in sightings}))
        self._view_at = {name: 6 * i for i, name in enumerate(self.view_names)}
        first = 6 * len(self.view_names)
        self._tag_at = {tag: first + 6 * i for i, tag in enumerate(self.tag_ids)}
        self.n_unknowns = first + 6 * len(self.tag_ids) + 1
        self._view = np.array([self.view_names.index(s.view) for s in self.sightings], dtype=np.intp)
        self._tag = np.array([self.tag_ids.index(s.tag) for s in self.sightings], dtype=np.intp)
        self._points_m = np.stack([s.points_m for s in self.sightings])
        self._ray = np.stack([s.ray for s in self.sightings])
        self._px_from_ray = np.stack([s.px_from_ray for s in self.sightings])
        self._weight = 1.0 / np.array([corner_px[s.camera] for s in self.sightings])
        self._measured = _measured_points([tags[tag] for tag in self.tag_ids])
        floor = [k for k, tag in enumerate(self.tag_ids) if tags[tag].on_floor]
        self._floor = np.repeat(np.array(floor, dtype=np.intp), 4)
        corners = [tags[self.tag_ids[k]].corners_m() for k in floor]
        self._floor_corners_m = np.concatenate([np.zeros((0, 3)), *corners])

    def columns(self, view: str) -> slice:
        """Columns of a view's pose: three of rotation (rig frame, radians), three of translation (metres)."""
        return slice(self._view_at[view], self._view_at[view] + 6)

    def tag_columns(self, tag: int) -> slice:
        """Columns of a tag's pose, as `columns`."""
        return slice(self._tag_at[tag], self._tag_at[tag] + 6)

    def moved(self, state: NetworkState, step: FloatArray) -> NetworkState:
        """State after a step of the unknowns."""
        steps = step[:-1].reshape(-1, 6)
        turns = Rotation.from_rotvec(steps[:, :3]).as_matrix()
        poses = [*(state.views[name] for name in self.view_names), *(state.tags[tag] for tag in self.tag_ids)]
        moved = [
            Pose(turn @ pose.R, pose.t_m + one[3:])
            for turn, pose, one in zip(turns, poses, steps, strict=True)
        ]
        n = len(self.view_names)
        return replace(
            state,
            views=dict(zip(self.view_names, moved[:n], strict=True)),
            tags=dict(zip(self.tag_ids, moved[n:], strict=True)),
            scale=state.scale + float(step[-1]),
        )

    def corner_residuals_px(self, state: NetworkState) -> FloatArray:
        """Residuals ``(n, 4, 2)`` of every sighting's corners, pixels."""
        return self._corners(state)[0]

    def corners_by_tag(self, state: NetworkState) -> FloatArray:
        """Derivatives ``(n, 4, 2, 6)`` of `corner_residuals_px` by the pose of the tag."""
        return self._corners(state)[2]

    def measured(self, tag: Tag, state: NetworkState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far a tag's points are from where they were measured.

        Returns
        -------
        off : float64 (1 + k, 3)
            Metres, in the order of `Tag.points_m`; NaN where not measured.
        by_pose, by_scale : float64 (1 + k, 3, 6), (1 + k, 3)
            Derivatives by the tag's pose and by the scale.
        """
        pose = state.tags[tag.id]
        turned = tag.points_m() @ pose.R.T
        arms = (1.0 + state.scale) * turned
        straight = np.broadcast_to(np.eye(3), (len(arms), 3, 3))
        by_pose = np.concatenate([-_cross_matrix(arms), straight], axis=2)
        return arms + pose.t_m - tag.places_m(), by_pose, turned

    def equations(self, state: NetworkState) -> NetworkEquations:
        """Residuals and Jacobian, both divided by the sigmas."""
        blocks = [self._corner_rows(state), *self._tag_rows(state), *self._weak_rows(state)]
        values = np.concatenate([block.values.ravel() for block in blocks])
        columns = np.concatenate([block.columns.ravel() for block in blocks])
        in_row = np.concatenate([np.full(len(block.values), block.values.shape[1]) for block in blocks])
        starts = np.concatenate([[0], np.cumsum(in_row)])
        return NetworkEquations(
            np.concatenate([block.residual for block in blocks]),
            sparse.csr_matrix((values, columns, starts), shape=(len(in_row), self.n_unknowns)),
        )

    def _corner_rows(self, state: NetworkState) -> _Rows:
        residual, by_view, by_tag, by_scale = self._corners(state)
        n = len(self.sightings)
        columns = np.concatenate(
            [
                6 * self._view[:, np.newaxis] + np.arange(6),
                self._pose_columns(self._tag),
                np.full((n, 1), self.n_unknowns - 1),
            ],
            axis=1,
        )
        values = np.concatenate([by_view, by_tag, by_scale[..., np.newaxis]], axis=3).reshape(n, 8, 13)
        values = values * self._weight[:, np.newaxis, np.newaxis]
        place = np.broadcast_to(columns[:, np.newaxis, :], values.shape)
        weighted = (self._weight[:, np.newaxis, np.newaxis] * residual).ravel()
        return _Rows(weighted, values.reshape(8 * n, 13), place.reshape(8 * n, 13))

    def _tag_rows(self, state: NetworkState) -> tuple[_Rows, _Rows]:
        """What was measured of the tags: places of points, and which of them lie on the floor."""
        R = np.stack([state.tags[tag].R for tag in self.tag_ids])
        t_m = np.stack([state.tags[tag].t_m for tag in self.tag_ids])
        of, sigma_m = self._measured.tag, self._measured.sigma_m
        turned = np.einsum("nij,nj->ni", R[of], self._measured.points_m)
        arms = (1.0 + state.scale) * turned
        off = arms + t_m[of] - self._measured.places_m
        straight = np.broadcast_to(np.eye(3), (len(of), 3, 3))
        values = np.concatenate([-_cross_matrix(arms), straight, turned[..., np.newaxis]], axis=2)
        columns = np.concatenate([self._pose_columns(of), np.full((len(of), 1), self.n_unknowns - 1)], axis=1)
        known = np.isfinite(self._measured.places_m).ravel()
        measured = _Rows(
            (off / sigma_m[:, np.newaxis]).ravel()[known],
            (values / sigma_m[:, np.newaxis, np.newaxis]).reshape(-1, 7)[known],
            np.repeat(columns, 3, axis=0)[known],
        )
        arms = (1.0 + state.scale) * np.einsum("nij,nj->ni", R[self._floor], self._floor_corners_m)
        by_pose = np.zeros((len(arms), 6))
        by_pose[:, :3] = -_cross_matrix(arms)[:, 2]
        by_pose[:, 5] = 1.0
        heights = arms[:, 2] + t_m[self._floor, 2]
        floor_m = self.sigmas.floor_m
        return measured, _Rows(heights / floor_m, by_pose / floor_m, self._pose_columns(self._floor))

    def _weak_rows(self, state: NetworkState) -> tuple[_Rows, _Rows]:
        """What keeps the equations solvable, and the scale near one."""
        n, size = self.n_unknowns - 1, self.sigmas.size
        weak = np.tile(np.repeat([1.0 / WEAK_RAD, 1.0 / WEAK_M], 3), n // 6)
        return (
            _Rows(np.zeros(n), weak[:, np.newaxis], np.arange(n)[:, np.newaxis]),
            _Rows(np.array([state.scale / size]), np.array([[1.0 / size]]), np.array([[n]])),
        )

    def _pose_columns(self, tag: IntArray) -> IntArray:
        """Columns (n, 6) of the poses of tags by their places in `tag_ids`."""
        return np.asarray(6 * (len(self.view_names) + tag)[:, np.newaxis] + np.arange(6))

    def _corners(self, state: NetworkState) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Residuals (n, 4, 2) in pixels, and their derivatives by view and tag (…, 6), and by scale."""
        view_R = np.stack([state.views[name].R for name in self.view_names])[self._view]
        view_t = np.stack([state.views[name].t_m for name in self.view_names])[self._view]
        tag_R = np.stack([state.tags[tag].R for tag in self.tag_ids])[self._tag]
        tag_t = np.stack([state.tags[tag].t_m for tag in self.tag_ids])[self._tag]
        turned = self._points_m @ np.swapaxes(tag_R, 1, 2)
        arms = (1.0 + state.scale) * turned
        away = arms + (tag_t - view_t)[:, np.newaxis]
        distance = np.linalg.norm(away, axis=2, keepdims=True)
        toward = (away / distance) @ view_R
        residual = np.einsum("nkij,nkj->nki", self._px_from_ray, toward - self._ray)
        square = np.eye(3) - toward[..., :, np.newaxis] * toward[..., np.newaxis, :]
        by_point = self._px_from_ray @ (square / distance[..., np.newaxis])
        by_point = by_point @ np.swapaxes(view_R, 1, 2)[:, np.newaxis]
        by_view = np.concatenate([by_point @ _cross_matrix(away), -by_point], axis=3)
        by_tag = np.concatenate([-by_point @ _cross_matrix(arms), by_point], axis=3)
        by_scale = np.einsum("nkij,nkj->nki", by_point, turned)
        return residual, by_view, by_tag, by_scale


class _Rows(NamedTuple):
    """Rows of a sparse Jacobian that have as many entries each.

    Attributes
    ----------
    residual : float64 (n,)
    values : float64 (n, k)
    columns : int64 (n, k)
    """

    residual: FloatArray
    values: FloatArray
    columns: IntArray


class _Measured(NamedTuple):
    """Points of all tags: whose (place in a sequence), where in its frame, where in the rig's, and how well.

    A coordinate that was not measured is NaN.
    """

    tag: IntArray
    points_m: FloatArray
    places_m: FloatArray
    sigma_m: FloatArray


def _measured_points(tags: Sequence[Tag]) -> _Measured:
    parts = [(tag.points_m(), tag.places_m()) for tag in tags]
    of = np.repeat(np.arange(len(tags)), [len(points) for points, _ in parts])
    points, places = (np.concatenate(some) for some in zip(*parts, strict=True))
    sigma = np.array([tag.centre_sigma_m for tag in tags])[of]
    return _Measured(of, points, places, sigma)


def _cross_matrix(vector: FloatArray) -> FloatArray:
    """Matrices ``(..., 3, 3)`` with ``[v] w = v x w``."""
    matrix = np.zeros((*vector.shape, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix
