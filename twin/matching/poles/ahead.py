"""Drives whose signs all lie ahead of NVDB's, or behind: the start of the video was stated wrongly."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import grid_convergence_deg, utm33_from_geographic
from geoloc.trajectory.trajectory import Poses
from twin.matching.sites import Site
from twin.store.records import Estimate

_LATEST_S, _STEP_S = 10.0, 0.1
_FEWEST = 4
"""Signs that must agree on one shift: three of one code may by chance."""
_LEAST_M = 3.0
"""Less may be a datum, or satellites that are a little off for the whole drive."""
_OWN_SIGMAS = 1.5
"""Less is what the drive says of itself: no sign counts as moved by it."""
_SCATTER, NEAR_M = 1 / 3, 10.0
"""How near a shifted sign must come to NVDB's: a share of the shift, and at most so far. In a bend no
shift is exact: a sign hangs on all the places that it was seen from."""
_NEAREST_S = 0.7
"""So long before its last sighting a sign is best placed: near, and still in the picture."""


_LATE_S: FloatArray = np.linspace(-_LATEST_S, _LATEST_S, round(2 * _LATEST_S / _STEP_S) + 1)
SURELY_M = 0.99 * _SCATTER * _LEAST_M
"""A sign this near to NVDB's counts as being there, whatever the shift that it is weighed against."""


class Ahead(NamedTuple):
    """One shift along the drive's own path that brings its signs to NVDB's.

    Attributes
    ----------
    along_m : float
        How far its signs lie ahead of NVDB's; below zero: behind.
    late_s : float
        By how much the camera's clock would have to be late for that; below zero: early.
    """

    along_m: float
    late_s: float


class Signs(NamedTuple):
    """What a drive has read, as far as a clock can be told by it.

    Attributes
    ----------
    read : list of Estimate
        One a pole, of which codes and last sighting are known.
    place : float64 (n, 2)
        EPSG:25833.
    poses : Poses
        Where the drive drove, in time order.
    """

    read: list[Estimate]
    place: FloatArray
    poses: Poses

    @classmethod
    def of(cls, estimates: Sequence[Estimate], poses: Poses) -> Signs:
        """Take those of one drive that count."""
        read = [one for one in estimates if one.codes and one.last_ns and poses.epoch_ns.size > 1]
        return cls(read, np.array([(one.east_m, one.north_m) for one in read]).reshape(-1, 2), poses)

    def seen_s(self) -> FloatArray:
        """When each was best placed (n,), seconds after the first pose."""
        last_ns = np.array([one.last_ns for one in self.read], dtype=np.int64)
        return np.asarray(1e-9 * (last_ns - self.poses.epoch_ns[0]) - _NEAREST_S)

    def if_shifted(self) -> FloatArray:
        """Places (n, 2) at which sites can tell by what the signs are shifted, each to within `NEAR_M`."""
        some = np.concatenate([self.place, _shifted(self).reshape(-1, 2)])
        return np.asarray(some[np.isfinite(some[:, 0])])

    def fit(self, sites: Sequence[Site]) -> bool:
        """Whether so many stand where NVDB has them that no shift can bring twice as many to sites.

        So it is with nearly every drive, which need not be looked at further. Sites further than `SURELY_M`
        from all signs do not count.
        """
        from scipy.spatial import cKDTree

        near = [site for site in sites if site.own_geometry and site.codes]
        if len(self.read) < _FEWEST or not near:
            return len(self.read) < _FEWEST
        seen_s, ended_s = self.seen_s(), 1e-9 * (self.poses.epoch_ns[-1] - self.poses.epoch_ns[0])
        on_path = np.flatnonzero((seen_s >= 0.0) & (seen_s <= ended_s))
        if not on_path.size:
            return False
        there = cKDTree([(site.east_m, site.north_m) for site in near])
        here = cKDTree(self.place[on_path])
        close = here.sparse_distance_matrix(there, SURELY_M, output_type="ndarray")
        codes = [frozenset(site.codes) for site in near]
        pairs = [
            (k, j)
            for k, j in zip(on_path[close["i"]].tolist(), close["j"].tolist(), strict=True)
            if not codes[j].isdisjoint(self.read[k].codes)
        ]
        as_is = min(len({k for k, _ in pairs}), len({j for _, j in pairs}))
        return len(self.read) < 2 * as_is + 2


def ahead_of_nvdb(signs: Signs, sites: Sequence[Site]) -> Ahead | None:
    """Find the one error of the camera's clock that brings a drive's signs to NVDB's, as they are not.

    A clock that is stated to a second is no contradiction within the drive: a path without landmarks fits any
    start. NVDB's signs are landmarks. Each sign keeps its place before the camera, and the camera moves along
    the path; the sign then has to come near a site with one of its codes.

    Parameters
    ----------
    signs : Signs
        Of one drive, one a pole.
    sites : sequence of Site
        Of which those that NVDB has on the centre line do not count.

    Returns
    -------
    Ahead or None
        None where the drive fits as it is, or too few signs agree on another shift.
    """
    read, place, _ = signs
    near = [site for site in sites if site.own_geometry and site.codes]
    if len(read) < _FEWEST or len(near) < _FEWEST or signs.fit(near):
        return None
    shifted = _shifted(signs)
    pairs = _pairs(read, near, shifted)
    sign, site = pairs.T
    if np.unique(sign).size < _FEWEST:
        return None
    there = np.array([(one.east_m, one.north_m) for one in near])
    with np.errstate(invalid="ignore"):
        off_m = np.hypot(*np.moveaxis(shifted[sign] - there[site][:, None], -1, 0))
        moved_m = np.hypot(*np.moveaxis(shifted - place[:, None], -1, 0))
    as_is_m = np.hypot(*(place[sign] - there[site]).T)
    along_m = _median(moved_m)
    within_m = np.minimum(NEAR_M, _SCATTER * along_m)
    count = _paired(pairs, off_m <= within_m)
    as_is = _paired(pairs, as_is_m[:, None] <= within_m)
    own_m = _median(_own_sigma_m(read, shifted - place[:, None]))
    clear = (along_m > _LEAST_M) & (along_m > _OWN_SIGMAS * own_m)
    clear &= (count >= np.maximum(_FEWEST, 2 * as_is + 2)) & (2 * count >= np.unique(sign).size)
    if not clear.any():
        return None
    scatter_m = np.where(off_m <= within_m, off_m, np.nan)
    best = min(np.flatnonzero(clear).tolist(), key=lambda k: (-count[k], np.nanmean(scatter_m[:, k])))
    late = float(_LATE_S[best])
    return Ahead(float(np.copysign(along_m[best], late)), late)


def _shifted(signs: Signs) -> FloatArray:
    """Places (n, shifts, 2) of the signs if the clock is late by so much; NaN beyond the ends of the path."""
    place, poses = signs.place, signs.poses
    if not signs.read:
        return np.zeros((0, _LATE_S.size, 2))
    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    turned = poses.heading_deg - grid_convergence_deg(poses.latitude_deg, poses.longitude_deg)
    heading = np.unwrap(np.deg2rad(turned))
    at_s = 1e-9 * (poses.epoch_ns - poses.epoch_ns[0])
    seen_s = signs.seen_s()
    true_s = seen_s[:, None] - _LATE_S
    there, here = (
        [np.interp(time, at_s, column, left=np.nan, right=np.nan) for column in (east, north, heading)]
        for time in (true_s, seen_s[:, None])
    )
    turn = there[2] - here[2]
    cos, sin = np.cos(turn), np.sin(turn)
    de, dn = place[:, :1] - here[0], place[:, 1:] - here[1]
    # Headings turn clockwise.
    return np.stack([there[0] + cos * de + sin * dn, there[1] - sin * de + cos * dn], axis=-1)


def _pairs(read: Sequence[Estimate], near: Sequence[Site], shifted: FloatArray) -> IntArray:
    """Numbers (k, 2) of signs and of the sites with a code of theirs that some shift brings them near to."""
    from scipy.spatial import cKDTree

    there = np.array([(site.east_m, site.north_m) for site in near])
    on_path = np.flatnonzero(np.isfinite(shifted[..., 0]).any(axis=1))
    middle = np.nanmean(shifted[on_path], axis=1)
    far = np.nanmax(np.hypot(*np.moveaxis(shifted[on_path] - middle[:, None], -1, 0)), axis=1)
    # The circle about all of a sign's places first: few sites are left to be measured from each of them.
    about = cKDTree(there).query_ball_point(middle, far + 2.0 * NEAR_M, return_sorted=True)
    pairs, codes = [], [frozenset(site.codes) for site in near]
    for number, some in zip(on_path.tolist(), about, strict=True):
        alike = [j for j in some if not codes[j].isdisjoint(read[number].codes)]
        if alike:
            east, north = np.moveaxis(shifted[number] - there[alike, None], -1, 0)
            found = (east**2 + north**2 <= NEAR_M**2).any(axis=1)
            pairs += list(product([number], np.array(alike)[found].tolist()))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _paired(pairs: IntArray, some: BoolArray) -> IntArray:
    """How many signs by some pairs (k, shifts), each with a site of its own at most (shifts,)."""
    counts = []
    for ends in pairs.T:
        order = np.argsort(ends, kind="stable")
        first = np.flatnonzero(np.diff(ends[order], prepend=-1))
        counts.append(np.logical_or.reduceat(some[order], first, axis=0).sum(axis=0))
    fewest: IntArray = np.minimum(*counts)
    return fewest


def _own_sigma_m(read: Sequence[Estimate], moved: FloatArray) -> FloatArray:
    """One sigma (n, shifts) of each sign's place in the direction in which it is shifted."""
    ee, en, nn = (one[:, None] for one in np.array([one.covariance_m2 for one in read]).T)
    east, north = np.moveaxis(moved, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        square: FloatArray = (ee * east**2 + 2 * en * east * north + nn * north**2) / (east**2 + north**2)
    return np.sqrt(square)


def _median(of_signs: FloatArray) -> FloatArray:
    """Median of the signs for each shift; NaN where none is on the path."""
    known = np.where(np.isfinite(of_signs).any(axis=0), of_signs, 0.0)
    return np.where(np.isfinite(of_signs).any(axis=0), np.nanmedian(known, axis=0), np.nan)
