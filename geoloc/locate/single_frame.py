"""One sighting → position and covariance: the paper's method and the true ray."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_enu, inverse_haversine
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.locate.error_budget import LENS_SOURCES, ErrorBudget, Pair, source_moves
from geoloc.locate.feet import (
    BLOCK,
    Axes,
    Enu,
    Feet,
    Rejections,
    axes_of,
    cameras_of,
    enu_of,
    feet_on_plane,
    rows_by_camera,
)
from geoloc.locate.paper_readings import PaperReadings
from geoloc.locate.records import Located, Sightings
from geoloc.reasons import Reason
from geoloc.rig.rig import Rig, RigCamera
from geoloc.trajectory.poses import Poses, part

__all__ = ["ErrorBudget", "Located", "Sightings", "locate_paper", "locate_single_frame"]


_DEFAULT_BUDGET = ErrorBudget()
_DEFAULT_READINGS = PaperReadings()


def locate_single_frame(
    rig: Rig,
    sightings: Sightings,
    poses: Poses,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    max_range_m: float = MAX_RANGE_M,
) -> Located:
    """Locate each sighting from its own frame: the true ray of its pixel, cut with the road's plane.

    The ray of the camera model is turned into the rig frame and meets the plane z = 0 of the rig, on which
    the car's wheels stand. Pitch and roll of the pose say how that plane lies in the world; heading turns the
    point to east and north, and the ellipsoidal direct problem gives its coordinates.

    Parameters
    ----------
    rig : Rig
    sightings : Sightings (n,)
    poses : Poses (n,)
        The rig's pose at the epoch of each sighting.
    budget : ErrorBudget
    max_range_m : float
        Hits further from the camera are refused.

    Returns
    -------
    Located
        Rejected, with the reason: an invalid pose, a pixel outside the image or the model's domain or on the
        car itself, a ray that does not go down, a hit beyond `max_range_m`.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """

    def put(_camera: RigCamera, seen: _Seen) -> _Put:
        p, enu = seen.poses, seen.enu
        lat, lon = geographic_from_enu(p.latitude_deg, p.longitude_deg, enu.east, enu.north)
        return _Put(lat, lon, p.height_m + enu.up, [], {})

    return _located(rig, sightings, poses, budget, max_range_m, put)


def locate_paper(
    rig: Rig,
    sightings: Sightings,
    nearest: Poses,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    readings: PaperReadings = _DEFAULT_READINGS,
    fix_interval_s: float = 0.2,
    delay_ms: float = 78.0,
    max_range_m: float = MAX_RANGE_M,
) -> Located:
    """Locate each sighting as the paper does: the baseline that everything is compared with.

    The paper leaves some things open; they are read like this, unless `readings` say otherwise. The distance
    d is the horizontal length, from the rig's origin, of the point where the true ray meets the rig's ground
    plane. Equation 1 gives the azimuth ``θ = (FOV / w) (p_x - w/2) + ψ_camera + θ_car``, with p_x counted
    from the image's left edge (half a pixel more than ours), FOV the camera's horizontal field of view,
    ψ_camera the camera's yaw turned clockwise (the rig's is counter-clockwise), and θ_car the heading of the
    fix. Equations 2 and 3 are the inverse haversine on a sphere of 6371 km, starting from the fix whose host
    stamp is nearest to that of the frame: no interpolation, no lever arm, no correction for late stamps.

    Parameters
    ----------
    nearest : Poses (n,)
        From `Trajectory.nearest_fix`.
    readings : PaperReadings
    fix_interval_s : float
        Time between fixes: the nearest one is off by a uniform ± half of it, random.
    delay_ms : float
        How late host stamps are (`Trajectory.delay_ms`): taken as one sigma, systematic.

    Returns
    -------
    Located
        Rejections as in `locate_single_frame`. The covariance is that of the exact model with the two terms
        of time added. It leaves out what the method itself gets wrong: the bearing that is linear in the
        pixel, the lever arm of antenna and camera, the sphere. `height_m` is that of the fix: the paper gives
        no height.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.

    Notes
    -----
    Shami, Kiss, Haakonsen and Lindseth (2024), arXiv:2401.07582.
    """

    def put(camera: RigCamera, seen: _Seen) -> _Put:
        p, feet = seen.poses, seen.feet
        fov_rad = readings.fov_rad(camera)
        azimuth = _paper_azimuth(camera, fov_rad, seen.pixel_px) + p.heading_deg
        distance_m = readings.distance_m(camera, feet)
        lat, lon = inverse_haversine(*readings.start_deg(p), azimuth, distance_m)
        along = [axis * p.speed_mps for axis in seen.axes.forward[:2]]
        half_way = fix_interval_s / np.sqrt(12.0)
        return _Put(
            lat,
            lon,
            p.height_m,
            [(along[0] * half_way, along[1] * half_way)],
            {"link delay": (along[0] * delay_ms * 1e-3, along[1] * delay_ms * 1e-3)},
            Reason.WIDER_THAN_MODEL if np.isnan(fov_rad) else None,
        )

    return _located(rig, sightings, nearest, budget, max_range_m, put)


class _Seen(NamedTuple):
    """Feet of one camera in one block, and all that their places depend on."""

    pixel_px: FloatArray
    feet: Feet
    poses: Poses
    axes: Axes
    enu: Enu


class _Put(NamedTuple):
    """Where a method puts these feet, and the sources of error that are its own (moves east and north)."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    random: list[Pair]
    systematic: dict[str, Pair]
    rejected: Reason | None = None
    """Why it puts none of them."""


def _paper_azimuth(camera: RigCamera, fov_rad: float, pixel_px: FloatArray) -> FloatArray:
    """Equation 1 of the paper without the car's heading, degrees."""
    width = camera.model.width_px
    axis = camera.rig_R_camera[:, 2]
    per_pixel = fov_rad / width
    p_x = pixel_px[:, 0] + 0.5
    return np.asarray(np.degrees(per_pixel * (p_x - width / 2.0) - np.arctan2(axis[1], axis[0])))


def _located(
    rig: Rig,
    sightings: Sightings,
    poses: Poses,
    budget: ErrorBudget,
    max_range_m: float,
    put: Callable[[RigCamera, _Seen], _Put],
) -> Located:
    """Locate a block of rows of one camera at a time; rejected rows become NaN throughout."""
    n, names = sightings.camera.size, cameras_of(sightings.camera)
    out: _Columns | None = None
    rejections = Rejections()
    for start in range(0, max(n, 1), BLOCK):
        own = slice(start, start + BLOCK)
        block = part(poses, own)
        for camera, rows in rows_by_camera(rig, sightings.camera[own]):
            at = own if isinstance(rows, slice) else start + rows
            with np.errstate(all="ignore"):
                seen = _seen(camera, sightings.pixel_px[own][rows], part(block, rows), max_range_m)
                placed = put(camera, seen)
                random, of_camera, shared = source_moves(
                    camera, seen.feet, seen.axes, seen.enu, seen.poses, budget
                )
            random, shared = random + placed.random, shared | placed.systematic
            if out is None:
                exact = all(budget.lens_of(rig.camera(name)).is_exact for name in names)
                sources = [what for what in of_camera if what not in LENS_SOURCES]
                out = _Columns.empty(n, names, sources if exact else [*sources, *LENS_SOURCES], shared)
            bad = rejections.add(
                camera, seen.feet, block, rows, start, max_range_m, otherwise=placed.rejected
            )
            systematic = {f"{what} {camera.name}": move for what, move in of_camera.items()} | shared
            out.write(at, placed, seen.feet.range_m, random, systematic, bad)
    if out is None:
        out = _Columns.empty(n, names, {}, {})
    return out.located(rejections.column(n))


def _seen(camera: RigCamera, pixel_px: FloatArray, poses: Poses, max_range_m: float) -> _Seen:
    feet, axes = feet_on_plane(camera, pixel_px, max_range_m), axes_of(poses)
    return _Seen(pixel_px, feet, poses, axes, enu_of(axes, feet))


@dataclass(frozen=True, slots=True)
class _Columns:
    """A `Located` that is being filled."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    range_m: FloatArray
    random_m2: FloatArray
    systematic_m: FloatArray
    covariance_m2: FloatArray
    source: tuple[str, ...]

    @classmethod
    def empty(
        cls, n: int, cameras: Sequence[str], of_camera: Iterable[str], shared: Iterable[str]
    ) -> _Columns:
        """Room for n rows and every source."""
        source = (*(f"{what} {name}" for name in cameras for what in of_camera), *shared)
        matrices = np.empty((n, 2, 2)), np.zeros((n, 2, len(source))), np.empty((n, 2, 2))
        return cls(np.empty(n), np.empty(n), np.empty(n), np.empty(n), *matrices, source)

    def write(
        self,
        at: slice | IntArray,
        placed: _Put,
        range_m: FloatArray,
        random: list[Pair],
        systematic: dict[str, Pair],
        bad: BoolArray | None,
    ) -> None:
        """Put the rows `at`; those that are `bad` become NaN."""
        for source, (east, north) in systematic.items():
            column = self.source.index(source)
            self.systematic_m[at, 0, column], self.systematic_m[at, 1, column] = east, north
        spread = _outer(random)
        self.random_m2[at] = spread
        self.covariance_m2[at] = spread + _outer(systematic.values())
        self.latitude_deg[at], self.longitude_deg[at] = placed.latitude_deg, placed.longitude_deg
        self.height_m[at], self.range_m[at] = placed.height_m, range_m
        if bad is not None:
            rows = np.flatnonzero(bad) + at.start if isinstance(at, slice) else at[bad]
            for values in (getattr(self, field.name) for field in fields(self) if field.name != "source"):
                values[rows] = np.nan

    def located(self, rejected: NDArray[np.str_]) -> Located:
        """The finished result."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        return Located(**columns, rejected=rejected)


def _outer(moves: Iterable[Pair]) -> FloatArray:
    """Sum of the outer products of moves (m,): float64 (m, 2, 2)."""
    ee, en, nn = (sum(products) for products in zip(*((e * e, e * n, n * n) for e, n in moves), strict=True))
    return np.stack([ee, en, en, nn], axis=-1).reshape(-1, 2, 2)
