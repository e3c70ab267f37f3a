"""What an adjustment gives: points brought back to objects, with covariances by source and corrections."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.covariance import Spread
from geoloc.adjustment.model import Model
from geoloc.adjustment.scene import lasting_m2
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.unknowns import BESIDE_ROAD, READOUT, TIME
from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.doubts import Doubt
from geoloc.earth.geodesy import geographic_from_enu
from geoloc.locate.combine import ellipse
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.trajectory.pose_noise import PoseSigmas
from geoloc.trajectory.poses import Poses

# A bearing alone leaves a position open along the ray: what is worse than this is no position.
_WORST_SIGMA_M = 5.0
# What a calibration leaves of a lens's centre: a turn of the camera looks the same, however long it drives.
_CENTRE_PX = 0.3
# Logarithm of the ratio between the distances of a point's start and end: a factor of three.
_LARGEST_LEAP = 1.1


class AdjustmentDoubt(StrEnum):
    """What an adjustment is doubted for."""

    CLOCK = "clock"
    CLOCK_DOUBTED = "clock-doubted"
    CLOCK_UNCHECKED = "clock-unchecked"
    SHUTTER = "shutter"
    TERRAIN_UNUSED = "terrain-unused"


@dataclass(frozen=True, slots=True)
class Correction:
    """What the adjustment found out about something that all sightings share."""

    value: float
    sigma: float


class OfTheTrack(NamedTuple):
    """What no sighting can show, because it moves the whole track.

    Whether poses were fitted to fixes; one sigma of the antennas' lever arms, of a change of datum, and of a
    base station's own place, which is part of what fixes are off (m); how much had been added to the camera
    clock before the adjustment, and what it may be off beyond what the adjustment says (s); by how much the
    variance of a place grows in a second that velocities alone bridge (m²/s), infinite without.
    """

    is_fitted: bool
    lever_arm_m: float
    sigma_m: float
    base_m: float
    shift_s: float
    unsure_s: float
    wander_m2ps: float = np.inf


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
        body, ground, gnss, datum (and base station), lever arm. They add up to it.
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
        Factor on the stated sigma of a pixel that the residuals ask for: labels that repeat the error of the
        last one count as fewer.
    time_offset_ms, readout_ms : Correction
        Added to the camera clock; and the readout itself.
    time_prior_ms : float
        One sigma of the clock's offset that was taken for granted.
    time_solved_ms : float
        One sigma of it by the least squares alone, without what looks like a clock and does not average.
    boresight_deg : mapping camera → tuple of Correction
        About the camera's own x (pitch), y (yaw) and z (roll).
    focal_percent : mapping camera → Correction
        Of focal lengths that nobody calibrated: how much longer they are than the rig states.
    doubts : tuple of Doubt
        Of the kinds of `AdjustmentDoubt`: a clock that cannot be, or be checked, a shutter that cannot
        be, terrain not used.
    pose_sigmas : PoseSigmas or None
        What recorded poses without sigmas were taken as (NaN: stated); None where all were stated.
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
    pose_sigmas: PoseSigmas | None = None
    time_prior_ms: float = math.nan
    time_solved_ms: float = math.nan
    focal_percent: dict[str, Correction] = field(default_factory=dict)


def adjusted_of(
    objects: IntArray,
    rejected: TextArray,
    poses: Poses,
    model: Model,
    solution: Solution,
    found: Spread,
    track: OfTheTrack,
    doubts: tuple[Doubt, ...],
    pose_sigmas: PoseSigmas | None,
    time_prior_ms: float,
) -> Adjusted:
    """Bring points back to objects, positions to the ellipsoid, and add what no sighting can show."""
    scene, n, g = model.scene, rejected.size, objects.size
    points = model.points_m(solution.x)
    latitude, longitude = geographic_from_enu(
        scene.anchor_deg[:, 0], scene.anchor_deg[:, 1], points[:, 0], points[:, 1]
    )
    by_source = _every_source(found, model, track)
    total = np.sum(list(by_source.values()), axis=0)
    # A clock that no bend shows moves all points of a drive alike: that makes no bearing vague.
    late = found.with_clock[:, :2] / np.sqrt(found.shared[TIME, TIME])
    sigma_major, _, _ = ellipse(found.covariance_m2[:, :2, :2] - late[:, :, None] * late[:, None, :])
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
        sigma_height_m=of_objects(np.sqrt(found.covariance_m2[:, 2, 2] + _of_the_track_up_m2(model, track))),
        by_source={source: of_objects(value) for source, value in by_source.items()},
        reason=reason,
        used=rejected == "",
        rejected=rejected,
        residual_px=residual_px,
        range_m=np.hypot(eye_m[:, 0], eye_m[:, 1]),
        eye_m=eye_m,
        poses=poses,
        noise=solution.noise,
        time_offset_ms=Correction(
            1e3 * (track.shift_s + float(solution.x[TIME])),
            1e3 * float(np.hypot(shared[TIME], track.unsure_s)),
        ),
        readout_ms=Correction(
            1e3 * (model.readout_s + float(solution.x[READOUT])), 1e3 * float(shared[READOUT])
        ),
        boresight_deg=_boresight_deg(model, solution, shared),
        doubts=doubts,
        pose_sigmas=pose_sigmas,
        time_prior_ms=time_prior_ms,
        time_solved_ms=1e3 * float(shared[TIME]),
        focal_percent=_focal_percent(model, solution, shared),
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


def _every_source(found: Spread, model: Model, track: OfTheTrack) -> dict[str, FloatArray]:
    """Covariance of each source: what the sightings show, and what holds for the whole track."""
    by_source = _merged(found.by_source)
    for source, whole in _of_the_track(model, track).items():
        by_source[source] = by_source.get(source, 0.0) + whole
    return by_source


def _boresight_deg(model: Model, solution: Solution, sigma: FloatArray) -> dict[str, tuple[Correction, ...]]:
    """Pitch, yaw and roll of each camera; `sigma` is that of the shared unknowns, in radians for angles."""
    scene, corrections = model.scene, {}
    for i, name in enumerate(scene.cameras):
        if not np.any(scene.camera == i):
            continue
        focal_px = np.median(np.linalg.norm(scene.pixel_from_ray[scene.camera == i], axis=2))
        places = model.layout.boresight(np.array(i))
        known = np.hypot(sigma[places], np.array([_CENTRE_PX, _CENTRE_PX, 0.0]) / focal_px)
        corrections[name] = tuple(
            Correction(float(x), float(s))
            for x, s in zip(np.degrees(solution.x[places]), np.degrees(known), strict=True)
        )
    return corrections


def _focal_percent(model: Model, solution: Solution, sigma: FloatArray) -> dict[str, Correction]:
    scene, layout = model.scene, model.layout
    if not layout.has_lenses or scene.lens_known is None or scene.lens_sigma is None:
        return {}
    places = layout.lens(np.arange(layout.n_cameras))[:, 0]
    # The error is by how much the stated one is too large.
    shorter = scene.lens_known[:, 0] + solution.x[places]
    return {
        name: Correction(-100.0 * float(shorter[i]), 100.0 * float(sigma[places[i]]))
        for i, name in enumerate(scene.cameras)
        if scene.lens_sigma[i, 0] > 0.0
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


def _of_the_track(model: Model, track: OfTheTrack) -> dict[str, FloatArray]:
    """What moves the car's whole track, and every object with it, so that no sighting can show it."""
    scene = model.scene
    count = np.bincount(scene.point)
    sigma_m = scene.body.sigma_horizontal_m
    lasting = lasting_m2(sigma_m, is_fitted=track.is_fitted, wander_m2ps=track.wander_m2ps)
    mean = np.bincount(scene.point, weights=lasting) / count
    base = np.minimum(mean, track.base_m**2)
    lever = np.full(count.size, track.lever_arm_m**2)
    late = track.unsure_s * _carried_along(model, count)
    return {
        "gnss": (mean - base)[:, None, None] * np.eye(2),
        "datum": (base + track.sigma_m**2)[:, None, None] * np.eye(2),
        "lever arm": lever[:, None, None] * np.eye(2),
        "time": late[:, :, None] * late[:, None, :],
    }


def _of_the_track_up_m2(model: Model, track: OfTheTrack) -> FloatArray:
    """Variance (m,) of a height that moves with the whole track: of the fixes, and of the antennas' arms."""
    scene = model.scene
    lasting = lasting_m2(scene.body.sigma_vertical_m, is_fitted=track.is_fitted)
    fixes = np.bincount(scene.point, weights=lasting)
    return np.asarray(fixes / np.bincount(scene.point) + track.lever_arm_m**2)


def _carried_along(model: Model, count: IntArray) -> FloatArray:
    """How fast a point that is fixed to the car moves, east and north (m, 2), while the car sees it."""
    scene, body = model.scene, model.scene.body
    east, north = (scene.start_m[scene.point] - model.origin_m)[:, :2].T
    turning = body.yaw_rate_radps * np.stack([-north, east])
    speed = body.velocity_mps[:, :2].T + turning
    return np.stack([np.bincount(scene.point, weights=axis) / count for axis in speed], axis=1)


def nothing_adjusted(objects: IntArray, rejected: TextArray, poses: Poses) -> Adjusted:
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
