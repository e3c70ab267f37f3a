"""The adjustment's equations: residuals and their derivatives by the poses of cameras and tags.

A pose moves by a small rotation in the outer frame and a translation: ``R <- exp([w]) R``, ``t <- t + d``.
With X a corner in the rig frame, ``p = R_c' (X - t_c)`` is where the camera has it, and the residual is the
difference of the unit ray to p and the ray of the observed pixel, in pixels. So no camera model is ever
asked for a projection, only for rays and their slopes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from geoloc.arrays import FloatArray
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

    def columns(self, view: str) -> slice:
        """Columns of a view's pose: three of rotation (rig frame, radians), three of translation (metres)."""
        return slice(self._view_at[view], self._view_at[view] + 6)

    def tag_columns(self, tag: int) -> slice:
        """Columns of a tag's pose, as `columns`."""
        return slice(self._tag_at[tag], self._tag_at[tag] + 6)

    def moved(self, state: NetworkState, step: FloatArray) -> NetworkState:
        """State after a step of the unknowns."""
        views = {name: _moved(state.views[name], step[self.columns(name)]) for name in self.view_names}
        tags = {tag: _moved(state.tags[tag], step[self.tag_columns(tag)]) for tag in self.tag_ids}
        return replace(state, views=views, tags=tags, scale=state.scale + float(step[-1]))

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
        rows = _Rows()
        for tag_id in self.tag_ids:
            self._tag_priors(rows, self.tags[tag_id], state)
        weak = np.tile(np.repeat([1.0 / WEAK_RAD, 1.0 / WEAK_M], 3), (self.n_unknowns - 1) // 6)
        rows.add(np.zeros(self.n_unknowns - 1), (0, np.diag(weak)))
        rows.add(
            np.array([state.scale / self.sigmas.size]), (self.n_unknowns - 1, [[1.0 / self.sigmas.size]])
        )
        priors = rows.equations(self.n_unknowns)
        residual, jacobian = self._corner_equations(state)
        return NetworkEquations(
            np.concatenate([residual, priors.residual]),
            sparse.csr_matrix(sparse.vstack([jacobian, priors.jacobian])),
        )

    def _corner_equations(self, state: NetworkState) -> tuple[FloatArray, sparse.csr_matrix]:
        residual, by_view, by_tag, by_scale = self._corners(state)
        n = len(self.sightings)
        columns = np.concatenate(
            [
                6 * self._view[:, np.newaxis] + np.arange(6),
                6 * (len(self.view_names) + self._tag)[:, np.newaxis] + np.arange(6),
                np.full((n, 1), self.n_unknowns - 1),
            ],
            axis=1,
        )
        values = np.concatenate([by_view, by_tag, by_scale[..., np.newaxis]], axis=3).reshape(n, 8, 13)
        values = values * self._weight[:, np.newaxis, np.newaxis]
        place = np.broadcast_to(columns[:, np.newaxis, :], values.shape)
        starts = np.arange(8 * n + 1) * 13
        shape = (8 * n, self.n_unknowns)
        jacobian = sparse.csr_matrix((values.ravel(), place.ravel(), starts), shape=shape)
        return (self._weight[:, np.newaxis, np.newaxis] * residual).ravel(), jacobian

    def _tag_priors(self, rows: _Rows, tag: Tag, state: NetworkState) -> None:
        pose, at = state.tags[tag.id], self._tag_at[tag.id]
        known = np.isfinite(tag.places_m())
        if known.any():
            off, by_pose, by_scale = self.measured(tag, state)
            rows.add(
                off[known] / tag.centre_sigma_m,
                (at, by_pose[known] / tag.centre_sigma_m),
                (self.n_unknowns - 1, by_scale[known][:, np.newaxis] / tag.centre_sigma_m),
            )
        if tag.on_floor:
            arms = (1.0 + state.scale) * tag.corners_m() @ pose.R.T
            by_pose = np.zeros((4, 6))
            by_pose[:, :3] = -_cross_matrix(arms)[:, 2]
            by_pose[:, 5] = 1.0
            heights = arms[:, 2] + pose.t_m[2]
            rows.add(heights / self.sigmas.floor_m, (at, by_pose / self.sigmas.floor_m))

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


class _Rows:
    """Blocks of a sparse Jacobian, gathered row by row."""

    def __init__(self) -> None:
        self._residuals: list[FloatArray] = []
        self._blocks: list[tuple[int, int, FloatArray]] = []
        self._n = 0

    def add(self, residual: FloatArray, *blocks: tuple[int, FloatArray | list[list[float]]]) -> None:
        """Add rows: their residuals, and derivatives from the given column on."""
        self._residuals.append(residual)
        self._blocks += [(self._n, column, np.asarray(block)) for column, block in blocks]
        self._n += len(residual)

    def equations(self, n_unknowns: int) -> NetworkEquations:
        """Everything that was added."""
        row = [np.repeat(top + np.arange(len(b)), b.shape[1]) for top, _, b in self._blocks]
        column = [np.tile(left + np.arange(b.shape[1]), len(b)) for _, left, b in self._blocks]
        value = [b.ravel() for _, _, b in self._blocks]
        entries = (np.concatenate(value), (np.concatenate(row), np.concatenate(column)))
        jacobian = sparse.csr_matrix(entries, shape=(self._n, n_unknowns))
        return NetworkEquations(np.concatenate(self._residuals), jacobian)


def _moved(pose: Pose, step: FloatArray) -> Pose:
    return Pose(Rotation.from_rotvec(step[:3]).as_matrix() @ pose.R, pose.t_m + step[3:])


def _cross_matrix(vector: FloatArray) -> FloatArray:
    """Matrices ``(..., 3, 3)`` with ``[v] w = v x w``."""
    matrix = np.zeros((*vector.shape, 3))
    x, y, z = np.moveaxis(vector, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2] = -z, y
    matrix[..., 1, 0], matrix[..., 1, 2] = z, -x
    matrix[..., 2, 0], matrix[..., 2, 1] = -y, x
    return matrix
