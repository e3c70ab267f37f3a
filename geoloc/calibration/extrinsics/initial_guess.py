"""A first guess of every pose: tag by tag from single pictures, chained, then laid onto what was measured.

A flat square seen from afar has two poses that look almost alike; wherever a pose is chosen, both of every
sighting are tried and the one that all pictures together like best is taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.network import NetworkState
from geoloc.calibration.extrinsics.observations import Pose, Sighting, Tag, by_view

_WORST_RAD = 0.05
"""Directions that differ more count as this: one wrong tag must not decide."""
_YAWS = 12
_MAX_STEPS = 40
"""Only a start: where the tags leave something open, going on would follow it for ever."""
_MIN_SPREAD_M = 0.3
"""Measured places closer to one line than this do not settle a rotation."""


def chained(sightings: Sequence[Sighting]) -> tuple[NetworkState, ...]:
    """Poses of views and tags, in one frame for each group that tags tie together.

    Returns
    -------
    tuple of NetworkState
        One a group, in the frame of that group's first view: the one with most tags.
    """
    of_view = by_view(list(sightings))
    candidates = {id(s): tag_poses(s) for s in sightings}
    waiting = set(of_view)
    groups = []
    while waiting:
        root = max(sorted(waiting), key=lambda view: len(of_view[view]))
        views = {root: Pose(np.eye(3), np.zeros(3))}
        placed: dict[int, Pose] = {}
        waiting.discard(root)
        while True:
            _place_tags(views, placed, sightings, candidates)
            shared = {v: sum(s.tag in placed for s in of_view[v]) for v in sorted(waiting)}
            best = max(shared, key=lambda view: shared[view], default=None)
            if best is None or not shared[best]:
                break
            views[best] = _placed_view(of_view[best], placed, candidates)
            waiting.discard(best)
        groups.append(NetworkState(views, placed))
    return tuple(groups)


def tag_poses(sighting: Sighting) -> tuple[Pose, ...]:
    """Both poses of four flat points in the camera frame that fit its four rays, best first.

    The rays are turned to where the tag is straight ahead, so that wide lenses need no undistorted image.
    Collins and Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 109 (2014), in OpenCV.
    """
    import cv2

    camera_R_ahead = _rotation_onto(sighting.ray.mean(axis=0))
    turned = sighting.ray @ camera_R_ahead
    if (turned[:, 2] <= 1e-3).any():
        return ()
    plane = np.ascontiguousarray(turned[:, :2] / turned[:, 2:])
    try:
        found, rotations, translations, _ = cv2.solvePnPGeneric(
            sighting.points_m, plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:  # four corners on one line
        return ()
    poses = [
        Pose(camera_R_ahead @ cv2.Rodrigues(r)[0], camera_R_ahead @ np.asarray(t).ravel())
        for r, t in zip(rotations, translations, strict=True)
        if found and np.isfinite(r).all() and np.isfinite(t).all() and np.asarray(t).ravel()[2] > 0.0
    ]
    return tuple(poses)


def laid_onto_rig(group: NetworkState, tags: Mapping[int, Tag], nominal: Mapping[str, Pose]) -> NetworkState:
    """Turn and move a group so that it fits what was measured in the rig frame.

    Parameters
    ----------
    group : NetworkState
        From `chained`.
    tags : mapping of id to Tag
    nominal : mapping of view to Pose
        Roughly known poses of cameras in the rig frame; only a start where tags leave something open.
    """
    starts = [*_by_places(group, tags), *_by_nominal(group, nominal)]
    starts = starts or list(_by_floor(group, tags)) or list(_by_any_turn(group, tags))
    solved = [
        least_squares(_misfit, _vector(start), args=(group, tags), max_nfev=_MAX_STEPS) for start in starts
    ]
    if not solved:
        return group
    # Where several fit alike the first counts: measured places come before rough poses.
    costs = np.array([s.cost for s in solved])
    best = int(np.flatnonzero(costs <= costs.min() * 1.01 + 1e-6)[0])
    frame = _pose(solved[best].x)
    return NetworkState(
        {name: frame.after(pose) for name, pose in group.views.items()},
        {tag: frame.after(pose) for tag, pose in group.tags.items()},
    )


def _place_tags(
    views: Mapping[str, Pose],
    placed: dict[int, Pose],
    sightings: Sequence[Sighting],
    candidates: Mapping[int, tuple[Pose, ...]],
) -> None:
    """Place every tag that a placed view sees."""
    seen: dict[int, list[Sighting]] = {}
    for sighting in sightings:
        if sighting.view in views and sighting.tag not in placed:
            seen.setdefault(sighting.tag, []).append(sighting)
    for tag, mine in seen.items():
        poses = [views[s.view].after(pose) for s in mine for pose in candidates[id(s)]]
        if poses:
            placed[tag] = min(poses, key=lambda p: sum(_unlikeness(views[s.view], p, s) for s in mine))


def _placed_view(
    mine: Sequence[Sighting],
    placed: Mapping[int, Pose],
    candidates: Mapping[int, tuple[Pose, ...]],
) -> Pose:
    known = [s for s in mine if s.tag in placed]
    poses = [placed[s.tag].after(pose.inverse()) for s in known for pose in candidates[id(s)]]
    if not poses:
        return Pose(np.eye(3), np.zeros(3))
    return min(
        poses,
        key=lambda view: sum(_unlikeness(view, placed[s.tag], s) for s in known),
    )


def _unlikeness(view: Pose, tag: Pose, sighting: Sighting) -> float:
    """Sum of the angles between observed and expected rays, each capped."""
    away = (sighting.points_m @ tag.R.T + tag.t_m - view.t_m) @ view.R
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    return float(np.minimum(np.linalg.norm(away - sighting.ray, axis=1), _WORST_RAD).sum())


def _by_places(group: NetworkState, tags: Mapping[int, Tag]) -> Iterable[Pose]:
    """Turn and shift that bring points to their measured places (Kabsch 1976), from three not on a line."""
    here, there = _measured(group, tags)
    whole = np.isfinite(there).all(axis=1)
    here, there = here[whole], there[whole]
    if len(here) < 3:
        return
    middle, target = here.mean(axis=0), there.mean(axis=0)
    if np.linalg.svd(there - target, compute_uv=False)[1] < _MIN_SPREAD_M:
        return
    u, _, vt = np.linalg.svd((here - middle).T @ (there - target))
    sign = np.sign(np.linalg.det(vt.T @ u.T))
    rotation = vt.T @ np.diag([1.0, 1.0, sign]) @ u.T
    yield Pose(rotation, target - rotation @ middle)


def _measured(group: NetworkState, tags: Mapping[int, Tag]) -> tuple[FloatArray, FloatArray]:
    """Points of tags in the group's frame, and where they were measured (n, 3); NaN where not."""
    here = [tags[t].points_m() @ pose.R.T + pose.t_m for t, pose in group.tags.items()]
    there = [tags[t].places_m() for t in group.tags]
    return np.vstack([np.empty((0, 3)), *here]), np.vstack([np.empty((0, 3)), *there])


def _by_nominal(group: NetworkState, nominal: Mapping[str, Pose]) -> Iterable[Pose]:
    for view, pose in group.views.items():
        if view in nominal:
            yield nominal[view].after(pose.inverse())


def _by_floor(group: NetworkState, tags: Mapping[int, Tag]) -> Iterable[Pose]:
    """The floor tags' common up made the rig's up, with every yaw in steps."""
    floor = [pose for tag, pose in group.tags.items() if tags[tag].on_floor]
    if not floor:
        return
    up = -np.mean([pose.R[:, 2] for pose in floor], axis=0)
    level = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up / np.linalg.norm(up)])[0]
    middle = np.mean([pose.t_m for pose in floor], axis=0)
    for yaw in np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False):
        rotation = (Rotation.from_euler("z", yaw) * level).as_matrix()
        yield Pose(rotation, -rotation @ middle)


def _by_any_turn(group: NetworkState, tags: Mapping[int, Tag]) -> Iterable[Pose]:
    """Every turn of a cube onto itself, with the measured points' middle where it should be."""
    here, there = _measured(group, tags)
    known = np.isfinite(there)
    some = known.any(axis=1)
    if not some.any():
        return
    middle = here[some].mean(axis=0)
    target = np.nan_to_num(there).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    for turn in Rotation.create_group("O").as_matrix():
        yield Pose(turn, target - turn @ middle)


def _misfit(vector: FloatArray, group: NetworkState, tags: Mapping[int, Tag]) -> FloatArray:
    """How far tags are from where they were measured, metres; the weak pull keeps an open frame in place."""
    frame = _pose(vector)
    here, there = _measured(group, tags)
    off = here @ frame.R.T + frame.t_m - there
    parts = [1e-3 * vector, off[np.isfinite(off)]]
    for tag, pose in group.tags.items():
        moved = frame.after(pose)
        if tags[tag].on_floor:
            parts.append((tags[tag].corners_m() @ moved.R.T + moved.t_m)[:, 2])
            # A floor tag that lies face down fits z = 0 just as well.
            parts.append(np.array([np.maximum(0.0, moved.R[2, 2])]))
    return np.concatenate(parts)


def _rotation_onto(ray: FloatArray) -> FloatArray:
    """Rotation whose third column is the ray's direction."""
    z = ray / np.linalg.norm(ray)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _vector(pose: Pose) -> FloatArray:
    return np.concatenate([Rotation.from_matrix(pose.R).as_rotvec(), pose.t_m])


def _pose(vector: FloatArray) -> Pose:
    return Pose(Rotation.from_rotvec(vector[:3]).as_matrix(), vector[3:])
