"""What the drives could see: evidence that a sign is gone, as a probability that grows over drives."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, metres_per_degree
from geoloc.locate.visibility import views
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import Poses
from twin.matching.config import MatchConfig
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site

_NS_PER_YEAR = 365.25 * 86_400e9


@dataclass(frozen=True, slots=True)
class PlaceViews:
    """Camera images that had places in view, in which the camera stood in a given direction from them.

    Attributes
    ----------
    place : int64 (k,)
        Index of the place, one row an image.
    azimuth_deg : float64 (k,)
        From the place to the camera, from true north.
    """

    place: IntArray
    azimuth_deg: FloatArray


def views_of_places(
    rig: Rig,
    poses: Poses,
    east: FloatArray,
    north: FloatArray,
    config: MatchConfig,
    *,
    cameras: Sequence[str],
) -> PlaceViews:
    """Find the camera images that had each place (EPSG:25833) in view, and where the car stood from it."""
    place, azimuth = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    if len(east):
        lat, lon = geographic_from_utm33(east, north)
        for seen in views(rig, poses, lat, lon, max_range_m=config.view_range_m, cameras=list(cameras)):
            per_east, per_north = metres_per_degree(lat[seen.site])
            de = (poses.longitude_deg[seen.pose] - lon[seen.site]) * per_east
            dn = (poses.latitude_deg[seen.pose] - lat[seen.site]) * per_north
            place.append(seen.site)
            azimuth.append(np.rad2deg(np.arctan2(de, dn)) % 360.0)
    return PlaceViews(np.concatenate(place), np.concatenate(azimuth))


@dataclass(frozen=True, slots=True)
class Passage:
    """One drive past the sites.

    Attributes
    ----------
    drive_id : str
    started_ns : int
        Epoch, UTC.
    is_evidence : bool
        Whether a sign that it passed and did not see is gone: the drive was declared completely annotated,
        nothing that it annotated was lost on the way, and it fits itself.
    views : PlaceViews
        Of the sites, or of the poles.
    """

    drive_id: str
    started_ns: int
    is_evidence: bool
    views: PlaceViews


@dataclass(frozen=True, slots=True)
class Absence:
    """What the drives say of each site by not having seen it.

    Attributes
    ----------
    p_unannotated : float64 (n_sites,)
        Probability that a pole that stands at the site goes unannotated in every drive.
    complete : int64 (n_sites,)
        Images of drives that are evidence in which the site's front was in view.
    passed : bool (n_sites,)
        Whether a drive that is evidence had the place in view at all, from whichever side.
    watched_by : list of lists of str
        Per site, the drives that are evidence and had its front in view.
    """

    p_unannotated: FloatArray
    complete: IntArray
    passed: NDArray[np.bool_]
    watched_by: list[list[str]]


def evidence_of_absence(passages: Sequence[Passage], sites: Sequence[Site], config: MatchConfig) -> Absence:
    """Accumulate over drives what not having seen a sign says.

    A complete drive with a site in view in `MatchConfig.min_views` images overlooks it with `p_missed`, one
    with fewer with `p_unseen`; drives that are no evidence count together as one of those. Over drives the
    chances multiply, but `p_hidden` remains: what a hedge hides, it hides from every drive. A site whose
    plates all look away from a camera was not in view of it.
    """
    n = len(sites)
    overlooked, other = np.ones(n), np.zeros(n, dtype=np.bool_)
    found = Absence(np.ones(n), np.zeros(n, np.int64), np.zeros(n, np.bool_), [[] for _ in range(n)])
    starts = np.array([site.start_date for site in sites], dtype=np.str_)
    for passage in passages:
        # What NVDB says was put up later than the drive could not be seen.
        stood = starts <= _day(passage.started_ns)
        views = front_views(passage.views, sites)
        count = np.where(stood, np.bincount(views.place, minlength=n), 0)
        if not passage.is_evidence:
            other |= count > 0
            continue
        found.passed[:] |= stood & (np.bincount(passage.views.place, minlength=n) > 0)
        found.complete[:] += count
        overlooked *= np.where(
            count >= config.min_views, config.p_missed, np.where(count > 0, config.p_unseen, 1.0)
        )
        for j in np.flatnonzero(count).tolist():
            found.watched_by[j].append(passage.drive_id)
    overlooked *= np.where(other, config.p_unseen, 1.0)
    hidden = np.where(overlooked < 1.0, config.p_hidden, 0.0)
    found.p_unannotated[:] = hidden + (1 - hidden) * overlooked
    return found


def _day(epoch_ns: int) -> str:
    return dt.datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=dt.UTC).date().isoformat()


def front_views(views: PlaceViews, sites: Sequence[Site]) -> PlaceViews:
    """Leave out the views of sites whose every plate is known to look away from the camera."""
    faces = np.full((len(sites), _MOST_FACES), np.nan)
    for j, site in enumerate(sites):
        known = sorted({face for plate in site.plates for face in plate.faces_deg if not math.isnan(face)})
        if known and all(not math.isnan(plate.faces_deg[0]) for plate in site.plates):
            # More directions than columns cannot all look away.
            faces[j, : len(known)] = known[:_MOST_FACES]
    seen = np.cos(np.deg2rad(views.azimuth_deg[:, np.newaxis] - faces[views.place])) > 0
    keep = seen.any(axis=1) | np.isnan(faces[views.place, 0])
    return PlaceViews(views.place[keep], views.azimuth_deg[keep])


_MOST_FACES = 6


def still_seen(
    poles: Sequence[ObservedPole], passages: Sequence[Passage], config: MatchConfig
) -> list[ObservedPole]:
    """Leave out poles that have been taken down since: later, complete drives passed and did not see them.

    Where that is not sure enough, the pole keeps the probability.

    Parameters
    ----------
    passages : in time order; their views are of the poles
    """
    order = {passage.drive_id: number for number, passage in enumerate(passages)}
    last_seen = np.array([max(order[d] for d in pole.drive_ids) for pole in poles], dtype=np.int64)
    passed: dict[int, list[int]] = {}
    for number, passage in enumerate(passages):
        if not passage.is_evidence:
            continue
        later = last_seen[passage.views.place] < number
        place = passage.views.place[later]
        alike = _from_where_it_was_seen(poles, place, passage.views.azimuth_deg[later])
        count = np.bincount(place[alike], minlength=len(poles))
        for k in np.flatnonzero(count >= config.min_views).tolist():
            passed.setdefault(k, []).append(passage.started_ns)
    current = []
    for k, pole in enumerate(poles):
        p_taken_down = _p_taken_down(pole, passed[k], config) if k in passed else 0.0
        if p_taken_down < config.review_below:
            current.append(replace(pole, p_taken_down=p_taken_down) if p_taken_down else pole)
    return current


def _from_where_it_was_seen(
    poles: Sequence[ObservedPole], place: IntArray, azimuth_deg: FloatArray
) -> NDArray[np.bool_]:
    """Views from within 60° of a direction in which the pole was seen; all where that is not known."""
    alike = np.ones(place.size, dtype=np.bool_)
    for k, (pole, azimuth) in enumerate(zip(place.tolist(), azimuth_deg.tolist(), strict=True)):
        known = poles[pole].seen_from_deg
        alike[k] = not known or any(math.cos(math.radians(azimuth - one)) >= 0.5 for one in known)
    return alike


def _p_taken_down(pole: ObservedPole, passed_ns: Sequence[int], config: MatchConfig) -> float:
    """Probability that a pole is gone that complete drives passed at these epochs without seeing it."""
    years = max(0.0, (max(passed_ns) - pole.last_ns) / _NS_PER_YEAR)
    removed = 1.0 - math.exp(-config.removed_per_year * years)
    overlooked = config.p_hidden + (1 - config.p_hidden) * config.p_missed ** len(passed_ns)
    return removed / (removed + (1 - removed) * overlooked)
