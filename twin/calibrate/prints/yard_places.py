"""Where to stand AprilTags around a car, so that each of its cameras sees enough of them, well spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.rig.rig import Rig, RigCamera
from twin.errors import ConfigError

RINGS_M = ((5.0, 0.65), (7.5, 1.35), (10.5, 2.2))
"""Distance from a camera, and height of a standing tag's middle: behind one another, none hides another."""
PARTS = 4
_STEP_DEG = 5.0
_GRID_M = 0.1
"""Places are told to so much: nobody stands a tripod closer."""
_MARGIN = 1.6
"""Of the black square's edge: with its white margin, and some room to the picture's edge."""
_LEAST_SIDE_PX = 25.0
_FLOOR_REACH_M, _FLOOR_STEP_M = 8.0, 0.5
_NEAREST_M = 1.0
"""Between a tag and a camera."""


@dataclass(frozen=True, slots=True)
class PlannedTag:
    """One tag of a yard.

    Attributes
    ----------
    id : int
    place_m : tuple of float
        Its middle in the rig frame: x forward, y left, z up.
    on_floor : bool
    cameras : tuple of str
        Those that see it whole.
    """

    id: int
    place_m: tuple[float, float, float]
    on_floor: bool
    cameras: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A place that a tag may stand at, and which wishes it would fulfil: camera, ring (or floor), quarter."""

    place_m: FloatArray
    on_floor: bool
    fulfils: frozenset[tuple[str, int, int]]


def planned_tags(rig: Rig, size_m: float) -> tuple[PlannedTag, ...]:
    """Plan a yard for all cameras of a rig whose rough place is known.

    Each camera wants a standing tag in each quarter of its picture's width at each of three distances, and
    some on the floor. What several cameras see comes first: it ties them together.

    Parameters
    ----------
    rig : Rig
    size_m : float
        Edge of the tags' black squares.

    Raises
    ------
    ConfigError
        If no camera is placed, or one sees no place for a tag.
    """
    cameras = {name: camera for name, camera in rig.cameras.items() if camera.is_placed}
    if not cameras:
        raise ConfigError(
            f"{rig.source} does not say where a camera sits: write its rough place and angles into the rig, "
            "to 10 cm and 5°."
        )
    standing = _chosen(_standing(cameras, size_m), cameras, size_m, [])
    floor = _chosen(_lying(cameras, size_m), cameras, size_m, standing)
    chosen = [*standing, *floor]
    blind = [name for name in cameras if not any(name == wish[0] for c in chosen for wish in c.fulfils)]
    if blind:
        raise ConfigError(
            f"No tag of {size_m:g} m would be seen by {', '.join(blind)} of {rig.source} at "
            f"{RINGS_M[0][0]:g} to {RINGS_M[-1][0]:g} m: look at its place and angles in the rig, or take "
            "larger tags."
        )
    return tuple(
        PlannedTag(
            number,
            (float(c.place_m[0]), float(c.place_m[1]), float(c.place_m[2])),
            c.on_floor,
            tuple(name for name in cameras if any(wish[0] == name for wish in c.fulfils)),
        )
        for number, c in enumerate(chosen)
    )


def _standing(cameras: Mapping[str, RigCamera], size_m: float) -> list[_Candidate]:
    places = set()
    for camera in cameras.values():
        for distance_m, height_m in RINGS_M:
            for azimuth in np.radians(np.arange(0.0, 360.0, _STEP_DEG)):
                x, y = camera.rig_t_camera_m[:2] + distance_m * np.array([np.cos(azimuth), np.sin(azimuth)])
                z = max(height_m, 0.5 * _MARGIN * size_m)
                places.add((round(x / _GRID_M), round(y / _GRID_M), z))
    candidates = []
    for x, y, z in sorted(places):
        place = np.array([round(x * _GRID_M, 1), round(y * _GRID_M, 1), z])
        ring = min(range(len(RINGS_M)), key=lambda n: abs(RINGS_M[n][1] - z))
        fulfils = {
            (name, ring, part)
            for name, camera in cameras.items()
            if (part := _part(camera, _upright_corners(place, camera, size_m))) is not None
        }
        candidates.append(_Candidate(place, False, frozenset(fulfils)))
    return candidates


def _lying(cameras: Mapping[str, RigCamera], size_m: float) -> list[_Candidate]:
    steps = np.arange(-_FLOOR_REACH_M, _FLOOR_REACH_M + _FLOOR_STEP_M / 2.0, _FLOOR_STEP_M)
    half = 0.5 * _MARGIN * size_m
    outline = half * np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
    middle = np.mean([camera.rig_t_camera_m for camera in cameras.values()], axis=0)
    candidates = []
    for x in steps:
        for y in steps:
            place = np.array([round(middle[0]) + x, y, 0.0])
            fulfils = {
                (name, len(RINGS_M), part)
                for name, camera in cameras.items()
                if (part := _part(camera, place + outline)) is not None
            }
            candidates.append(_Candidate(place, True, frozenset(fulfils)))
    return candidates


def _upright_corners(place_m: FloatArray, camera: RigCamera, size_m: float) -> FloatArray:
    """Corners (4, 3) of a tag, its margin too, that stands upright and faces a camera."""
    away = place_m[:2] - camera.rig_t_camera_m[:2]
    aside = np.array([-away[1], away[0], 0.0]) / max(float(np.hypot(*away)), 1e-9)
    up = np.array([0.0, 0.0, 1.0])
    half = 0.5 * _MARGIN * size_m
    signs = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
    return np.array([place_m + half * (s * aside + t * up) for s, t in signs])


def _part(camera: RigCamera, corners_m: FloatArray) -> int | None:
    """Which quarter of the picture's width a tag is in; None if it is not seen whole, or too small."""
    point = (corners_m - camera.rig_t_camera_m) @ camera.rig_R_camera
    if np.linalg.norm(point, axis=1).min() < _NEAREST_M:
        return None
    pixel, inside = camera.model.pixel_from_camera_point(point)
    if not inside.all():
        return None
    sides = np.linalg.norm(pixel - np.roll(pixel, -1, axis=0), axis=1) / _MARGIN
    if sides.min() < _LEAST_SIDE_PX:
        return None
    return int(pixel[:, 0].mean() * PARTS / camera.model.width_px)


def _chosen(
    candidates: Sequence[_Candidate],
    cameras: Mapping[str, RigCamera],
    size_m: float,
    standing: Sequence[_Candidate],
) -> list[_Candidate]:
    """Take the candidate that fulfils most of what is still wished for, until none does."""
    rest = [c for c in candidates if not any(_in_the_way(c, s, cameras, size_m) for s in standing)]
    wished = {wish for candidate in rest for wish in candidate.fulfils}
    taken: list[_Candidate] = []
    while wished and rest:
        best = max(rest, key=lambda c: len(c.fulfils & wished))
        if not best.fulfils & wished:
            break
        taken.append(best)
        wished -= best.fulfils
        rest = [c for c in rest if not _in_the_way(c, best, cameras, size_m)]
    return taken


def _in_the_way(one: _Candidate, other: _Candidate, cameras: Mapping[str, RigCamera], size_m: float) -> bool:
    """Whether a camera that sees both sees them on top of one another, or they stand too close."""
    radius = 0.5 * np.sqrt(2.0) * _MARGIN * size_m
    if np.linalg.norm(one.place_m - other.place_m) < 2.0 * radius:
        return True
    for camera in cameras.values():
        a, b = one.place_m - camera.rig_t_camera_m, other.place_m - camera.rig_t_camera_m
        far_a, far_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
        angle = float(np.arccos(np.clip(a @ b / (far_a * far_b), -1.0, 1.0)))
        if angle < np.arctan(radius / far_a) + np.arctan(radius / far_b):
            return True
    return False
