"""Which of NVDB's signs the cameras have had in view so far, counted as a match counts them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoloc.arrays import IntArray
from geoloc.earth.geodesy import metres_per_degree, utm33_from_geographic
from geoloc.trajectory.interpolation import NANOSECONDS
from geoloc.trajectory.poses import Poses, part
from geoloc.trajectory.trajectory import Trajectory
from twin.live.check.ahead import SignsAhead
from twin.live.engine import LiveCar
from twin.live.events import Frame
from twin.matching.config import MatchConfig
from twin.matching.in_view import Places, views_of_places
from twin.matching.sites import Site

_STEP_M, _LONGEST_S = 0.3, 1.0
"""Of the frames of one camera those count that lie so far apart, as an ingest keeps them."""
_SURE_M = 3.0
"""A frame of which the car's own place is known worse than this (one sigma) says nothing of what it had in
view: a tenth and more of the distance at which a sign counts as seen."""
_GONE_S = 1.0
"""A sign that was out of view of all cameras for so long has been passed, or is hidden behind the car."""

SiteId = tuple[int, int]


def id_of(site: Site) -> SiteId:
    """Return what a sign of NVDB is known by: type and id."""
    return site.nvdb_type, site.nvdb_id


@dataclass(slots=True)
class InView:
    """One sign's time in view: images, those of its front, and when, by exposure, to half a second."""

    site: Site
    views: int = 0
    fronts: int = 0
    first_ns: int = 0
    last_ns: int = 0


@dataclass(slots=True)
class _Camera:
    """Frames of one camera that were not looked at yet, and the last that counted."""

    waiting: list[int] = field(default_factory=list)
    last_ns: int = 0
    last_deg: tuple[float, float] = (np.nan, np.nan)


class Watched:
    """Counts the images in which each sign was in view.

    Parameters
    ----------
    car : LiveCar
    signs : SignsAhead
    config : MatchConfig
    """

    def __init__(self, car: LiveCar, signs: SignsAhead, config: MatchConfig) -> None:
        self._car, self._signs, self._config = car, signs, config
        self._cameras: dict[str, _Camera] = {}
        self._seen: dict[SiteId, InView] = {}
        self._newest_ns = 0

    def take(self, frame: Frame) -> None:
        """Take a frame in which everything that was to be seen was marked."""
        if frame.camera in self._car.rig.cameras:
            self._cameras.setdefault(frame.camera, _Camera()).waiting.append(frame.epoch_ns)

    def look(self, trajectory: Trajectory | None) -> None:
        """Count what the frames since the last look had in view; without a trajectory they say nothing."""
        for name, camera in self._cameras.items():
            stamps = np.sort(np.array(camera.waiting, dtype=np.int64))
            camera.waiting.clear()
            if trajectory is None or not stamps.size:
                continue
            self._newest_ns = max(self._newest_ns, int(stamps[-1]))
            poses = trajectory.poses_at(stamps)
            with np.errstate(invalid="ignore"):
                sure = np.flatnonzero(poses.valid & (poses.sigma_horizontal_m <= _SURE_M))
            self._count(name, part(poses, self._apart(camera, poses, sure)))

    def of(self, site: Site) -> InView:
        """Return what is known of a sign."""
        return self._seen.get(id_of(site)) or InView(site)

    def has_passed(self, seen: InView) -> bool:
        """Whether a sign that was in view is so no longer."""
        return seen.views > 0 and self._newest_ns - seen.last_ns > _GONE_S * NANOSECONDS

    def forget(self, far: list[SiteId]) -> None:
        """Forget signs."""
        for one in far:
            self._seen.pop(one, None)

    def known(self) -> list[InView]:
        """Return all signs that were in view."""
        return list(self._seen.values())

    def _apart(self, camera: _Camera, poses: Poses, rows: IntArray) -> IntArray:
        """Which frames count: where the car has moved on since the last one, or time has."""
        kept = []
        for row in rows.tolist():
            at_ns = int(poses.epoch_ns[row])
            place = float(poses.latitude_deg[row]), float(poses.longitude_deg[row])
            per_east, per_north = (float(one) for one in metres_per_degree(place[0]))
            north_m = (place[0] - camera.last_deg[0]) * per_north
            east_m = (place[1] - camera.last_deg[1]) * per_east
            # Before the first one nothing is near.
            if not (
                np.hypot(east_m, north_m) < _STEP_M and at_ns - camera.last_ns < _LONGEST_S * NANOSECONDS
            ):
                camera.last_ns, camera.last_deg = at_ns, place
                kept.append(row)
        return np.array(kept, dtype=np.int64)

    def _count(self, camera: str, poses: Poses) -> None:
        if not poses.epoch_ns.size:
            return
        arm_m = float(np.hypot(*self._car.rig.camera(camera).rig_t_camera_m[:2]))
        driven = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=1)
        sites = self._signs.near(driven, _WIDER * (self._config.view_range_m + arm_m))
        if not sites:
            return
        places = Places.of_sites(sites)
        east, north = places.place_m.T
        counts = places.count(
            views_of_places(self._car.rig, poses, east, north, self._config, cameras=[camera])
        )
        begin_ns, end_ns = int(poses.epoch_ns[0]), int(poses.epoch_ns[-1])
        for j in np.flatnonzero(counts.views).tolist():
            seen = self._seen.setdefault(id_of(sites[j]), InView(sites[j], first_ns=begin_ns))
            seen.views += int(counts.views[j])
            seen.fronts += int(counts.fronts[j])
            seen.last_ns = max(seen.last_ns, end_ns)


_WIDER = 1.1
"""A metre of the grid is a metre on the ground to a few per cent."""
