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
from twin.matching.kept import Kept, NotSure, digest
from twin.matching.poles.kept_places import KeptPlaces
from twin.matching.poles.poles import ObservedPole
from twin.matching.poles.windows import Window, Windows
from twin.store.records import Correction, Corrections, Covariance, Estimate


@dataclass(frozen=True, slots=True)
class Driven:
    """What fusing needs of a drive.

    Attributes
    ----------
    read_poses : callable
        Gives where it drove, in time order.
    heading_deg : callable
        Gives the car's heading (n,) from true north at epochs (n,), where there is any pose.
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
    heading_deg: Callable[[IntArray], FloatArray]
    corrections: Corrections | None
    car: str
    recorded: str
    has_poses: bool = True

    @property
    def content(self) -> bytes:
        """What tells it from any other drive, as far as fusing goes."""
        return repr((self.drive_id, self.recorded, self.car, self.corrections)).encode()


def headings_at(poses: Poses, epoch_ns: IntArray) -> FloatArray:
    """Heading (n,) of the first pose at or after each epoch (n,), else of the last one."""
    at = np.clip(np.searchsorted(poses.epoch_ns, epoch_ns), 0, poses.epoch_ns.size - 1)
    return np.asarray(poses.heading_deg[at])


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
    only: Mapping[int, float] | None = None,
) -> Placed:
    """Place poles by the estimates of all drives that are tied together by poles that several of them saw.

    Poles of one square of the grid are placed at a time, by what drives say of them and of the poles about
    (:mod:`twin.matching.poles.windows`). Drives that no other one shares a pole with there keep their places,
    and so do poles of drives whose method tells nothing of where its errors come from: covariance
    intersection holds for these.

    Parameters
    ----------
    poles : sequence of ObservedPole
    estimates : sequence of Estimate, of one method
        What the poles were made of.
    drives : sequence of Driven
    measured : mapping of a pole's number → Measured, optional
        Places that tie drives down where they agree with one another; never the pole itself.
    kept : Kept, optional
        What earlier matches worked out of the same squares.
    only : mapping of a square's number → metres, optional
        Squares to be placed, and how far about each the poles are all there. Elsewhere poles stand where the
        last match has them.

    Raises
    ------
    NotSure
        Poles further away count for one of these squares.
    """
    by_id = {drive.drive_id: drive for drive in drives}
    by_member = {member: estimate for estimate in estimates for member in estimate.members}
    seen = [_best_of_drives(pole, by_member, by_id) for pole in poles]
    told = np.array([k for k, of_pole in enumerate(seen) if of_pole], dtype=np.int64)
    before = KeptPlaces(kept or Kept(), "aided" if measured else "fused")
    if not told.size:
        before.keep(only)
        return Placed(list(poles), frozenset())
    passes = _all_passes([seen[k] for k in told], drives)
    known = np.array([(measured or {}).get(k, _NOWHERE) for k in told.tolist()])
    fusing = _Fusing(passes, [poles[k].members[0] for k in told], drives, known, before)
    windows = Windows(np.array([(poles[k].east_m, poles[k].north_m) for k in told]))
    placed, tied_by = list(poles), set[int]()
    for rows, found in fusing.everywhere(windows) if only is None else fusing.there(windows, only):
        for k, (east, north, ee, en, nn, used) in zip(told[rows].tolist(), found.tolist(), strict=True):
            if used:
                tied_by.add(k)
            if math.isnan(east):  # its drives do not agree on it: it ties nothing, and stays
                continue
            placed[k] = replace(
                poles[k],
                east_m=east,
                north_m=north,
                covariance_m2=np.array([[ee, en], [en, nn]]),
                # What each drive has of its own is averaged in that covariance.
                averaged=1.0,
            )
    before.keep(only)
    return Placed(placed, frozenset(tied_by))


_NOWHERE = Measured(math.nan, math.nan, 1.0)


class _Fusing:
    """Passes of all drives past all poles, of which those about one square are put together at a time."""

    def __init__(
        self,
        passes: Passes,
        names: Sequence[str],
        drives: Sequence[Driven],
        known: FloatArray,
        kept: KeptPlaces,
    ) -> None:
        self._passes, self._names, self._known, self._kept = passes, names, known, kept
        self._clocks = _clocks(drives)
        self._order = np.argsort(passes.pole, kind="stable")
        self._first = np.searchsorted(passes.pole[self._order], np.arange(len(known) + 1))
        names = ("place_m", "own_m2", "common_m2", "track_m", "ahead_mps")
        columns = [getattr(passes, name).reshape(len(passes.pole), -1) for name in names]
        self._said = np.column_stack([passes.epoch_ns.view(np.float64), *columns])

    def everywhere(self, windows: Windows) -> Iterator[tuple[IntArray, FloatArray]]:
        """Place the poles of every square."""
        for window in windows:
            yield from self._groups_of(window)

    def there(self, windows: Windows, only: Mapping[int, float]) -> Iterator[tuple[IntArray, FloatArray]]:
        """Place the poles of some squares; of the others give what was kept."""
        for square in np.unique(windows.square_of).tolist():
            if square not in only:
                continue
            window = windows.window(square)
            if window.margin_m > only[square]:
                raise NotSure
            yield from self._groups_of(window)
        for k, square in enumerate(windows.square_of.tolist()):
            row = None if square in only else self._kept.of_pole(square, self._names[k])
            if row is not None:
                yield np.array([k]), row[None]

    def _groups_of(self, window: Window) -> Iterator[tuple[IntArray, FloatArray]]:
        """Poles of a square that drives tie together, and what `_fused` says of them."""
        self._kept.looked(window.square, window.margin_m, window.inside.size)
        inside = np.zeros(len(self._known), dtype=bool)
        inside[window.inside] = True
        rows = np.sort(
            np.concatenate([self._order[self._first[k] : self._first[k + 1]] for k in window.about.tolist()])
        )
        group = _groups(self._passes.pole[rows], self._passes.drive[rows])
        for one in np.unique(group[inside[self._passes.pole[rows]]]).tolist():
            mine = rows[group == one]
            there = np.unique(self._passes.pole[mine])
            drives = np.unique(self._passes.drive[mine])
            known = self._known[there]
            if drives.size < 2 and np.isfinite(known[:, 0]).sum() < LEAST:
                continue
            wanted = inside[there]
            found = self._fused(window.square, mine, there, drives, wanted)
            if drives.size < 2 and not found[:, 5].any():
                continue
            yield there[wanted], found

    def _fused(
        self, square: int, rows: IntArray, there: IntArray, drives: IntArray, wanted: BoolArray
    ) -> FloatArray:
        """Easting, northing, three of the covariance, and whether its known place counts, of those wanted."""
        known = self._known[there]
        pole, drive = np.searchsorted(there, self._passes.pole[rows]), self._passes.drive[rows]
        number = np.searchsorted(drives, drive)
        clocks = Clocks(*(getattr(self._clocks, name)[drives] for name in Clocks.__dataclass_fields__))
        clocks = replace(clocks, car=np.unique(clocks.car, return_inverse=True)[1])
        rests_on = digest(
            *(getattr(clocks, name).tobytes() for name in Clocks.__dataclass_fields__),
            *(part.tobytes() for part in (known, pole, number, self._said[rows], wanted)),
        )
        found = self._kept.get(square, rests_on)
        if found is None:
            columns = {name: getattr(self._passes, name)[rows] for name in Passes.__dataclass_fields__}
            passes = Passes(**(columns | {"pole": pole, "drive": number}))
            fused, used = fuse_with_agreeing(passes, clocks, Known(known[:, :2], known[:, 2]))
            covariance = fused.covariance_m2.reshape(-1, 4)[:, [0, 1, 3]]
            found = np.column_stack([fused.place_m, covariance, used])[wanted]
        self._kept.put(square, rests_on, (self._names[k] for k in there[wanted].tolist()), found)
        return found


def _groups(pole: IntArray, drive: IntArray) -> IntArray:
    """Group (n,) of each pass: drives that poles tie together have the same, and so have these poles."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    there, of_pole = np.unique(pole, return_inverse=True)
    drives, of_drive = np.unique(drive, return_inverse=True)
    size = drives.size + there.size
    graph = coo_array((np.ones(pole.size), (of_drive, drives.size + of_pole)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1][of_drive], dtype=np.int64)


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


def _all_passes(seen: Sequence[Sequence[Estimate]], drives: Sequence[Driven]) -> Passes:
    """What drives say of poles, whose numbers are their places in `seen`: drive by drive."""
    mine: dict[str, list[tuple[int, Estimate]]] = {drive.drive_id: [] for drive in drives}
    for k, of_pole in enumerate(seen):
        for estimate in of_pole:
            mine[estimate.drive_id].append((k, estimate))
    parts = [
        _passes(number, drive, mine[drive.drive_id])
        for number, drive in enumerate(drives)
        if mine[drive.drive_id]
    ]
    columns = (
        np.concatenate([getattr(part, name) for part in parts]) for name in Passes.__dataclass_fields__
    )
    return Passes(*columns)


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
    heading = drive.heading_deg(last_ns) - grid_convergence_deg(*where)
    lasts_s = CODE_LASTS_S if drive.corrections is None else drive.corrections.track_lasts_s
    return Passes(
        np.array([pole for pole, _ in seen], dtype=np.int64),
        np.full(len(seen), number),
        last_ns,
        place,
        *parts_of(by_source, heading, _found_clock(drive), lasts_s),
        np.full(len(seen), lasts_s),
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
    """Clocks of drives; those that were not adjusted have no pass, and any clock."""
    cars = sorted({drive.car for drive in drives})
    found = [drive.corrections or _NOT_ADJUSTED for drive in drives]
    value, sigma = (
        np.array([(one.camera_offset_ms.value, one.camera_offset_ms.sigma) for one in found]).T / 1e3
    )
    prior = np.array([one.camera_prior_ms or 0.0 for one in found]) / 1e3
    car = np.array([cars.index(drive.car) for drive in drives])
    late = np.array([one.receiver_late_ms for one in found]) / 1e3
    return Clocks.of_drives(car, value, sigma, prior, late)


_NOT_ADJUSTED = Corrections(1.0, Correction(0.0, 1.0), Correction(0.0, 1.0), {})
