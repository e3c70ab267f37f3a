"""Places of poles from all drives at once, with what each drive shares estimated as such."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg, utm33_covariance_from_enu
from geoloc.fusion.agreeing import LEAST, fuse_with_agreeing
from geoloc.fusion.fuse import Clocks, Known, Passes
from geoloc.fusion.sources import FoundClock, parts_of
from geoloc.trajectory.fix_checks import CODE_LASTS_S
from geoloc.trajectory.trajectory import Poses
from twin.matching.kept import Kept, digest
from twin.matching.poles.poles import ObservedPole
from twin.store.records import Corrections, Covariance, Estimate


@dataclass(frozen=True, slots=True)
class Driven:
    """What fusing needs of a drive.

    Attributes
    ----------
    read_poses : callable
        Gives where it drove, in time order.
    corrections : Corrections or None
        What its adjustment found; None where it was ingested by another method.
    car : str
        The same for drives with the same rig.
    recorded : str
        What tells its poses from any others.
    has_poses : bool
        Whether there is any pose of it.
    """

    drive_id: str
    read_poses: Callable[[], Poses]
    corrections: Corrections | None
    car: str
    recorded: str
    has_poses: bool = True

    @property
    def content(self) -> bytes:
        """What tells it from any other drive, as far as fusing goes."""
        return repr((self.drive_id, self.recorded, self.car, self.corrections)).encode()


class Measured(NamedTuple):
    """Where NVDB has a sign that was measured: EPSG:25833, and one sigma of an axis."""

    east_m: float
    north_m: float
    sigma_m: float


class Placed(NamedTuple):
    """Poles as all drives place them, and the numbers of those whose measured places tied drives down."""

    poles: list[ObservedPole]
    tied_by: frozenset[int]


def with_fused_places(
    poles: Sequence[ObservedPole],
    estimates: Sequence[Estimate],
    drives: Sequence[Driven],
    measured: Mapping[int, Measured] | None = None,
    kept: Kept | None = None,
) -> Placed:
    """Place poles by the estimates of all drives that are tied together by poles that several of them saw.

    Drives that no other one shares a pole with keep their places, and so do poles of drives whose method
    tells nothing of where its errors come from: covariance intersection holds for these.

    Parameters
    ----------
    poles : sequence of ObservedPole
    estimates : sequence of Estimate, of one method
        What the poles were made of.
    drives : sequence of Driven
    measured : mapping of a pole's number → Measured, optional
        Places that tie drives down where they agree with one another; never the pole itself.
    kept : Kept, optional
        What earlier matches worked out for drives that are tied together.
    """
    measured, kept = measured or {}, kept or Kept()
    by_id = {drive.drive_id: drive for drive in drives}
    by_member = {member: estimate for estimate in estimates for member in estimate.members}
    seen = [_best_of_drives(pole, by_member, by_id) for pole in poles]
    number = {drive.drive_id: k for k, drive in enumerate(drives)}
    group = _tied([[number[one.drive_id] for one in of_pole] for of_pole in seen], len(drives))
    placed, tied_by = list(poles), set[int]()
    for tied in np.unique(group):
        ids = [drive.drive_id for drive, one in zip(drives, group, strict=True) if one == tied]
        of_group = [k for k, one in enumerate(seen) if one and group[number[one[0].drive_id]] == tied]
        known = [measured.get(k, _NOWHERE) for k in of_group]
        if len(ids) < 2 and sum(one is not _NOWHERE for one in known) < LEAST:
            continue
        fused, used = _fused([seen[k] for k in of_group], [by_id[i] for i in ids], known, kept)
        if len(ids) < 2 and not used.any():
            continue
        tied_by |= {k for k, counts in zip(of_group, used, strict=True) if counts}
        for k, (east, north), covariance in zip(of_group, *fused, strict=True):
            if math.isnan(east):  # its drives do not agree on it: it ties nothing, and stays
                continue
            placed[k] = replace(
                poles[k],
                east_m=float(east),
                north_m=float(north),
                covariance_m2=covariance,
                # What each drive has of its own is averaged in that covariance.
                averaged=1.0,
            )
    return Placed(placed, frozenset(tied_by))


_NOWHERE = Measured(math.nan, math.nan, 1.0)


def _fused(
    seen: Sequence[Sequence[Estimate]], drives: Sequence[Driven], known: Sequence[Measured], kept: Kept
) -> tuple[tuple[FloatArray, FloatArray], BoolArray]:
    """Places and covariances of the poles of one group, and which known places count."""
    places = np.array(known).reshape(-1, 3)
    key = digest(*(drive.content for drive in drives), places.tobytes(), *_said(seen))
    found = kept.get(_KIND, key)
    if found is None:
        passes, clocks = _group_of(seen, drives)
        fused, used = fuse_with_agreeing(passes, clocks, Known(places[:, :2], places[:, 2]))
        found = {"place_m": fused.place_m, "covariance_m2": fused.covariance_m2, "used": used}
        kept.put(_KIND, key, found)
    return (found["place_m"], found["covariance_m2"]), found["used"]


_KIND = "fused"


def _said(seen: Sequence[Sequence[Estimate]]) -> Iterator[bytes]:
    """Everything that estimates of poles say where they stand."""
    yield np.array([len(of_pole) for of_pole in seen]).tobytes()
    every = [one for of_pole in seen for one in of_pole]
    yield repr([(one.drive_id, tuple(one.budget)) for one in every]).encode()
    yield np.array([one.last_ns for one in every]).tobytes()
    yield np.array([(one.east_m, one.north_m) for one in every]).tobytes()
    yield np.array([part for one in every for part in one.budget.values()]).tobytes()


def _best_of_drives(
    pole: ObservedPole, by_member: Mapping[str, Estimate], drives: Mapping[str, Driven]
) -> list[Estimate]:
    """One estimate a drive, the best one; none at all where one does not tell its errors by source."""
    best: dict[str, Estimate] = {}
    for estimate in (by_member[member] for member in pole.members):
        drive = drives[estimate.drive_id]
        if not estimate.budget or drive.corrections is None or not drive.has_poses:
            return []
        known = best.get(estimate.drive_id)
        if known is None or _spread(estimate) < _spread(known):
            best[estimate.drive_id] = estimate
    return list(best.values())


def _spread(estimate: Estimate) -> tuple[float, str]:
    ee, _, nn = estimate.covariance_m2
    return ee + nn, estimate.member


def _tied(drives_of_poles: Sequence[Sequence[int]], drives: int) -> IntArray:
    """Group ``(drives,)`` of each drive: those that poles tie together have the same."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = [(of_pole[0], one) for of_pole in drives_of_poles for one in of_pole[1:]]
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(pairs)), (ends[0], ends[1])), shape=(drives, drives))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _group_of(seen: Sequence[Sequence[Estimate]], drives: Sequence[Driven]) -> tuple[Passes, Clocks]:
    """What drives say of poles, whose numbers are their places in `seen`."""
    mine: dict[str, list[tuple[int, Estimate]]] = {drive.drive_id: [] for drive in drives}
    for k, of_pole in enumerate(seen):
        for estimate in of_pole:
            mine[estimate.drive_id].append((k, estimate))
    parts = [_passes(number, drive, mine[drive.drive_id]) for number, drive in enumerate(drives)]
    columns = (
        np.concatenate([getattr(part, name) for part in parts]) for name in Passes.__dataclass_fields__
    )
    return Passes(*columns), _clocks(drives)


def _passes(number: int, drive: Driven, seen: Sequence[tuple[int, Estimate]]) -> Passes:
    """What one drive says of its poles, each with its number, in the grid."""
    estimates = [estimate for _, estimate in seen]
    place = np.array([(one.east_m, one.north_m) for one in estimates]).reshape(-1, 2)
    last_ns = np.array([one.last_ns for one in estimates], dtype=np.int64)
    where = geographic_from_utm33(*place.T)
    sources = sorted({source for one in estimates for source in one.budget})
    by_source = {
        source: utm33_covariance_from_enu(
            _matrices([one.budget.get(source, _NONE) for one in estimates]), *where
        )
        for source in sources
    }
    poses = drive.read_poses()
    at = np.clip(np.searchsorted(poses.epoch_ns, last_ns), 0, poses.epoch_ns.size - 1)
    heading = poses.heading_deg[at] - grid_convergence_deg(*where)
    return Passes(
        np.array([pole for pole, _ in seen], dtype=np.int64),
        np.full(len(seen), number),
        last_ns,
        place,
        *parts_of(by_source, heading, _found_clock(drive)),
        np.full(len(seen), CODE_LASTS_S if drive.corrections is None else drive.corrections.track_lasts_s),
    )


_NONE: Covariance = (0.0, 0.0, 0.0)


def _matrices(covariances: Sequence[Covariance]) -> FloatArray:
    """Matrices ``(n, 2, 2)``."""
    ee, en, nn = np.array(covariances).reshape(-1, 3).T
    return np.stack([np.stack([ee, en], axis=1), np.stack([en, nn], axis=1)], axis=1)


def _found_clock(drive: Driven) -> FoundClock:
    """How well the clock of a drive is known."""
    clocks = _clocks([drive])
    stated_s, prior_s = float(clocks.sigma_s[0]), float(clocks.prior_s[0])
    solved_ms = None if drive.corrections is None else drive.corrections.camera_solved_ms
    if solved_ms is None:  # of older versions: as if bearings had said nothing
        return FoundClock(stated_s, stated_s, stated_s)
    return FoundClock(max(prior_s, 1e-3 * solved_ms), 1e-3 * solved_ms, stated_s)


def _clocks(drives: Sequence[Driven]) -> Clocks:
    """Clocks of drives that were adjusted."""
    cars = sorted({drive.car for drive in drives})
    found = [drive.corrections for drive in drives if drive.corrections is not None]
    value, sigma = (
        np.array([(one.camera_offset_ms.value, one.camera_offset_ms.sigma) for one in found]).T / 1e3
    )
    prior = np.array([one.camera_prior_ms or 0.0 for one in found]) / 1e3
    car = np.array([cars.index(drive.car) for drive in drives])
    late = np.array([one.receiver_late_ms for one in found]) / 1e3
    return Clocks.of_drives(car, value, sigma, prior, late)
