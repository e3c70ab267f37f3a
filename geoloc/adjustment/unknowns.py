"""The unknowns of an adjustment, their order in one vector, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.cameras.nominal import LENS_ERRORS
from geoloc.locate.single_frame import ErrorBudget
from geoloc.trajectory.fix_checks import CHANGES_WITHIN_S
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import LastingRoll

TIME, READOUT, SLIP, ROLL, LEAN, AXLES, PITCHING, FALL_LEFT, FALL_RIGHT, RISE, FIRST_CAMERA = range(11)
"""Places of what a whole drive shares.

The camera clock's offset (s), the readout time (s) and the rear tyres' slip (rad s²/m); what the trajectory's
roll is off (rad), and what it is off a lateral acceleration (rad s²/m); how much further ahead the road tilts
the car than the trajectory takes it (m); how much the car turns to the left as it pitches (rad a rad); how
much the ground rises above the car's plane a metre to the left and to the right, and feet above that (m).
Each camera then has six: boresight about its own x, y, z (rad) and position in the rig (m); and where a lens
of the drive was not calibrated, what `geoloc.cameras.nominal.lens_moves` counts.
"""
PER_CAMERA = 6
PER_NODE = 8

NODE_STEP_NS = 1_000_000_000
# Crossfall, verges and superelevation change with the road's sections, so that falls beside it do too.
_FALL_TAU_S = 15.0
# How long an error of the trajectory's attitude lasts: roll is the crossfall of the road, pitch what a
# climb over about a second does not show, heading the slip in a bend and noise of fixes over a second,
# place the noise of fixes and reflections that change as the car moves.
_PLACE_TAU_S = CHANGES_WITHIN_S
SLOW_TAU_S = (6.0, 1.0, 8.0, _PLACE_TAU_S, _PLACE_TAU_S, _PLACE_TAU_S, _FALL_TAU_S, _FALL_TAU_S)
# Half a wheelbase is 1.25 to 1.55 m in cars, and 1.9 m in vans.
_AXLES_SIGMA_M = 0.2
# A car does not pitch just about the rig's y axis. Its axles lie as the road does, which falls by 3 % to the
# side; what a climb adds turns it about a level axis; and springs are not alike on both sides. Thousands of
# frames would else show by it how all cameras are rolled, to a third of a degree, and wrongly.
_PITCHING_SIGMA = 0.03
# A car body on its springs swings at 1.2 to 1.5 Hz and is damped within a swing: after a tenth of a second
# half of its angle is still there.
BOUNCE_TAU_S = 0.15
# The heading trembles with what the rear axle does every 0.2 s, as the fit of the fixes smooths it.
_TREMBLING_TAU_S = 0.4
BESIDE_ROAD = "ground beside the road"
"""Source of what the ground under all feet of a drive has in common."""
_NODE_SOURCES = ("body", "body", "heading", "gnss", "gnss", "gnss", BESIDE_ROAD, BESIDE_ROAD)
LENS = "lens"
"""Source of what is wrong with lenses that nobody calibrated."""
_CERTAIN_RAD = 1e-6
_CERTAIN_LENS = 1e-6
# Keeps a bearing without parallax solvable; far wider than anything that is kept.
_ANYWHERE_M = 200.0
# The rear axle drifts out of a bend by 2 to 3 degrees per g; the trajectory's own guess is off by some of it.
_SLIP_DEG_PER_MPS2 = 0.15
# A face hangs on the front of its pole, and a plate need not hang in the middle.
_FACE_FROM_FOOT_M = 0.15


@dataclass(frozen=True, slots=True)
class Layout:
    """Where each unknown stands in the vector.

    Attributes
    ----------
    n_cameras, n_points, n_nodes, n_instants : int
        A node is a second of the drive at which the trajectory's roll, pitch, heading and place (east, north,
        up) and the ground's rises to the left and right are corrected, linear in between; an instant has the
        body's bounce in roll and pitch, and what the trajectory's heading trembles.
    """

    n_cameras: int
    n_points: int
    n_nodes: int
    n_instants: int
    has_lenses: bool = False
    """Whether the errors of lenses are unknowns too."""

    @property
    def per_camera(self) -> int:
        """Unknowns of each camera."""
        return PER_CAMERA + LENS_ERRORS * self.has_lenses

    @property
    def first_point(self) -> int:
        """Place of the first point's first coordinate."""
        return FIRST_CAMERA + self.per_camera * self.n_cameras

    @property
    def first_node(self) -> int:
        """Place of the first node's roll."""
        return self.first_point + 3 * self.n_points

    @property
    def first_instant(self) -> int:
        """Place of the first instant's roll."""
        return self.first_node + PER_NODE * self.n_nodes

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.first_instant + 3 * self.n_instants

    def boresight(self, camera: IntArray) -> IntArray:
        """Places ``(..., 3)`` of the boresight corrections of cameras."""
        return np.asarray(FIRST_CAMERA + self.per_camera * camera[..., None] + np.arange(3))

    def camera_position(self, camera: IntArray) -> IntArray:
        """Places ``(..., 3)`` of the position corrections of cameras."""
        return self.boresight(camera) + 3

    def lens(self, camera: IntArray) -> IntArray:
        """Places ``(..., 5)`` of the errors of cameras' lenses; only where `has_lenses`."""
        return self.boresight(camera)[..., :1] + PER_CAMERA + np.arange(LENS_ERRORS)

    def point(self, point: IntArray) -> IntArray:
        """Places ``(..., 3)`` of points."""
        return np.asarray(self.first_point + 3 * point[..., None] + np.arange(3))

    def node(self, node: IntArray) -> IntArray:
        """Places ``(..., 8)`` of nodes: roll, pitch, heading (rad), east, north, up (m), rise left, right."""
        return np.asarray(self.first_node + PER_NODE * node[..., None] + np.arange(PER_NODE))

    def bounce(self, instant: IntArray) -> IntArray:
        """Places ``(..., 3)`` of instants: roll, pitch, heading."""
        return np.asarray(self.first_instant + 3 * instant[..., None] + np.arange(3))


class Nodes(NamedTuple):
    """Which nodes epochs lie between: ``left`` and its neighbour ``left + 1``, `share` of the way."""

    epoch_ns: IntArray
    left: IntArray
    share: FloatArray


def nodes_of(epoch_ns: IntArray) -> Nodes:
    """Lay nodes of a second under the epochs; only seconds that are needed get them."""
    second = epoch_ns // NODE_STEP_NS
    needed = np.unique(np.concatenate([second, second + 1]))
    left = np.searchsorted(needed, second)
    return Nodes(needed * NODE_STEP_NS, left, (epoch_ns - second * NODE_STEP_NS) / NODE_STEP_NS)


class Prior(NamedTuple):
    """Linear residuals of unit variance, ``matrix @ x + constant``, and what each row says something of."""

    row: IntArray
    column: IntArray
    value: FloatArray
    constant: FloatArray
    source: NDArray[np.str_]


class _Rows:
    """Collects residuals."""

    def __init__(self) -> None:
        self.row: list[IntArray] = []
        self.column: list[IntArray] = []
        self.value: list[FloatArray] = []
        self.constant: list[FloatArray] = []
        self.source: list[NDArray[np.str_]] = []
        self.count = 0

    def add(
        self, source: str, columns: IntArray, values: FloatArray, constant: FloatArray | None = None
    ) -> None:
        """Add residuals ``(k,)`` with places and factors ``(k, j)``."""
        k, j = columns.shape
        self.row.append(np.repeat(self.count + np.arange(k), j))
        self.column.append(columns.ravel())
        self.value.append(values.ravel())
        self.constant.append(np.zeros(k) if constant is None else constant)
        self.source.append(np.full(k, source))
        self.count += k

    def prior(self) -> Prior:
        """Join what was collected."""
        return Prior(
            np.concatenate(self.row),
            np.concatenate(self.column),
            np.concatenate(self.value),
            np.concatenate(self.constant),
            np.concatenate(self.source),
        )


def prior_of(
    layout: Layout,
    budget: ErrorBudget,
    node_age_s: FloatArray,
    node_sigma: FloatArray,
    roll: LastingRoll,
    fall: float,
    instant_ns: IntArray,
    instant_sigma: FloatArray,
    links: FloatArray,
    lens_sigma: FloatArray | None = None,
) -> Prior:
    """What is known before any pixel is looked at.

    Parameters
    ----------
    node_age_s : float64 (nodes,)
        When, on a clock that runs as the car moves: what is wrong with the pose of a standing car stays.
    node_sigma : float64 (nodes, 8)
        Of each node's corrections, in their order.
    roll : LastingRoll
        What lasts of the trajectory's roll error, beyond those.
    fall : float
        Of the ground's rise a metre to either side, what lasts of it.
    instant_ns : int64 (instants,)
    instant_sigma : float64 (instants, 3)
    links : float64 (k, 4)
        Pairs of points of one object (foot, face) and how far apart they start, east and north.
    lens_sigma : float64 (cameras, 5), optional
        Of each camera's lens, where `Layout.has_lenses`; 0 for an exact one.
    """
    rows = _Rows()
    cameras = np.arange(layout.n_cameras)
    for source, place, sigma in (
        ("time", TIME, 1e-3 * budget.time_ms),
        ("rolling shutter", READOUT, 1e-3 * budget.readout_ms),
        ("heading", SLIP, np.radians(_SLIP_DEG_PER_MPS2)),
        ("body", ROLL, max(np.radians(roll.sigma_deg), _CERTAIN_RAD)),
        ("body", LEAN, max(np.radians(roll.sigma_deg_per_mps2), _CERTAIN_RAD)),
        ("body", AXLES, _AXLES_SIGMA_M),
        ("body", PITCHING, _PITCHING_SIGMA),
        (BESIDE_ROAD, FALL_LEFT, fall),
        (BESIDE_ROAD, FALL_RIGHT, fall),
        (BESIDE_ROAD, RISE, budget.ground_height_m),
    ):
        rows.add(source, np.array([[place]]), np.array([[1.0 / sigma]]))
    for source, places, sigma in (
        ("boresight", layout.boresight(cameras), np.radians(budget.boresight_deg)),
        ("camera position", layout.camera_position(cameras), budget.camera_position_m),
    ):
        rows.add(source, places.reshape(-1, 1), np.full((places.size, 1), 1.0 / sigma))
    if lens_sigma is not None:
        certain = np.maximum(lens_sigma, _CERTAIN_LENS)
        rows.add(LENS, layout.lens(cameras).reshape(-1, 1), 1.0 / certain.reshape(-1, 1))
    points = layout.point(np.arange(layout.n_points)).reshape(-1, 1)
    rows.add("anywhere", points, np.full(points.shape, 1.0 / _ANYWHERE_M))
    for axis, source in enumerate(_NODE_SOURCES):
        places = layout.node(np.arange(layout.n_nodes))[:, axis]
        _add_process(rows, source, places, node_age_s, node_sigma[:, axis], SLOW_TAU_S[axis])
    age_s = (instant_ns - instant_ns[:1]) / NANOSECONDS
    fast = (("body", BOUNCE_TAU_S), ("body", BOUNCE_TAU_S), ("heading", _TREMBLING_TAU_S))
    for axis, (source, tau_s) in enumerate(fast):
        places = layout.bounce(np.arange(layout.n_instants))[:, axis]
        _add_process(rows, source, places, age_s, instant_sigma[:, axis], tau_s)
    if links.size:
        pair = layout.point(links[:, :2].astype(np.int64))[:, :, :2]
        for axis in (0, 1):
            values = np.tile([1.0, -1.0], (len(links), 1)) / _FACE_FROM_FOOT_M
            rows.add("face beside foot", pair[:, :, axis], values, links[:, 2 + axis] / _FACE_FROM_FOOT_M)
    return rows.prior()


def _add_process(
    rows: _Rows, source: str, places: IntArray, age_s: FloatArray, sigma: FloatArray, tau_s: float
) -> None:
    """First-order Gauss-Markov process: the first value by its sigma, each further one by its innovation.

    Where sigmas grow, something new is added to what was there: an error that grew in proportion would take a
    small drift of a standing car's heading for a share of a large error that it always had.
    """
    rows.add(source, places[:1, None], 1.0 / sigma[:1, None])
    if places.size == 1:
        return
    ratio = sigma[1:] / sigma[:-1]
    fades = np.exp(-np.diff(age_s) / tau_s) * np.minimum(ratio, 1.0 / ratio)
    innovation = 1.0 / (sigma[1:] * np.sqrt(1.0 - fades**2))
    before = -fades * ratio * innovation
    rows.add(source, np.stack([places[:-1], places[1:]], axis=1), np.stack([before, innovation], axis=1))


def links_of(objects: Sequence[int] | IntArray, is_foot: BoolArray, start_m: FloatArray) -> FloatArray:
    """Pairs (foot, face) of points that belong to one object, with their distance east and north."""
    face = {int(o): i for i, (o, foot) in enumerate(zip(objects, is_foot, strict=True)) if not foot}
    pairs = [
        (i, face[int(o)])
        for i, (o, foot) in enumerate(zip(objects, is_foot, strict=True))
        if foot and int(o) in face
    ]
    return np.array([(i, j, *(start_m[i, :2] - start_m[j, :2])) for i, j in pairs]).reshape(-1, 4)
