"""What an adjustment starts from: rays, poses and where each object's ground is, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.cameras.nominal import from_axis, moves_at
from geoloc.earth.geodesy import enu_offset, metres_per_degree, rotation_enu_from_rig, wrap_deg
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import ErrorBudget
from geoloc.locate.visibility import on_the_car_itself
from geoloc.reasons import REASON_TYPE, Reason
from geoloc.rig.rig import Rig
from geoloc.trajectory.fix_checks import changing_m
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import Poses, part
from geoloc.trajectory.rig_poses import lean_m, lean_up_m
from geoloc.trajectory.trajectory import Trajectory

# Rates are differences over twice this: longer than most errors of the trajectory last, shorter than a bend.
# Over a tenth of a second they are the slopes of those errors, which look like a clock that is wrong.
_RATE_STEP_NS = 500_000_000
# The acceleration that tyres slip by is smoothed over more: its noise goes with that of the heading.
_TURN_STEP_NS = 1_000_000_000
_CRAWLING_MPS = 1.0
# Frames of cameras that are triggered together carry stamps of their own, a fraction of a frame apart.
_SAME_INSTANT_NS = 8_000_000
# A pass over the ground beside an object this long before or after it was seen still tells its height: the
# slow error of RTK heights lasts for minutes.
_NEAREST_WITHIN_S = 30.0
_CHORD_M = 12.0
# 0.1°: what a paver lays.
_FLATTEST = 0.0017


class Bodies(NamedTuple):
    """Poses of the rig, and how they change: rows of an adjustment."""

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    enu_R_rig: FloatArray
    velocity_mps: FloatArray
    """East, north, up: float64 (n, 3)."""
    yaw_rate_radps: FloatArray
    """Counter-clockwise about the rig's z."""
    lateral_mps2: FloatArray
    """Acceleration to the left that the bend asks for."""
    pitch_per_m: FloatArray
    """How the pitch changes along the way, rad/m; 0 where the car stands."""
    sigma_rad: FloatArray
    """Of roll, pitch and heading: float64 (n, 3)."""
    sigma_horizontal_m: FloatArray
    """Of the point whose place was measured, `Trajectory.measured_at_m`."""
    sigma_vertical_m: FloatArray


@dataclass(frozen=True, slots=True)
class Scene:
    """The sightings that can take part, and the ground under each point.

    Rows (n) are sightings, points (m) what is to be found: the foot or the face of an object.

    Attributes
    ----------
    row : int64 (n,)
        Index into what `adjust` was given.
    point : int64 (n,)
    camera : int64 (n,)
        Index into `cameras`.
    epoch_ns : int64 (n,)
    instant : int64 (n,)
        Index into `instant_ns`: sightings of one instant share the body's bounce.
    ray : float64 (n, 3)
        Unit ray in the camera frame.
    pixel_from_ray : float64 (n, 2, 3)
        Pixels a unit that the ray's end moves.
    readout : float64 (n,)
        Row of the pixel as a share of the image's height, from the middle: -0.5 to 0.5.
    height_px : int64 (n,)
        The image's height.
    sigma_px : float64 (n,)
    body : Bodies (n,)
    cameras : tuple of str
    rig_R_camera : float64 (c, 3, 3)
    rig_t_camera_m : float64 (c, 3)
    instant_ns : int64 (k,)
    object : int64 (m,)
        Which object a point belongs to.
    is_foot : bool (m,)
    anchor_deg : float64 (m, 2)
        Latitude and longitude of the point's local frame (east, north, height).
    start_m : float64 (m, 3)
        First guess in that frame; its third component is the ellipsoidal height.
    lens_away_px : float64 (n, 2) or None
        The pixel from that of the camera's axis; None where all lenses are exact.
    lens_half_px : float64 (n,) or None
        Half the longer side of the camera's picture.
    lens_sigma : float64 (c, 5) or None
        One sigma of each.
    lens_known : float64 (c, 5)
        What is taken off the pixels already.
    """

    row: IntArray
    point: IntArray
    camera: IntArray
    epoch_ns: IntArray
    instant: IntArray
    ray: FloatArray
    pixel_from_ray: FloatArray
    readout: FloatArray
    height_px: IntArray
    sigma_px: FloatArray
    body: Bodies
    cameras: tuple[str, ...]
    rig_R_camera: FloatArray
    rig_t_camera_m: FloatArray
    instant_ns: IntArray
    object: IntArray
    is_foot: BoolArray
    anchor_deg: FloatArray
    start_m: FloatArray
    lens_away_px: FloatArray | None = None
    lens_half_px: FloatArray | None = None
    lens_sigma: FloatArray | None = None
    lens_known: FloatArray | None = None


class Rays(NamedTuple):
    """Rays of sightings in their cameras' frames, and why those without one have none."""

    ray: FloatArray
    pixel_from_ray: FloatArray
    readout: FloatArray
    rejected: TextArray
    away_px: FloatArray
    """From the camera's axis (n, 2); with the next, see `geoloc.cameras.nominal.from_axis`."""
    half_px: FloatArray


def rays_of(rig: Rig, sightings: Sightings, lens: Mapping[str, FloatArray] | None = None) -> Rays:
    """Turn pixels into rays, a camera at a time.

    `lens` has what is known of the errors of cameras' lenses, float64 (5,): it is taken off the pixels.

    `pixel_from_ray` is the pseudo-inverse of the ray's derivative by pixel: what the end of a unit ray moves
    is so measured in pixels, whatever the lens, and its noise is the annotator's.
    """
    n = sightings.camera.size
    ray, slope = np.full((n, 3), np.nan), np.full((n, 3, 2), np.nan)
    readout, rejected = np.full(n, np.nan), np.full(n, "", dtype=REASON_TYPE)
    away_px, half_px = np.zeros((n, 2)), np.ones(n)
    for name in np.unique(sightings.camera):
        rows = np.flatnonzero(sightings.camera == name)
        camera = rig.camera(str(name))
        pixel = sightings.pixel_px[rows]
        away_px[rows], half_px[rows] = from_axis(camera.model, pixel)
        known = None if lens is None else lens.get(str(name))
        nominal = pixel if known is None else pixel + moves_at(away_px[rows], half_px[rows]) @ known
        seen = camera.model.rays(nominal[:, 0], nominal[:, 1], slopes=True)
        ray[rows] = np.stack(seen.ray, axis=1)
        if seen.by_u is not None and seen.by_v is not None:
            slope[rows] = np.stack([np.stack(seen.by_u, axis=1), np.stack(seen.by_v, axis=1)], axis=2)
        height = camera.model.height_px
        readout[rows] = (pixel[:, 1] - 0.5 * (height - 1)) / height
        rejected[rows] = np.where(seen.inside, "", Reason.OUTSIDE_CAMERA)
        rejected[rows[seen.inside & on_the_car_itself(camera, pixel)]] = Reason.ON_CAR
    known = np.isfinite(slope).all(axis=(1, 2))
    rejected[(rejected == "") & ~known] = Reason.OUTSIDE_CAMERA
    gram = np.swapaxes(slope, 1, 2) @ slope
    gram[~known] = np.eye(2)
    return Rays(ray, np.linalg.solve(gram, np.swapaxes(slope, 1, 2)), readout, rejected, away_px, half_px)


class _Ends(NamedTuple):
    """Poses shortly before and after others, and the time between; where there is none, those themselves."""

    before: Poses
    here: Poses
    after: Poses
    span_s: FloatArray

    @classmethod
    def about(cls, before: Poses, poses: Poses, after: Poses, step_ns: int) -> _Ends:
        steps = before.valid.astype(np.float64) + after.valid
        return cls(before, poses, after, steps * step_ns / NANOSECONDS)

    def rate(self, name: str, *, angle: bool = False) -> FloatArray:
        here = getattr(self.here, name)
        first, last = (np.where(p.valid, getattr(p, name), here) for p in (self.before, self.after))
        change = wrap_deg(last - first) if angle else last - first
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.span_s > 0, change / self.span_s, 0.0)


def bodies_at(trajectory: Trajectory, epoch_ns: IntArray) -> tuple[Bodies, Poses]:
    """Poses at epochs with velocity and yaw rate from the trajectory itself."""
    steps = (0, -_RATE_STEP_NS, _RATE_STEP_NS, -_TURN_STEP_NS, _TURN_STEP_NS)
    # Asked for at once: what makes curves of the knots costs as much as a thousand poses.
    every = trajectory.poses_at(np.concatenate([epoch_ns + step for step in steps]))
    n = epoch_ns.size
    poses, *ends = (part(every, slice(i * n, (i + 1) * n)) for i in range(len(steps)))
    east, north = metres_per_degree(poses.latitude_deg, poses.height_m)

    near = _Ends.about(ends[0], poses, ends[1], _RATE_STEP_NS)
    wide = _Ends.about(ends[2], poses, ends[3], _TURN_STEP_NS)
    yaw_rate, smooth_rate = (-np.radians(ends.rate("heading_deg", angle=True)) for ends in (near, wide))
    velocity = [near.rate("longitude_deg") * east, near.rate("latitude_deg") * north, near.rate("height_m")]
    speed = np.hypot(velocity[0], velocity[1])
    sigma = np.radians(np.stack([poses.sigma_roll_deg, poses.sigma_pitch_deg, poses.sigma_heading_deg], 1))
    _, aside_m, above_m = trajectory.measured_at_m.tolist()
    lean = lean_m(above_m, poses.sigma_roll_deg, poses.sigma_pitch_deg)
    lean_up = lean_up_m(aside_m, poses.sigma_roll_deg)
    return (
        Bodies(
            poses.latitude_deg,
            poses.longitude_deg,
            poses.height_m,
            rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg),
            np.stack(velocity, axis=1),
            yaw_rate,
            smooth_rate * speed,
            np.radians(near.rate("pitch_deg")) / np.maximum(speed, _CRAWLING_MPS),
            sigma,
            np.sqrt(np.maximum(poses.sigma_horizontal_m**2 - lean**2, 0.0)),
            np.sqrt(np.maximum(poses.sigma_vertical_m**2 - lean_up**2, 0.0)),
        ),
        poses,
    )


def lasting_m2(sigma_m: FloatArray, *, is_fitted: bool, wander_m2ps: float = np.inf) -> FloatArray:
    """Variance of what moves the whole track, so that no sighting shows it.

    A quarter of the variance of fixes is new at each or gone in seconds, or less where velocities say how the
    car went on (`changing_m`); recorded poses do not say how long their errors last, so that all of it may.
    """
    return np.asarray(sigma_m**2 - changing_m(sigma_m, wander_m2ps) ** 2 * is_fitted)


def rows_of(bodies: Bodies, rows: IntArray | BoolArray) -> Bodies:
    """Select rows."""
    return Bodies(*(column[rows] for column in bodies))


def origin_from_anchor(bodies: Bodies, anchor_deg: FloatArray) -> FloatArray:
    """Rig's origin in each row's local frame: east, north of the anchor, ellipsoidal height."""
    east, north = enu_offset(anchor_deg[:, 0], anchor_deg[:, 1], bodies.latitude_deg, bodies.longitude_deg)
    return np.stack([east, north, bodies.height_m], axis=1)


def instants(epoch_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Group epochs that are one instant: index of each, and the instants' epochs."""
    order = np.argsort(epoch_ns, kind="stable")
    new = np.diff(epoch_ns[order], prepend=epoch_ns[order[:1]] - 2 * _SAME_INSTANT_NS) > _SAME_INSTANT_NS
    number = np.empty(epoch_ns.size, dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return number, epoch_ns[order][new]


def nearest_knots(
    trajectory: Trajectory, anchor_deg: FloatArray, first_ns: IntArray, last_ns: IntArray
) -> IntArray:
    """Epoch (m,) at which the rig came nearest to each place, near the time when it was seen.

    The road under the car then lies beside the object: what its plane says there is worth more than what it
    says from afar.
    """
    knots = trajectory.knots
    known = np.flatnonzero(knots.valid)
    epoch = knots.epoch_ns[known]
    window = int(_NEAREST_WITHIN_S * NANOSECONDS)
    low = np.searchsorted(epoch, first_ns - window, side="left")
    high = np.searchsorted(epoch, last_ns + window, side="right")
    east, north = metres_per_degree(anchor_deg[:, 0])
    nearest = np.empty(first_ns.size, dtype=np.int64)
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        rows = known[a:b]
        across = np.hypot(
            (knots.longitude_deg[rows] - anchor_deg[i, 1]) * east[i],
            (knots.latitude_deg[rows] - anchor_deg[i, 0]) * north[i],
        )
        nearest[i] = knots.epoch_ns[rows[np.argmin(across)]]
    return nearest


def changes_of_slope(trajectory: Trajectory) -> float:
    """How much the ground ahead departs from the slope under the car, metres a metre, one sigma.

    From the drive itself: heights at three places `_CHORD_M` apart. Infinite where the car has not driven far
    enough to tell.
    """
    knots = trajectory.knots
    known = np.flatnonzero(knots.valid)
    step_s = np.diff(knots.epoch_ns[known], prepend=knots.epoch_ns[known[:1]]) / NANOSECONDS
    way = np.cumsum(np.nan_to_num(knots.speed_mps[known]) * np.minimum(step_s, trajectory.max_gap_s))
    if known.size < 2 or way[-1] < 3.0 * _CHORD_M:
        return np.inf
    middle = np.arange(_CHORD_M, way[-1] - _CHORD_M, 1.0)
    before, here, after = (
        np.interp(middle + offset, way, knots.height_m[known]) for offset in (-_CHORD_M, 0.0, _CHORD_M)
    )
    departure = (after - 2.0 * here + before) / _CHORD_M
    return max(_FLATTEST, float(np.sqrt(np.mean(departure**2))))


def sigma_px_of(budget: ErrorBudget, size_px: FloatArray) -> FloatArray:
    """One sigma of a pixel coordinate; of boxes it grows with their size (NaN: a point)."""
    return np.hypot(budget.pixel_px, budget.box_share * np.nan_to_num(size_px))
