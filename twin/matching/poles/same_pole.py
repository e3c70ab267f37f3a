"""Objects of one drive that are one pole: a track that was lost and begun anew, or a pole found twice.

Two objects that were marked in one picture, as the same kind of thing, are two. Else, where they carry the
same plates and the measurement cannot tell their places apart, they are one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from geoloc.arrays import FloatArray
from twin.matching.config import MatchConfig
from twin.matching.poles.poles import split_codes

Row = Mapping[str, Any]
Picture = tuple[str, int, str]
"""Camera, frame, and the kind of what was marked: foot or box."""

_CHI2_999_2DOF = 13.816
# (2 cm)²: a pole leans, and annotators do not mark the same side of it twice.
_LEAST_M2 = (4e-4, 0.0, 4e-4)
# Errors that move everything that a drive sees within seconds alike: they cancel between two objects.
_SHARED = frozenset({"lever arm", "boresight", "camera position", "time", "rolling shutter"})
_OF_THE_TRACK = "gnss"
_TRACK_KEEPS_ITS_ERROR_NS = 30_000_000_000


def member_of(row: Row) -> str:
    """``drive:object`` of a row of the estimate table."""
    return f"{row['drive_id']}:{row['object']}"


def may_be_one(estimates: Sequence[Row], config: MatchConfig) -> list[tuple[str, str]]:
    """Pairs of objects of one drive with the same plates, whose places the measurement cannot tell apart.

    Parameters
    ----------
    estimates : rows of the ``estimate`` table, of one method
        Without ``budget`` (covariance by source) all of a position's covariance counts as its own.

    Returns
    -------
    list of (member, member)
        The nearest first.
    """
    from scipy.spatial import cKDTree

    by_drive: dict[str, list[Row]] = {}
    for row in estimates:
        by_drive.setdefault(row["drive_id"], []).append(row)
    found: list[tuple[float, str, str]] = []
    for rows in by_drive.values():
        place = np.array([(row["east_m"], row["north_m"]) for row in rows])
        reach = max(config.same_pole_m, config.seen_twice_m)
        for i, j in cKDTree(place).query_pairs(reach, output_type="ndarray").tolist():
            if _may_be_one(rows[i], rows[j], place[i] - place[j], config):
                one, other = sorted((member_of(rows[i]), member_of(rows[j])))
                found.append((float(np.hypot(*(place[i] - place[j]))), one, other))
    return [(one, other) for _, one, other in sorted(found)]


def each_pole_once(
    estimates: Sequence[Row],
    pairs: Sequence[tuple[str, str]],
    pictures: Mapping[str, frozenset[Picture]],
) -> list[Row]:
    """Put the objects of each pair into one row, but never two that were marked in one picture.

    Parameters
    ----------
    estimates : rows of the ``estimate`` table, of one method
    pairs : from `may_be_one`
        Those that come first are joined first.
    pictures : mapping of member to its pictures
        A member without any is joined with nothing: it is not known what it was seen beside.

    Returns
    -------
    list of rows
        Those of joined objects as one, with their ``members``: place and covariance of the best, plates of
        the one that shows most of them.
    """
    leader = _leaders(pairs, pictures)
    groups: dict[str, list[Row]] = {}
    for row in estimates:
        groups.setdefault(leader.get(member_of(row), member_of(row)), []).append(row)
    return [_one_row(group) if len(group) > 1 else group[0] for group in groups.values()]


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


def _one_row(group: Sequence[Row]) -> Row:
    """One estimate of a pole from several tracks of it: they share errors, so the best place is kept."""
    best = min(group, key=lambda row: (row["cov_ee_m2"] + row["cov_nn_m2"], member_of(row)))
    fullest = max(group, key=lambda row: (row["skiltnummer"].count(";"), row["n_sightings"]))
    return {
        **best,
        "members": sorted(member_of(row) for row in group),
        "skiltnummer": fullest["skiltnummer"],
        "text": fullest.get("text"),
        "cameras": sorted({camera for row in group for camera in row["cameras"]}),
        "n_sightings": sum(row["n_sightings"] for row in group),
        "first_ns": min(row.get("first_ns", 0) for row in group),
        "last_ns": max(row.get("last_ns", 0) for row in group),
    }


def _may_be_one(one: Row, other: Row, offset_m: FloatArray, config: MatchConfig) -> bool:
    # What different cameras saw is put together one-to-one, as different drives are.
    if set(one["cameras"]).isdisjoint(other["cameras"]) or not _same_plates(one, other):
        return False
    near = bool(np.hypot(*offset_m) <= config.same_pole_m)
    return near or _not_told_apart(one, other, offset_m)


def _same_plates(one: Row, other: Row) -> bool:
    """Whether the plates of one are plates of the other: from afar an annotator reads only the largest."""
    a, b = (Counter(split_codes(row["skiltnummer"])) for row in (one, other))
    return bool(a and b) and (a <= b or b <= a)


def _not_told_apart(one: Row, other: Row, offset_m: FloatArray) -> bool:
    """Whether two places are one, as far as errors tell that two objects of a drive do not share."""
    apart_ns = max(one.get("first_ns", 0), other.get("first_ns", 0)) - min(
        one.get("last_ns", 0), other.get("last_ns", 0)
    )
    shared = _SHARED if apart_ns > _TRACK_KEEPS_ITS_ERROR_NS else _SHARED | {_OF_THE_TRACK}
    covariance = _own_covariance(one, shared) + _own_covariance(other, shared)
    return bool(offset_m @ np.linalg.solve(covariance, offset_m) <= _CHI2_999_2DOF)


def _own_covariance(row: Row, shared: frozenset[str]) -> FloatArray:
    """Covariance (2, 2) of a position without what is shared; the grid's north is near enough to the true."""
    budget = row.get("budget") or {"all": [row["cov_ee_m2"], row["cov_en_m2"], row["cov_nn_m2"]]}
    own = [part for source, part in budget.items() if source not in shared]
    ee, en, nn = np.sum([_LEAST_M2, *own], axis=0).tolist()
    return np.array([[ee, en], [en, nn]])
