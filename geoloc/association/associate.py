"""Sightings → objects where no track ids were given, and a check of ids that were."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.association.across_cameras import join_tracks
from geoloc.association.bearings import AssociationRules, bearings_from_sightings
from geoloc.association.faces_and_strays import faces_on_feet, strays
from geoloc.association.id_contradictions import IdFinding, contradictions
from geoloc.association.inverse_depth import Triangulation
from geoloc.association.merging import refine
from geoloc.association.tracking import numbered, track
from geoloc.locate.observations import Observations
from geoloc.reasons import Reason
from geoloc.trajectory.poses import Poses

__all__ = [
    "AssociatedObject",
    "Association",
    "AssociationRules",
    "IdFinding",
    "associate",
    "associate_drive",
    "check_ids",
    "join_cameras",
    "poses_by_objects",
]


_DEFAULT_RULES = AssociationRules()
# By which share of the poses' own sigma directions are widened in the passes before the last: narrow gates on
# a poor track let sightings go to the neighbour, and what is wrongly put together spoils the correction.
_WIDENED = (2.0 / 3.0, 2.0 / 9.0)


class AssociatedObject(NamedTuple):
    """One object that was found.

    Attributes
    ----------
    number : int
    n_sightings : int
    label : str
        The commonest that is not empty; of equals the first in alphabetical order.
    flags : tuple of str
        ``merged``: tracks that were followed apart were found to be one; ``split``: some of its sightings
        were first followed with another object; ``one sighting``.
    """

    number: int
    n_sightings: int
    label: str
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Association:
    """Which object each sighting belongs to.

    Attributes
    ----------
    object : int64 (n,)
        0, 1, … in order of first sighting; -1 for none.
    objects : tuple of AssociatedObject
        By number.
    reason : str (n,)
        Why a sighting belongs to none, a `geoloc.reasons.Reason`; "" where it belongs to one.
    """

    object: IntArray
    objects: tuple[AssociatedObject, ...]
    reason: TextArray


def associate(
    observations: Observations,
    label: TextArray,
    poses: Poses | None = None,
    rules: AssociationRules = _DEFAULT_RULES,
) -> Association:
    """Find out which sightings, of all cameras, show the same object.

    Every object is a point in inverse-depth form that is followed through the pictures: in each, sightings
    are assigned one-to-one by likelihood, and "a new object" competes. A foot starts with the depth that the
    ground tells, a face with hardly any; parallax does the rest. Then, with the whole drive known, tracks
    that are one object are merged, sightings go to the object that they fit best, and faces join the foot
    that they stand over.

    Parameters
    ----------
    observations : Observations (n,)
        Which object a sighting belongs to is not looked at.
    label : str (n,)
        Label or sign codes ("362.50;808.1"). One object has one label, but an empty one fits any; a face may
        stand over a foot that has its codes among others.
    poses : Poses (n,), optional
        The rig's pose at each sighting. Default: those of the trajectory as it is.
    rules : AssociationRules

    Returns
    -------
    Association
        The same for any order of the sightings.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.

    Notes
    -----
    Inverse depth: Civera, Davison and Montiel (2008), doi:10.1109/TRO.2008.2003276. Assignment with a
    competing "no match": Bar-Shalom, Willett and Tian (2011), *Tracking and Data Fusion*, 2-D assignment.
    """
    names, numbers = np.unique(np.concatenate([[""], label]), return_inverse=True)
    poses = observations.trajectory.poses_at(observations.epoch_ns) if poses is None else poses
    seen, reason = bearings_from_sightings(observations, poses, numbers[1:].astype(np.int64), rules)
    object_index = np.full(label.size, -1, dtype=np.int64)
    if not seen.row.size:
        return Association(object_index, (), reason)
    fitted = Triangulation(seen)
    group, merged, split = refine(seen, track(seen, rules), rules, fitted)
    slips = strays(seen, group, rules, fitted)
    group[slips] = -1
    group = numbered(faces_on_feet(seen, numbered(group), _on_pole(names), rules, fitted))
    object_index[seen.row] = group
    reason[seen.row[slips]] = Reason.SLIP
    return Association(object_index, _objects(group, label[seen.row], merged, split), reason)


def associate_drive(
    observations: Observations, label: TextArray, rules: AssociationRules = _DEFAULT_RULES
) -> Association:
    """Find out which sightings of a drive show the same object, whatever its fixes are worth.

    `associate` takes poses as they are. On a track of ordinary fixes, metres and degrees off and otherwise
    every second, the rays to one pole miss one another, and it is found twice. But all poles of a moment
    share these errors: an adjustment of the objects found first tells them, and on the track so corrected the
    sightings are associated anew, twice. Directions are first widened by what the poses' sigmas say.

    Parameters
    ----------
    observations, label, rules
        As in `associate`.

    Returns
    -------
    Association

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    poses = observations.trajectory.poses_at(observations.epoch_ns)
    if _shaky(poses, rules):
        sigma_deg = float(np.nanmedian(_angle_deg(poses)))
        for share in _WIDENED:
            wide = replace(rules, angle_deg=float(np.hypot(rules.angle_deg, share * sigma_deg)))
            number = associate(observations, label, poses, wide).object
            poses = adjust(replace(observations, object_index=number)).poses
    return associate(observations, label, poses, rules)


def poses_by_objects(observations: Observations, rules: AssociationRules = _DEFAULT_RULES) -> Poses:
    """Give the poses at a drive's sightings, good enough to compare their rays.

    Returns
    -------
    Poses (n,)
        Those of the trajectory where it is known as well as `rules` take for granted, else corrected by an
        adjustment of the objects.
    """
    poses = observations.trajectory.poses_at(observations.epoch_ns)
    return adjust(observations).poses if _shaky(poses, rules) else poses


def _shaky(poses: Poses, rules: AssociationRules) -> bool:
    """Whether some pose is worse than the rules take for granted."""
    return bool(np.any((_angle_deg(poses) > rules.angle_deg) | (poses.sigma_horizontal_m > rules.place_m)))


def _angle_deg(poses: Poses) -> FloatArray:
    """One sigma of the direction ahead."""
    return np.asarray(np.fmax(poses.sigma_heading_deg, poses.sigma_pitch_deg))


def check_ids(
    observations: Observations,
    label: TextArray,
    ids: TextArray,
    poses: Poses | None = None,
    rules: AssociationRules = _DEFAULT_RULES,
    focal_share: float = 0.0,
) -> tuple[IdFinding, ...]:
    """Find ids that hold two signs, and several ids that are one sign.

    The sightings are associated without the ids. Where both disagree, one point is fitted to all sightings
    in question, and a point to each side: only what one point explains clearly worse is two signs, and only
    what one point explains as well is one.

    Parameters
    ----------
    ids : str (n,)
        Object or track id of each sighting; "" for none.
    poses : Poses (n,), optional
        The rig's pose at each sighting. Default: `poses_by_objects`.
    observations, label, rules
        As in `associate`.
    focal_share : float
        One sigma of a focal length that nobody calibrated, as a share of it. Rays that miss one another by
        what that explains are no contradiction; nor does it make one sign of two.

    Returns
    -------
    tuple of IdFinding
        Splits first, each sorted by id. An id that marks several things in one picture (two plates of a pole)
        is taken as meant.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    poses = poses_by_objects(observations, rules) if poses is None else poses
    association = associate(observations, label, poses, rules)
    _, numbers = np.unique(label, return_inverse=True)
    seen, _ = bearings_from_sightings(observations, poses, numbers.astype(np.int64), rules)
    rough = replace(rules, focal_share=max(focal_share, rules.focal_share))
    by_lens, _ = bearings_from_sightings(observations, poses, numbers.astype(np.int64), rough)
    return contradictions(seen, by_lens, association.object[seen.row], ids[seen.row], rules)


def join_cameras(
    observations: Observations,
    label: TextArray,
    ids: TextArray,
    is_track: BoolArray,
    rules: AssociationRules = _DEFAULT_RULES,
) -> TextArray:
    """Find out which tracks of different cameras show one object, whatever the drive's fixes are worth.

    Parameters
    ----------
    observations : Observations (n,)
        With the ids as objects: a poor track is corrected by them.
    ids : str (n,)
        Object or track id of each sighting; "" for none.
    is_track : bool (n,)
        Whether it is that of a track, which each camera numbers by itself.
    label, rules
        As in `associate`.

    Returns
    -------
    str (n,)
        Id of the object of each sighting, as `geoloc.association.across_cameras.join_tracks` names it.

    Raises
    ------
    CalibrationError
        If the rig lacks one of the cameras, or cannot compute with it.
    """
    names, numbers = np.unique(np.concatenate([[""], label]), return_inverse=True)
    poses = poses_by_objects(observations, rules)
    seen, _ = bearings_from_sightings(observations, poses, numbers[1:].astype(np.int64), rules)
    usable = ids[seen.row]
    joined = join_tracks(seen, usable, is_track[seen.row], _on_pole(names), rules)
    # What cannot be used goes with the rest of its track.
    name_of = dict(zip(usable.tolist(), joined.tolist(), strict=True))
    return np.array([name_of.get(name, name) for name in ids.tolist()], dtype=ids.dtype)


def _on_pole(names: TextArray) -> BoolArray:
    """Whether a face of one label (row) may hang on a pole of another (column): its codes are among them.

    Words ("pole", "sign face") are no codes and say nothing about it.
    """
    codes = [{part for part in name.split(";") if part[:1].isdigit()} for name in names.tolist()]
    return np.array([[face <= pole or not pole for pole in codes] for face in codes])


def _objects(
    group: IntArray, label: TextArray, merged: BoolArray, split: BoolArray
) -> tuple[AssociatedObject, ...]:
    """Sum the sightings of each object up."""
    order = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[order], np.arange(int(group.max(initial=-1)) + 2))
    objects = []
    for number, (start, stop) in enumerate(pairwise(bounds)):
        rows = order[start:stop]
        flags = [flag for flag, where in (("merged", merged), ("split", split)) if where[rows].any()]
        flags += ["one sighting"] if rows.size == 1 else []
        objects.append(AssociatedObject(number, rows.size, _commonest(label[rows]), tuple(flags)))
    return tuple(objects)


def _commonest(label: TextArray) -> str:
    named, count = np.unique(label[label != ""], return_counts=True)
    return str(named[np.argmax(count)]) if named.size else ""
