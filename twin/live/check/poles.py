"""Live estimates as poles, put together by the rules that a match has for the objects of one drive."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import (
    grid_convergence_deg,
    utm33_covariance_from_enu,
    utm33_from_geographic,
)
from twin.live.estimates import Estimate, State
from twin.live.events import Frame
from twin.matching.config import MatchConfig
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.poles.same_pole import Picture, each_pole_once, may_be_one
from twin.store.records import Estimate as Measured
from twin.store.records import split_codes

DRIVE = "live"
"""What matching calls the drive that goes on."""
_STEP_DEG = 30.0
_TRACK_EVERY_M, _TRACK_POINTS = 2.0, 1000


class Pole(NamedTuple):
    """A pole as it is known now.

    Attributes
    ----------
    id : str
        That of its object that was seen first.
    seen : ObservedPole
    covariance_m2 : float64 (2, 2)
        East and true north.
    of_one_frame : bool
        Whether one frame alone shows it, or its place is what one frame says.
    is_final : bool
        Whether all its objects have left the window.
    """

    id: str
    seen: ObservedPole
    covariance_m2: FloatArray
    of_one_frame: bool
    is_final: bool


class _Placed(NamedTuple):
    said: Estimate
    measured: Measured
    seen_from_deg: frozenset[float]


class Poles:
    """The objects that the engine has located so far, near the car.

    Parameters
    ----------
    config : MatchConfig
    """

    def __init__(self, config: MatchConfig) -> None:
        self._config = config
        self._placed: dict[str, _Placed] = {}
        self._lost: list[tuple[int, int]] = []
        self._pictures: dict[str, set[Picture]] = {}
        # Epoch, easting and northing of the car: longer than any sign is in view.
        self._track: deque[tuple[int, float, float]] = deque(maxlen=_TRACK_POINTS)

    def drive(self, epoch_ns: int, place_m: FloatArray) -> None:
        """Tell where the car is, EPSG:25833: it is from there that poles are seen."""
        east_m, north_m = place_m.tolist()
        if not self._track or np.hypot(*(place_m - self._track[-1][1:])) > _TRACK_EVERY_M:
            self._track.append((epoch_ns, east_m, north_m))

    def see(self, frame: Frame, shown: Iterable[tuple[str, str]]) -> None:
        """Take what a frame shows: objects by their estimates' ids, and as what."""
        for name, kind in shown:
            self._pictures.setdefault(name, set()).add((frame.camera, frame.number, kind))

    def take(self, estimates: Iterable[Estimate]) -> FloatArray:
        """Take estimates; return where they stand, and stood until now: EPSG:25833 and reach (n, 3)."""
        touched: list[tuple[float, float, float]] = []
        for said in estimates:
            if said.state is State.LOST:
                self._lost.append((said.first_seen_ns, said.last_seen_ns))
                self._pictures.pop(said.id, None)
                continue
            before, measured = self._placed.get(said.id), _measured(said)
            placed = _Placed(said, measured, self._seen_from(said, measured, before))
            self._placed[said.id] = placed
            touched += [_about(one.measured) for one in (before, placed) if one is not None]
        return np.array(touched, dtype=np.float64).reshape(-1, 3)

    def near(self, places_m: FloatArray, reach_m: float) -> list[Pole]:
        """Return the poles within so far of any of some places (n, 2)."""
        rows = list(self._placed.values())
        if not rows or not len(places_m):
            return []
        stand = np.array([(one.measured.east_m, one.measured.north_m) for one in rows])
        away = np.hypot(*np.moveaxis(stand[:, None] - places_m, -1, 0)).min(axis=1)
        return self._together([rows[k] for k in np.flatnonzero(away <= reach_m).tolist()])

    def was_lost(self, begin_ns: int, end_ns: int) -> bool:
        """Whether an object was seen in that time that never got a position: it may have been any sign."""
        return any(begin <= end_ns and end >= begin_ns for begin, end in self._lost)

    def forget(self, place_m: FloatArray, beyond_m: float) -> None:
        """Forget what stands so far from a place, and from where it was seen."""
        for name, one in list(self._placed.items()):
            stands = one.measured.east_m - place_m[0], one.measured.north_m - place_m[1]
            if np.hypot(*stands) > beyond_m and one.said.state is State.FINAL:
                del self._placed[name]
                self._pictures.pop(name, None)
        self._lost = [one for one in self._lost if one[1] >= self._track[0][0]]

    def _together(self, placed: Sequence[_Placed]) -> list[Pole]:
        said = {one.measured.member: one.said for one in placed}
        seen_from = {one.measured.member: one.seen_from_deg for one in placed}
        # What one frame says is joined with nothing: metres along its sight lie other poles.
        first = [one.measured for one in placed if one.said.state is State.FIRST]
        sure = [one.measured for one in placed if one.said.state is not State.FIRST]
        names = {one.measured.member: one.said.object for one in placed}
        once = each_pole_once(sure, self._one_pole(sure, names), self._shown(sure))
        poles = observed_poles(once, [DRIVE], self._config, seen_from)
        for one in first:
            poles += observed_poles([one], [DRIVE], self._config, seen_from)
        return [_pole(pole, [said[member] for member in pole.members]) for pole in poles]

    def _one_pole(self, rows: Sequence[Measured], names: Mapping[str, str | None]) -> list[tuple[str, str]]:
        """Pairs that may be one pole: those of one name of the source, passed again, and tracks lost."""
        again = [
            (one.member, other.member)
            for one, other in combinations(rows, 2)
            if names[one.member] is not None and names[one.member] == names[other.member]
        ]
        return again + (may_be_one(rows, self._config) if len(rows) > 1 else [])

    def _shown(self, rows: Sequence[Measured]) -> dict[str, frozenset[Picture]]:
        return {one.member: frozenset(self._pictures.get(one.object, ())) for one in rows}

    def _seen_from(self, said: Estimate, measured: Measured, before: _Placed | None) -> frozenset[float]:
        """From which directions it was seen: where the car was then, in steps of 30° from true north."""
        first, last = said.first_seen_ns, said.last_seen_ns
        eyes = np.array([place for at, *place in self._track if first <= at <= last]).reshape(-1, 2)
        east, north = (eyes - (measured.east_m, measured.north_m)).T
        turn = float(grid_convergence_deg([said.latitude_deg], [said.longitude_deg])[0])
        azimuth = np.round((np.rad2deg(np.arctan2(east, north)) + turn) / _STEP_DEG) * _STEP_DEG % 360.0
        known = frozenset(azimuth.tolist())
        is_whole = bool(self._track) and self._track[0][0] <= first
        return known if before is None or is_whole else known | before.seen_from_deg


def _pole(seen: ObservedPole, said: Sequence[Estimate]) -> Pole:
    best = min(said, key=lambda one: float(np.trace(one.covariance_m2)))
    return Pole(
        id=min(said, key=lambda one: (one.first_seen_ns, one.id)).id,
        seen=seen,
        covariance_m2=best.covariance_m2,
        of_one_frame=seen.n_sightings == 1 or best.state is State.FIRST,
        is_final=all(one.state is State.FINAL for one in said),
    )


def _measured(said: Estimate) -> Measured:
    latitude, longitude = np.array([said.latitude_deg]), np.array([said.longitude_deg])
    east, north = utm33_from_geographic(latitude, longitude)
    (ee, en), (_, nn) = utm33_covariance_from_enu(said.covariance_m2, latitude, longitude)[0].tolist()
    return Measured(
        drive_id=DRIVE,
        object=said.id,
        codes=split_codes(said.skiltnummer),
        east_m=float(east[0]),
        north_m=float(north[0]),
        covariance_m2=(ee, en, nn),
        cameras=said.cameras,
        n_sightings=said.sightings,
        first_ns=said.first_seen_ns,
        last_ns=said.last_seen_ns,
        text=said.text or None,
    )


def _about(one: Measured) -> tuple[float, float, float]:
    """Where it stands, and how far from there a sign of NVDB may be it."""
    return one.east_m, one.north_m, _GATE_SIGMAS * float(np.sqrt(one.covariance_m2[0] + one.covariance_m2[2]))


_GATE_SIGMAS = 4.0
