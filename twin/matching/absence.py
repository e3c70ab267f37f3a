"""What the drives could see: evidence that a sign is gone, as a probability that grows over drives."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from twin.matching.config import MatchConfig
from twin.matching.in_view import Counts
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site

_NS_PER_YEAR = 365.25 * 86_400e9


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
    counts : Counts
        Of the sites, or of the poles.
    """

    drive_id: str
    started_ns: int
    is_evidence: bool
    counts: Counts


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
        count = np.where(stood, passage.counts.fronts, 0)
        if not passage.is_evidence:
            other |= count > 0
            continue
        found.passed[:] |= stood & (passage.counts.views > 0)
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


def still_seen(
    poles: Sequence[ObservedPole], passages: Sequence[Passage], config: MatchConfig
) -> list[ObservedPole]:
    """Leave out poles that have been taken down since: later, complete drives passed and did not see them.

    Where that is not sure enough, the pole keeps the probability.

    Parameters
    ----------
    passages : in time order; their counts are of the poles, those seen by a later drive may be left out
    """
    last_seen = last_seen_by(poles, [passage.drive_id for passage in passages])
    passed: dict[int, list[int]] = {}
    for number, passage in enumerate(passages):
        if passage.is_evidence:
            since = (last_seen < number) & (passage.counts.fronts >= config.min_views)
            for k in np.flatnonzero(since).tolist():
                passed.setdefault(k, []).append(passage.started_ns)
    current = []
    for k, pole in enumerate(poles):
        p_taken_down = _p_taken_down(pole, passed[k], config) if k in passed else 0.0
        if p_taken_down < config.review_below:
            current.append(replace(pole, p_taken_down=p_taken_down) if p_taken_down else pole)
    return current


def last_seen_by(poles: Sequence[ObservedPole], drive_ids: Sequence[str]) -> IntArray:
    """Number of the last drive that saw each pole (n_poles,), of drives in time order."""
    order = {drive_id: number for number, drive_id in enumerate(drive_ids)}
    return np.array([max(order[d] for d in pole.drive_ids) for pole in poles], dtype=np.int64)


def _p_taken_down(pole: ObservedPole, passed_ns: Sequence[int], config: MatchConfig) -> float:
    """Probability that a pole is gone that complete drives passed at these epochs without seeing it."""
    years = max(0.0, (max(passed_ns) - pole.last_ns) / _NS_PER_YEAR)
    removed = 1.0 - math.exp(-config.removed_per_year * years)
    overlooked = config.p_hidden + (1 - config.p_hidden) * config.p_missed ** len(passed_ns)
    return removed / (removed + (1 - removed) * overlooked)
