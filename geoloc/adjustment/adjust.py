"""Every sighting of every object in every camera of a drive → positions, by one robust least squares.

One frame and flat ground cannot place a sign beyond 15 m to half a metre: a tenth of a degree of pitch is a
metre there. But a car that passes a sign sees it from many places, and bearings that cross say where it
stands. `adjust` finds the positions of all objects together with what all sightings share: the boresight of
each camera, the offset of the camera clock, the rolling shutter, the trajectory's error in roll, pitch and
heading second by second, and the bounce of the body in each frame. Everything that is unknown has a prior, so
that one frame, one camera or a car that stands still is solved as well as it can be, and its covariance says
how well that is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from geoloc.adjustment.build_model import Placed, model_of, on_terrain, scene_of
from geoloc.adjustment.corrected_poses import corrected_poses
from geoloc.adjustment.covariance import Spread, spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.scene import bodies_at, rays_of, sigma_px_of
from geoloc.adjustment.solve import Solution, solve
from geoloc.adjustment.unknowns import BESIDE_ROAD, READOUT, TIME
from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.doubts import Doubt
from geoloc.earth.geodesy import geographic_from_enu
from geoloc.earth.terrain import Terrain
from geoloc.locate.combine import ellipse
from geoloc.locate.error_budget import LIKELY_READOUT_MS, ErrorBudget
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.trajectory.poses import Poses

POLE_RADIUS_M = 0.03
"""The ordinary sign pole in Norway is a steel tube of 60 mm."""
_DEFAULT_BUDGET = ErrorBudget()
# A bearing alone leaves a position open along the ray: what is worse than this is no position.
_WORST_SIGMA_M = 5.0
# Logarithm of the ratio between the distances of a point's start and end: a factor of three.
_LARGEST_LEAP = 1.1
# So many sigmas, of what the rays say and of what was stated together, and a stated clock is given up. Honest
# clocks reach 4.7 in 180 simulated drives: long bends with slip look like a clock that is late.
_CERTAIN, _WIDER = 6.0, 3.0
# Outside this the rolling shutter takes up something else.
_READOUTS_MS = (-15.0, 50.0)
# A data sheet's readout, and how exposure and line time differ from it.
_STATED_READOUT_MS = 1.0


class AdjustmentDoubt(StrEnum):
    """What an adjustment is doubted for."""

    CLOCK = "clock"
    SHUTTER = "shutter"
    TERRAIN_UNUSED = "terrain-unused"


@dataclass(frozen=True, slots=True)
class Correction:
    """What the adjustment found out about something that all sightings share."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Adjusted:
    """Positions of objects, one row each in increasing order of `object`, and what else was found.

    Attributes
    ----------
    object : int64 (g,)
    latitude_deg, longitude_deg, height_m : float64 (g,)
        Foot of the object where feet were sighted, else the middle of its face. `height_m` ellipsoidal. NaN
        where it has no position: `reason` says why.
    covariance_m2 : float64 (g, 2, 2)
        East and true north.
    sigma_height_m : float64 (g,)
    by_source : mapping source → float64 (g, 2, 2)
        Where `covariance_m2` comes from: pixels, boresight, camera position, time, rolling shutter, heading,
        body, ground, gnss, lever arm. They add up to it.
    reason : str (g,)
        A `geoloc.reasons.Reason`; "" where there is a position.
    used : bool (n,)
        Sightings that took part.
    rejected : str (n,)
        Why a sighting did not, a `geoloc.reasons.Reason`; "" where it did.
    residual_px : float64 (n, 2)
        Seen minus expected; NaN for sightings that could not be tried.
    range_m : float64 (n,)
        Horizontal distance from the camera to the object's place.
    eye_m : float64 (n, 3)
        The camera's place when it saw, east and north of the object's place and above the ellipsoid.
    poses : Poses (n,)
        The rig's pose at each sighting, as corrected; sigmas are the trajectory's.
    noise : float
        Factor on the stated sigma of a pixel that the residuals ask for.
    time_offset_ms, readout_ms : Correction
        Added to the camera clock; and the readout itself.
    boresight_deg : mapping camera → tuple of Correction
        About the camera's own x (pitch), y (yaw) and z (roll).
    doubts : tuple of Doubt
        Of the kinds of `AdjustmentDoubt`: a clock or a shutter that cannot be, terrain not used.
    """

    object: IntArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    covariance_m2: FloatArray
    sigma_height_m: FloatArray
    by_source: dict[str, FloatArray]
    reason: TextArray
    used: BoolArray
    rejected: TextArray
    residual_px: FloatArray
    range_m: FloatArray
    eye_m: FloatArray
    poses: Poses
    noise: float
    time_offset_ms: Correction
    readout_ms: Correction
    boresight_deg: dict[str, tuple[Correction, ...]]
    doubts: tuple[Doubt, ...]


def adjust(
    observations: Observations,
    budget: ErrorBudget = _DEFAULT_BUDGET,
    *,
    size_px: FloatArray | None = None,
    readout_ms: float | None = None,
    pole_radius_m: float = POLE_RADIUS_M,
    noise: float | None = None,
    track_sigma_m: float = 0.0,
    terrain: Terrain | None = None,
) -> Adjusted:
    """Adjust a drive.

    Parameters
    ----------
    observations : Observations (n,)
    budget : ErrorBudget
        Priors: one sigma of each source.
    size_px : float64 (n,), optional
        Height of the box that a sighting is the middle of; NaN for points.
    readout_ms : float or None
        Rolling shutter's readout from the first to the last row, good to 1 ms. None: unknown.
    pole_radius_m : float
        What annotators mark as the foot is the front of the pole; its middle stands this much behind it.
    noise : float, optional
        Factor on every sigma of a pixel. Default: what the residuals ask for.
    track_sigma_m : float
        One sigma a horizontal axis that the whole track is off beyond what its poses say (a change of datum).
    terrain : Terrain, optional
        Measured ground to use instead of the plane of the road, where it has heights.

    Returns
    -------
    Adjusted

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras.
    """
    trajectory, object_index = observations.trajectory, observations.object_index
    placed, rejected, poses = _placed(observations, budget, size_px)
    objects = np.unique(object_index[object_index >= 0])
    scene = scene_of(observations.rig, observations.sightings.camera, placed)
    rejected[np.setdiff1d(placed.row, scene.row)] = Reason.NO_CROSSING
    if scene.point.size == 0:
        return _nothing(objects, rejected, poses)
    stated = budget if readout_ms is None else replace(budget, readout_ms=_STATED_READOUT_MS)
    likely = LIKELY_READOUT_MS if readout_ms is None else readout_ms

    def solved(priors: ErrorBudget) -> tuple[Model, Solution, Spread]:
        model, prior = model_of(scene, trajectory, priors, 1e-3 * likely, pole_radius_m)
        if terrain is not None:
            model = on_terrain(model, terrain, budget)
        solution = solve(model, prior, noise)
        return model, solution, spread(model, solution)

    model, solution, found = solved(stated)
    doubts = list(_doubts(model, solution, terrain))
    clock = _clock_of_the_rays(solution, found, budget)
    if abs(clock.value) > _CERTAIN * np.hypot(clock.sigma, budget.time_ms):
        # The stated clock cannot be: let the rays say what it is.
        model, solution, found = solved(replace(stated, time_ms=_WIDER * abs(clock.value)))
        later = 1e3 * float(solution.x[TIME])
        doubts.append(
            Doubt(
                AdjustmentDoubt.CLOCK,
                f"The camera clock does not fit the track: {later:+.0f} ms were added to it. Do not trust the"
                " positions before camera_offset_ms is right, and frames and fixes are both UTC.",
            )
        )
    rejected[scene.row[~solution.inlier]] = Reason.OUTLIER
    corrected = corrected_poses(model, solution.x, poses)
    return _adjusted(
        objects, rejected, corrected, model, solution, found, budget, track_sigma_m, tuple(doubts)
    )


def _clock_of_the_rays(solution: Solution, found: Spread, budget: ErrorBudget) -> Correction:
    """What the rays alone say of the camera clock, milliseconds: the solution without the clock's prior."""
    value, variance = 1e3 * float(solution.x[TIME]), 1e6 * float(found.shared[TIME, TIME])
    information = 1.0 / variance - 1.0 / budget.time_ms**2
    if information <= 0.0:
        return Correction(0.0, np.inf)
    return Correction(value / variance / information, float(np.sqrt(1.0 / information)))


def _doubts(model: Model, solution: Solution, terrain: Terrain | None) -> Iterator[Doubt]:
    """What a person should know of a solution."""
    readout_ms = 1e3 * (model.readout_s + float(solution.x[READOUT]))
    if not _READOUTS_MS[0] < readout_ms < _READOUTS_MS[1]:
        yield Doubt(
            AdjustmentDoubt.SHUTTER,
            f"The rolling shutter that fits best would take {readout_ms:.0f} ms, which no camera does: check"
            " camera_offset_ms, the frame stamps and the calibration.",
        )
    if terrain is None:
        return
    feet, used = int(model.scene.is_foot.sum()), 0 if model.terrain is None else model.terrain.point.size
    if used < feet:
        yield Doubt(
            AdjustmentDoubt.TERRAIN_UNUSED,
            f"The terrain was used for {used} of {feet} feet: elsewhere it has no height, or lies more than"
            " 2 m from the car's own, and the plane of the road was used.",
        )


def _placed(
    observations: Observations, budget: ErrorBudget, size_px: FloatArray | None
) -> tuple[Placed, TextArray, Poses]:
    """Cast the rays of an object's sightings from where the car was.

    Returns
    -------
    placed : Placed
        Sightings that can take part, and the point, a foot or a face, that each is of.
    rejected : str (n,)
        Why each of the others cannot.
    poses : Poses (n,)
    """
    object_index = observations.object_index
    rays = rays_of(observations.rig, observations.sightings)
    bodies, poses = bodies_at(observations.trajectory, observations.epoch_ns)
    rejected = np.where(rays.rejected != "", rays.rejected, poses.reason)
    rejected[(rejected == "") & ~poses.valid] = Reason.NO_POSE
    rejected[(rejected == "") & (object_index < 0)] = Reason.NO_OBJECT
    rows = np.flatnonzero(rejected == "")
    is_foot = np.asarray(observations.kind == Kind.FOOT)
    points, point = np.unique(2 * object_index[rows] + ~is_foot[rows], return_inverse=True)
    sizes_px = np.full(object_index.size, np.nan) if size_px is None else size_px
    placed = Placed(
        rows,
        point,
        points // 2,
        points % 2 == 0,
        observations.epoch_ns,
        bodies,
        rays,
        sigma_px_of(budget, sizes_px),
    )
    return placed, rejected, poses


def _adjusted(
    objects: IntArray,
    rejected: TextArray,
    poses: Poses,
    model: Model,
    solution: Solution,
    found: Spread,
    budget: ErrorBudget,
    track_sigma_m: float,
    doubts: tuple[Doubt, ...],
) -> Adjusted:
    """Bring points back to objects, positions to the ellipsoid, and add what no sighting can show."""
    scene, n, g = model.scene, rejected.size, objects.size
    points = model.points_m(solution.x)
    latitude, longitude = geographic_from_enu(
        scene.anchor_deg[:, 0], scene.anchor_deg[:, 1], points[:, 0], points[:, 1]
    )
    by_source = _every_source(found, model, budget, track_sigma_m)
    total = np.sum(list(by_source.values()), axis=0)
    sigma_major, _, _ = ellipse(total)
    firm = (sigma_major <= _WORST_SIGMA_M) & ~_leapt(model, points)
    index = np.searchsorted(objects, scene.object)
    chosen = _best_points(index, g, scene.is_foot, firm)
    reason = np.where(chosen < 0, Reason.NO_POSITION, np.where(firm[chosen], "", Reason.TOO_VAGUE))
    good = reason == ""
    lost = scene.row[~good[index[scene.point]]]
    rejected = np.where(np.isin(np.arange(n), lost) & (rejected == ""), Reason.TOO_VAGUE, rejected)

    def of_objects(values: FloatArray) -> FloatArray:
        result = np.full((g, *values.shape[1:]), np.nan)
        result[good] = values[chosen[good]]
        return result

    residual_px, eye_m = _of_sightings(model, solution, points, n)
    shared = np.sqrt(np.diag(found.shared))
    return Adjusted(
        object=objects,
        latitude_deg=of_objects(latitude),
        longitude_deg=of_objects(longitude),
        height_m=of_objects(points[:, 2]),
        covariance_m2=of_objects(total),
        sigma_height_m=of_objects(np.sqrt(found.covariance_m2[:, 2, 2])),
        by_source={source: of_objects(value) for source, value in by_source.items()},
        reason=reason,
        used=rejected == "",
        rejected=rejected,
        residual_px=residual_px,
        range_m=np.hypot(eye_m[:, 0], eye_m[:, 1]),
        eye_m=eye_m,
        poses=poses,
        noise=solution.noise,
        time_offset_ms=Correction(1e3 * float(solution.x[TIME]), 1e3 * float(shared[TIME])),
        readout_ms=Correction(
            1e3 * (model.readout_s + float(solution.x[READOUT])), 1e3 * float(shared[READOUT])
        ),
        boresight_deg=_boresight_deg(model, solution, shared),
        doubts=doubts,
    )


def _best_points(index: IntArray, n_objects: int, is_foot: BoolArray, firm: BoolArray) -> IntArray:
    """Choose the point (n_objects,) that stands for each object; -1 for none.

    `index`, `is_foot` and `firm` are of the points (m,): the object's, whether it is a foot, and whether its
    place is firm.
    """
    chosen = np.full(n_objects, -1)
    # What is written last counts: a foot before a face, a firm place before a vague one.
    for point in np.lexsort((is_foot, firm)):
        chosen[index[point]] = point
    return chosen


def _of_sightings(
    model: Model, solution: Solution, points_m: FloatArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, 2) of all sightings, and the camera's place (n, 3) from the point; NaN where unused."""
    scene = model.scene
    eye = model.origin_m + np.einsum("nij,nj->ni", scene.body.enu_R_rig, scene.rig_t_camera_m[scene.camera])
    eye[:, :2] -= points_m[scene.point, :2]
    residual_px, eye_m = np.full((n, 2), np.nan), np.full((n, 3), np.nan)
    residual_px[scene.row], eye_m[scene.row] = -solution.residual_px, eye
    return residual_px, eye_m


def _every_source(
    found: Spread, model: Model, budget: ErrorBudget, track_sigma_m: float
) -> dict[str, FloatArray]:
    """Covariance of each source: what the sightings show, and what holds for the whole track."""
    by_source = _merged(found.by_source)
    for source, whole in _of_the_track(model, budget, track_sigma_m).items():
        by_source[source] = by_source.get(source, 0.0) + whole
    return by_source


def _boresight_deg(model: Model, solution: Solution, sigma: FloatArray) -> dict[str, tuple[Correction, ...]]:
    """Pitch, yaw and roll of each camera; `sigma` is that of the shared unknowns, in radians for angles."""
    return {
        name: tuple(
            Correction(float(np.degrees(solution.x[k])), float(np.degrees(sigma[k])))
            for k in model.layout.boresight(np.array(i))
        )
        for i, name in enumerate(model.scene.cameras)
    }


def _leapt(model: Model, points_m: FloatArray) -> BoolArray:
    """Points (m,) that ended far from where they began: rays and ground contradict each other."""
    scene = model.scene
    _, first = np.unique(scene.point, return_index=True)
    origin = model.origin_m[first]
    began = np.linalg.norm((scene.start_m - origin)[:, :2], axis=1)
    ended = np.linalg.norm((points_m - origin)[:, :2], axis=1)
    return np.asarray(np.abs(np.log(np.maximum(ended, 0.1) / np.maximum(began, 0.1))) > _LARGEST_LEAP)


def _merged(by_source: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """East and north of each source; what keeps the equations solvable goes to the pixels."""
    plane = {source: value[:, :2, :2] for source, value in by_source.items()}
    for technical in ("anywhere", "face beside foot"):
        if technical in plane:
            plane["pixels"] = plane["pixels"] + plane.pop(technical)
    plane["ground"] = plane["ground"] + plane.pop(BESIDE_ROAD)
    return plane


def _of_the_track(model: Model, budget: ErrorBudget, track_sigma_m: float) -> dict[str, FloatArray]:
    """What moves the car's whole track, and every object with it, so that no sighting can show it."""
    scene = model.scene
    count = np.bincount(scene.point)
    mean = np.bincount(scene.point, weights=scene.body.sigma_horizontal_m**2) / count
    mean += track_sigma_m**2
    lever = np.full(count.size, budget.lever_arm_m**2)
    return {"gnss": mean[:, None, None] * np.eye(2), "lever arm": lever[:, None, None] * np.eye(2)}


def _nothing(objects: IntArray, rejected: TextArray, poses: Poses) -> Adjusted:
    """The answer where no sighting can be used."""
    n, g = rejected.size, objects.size
    nan = np.full(g, np.nan)
    unknown = Correction(0.0, np.inf)
    return Adjusted(
        objects,
        nan,
        nan,
        nan,
        np.full((g, 2, 2), np.nan),
        nan,
        {},
        np.full(g, Reason.NO_POSITION, dtype=REASON_TYPE),
        np.zeros(n, dtype=bool),
        rejected,
        np.full((n, 2), np.nan),
        np.full(n, np.nan),
        np.full((n, 3), np.nan),
        poses,
        1.0,
        unknown,
        unknown,
        {},
        (),
    )
