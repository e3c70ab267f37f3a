"""Objects of one drive that are one pole: a track that was lost and begun anew, or a pole found twice.

Two objects that were marked in one picture, as the same kind of thing, are two. Else, where they carry the
same plates and the measurement cannot tell their places apart, they are one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from geoloc.arrays import FloatArray
from twin.matching.config import MatchConfig
from twin.store.records import Estimate

Picture = tuple[str, int, str]
"""Camera, frame, and the kind of what was marked: foot or box."""

_CHI2_999_2DOF = 13.816
# (2 cm)²: a pole leans, and annotators do not mark the same side of it twice.
_LEAST_M2 = (4e-4, 0.0, 4e-4)
# Errors that move everything that a drive sees within seconds alike: they cancel between two objects.
_SHARED = frozenset({"lever arm", "boresight", "camera position", "lens", "time", "rolling shutter", "datum"})
_OF_THE_TRACK = "gnss"
_TRACK_KEEPS_ITS_ERROR_NS = 30_000_000_000


def may_be_one(estimates: Sequence[Estimate], config: MatchConfig) -> list[tuple[str, str]]:
    """Pairs of objects of one drive with the same plates, whose places the measurement cannot tell apart.

    Parameters
    ----------
    estimates : sequence of Estimate, of one method
        Without `budget` (covariance by source) all of a position's covariance counts as its own.

    Returns
    -------
    list of (member, member)
        The nearest first.
    """
    from scipy.spatial import cKDTree

    by_drive: dict[str, list[Estimate]] = {}
    for row in estimates:
        by_drive.setdefault(row.drive_id, []).append(row)
    found: list[tuple[float, str, str]] = []
    for rows in by_drive.values():
        place = np.array([(row.east_m, row.north_m) for row in rows])
        reach = max(config.same_pole_m, config.seen_twice_m)
        for i, j in cKDTree(place).query_pairs(reach, output_type="ndarray").tolist():
            if _may_be_one(rows[i], rows[j], place[i] - place[j], config):
                one, other = sorted((rows[i].member, rows[j].member))
                found.append((float(np.hypot(*(place[i] - place[j]))), one, other))
    return [(one, other) for _, one, other in sorted(found)]


def each_pole_once(
    estimates: Sequence[Estimate],
    pairs: Sequence[tuple[str, str]],
    pictures: Mapping[str, frozenset[Picture]],
) -> list[Estimate]:
    """Put the objects of each pair into one estimate, but never two that were marked in one picture.

    Parameters
    ----------
    estimates : sequence of Estimate, of one method
    pairs : from `may_be_one`
        Those that come first are joined first.
    pictures : mapping of member to its pictures
        A member without any is joined with nothing: it is not known what it was seen beside.

    Returns
    -------
    list of Estimate
        Joined objects as one, with their `joined` members: place and covariance of the best, plates of the
        one that shows most of them.
    """
    leader = _leaders(pairs, pictures)
    groups: dict[str, list[Estimate]] = {}
    for row in estimates:
        groups.setdefault(leader.get(row.member, row.member), []).append(row)
    return [_joined(group) if len(group) > 1 else group[0] for group in groups.values()]


def _leaders(pairs: Sequence[tuple[str, str]], pictures: Mapping[str, frozenset[Picture]]) -> dict[str, str]:
    """Member → the first member of its pole, of those that are joined."""
    leader: dict[str, str] = {}
    seen = {member: pictures[member] for pair in pairs for member in pair if pictures.get(member)}
    for pair in pairs:
        one, other = sorted(leader.get(member, member) for member in pair)
        if one == other or one not in seen or other not in seen or seen[one] & seen[other]:
            continue
        seen[one] = seen[one] | seen.pop(other)
        for member in (other, *(m for m, first in leader.items() if first == other)):
            leader[member] = one
        leader[one] = one
    return leader


def _joined(group: Sequence[Estimate]) -> Estimate:
    """One estimate of a pole from several tracks of it: they share errors, so the best place is kept."""
    best = min(group, key=lambda one: (one.covariance_m2[0] + one.covariance_m2[2], one.member))
    fullest = max(group, key=lambda one: (len(one.codes), one.n_sightings))
    return replace(
        best,
        joined=tuple(sorted(one.member for one in group)),
        codes=fullest.codes,
        text=fullest.text,
        cameras=tuple(sorted({camera for one in group for camera in one.cameras})),
        n_sightings=sum(one.n_sightings for one in group),
        first_ns=min(one.first_ns for one in group),
        last_ns=max(one.last_ns for one in group),
    )


def _may_be_one(one: Estimate, other: Estimate, offset_m: FloatArray, config: MatchConfig) -> bool:
    # What different cameras saw is put together one-to-one, as different drives are.
    if set(one.cameras).isdisjoint(other.cameras) or not _same_plates(one, other):
        return False
    near = bool(np.hypot(*offset_m) <= config.same_pole_m)
    return near or _not_told_apart(one, other, offset_m)


def _same_plates(one: Estimate, other: Estimate) -> bool:
    """Whether the plates of one are plates of the other: from afar an annotator reads only the largest."""
    a, b = Counter(one.codes), Counter(other.codes)
    return bool(a and b) and (a <= b or b <= a)


def _not_told_apart(one: Estimate, other: Estimate, offset_m: FloatArray) -> bool:
    """Whether two places are one, as far as errors tell that two objects of a drive do not share."""
    apart_ns = max(one.first_ns, other.first_ns) - min(one.last_ns, other.last_ns)
    shared = _SHARED if apart_ns > _TRACK_KEEPS_ITS_ERROR_NS else _SHARED | {_OF_THE_TRACK}
    covariance = _own_covariance(one, shared) + _own_covariance(other, shared)
    return bool(offset_m @ np.linalg.solve(covariance, offset_m) <= _CHI2_999_2DOF)


def _own_covariance(estimate: Estimate, shared: frozenset[str]) -> FloatArray:
    """Covariance (2, 2) of a position without what is shared; the grid's north is near enough to the true."""
    budget = estimate.budget or {"all": estimate.covariance_m2}
    own = [part for source, part in budget.items() if source not in shared]
    ee, en, nn = np.sum([_LEAST_M2, *own], axis=0).tolist()
    return np.array([[ee, en], [en, nn]])
