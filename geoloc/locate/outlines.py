"""Points, lines and areas on the ground: the corners of one drawing, located together.

A corner on the ground is located as the foot of a sign is (`geoloc.locate.single_frame`). What is different:
all corners come of one picture, and only the pixel is each corner's own error. Where the car stood, how its
body leant, how the camera sits and how the ground lies move all corners together, so that a length or an area
is known far better than a position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray, TextArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.locate.combine import combine
from geoloc.locate.error_budget import ErrorBudget, Pair, source_moves
from geoloc.locate.feet import Rejections, axes_of, enu_of, feet_on_plane
from geoloc.locate.records import Located
from geoloc.rig.rig import Rig, RigCamera
from geoloc.trajectory.poses import Poses, part

_FLOOR_M2 = 1e-8
"""(0.1 mm)²: keeps weights finite where every source of error was set to zero."""
_SEAM_M = 1.0
"""Parts of a line that lie further from each other than this have a gap between them."""
_CUTS = 64
"""A side of which one end is not located is looked at in so many places."""


class Measure(NamedTuple):
    """A length in metres or an area in square metres, and its one sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Corners on the ground, in their order, with one joint covariance.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float64 (k,)
        `height_m` ellipsoidal. NaN where not located.
    sigma_height_m : float64 (k,)
    own_m2 : float64 (k, 2, 2)
        Covariance, east and true north, of what each corner has for itself.
    shared_m : float64 (k, 2, m)
        How far one sigma of each error that corners have in common moves each of them.
    source : tuple of str
        Names of the m columns.
    range_m : float64 (k,)
        Horizontal distance from the camera.
    rejected : str (k,)
        A `geoloc.reasons.Reason`; "" where located.
    part : int64 (k,)
        Which part of a line in several parts a corner belongs to: 0, 1 … in the order of the line.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    sigma_height_m: FloatArray
    own_m2: FloatArray
    shared_m: FloatArray
    source: tuple[str, ...]
    range_m: FloatArray
    rejected: TextArray
    part: IntArray

    @property
    def corner_m2(self) -> FloatArray:
        """Covariance of each corner, float64 (k, 2, 2)."""
        return np.asarray(self.own_m2 + self.shared_m @ np.swapaxes(self.shared_m, 1, 2))

    def covariance_m2(self) -> FloatArray:
        """Joint covariance, float64 (2 k, 2 k): east and north of the first corner, then of the second."""
        k = len(self.own_m2)
        moves = self.shared_m.reshape(2 * k, -1)
        joint = moves @ moves.T
        for i, own in enumerate(self.own_m2):
            joint[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += own
        return np.asarray(joint)

    def plane_m(self) -> FloatArray:
        """Corners east and north of the first one, float64 (k, 2)."""
        east, north = enu_offset(
            self.latitude_deg[0], self.longitude_deg[0], self.latitude_deg, self.longitude_deg
        )
        return np.stack([east, north], axis=1)

    def length(self) -> Measure:
        """Length of a line, longer gaps between its parts left out.

        The noise of the pixels makes a line a little longer than it is, by ``σ² / d`` a side of length d.
        Parts, which stand in the order of the line, were cut where one begins and the other ends: what lies
        between two of them along the line is added, or taken off where they overlap, and the length of all is
        as good as the two ends are.
        """
        point = self.plane_m()
        step = np.diff(point, axis=0)
        is_side = np.diff(self.part) == 0
        size = np.hypot(*step.T) * is_side
        along = step / np.where(size > 0.0, size, 1.0)[:, None] * is_side[:, None]
        slope = np.zeros_like(point)
        slope[1:] += along
        slope[:-1] -= along
        if self.part[-1]:
            slope[1:-1] = 0.0
        seams = np.flatnonzero(~is_side)
        between = np.einsum("ki,ki->k", step[seams], along[seams - 1])
        total = size.sum() + between[np.abs(between) < _SEAM_M].sum()
        return Measure(float(total), self._sigma(slope))

    def area(self) -> Measure:
        """Area inside the corners."""
        x, y = self.plane_m().T
        after, before = (np.roll(np.arange(x.size), by) for by in (-1, 1))
        doubled = float(x @ y[after] - x[after] @ y)
        slope = 0.5 * np.stack([y[after] - y[before], x[before] - x[after]], axis=1)
        return Measure(abs(doubled) / 2.0, self._sigma(slope))

    def _sigma(self, slope: FloatArray) -> float:
        """One sigma of what changes by `slope` (k, 2) a metre that each corner moves."""
        own = float(np.einsum("ki,kij,kj->", slope, self.own_m2, slope))
        return float(np.sqrt(own + np.sum(np.einsum("ki,kim->m", slope, self.shared_m) ** 2)))

    def correlation(self) -> FloatArray:
        """Correlation of each corner's errors with the next one's, float64 (k,); of the last with the first.

        The trace of their covariance by the geometric mean of the traces of both: 1 for one and the same
        error, NaN for a single point.
        """
        following = np.roll(np.arange(len(self.own_m2)), -1)
        both = np.einsum("kim,kim->k", self.shared_m, self.shared_m[following])
        total = np.trace(self.corner_m2, axis1=1, axis2=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = both / np.sqrt(total * total[following])
        return np.where(following == np.arange(len(share)), np.nan, share)

    def at(self, place: FloatArray) -> Outline:
        """Return places on the sides, ``1.25`` a quarter of the way from the second corner to the third.

        What lies between two corners has its share of the own errors of both.
        """
        first = np.minimum(np.floor(place).astype(np.int64), len(self.own_m2) - 1)
        last = np.minimum(first + 1, len(self.own_m2) - 1)
        share = place - first

        def between(values: FloatArray, power: int = 1) -> FloatArray:
            by = share.reshape(-1, *[1] * (values.ndim - 1))
            return np.asarray((1.0 - by) ** power * values[first] + by**power * values[last])

        return Outline(
            latitude_deg=between(self.latitude_deg),
            longitude_deg=between(self.longitude_deg),
            height_m=between(self.height_m),
            sigma_height_m=between(self.sigma_height_m),
            own_m2=between(self.own_m2, 2),
            shared_m=between(self.shared_m),
            source=self.source,
            range_m=between(self.range_m),
            rejected=self.rejected[first],
            part=np.zeros(place.size, dtype=np.int64),
        )


def locate_outline(
    rig: Rig,
    camera: str,
    pixel_px: FloatArray,
    pose: Poses,
    budget: ErrorBudget,
    *,
    frame: str,
    max_range_m: float = MAX_RANGE_M,
) -> Outline:
    """Locate the corners of what was drawn in one picture, on the plane on which the car stands.

    Parameters
    ----------
    rig : Rig
    camera : str
    pixel_px : float64 (k, 2)
        (0, 0) is the centre of the first pixel.
    pose : Poses (1,)
        The rig's pose when the picture was taken.
    budget : ErrorBudget
    frame : str
        Name of the picture. The body's unrest is one error for all corners of it, and another in every other
        picture.
    max_range_m : float
        Corners further from the camera are refused.

    Returns
    -------
    Outline
        With the rejections of `geoloc.locate.single_frame.locate_single_frame`.

    Raises
    ------
    CalibrationError
        If the rig lacks the camera, or cannot compute with it.
    """
    seen, n = rig.camera(camera), len(pixel_px)
    poses = part(pose, np.zeros(n, dtype=np.int64))
    rejections = Rejections()
    with np.errstate(all="ignore"):
        feet, axes = feet_on_plane(seen, pixel_px, max_range_m), axes_of(poses)
        enu = enu_of(axes, feet)
        moves = source_moves(seen, feet, axes, enu, poses, budget)
        bad = rejections.add(seen, feet, poses, slice(None), 0, max_range_m)
        lat, lon = geographic_from_enu(poses.latitude_deg, poses.longitude_deg, enu.east, enu.north)
    across, down, pitch, roll = moves.random
    shared = {
        f"pitch jitter {frame}": pitch,
        f"roll jitter {frame}": roll,
        **{f"{what} {camera}": move for what, move in moves.of_camera.items()},
        **moves.shared,
    }
    climb = np.radians(budget.ground_slope_deg) * np.hypot(feet.x_m, feet.y_m)
    leaning = np.radians(np.hypot(feet.x_m * poses.sigma_pitch_deg, feet.y_m * poses.sigma_roll_deg))
    heights = (poses.sigma_vertical_m, budget.ground_height_m, climb, budget.ground_fall * feet.y_m, leaning)
    own = np.stack([_columns(across), _columns(down)], axis=2)
    lost = np.zeros(n, dtype=np.bool_) if bad is None else bad

    def known(values: FloatArray) -> FloatArray:
        return np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)

    return Outline(
        latitude_deg=known(lat),
        longitude_deg=known(lon),
        height_m=known(poses.height_m + enu.up),
        sigma_height_m=known(np.sqrt(sum(np.square(one) for one in heights))),
        own_m2=known(own @ np.swapaxes(own, 1, 2)),
        shared_m=known(np.stack([_columns(move) for move in shared.values()], axis=2)),
        source=tuple(shared),
        range_m=known(feet.range_m),
        rejected=rejections.column(n),
        part=np.zeros(n, dtype=np.int64),
    )


def _columns(move: Pair) -> FloatArray:
    return np.stack([np.asarray(component, dtype=np.float64) for component in move], axis=-1)


def cut_to_reach(camera: RigCamera, pixel_px: FloatArray, max_range_m: float = MAX_RANGE_M) -> FloatArray:
    """Cut a drawn line to its longest stretch that lies within reach on the ground.

    Parameters
    ----------
    pixel_px : float64 (k, 2)

    Returns
    -------
    float64 (n, 2)
        Its corners that can be located, and where it leaves the reach, which nobody marked. Empty where it
        never comes near.
    """
    steps = [np.linspace(a, b, _CUTS, endpoint=False) for a, b in pairwise(pixel_px)]
    dense = np.concatenate([*steps, pixel_px[-1:]])
    with np.errstate(all="ignore"):
        hit = feet_on_plane(camera, dense, max_range_m).hit
    edges = np.flatnonzero(np.diff(np.concatenate([[0], hit.astype(np.int64), [0]])))
    if not edges.size:
        return np.empty((0, 2))
    begins, ends = edges[::2], edges[1::2] - 1
    longest = int(np.argmax(ends - begins))
    first, last = int(begins[longest]), int(ends[longest])
    corners = range(-(-first // _CUTS) * _CUTS, last + 1, _CUTS)
    return np.asarray(dense[sorted({first, last, *corners})])


def joined(outlines: Sequence[Outline]) -> Outline:
    """Return outlines as the parts of one; an error that bears one name in several is one error."""
    source = tuple(dict.fromkeys(name for one in outlines for name in one.source))
    shared = [_with_columns(one, source) for one in outlines]
    sizes = [len(one.own_m2) for one in outlines]
    return Outline(
        latitude_deg=np.concatenate([one.latitude_deg for one in outlines]),
        longitude_deg=np.concatenate([one.longitude_deg for one in outlines]),
        height_m=np.concatenate([one.height_m for one in outlines]),
        sigma_height_m=np.concatenate([one.sigma_height_m for one in outlines]),
        own_m2=np.concatenate([one.own_m2 for one in outlines]),
        range_m=np.concatenate([one.range_m for one in outlines]),
        rejected=np.concatenate([one.rejected for one in outlines]),
        shared_m=np.concatenate(shared),
        source=source,
        part=np.repeat(np.arange(len(outlines)), sizes),
    )


def _with_columns(outline: Outline, source: tuple[str, ...]) -> FloatArray:
    """Moves by the errors of `source`; zero for those that the outline does not know."""
    moves = np.zeros((len(outline.own_m2), 2, len(source)))
    moves[:, :, [source.index(name) for name in outline.source]] = outline.shared_m
    return moves


def mean_outline(readings: Sequence[Outline]) -> tuple[Outline, int] | None:
    """Combine several drawings of the same corners, corner by corner, as `geoloc.locate.combine` does.

    Parameters
    ----------
    readings : sequence of Outline
        Each located throughout, with as many corners, in the same order.

    Returns
    -------
    (Outline, int) or None
        The mean, and how many readings of a single point were left out as gross outliers. None where a corner
        of several contradicts itself: these are not the same corners.
    """
    every, k, n = joined(readings), len(readings[0].own_m2), len(readings)
    corner = np.tile(np.arange(k), n)
    located = Located(
        every.latitude_deg,
        every.longitude_deg,
        every.height_m,
        every.corner_m2,
        every.own_m2,
        every.shared_m,
        every.source,
        every.range_m,
        every.rejected,
    )
    combined = combine(located, corner)
    if k > 1 and not combined.used.all():
        return None
    weight = np.linalg.inv(located.covariance_m2 + _FLOOR_M2 * np.eye(2)) * combined.used[:, None, None]
    gain = np.linalg.inv(weight.reshape(n, k, 2, 2).sum(axis=0))[corner] @ weight
    own = (gain @ every.own_m2 @ np.swapaxes(gain, 1, 2)).reshape(n, k, 2, 2).sum(axis=0)
    mean = Outline(
        latitude_deg=combined.latitude_deg,
        longitude_deg=combined.longitude_deg,
        height_m=combined.height_m,
        sigma_height_m=every.sigma_height_m.reshape(n, k).min(axis=0),
        own_m2=own,
        shared_m=(gain @ every.shared_m).reshape(n, k, 2, -1).sum(axis=0),
        source=every.source,
        range_m=combined.range_min_m,
        rejected=every.rejected[:k],
        part=np.zeros(k, dtype=np.int64),
    )
    return mean, int(combined.n_rejected.sum())
