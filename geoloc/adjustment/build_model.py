"""From rays and poses to the scene and the model that are solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.adjustment.ground import Ground, MeasuredGround
from geoloc.adjustment.initial_points import first_guesses
from geoloc.adjustment.model import Model
from geoloc.adjustment.scene import (
    Bodies,
    Rays,
    Scene,
    bodies_at,
    changes_of_slope,
    instants,
    nearest_knots,
    origin_from_anchor,
    rows_of,
)
from geoloc.adjustment.unknowns import PER_NODE, Layout, Nodes, Prior, links_of, nodes_of, prior_of
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.cameras.nominal import LENS_ERRORS
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, grid_convergence_deg, utm33_from_geographic
from geoloc.earth.terrain import Terrain
from geoloc.locate.single_frame import ErrorBudget
from geoloc.rig.rig import Rig
from geoloc.trajectory.fix_checks import changing_m
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import LastingRoll
from geoloc.trajectory.smoother.plane import sideways_rad
from geoloc.trajectory.trajectory import Trajectory

# The road under the car says less about the ground beside it than about the road ahead: crossfall ends at
# the edge, verges and pavements rise or fall.
_VERGE_SLOPE = 0.01
_LEVEL = 0.005
# A recorded heading's error changes slowly, but for the noise of single poses. One that was fitted to fixes
# errs by what the rear axle did sideways, within a second; by how far that fit is off in drives whose errors
# are those stated, a quarter of its variance goes on for longer.
_TREMBLING_SHARE, _TREMBLING_WITH_AXLE = 0.25, 0.87
# Of a process that fades in a second, straight lines between nodes a second apart leave so much:
# 1 + 2/3 + e⁻¹/3 - 4/e of its variance. It comes and goes about as fast as the body bounces. Those lines, on
# the mean between two nodes, have 2/3 + e⁻¹/3 of the nodes' variance: with 0.93 of the sigma there, the two
# together have what is stated.
_PITCH_BETWEEN_NODES, _PITCH_AT_NODES = 0.56, 0.93
_FULL_RATE_MPS, _LEAST_RATE = 3.0, 0.001
# What an engine and people in the car leave of the body's bounce while it stands.
_IDLE_SHARE = 0.1
_MIN_SIGMA_RAD, _MIN_SIGMA_M = np.radians(0.01), 0.002
_OTHER_GROUND_M = 2.0


class Place(NamedTuple):
    """A point in space: latitude and longitude (deg), ellipsoidal height (m)."""

    latitude_deg: float
    longitude_deg: float
    height_m: float


NO_PLACES: Mapping[tuple[int, bool], Place] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Placed:
    """Sightings that have a ray and a pose.

    Attributes
    ----------
    row : int64 (n,)
        Rows, of all that was given, that can take part.
    point : int64 (n,)
        Point of each.
    object : int64 (m,)
    is_foot : bool (m,)
    epoch_ns, body, rays, sigma_px
        Of all that was given.
    """

    row: IntArray
    point: IntArray
    object: IntArray
    is_foot: BoolArray
    epoch_ns: IntArray
    body: Bodies
    rays: Rays
    sigma_px: FloatArray


def scene_of(
    rig: Rig,
    camera: NDArray[np.str_],
    placed: Placed,
    budget: ErrorBudget | None = None,
    lens: Mapping[str, FloatArray] | None = None,
    cameras_of_drive: Sequence[str] = (),
    places: Mapping[tuple[int, bool], Place] = NO_PLACES,
) -> Scene:
    """Give every point its first guess; points without one, and their sightings, are left out.

    `budget` says which lenses are exact (None: all), `lens` what was taken off the others (`rays_of`);
    `cameras_of_drive` have unknowns whether they have sightings or not. Points of which `places` knows where
    they are, by object and whether it is the foot, begin there.
    """
    row = placed.row
    names = np.unique(np.concatenate([camera[row], np.array(cameras_of_drive, dtype=np.str_)]))
    index = np.searchsorted(names, camera[row])
    cameras = [rig.camera(str(name)) for name in names]
    rotations = np.array([c.rig_R_camera for c in cameras]).reshape(-1, 3, 3)
    positions = np.array([c.rig_t_camera_m for c in cameras]).reshape(-1, 3)
    body, ray = rows_of(placed.body, row), placed.rays.ray[row]
    mounted = 0.0 if budget is None else float(np.radians(budget.boresight_deg))
    anchor, start, new = _begun(placed, places)
    rows = np.flatnonzero(new[placed.point])
    if rows.size:
        guessed, number = np.flatnonzero(new), (np.cumsum(new) - 1)[placed.point[rows]]
        in_rig = np.einsum("nij,nj->ni", rotations[index[rows]], ray[rows])
        anchor[guessed], start[guessed] = first_guesses(
            rows_of(body, rows), in_rig, positions[index[rows]], number, placed.is_foot[guessed], mounted
        )
    found = np.asarray(np.isfinite(start).all(axis=1))
    # Each point's frame is moved to the point itself: offsets are then small, and the frame level there.
    latitude, longitude = geographic_from_enu(
        anchor[found, 0], anchor[found, 1], start[found, 0], start[found, 1]
    )
    level = np.column_stack([np.zeros((found.sum(), 2)), start[found, 2]])
    keep = found[placed.point] if row.size else np.zeros(0, dtype=bool)
    nominal = budget is not None and not all(budget.lens_of(one).is_exact for one in cameras)
    known = {} if lens is None else lens
    instant, instant_ns = instants(placed.epoch_ns[row[keep]]) if keep.any() else (row[:0], row[:0])
    return Scene(
        row=row[keep],
        point=(np.cumsum(found) - 1)[placed.point[keep]],
        camera=index[keep],
        epoch_ns=placed.epoch_ns[row[keep]],
        instant=instant,
        ray=ray[keep],
        pixel_from_ray=placed.rays.pixel_from_ray[row[keep]],
        readout=placed.rays.readout[row[keep]],
        height_px=np.array([c.model.height_px for c in cameras], dtype=np.int64)[index[keep]],
        sigma_px=placed.sigma_px[row[keep]],
        body=rows_of(body, keep),
        cameras=tuple(str(name) for name in names),
        rig_R_camera=rotations,
        rig_t_camera_m=positions,
        instant_ns=instant_ns,
        object=placed.object[found],
        is_foot=placed.is_foot[found],
        anchor_deg=np.column_stack([latitude, longitude]),
        start_m=level,
        lens_away_px=placed.rays.away_px[row[keep]] if nominal else None,
        lens_half_px=placed.rays.half_px[row[keep]] if nominal else None,
        lens_known=np.array([known.get(one.name, np.zeros(LENS_ERRORS)) for one in cameras]),
        lens_sigma=np.array([budget.lens_of(one).of_errors() for one in cameras]) if budget else None,
    )


def _begun(
    placed: Placed, places: Mapping[tuple[int, bool], Place]
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Anchors (m, 2) and starts (m, 3) of points whose places are known, and which points are new (m,)."""
    pairs = zip(placed.object.tolist(), placed.is_foot.tolist(), strict=True)
    known = [places.get(pair) for pair in pairs]
    anchor = np.array([(0.0, 0.0) if one is None else one[:2] for one in known]).reshape(-1, 2)
    start = np.array([(0.0, 0.0, 0.0 if one is None else one[2]) for one in known]).reshape(-1, 3)
    return anchor, start, np.array([one is None for one in known], dtype=bool)


def model_of(
    scene: Scene,
    trajectory: Trajectory,
    budget: ErrorBudget,
    readout_s: float = 0.0,
    pole_radius_m: float = 0.0,
    since_ns: int | None = None,
) -> tuple[Model, Prior]:
    """Lay out the unknowns of a scene, with the road's plane under every foot.

    With `since_ns`, the plane of no time before it: a window of the drive begins there.
    """
    feet = np.flatnonzero(scene.is_foot)
    beside_ns = _beside(scene, trajectory, feet)
    beside_ns = beside_ns if since_ns is None else np.maximum(beside_ns, since_ns)
    beside, _ = bodies_at(trajectory, beside_ns)
    nodes = nodes_of(np.concatenate([scene.epoch_ns, beside_ns]))
    is_fitted = trajectory.is_fitted
    sigma = np.concatenate(
        [
            _slow_sigma(body, _falls(body, budget.ground_fall), is_fitted, trajectory.wander_m2ps)
            for body in (scene.body, beside)
        ]
    )
    n = scene.row.size
    has_lenses = scene.lens_away_px is not None
    sizes = len(scene.cameras), len(scene.object), nodes.epoch_ns.size, scene.instant_ns.size
    layout = Layout(*sizes, has_lenses)
    slope = min(np.tan(np.radians(budget.ground_slope_deg)), changes_of_slope(trajectory))
    origin = origin_from_anchor(beside, scene.anchor_deg[feet])
    to_foot = np.einsum("nji,nj->ni", beside.enu_R_rig, scene.start_m[feet] - origin)
    ground = Ground(
        feet,
        beside,
        origin,
        _ground_sigma(to_foot, slope, budget.ground_height_m),
        np.maximum(to_foot[:, 1:2] * [1.0, -1.0], 0.0),
        nodes.left[n:],
        nodes.share[n:],
        np.ones(feet.size),
    )
    ages_s = _ages_s(nodes, trajectory)
    model = Model(
        scene,
        layout,
        origin_from_anchor(scene.body, scene.anchor_deg[scene.point]),
        nodes.left[:n],
        nodes.share[:n],
        nodes.epoch_ns,
        ages_s,
        readout_s,
        np.where(scene.is_foot, pole_radius_m, 0.0)[scene.point],
        np.einsum("nij,nj->ni", scene.body.enu_R_rig[:, :2], scene.rig_t_camera_m[scene.camera]),
        trajectory.measured_at_m,
        ground,
    )
    links = links_of(scene.object, scene.is_foot, _side_by_side(scene))
    sigma[:, 0] = _without(trajectory.lasting_roll, sigma[:, 0], scene.body, beside)
    node_sigma = _at_nodes(nodes, sigma)
    fast = _fast_sigma(scene, budget, is_fitted)
    roll = trajectory.lasting_roll
    fall = float(np.sqrt(np.mean(_falls(scene.body, budget.ground_fall) ** 2)))
    lens = scene.lens_sigma if has_lenses else None
    return model, prior_of(
        layout, budget, ages_s, node_sigma, roll, fall, scene.instant_ns, fast, links, lens
    )


def on_terrain(model: Model, terrain: Terrain, budget: ErrorBudget) -> Model:
    """Put a measured terrain under the feet that it covers; the others keep the road's plane.

    The raster says how much higher each foot stands than the car stood nearest to it, so that an error of all
    its heights, or of the geoid, does no harm. Where it lies more than `_OTHER_GROUND_M` from the car (a
    bridge, a tunnel) it shows another ground, and is not used.
    """
    scene, ground = model.scene, model.ground
    latitude, longitude = scene.anchor_deg[ground.point].T
    grid = np.stack(utm33_from_geographic(latitude, longitude), axis=1)
    under_foot = terrain.height_m(grid[:, 0], grid[:, 1])
    under_car = terrain.height_m(*utm33_from_geographic(ground.body.latitude_deg, ground.body.longitude_deg))
    above = ground.body.height_m - under_car
    with np.errstate(invalid="ignore"):
        known = np.isfinite(under_foot) & (np.abs(above) < _OTHER_GROUND_M)
    gamma = np.radians(grid_convergence_deg(latitude, longitude))
    turn = np.stack([np.cos(gamma), -np.sin(gamma), np.sin(gamma), np.cos(gamma)], axis=1).reshape(-1, 2, 2)
    sigma = np.hypot(budget.ground_height_m, np.sqrt(2.0) * terrain.noise_m)
    return replace(
        model,
        terrain=MeasuredGround(
            ground.point[known],
            terrain,
            grid[known],
            turn[known],
            above[known],
            np.full(int(known.sum()), sigma),
            np.ones(int(known.sum())),
        ),
        ground=Ground(
            ground.point[~known],
            rows_of(ground.body, ~known),
            ground.origin_m[~known],
            ground.sigma_m[~known],
            ground.beside_m[~known],
            ground.left[~known],
            ground.share[~known],
            ground.weight[~known],
        ),
    )


def _beside(scene: Scene, trajectory: Trajectory, feet: IntArray) -> IntArray:
    """Epoch at which the car stood nearest to each foot."""
    if not feet.size:
        return np.empty(0, dtype=np.int64)
    first = np.full(len(scene.object), np.iinfo(np.int64).max)
    last = np.full(len(scene.object), np.iinfo(np.int64).min)
    np.minimum.at(first, scene.point, scene.epoch_ns)
    np.maximum.at(last, scene.point, scene.epoch_ns)
    return nearest_knots(trajectory, scene.anchor_deg[feet], first[feet], last[feet])


def _ground_sigma(to_foot_m: FloatArray, slope: float, height_m: float) -> FloatArray:
    """How well the road's plane tells the height of each foot: kerb at once, slopes with the distance.

    `to_foot_m` (f, 3) is from the rig's origin, in its axes.
    """
    ahead, aside = slope * to_foot_m[:, 0], _VERGE_SLOPE * to_foot_m[:, 1]
    return np.asarray(np.sqrt(height_m**2 + ahead**2 + aside**2))


def _side_by_side(scene: Scene) -> FloatArray:
    """Starts of all points in one frame an object, so that foot and face of it can be compared."""
    first = {int(o): i for i, o in reversed(list(enumerate(scene.object)))}
    home = np.array([first[int(o)] for o in scene.object])
    east, north = enu_offset(*scene.anchor_deg[home].T, *scene.anchor_deg.T)
    return np.stack([east, north], axis=1)


def _at_nodes(nodes: Nodes, sigma: FloatArray) -> FloatArray:
    """Sigma of each node: the largest of what lies beside it."""
    at_nodes = np.zeros((nodes.epoch_ns.size, PER_NODE))
    for node in (nodes.left, nodes.left + 1):
        np.maximum.at(at_nodes, node, sigma)
    return at_nodes


def _ages_s(nodes: Nodes, trajectory: Trajectory) -> FloatArray:
    """Time of each node on a clock that runs fully at `_FULL_RATE_MPS` and almost stops with the car."""
    knots = trajectory.knots
    known = knots.valid
    middle = nodes.epoch_ns[:-1] + np.diff(nodes.epoch_ns) // 2
    speed = np.interp(middle, knots.epoch_ns[known], knots.speed_mps[known])
    rate = np.clip(speed / _FULL_RATE_MPS, _LEAST_RATE, 1.0)
    return np.concatenate([[0.0], np.cumsum(rate * np.diff(nodes.epoch_ns) / NANOSECONDS)])


def _fast_sigma(scene: Scene, budget: ErrorBudget, is_fitted: bool) -> FloatArray:
    """Sigmas (k, 3) of what changes from one instant to the next.

    Bounce, with what the pitch errs within a second, and the heading's trembling.
    """
    body = scene.body
    roll, pitch = np.radians([budget.roll_jitter_deg, budget.pitch_jitter_deg])
    lively = _lively(body)
    pitch = np.hypot(pitch, _PITCH_BETWEEN_NODES * body.sigma_rad[:, 1])
    trembling = np.maximum(_trembling(body, is_fitted), _MIN_SIGMA_RAD)
    fast = np.zeros((scene.instant_ns.size, 3))
    np.maximum.at(fast, scene.instant, np.column_stack([lively * roll, lively * pitch, trembling]))
    return fast


def _lively(body: Bodies) -> FloatArray:
    """How much (n,) the body bounces, of what it does while the car drives."""
    return np.clip(_speed_mps(body) / _FULL_RATE_MPS, _IDLE_SHARE, 1.0)


def _speed_mps(body: Bodies) -> FloatArray:
    return np.asarray(np.hypot(body.velocity_mps[:, 0], body.velocity_mps[:, 1]))


def _trembling(body: Bodies, is_fitted: bool) -> FloatArray:
    """One sigma (n,) of what the heading errs for less than a second."""
    heading, speed = body.sigma_rad[:, 2], _speed_mps(body)
    slightly = _TREMBLING_SHARE * heading
    if not is_fitted:
        return np.asarray(slightly)
    rolls = np.minimum(speed / _FULL_RATE_MPS, 1.0) * sideways_rad(speed)
    return np.clip(rolls, slightly, _TREMBLING_WITH_AXLE * heading)


def _without(roll: LastingRoll, sigma_rad: FloatArray, *bodies: Bodies) -> FloatArray:
    """Sigma of the roll (n,) without what lasts the whole drive."""
    lateral = np.concatenate([body.lateral_mps2 for body in bodies])
    lasting = np.radians(roll.sigma_deg) ** 2 + (np.radians(roll.sigma_deg_per_mps2) * lateral) ** 2
    return np.asarray(np.sqrt(np.maximum(sigma_rad**2 - lasting, _MIN_SIGMA_RAD**2)))


def _falls(body: Bodies, at_most: float) -> FloatArray:
    """One sigma (n,) of the ground's rise a metre to a side, above the car's plane.

    Beyond a crown the road falls the other way by as much as it leans here, and verges lie level: where the
    car stands level, so does what lies beside it. The lean itself is known to the roll's sigma.
    """
    lean = np.hypot(body.enu_R_rig[:, 2, 1], body.sigma_rad[:, 0])
    return np.minimum(np.hypot(lean, _LEVEL), at_most)


def _slow_sigma(body: Bodies, fall: FloatArray, is_fitted: bool, wander_m2ps: float) -> FloatArray:
    """Sigmas (n, 8) at a node: attitude, that part of the place that changes, the ground's falls."""
    attitude = body.sigma_rad.copy()
    attitude[:, 1] *= 1.0 - (1.0 - _PITCH_AT_NODES) * _lively(body)
    if is_fitted:
        attitude[:, 2] = np.sqrt(attitude[:, 2] ** 2 - _trembling(body, is_fitted) ** 2)
    across = changing_m(np.maximum(body.sigma_horizontal_m, _MIN_SIGMA_M), wander_m2ps)
    up = changing_m(np.maximum(body.sigma_vertical_m, _MIN_SIGMA_M))
    return np.column_stack([np.maximum(attitude, _MIN_SIGMA_RAD), across, across, up, fall, fall])
