"""What a match finds: of everything, or of what lies about the drives touched since the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from twin.matching.asked import Asked, sites_of
from twin.matching.cells import NOWHERE, are_among, cells_of
from twin.matching.compare import compare, places_of
from twin.matching.drives import (
    Drive,
    beside_nvdb,
    cells_passed,
    drives_of,
    forget,
    known_drives,
    warnings_of,
)
from twin.matching.in_view import COARSE_DEG
from twin.matching.kept import Kept, NotSure
from twin.matching.left import KnownDrive, State, put_results
from twin.matching.poles.kept_places import KeptPlaces
from twin.matching.poles.keys import Mark, with_known_keys
from twin.matching.poles.many_drives import with_fused_places
from twin.matching.poles.map_aided import map_aided
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.poles.same_pole import each_pole_once, may_be_one
from twin.matching.poles.seen_in import (
    clicks_of,
    ever_used,
    holders_of,
    keys_held,
    known_marks,
    known_marks_about,
    marks_of,
    pictures_of,
    seen_from,
)
from twin.matching.reading import estimates_of
from twin.matching.scope import NEAR_M, Scope, scope_about
from twin.matching.signs import cells_of_signs, drives_judged_anew, sites_that_judge
from twin.matching.sites import Site, mirror_near
from twin.store.records import Estimate, Finding
from twin.store.touched import FACT as TOUCHED
from twin.store.touched import Touched, touched_since


@dataclass(frozen=True, slots=True)
class Found:
    """What a match found, and what it leaves to the next one.

    Attributes
    ----------
    revision : int
        Of the store, that it is of.
    findings : list of Finding
    gone : list of str or None
        Ids of findings of the last match that these replace; None for all.
    keys : mapping of member to the key of its pole
    members_gone : frozenset of str
        Of which nothing is left.
    marks : mapping of member to Mark
    drives : list of Drive
        All that were looked at.
    known : mapping of drive id to KnownDrive
        Of these.
    state : State
    kept : Kept
    map_aided : str
    has_network : bool
    """

    revision: int
    findings: list[Finding]
    gone: list[str] | None
    keys: dict[str, str]
    members_gone: frozenset[str]
    marks: dict[str, Mark]
    drives: list[Drive]
    known: dict[str, KnownDrive]
    state: State
    kept: Kept
    map_aided: str
    has_network: bool


def everything(asked: Asked, kept: Kept) -> Found:
    """Work out the findings of the whole store."""
    view, method, config = asked.view, asked.method, asked.config
    asked.say("grouping estimates into poles")
    drives = drives_of(view, method, config, kept)
    estimates = estimates_of(view, method)
    once, gathered, directions = gathered_poles(asked, estimates, drives, {})
    placed = with_fused_places(gathered, once, [drive.driven for drive in drives], kept=kept).poles
    clicks = clicks_of(view, method)
    marks = marks_of(estimates, clicks)
    poles = with_known_keys(placed, marks, known_marks(view))
    sites = sites_of(asked, mirror_near(view, where_drives_were(drives, poles), config), kept, anew=True)
    drives = beside_nvdb(drives, sites, once, kept)
    tied = ""
    if config.map_aided:
        asked.say("tying drives to measured signs")
        poles, tied = map_aided(poles, sites, once, [drive.driven for drive in drives], config, kept)
    codes = asked.codes()
    compared = compare(asked, poles, sites, drives, codes)
    results = compared.results(cells_passed(drives), None)
    put_results(kept, results, None)
    known = known_drives(drives, estimates, clicks, directions, kept)
    for drive_id, one in known.items():
        one.put(kept, drive_id)
    squares = {drive_id: one.squares for drive_id, one in known.items()}
    state = State(asked.rests_on(), view.revision(), results.totals, codes, squares, warnings_of(drives))
    state.put(kept)
    return Found(
        revision=state.revision,
        findings=compared.findings,
        gone=None,
        keys={member: pole.key for pole in poles for member in pole.members},
        members_gone=frozenset(),
        marks=marks,
        drives=drives,
        known=known,
        state=state,
        kept=kept,
        map_aided=tied,
        has_network=asked.has_network,
    )


def since_last(asked: Asked, kept: Kept) -> tuple[State, Touched] | None:
    """What the last match left, and what was touched since; None where everything has to be matched."""
    view = asked.view
    state = None if asked.config.map_aided else State.of(kept)
    if state is None or state.rests_on != asked.rests_on():
        return None
    told = touched_since(view.fact(TOUCHED), state.revision, view.revision())
    if told is None or (told.places and asked.codes() != state.codes):
        return None
    return state, told


def touched_part(asked: Asked, kept: Kept) -> Found | None:
    """Work out what drives and signs that were touched since the last match can have changed.

    Returns
    -------
    Found or None
        None where everything has to be matched: nothing was, or by other settings, or somebody changed the
        store and did not say what, or a code has become more or less common among NVDB's signs.

    Raises
    ------
    NotSure
    """
    view, method, config = asked.view, asked.method, asked.config
    since = since_last(asked, kept)
    if since is None:
        return None
    state, told = since
    asked.say("reading what was touched since the last match")
    signs = np.unique(cells_of(np.array(sorted(told.places), dtype=np.float64).reshape(-1, 2)))
    touched = told.drives | (drives_judged_anew(asked, kept, state, signs) if signs.size else set())
    before = {one: known for one in sorted(touched) if (known := KnownDrive.of(kept, one)) is not None}
    came = drives_of(view, method, config, kept, touched)
    own = estimates_of(view, method, touched)
    passed = [drive.watcher.cells for drive in came] + [known.touched for known in before.values()]
    if signs.size:
        passed.append(cells_of_signs(asked, kept, state, signs))
    places = KeptPlaces(kept, "fused")
    scope = scope_about(
        touched,
        np.concatenate([np.zeros((0, 2)), *(known.place_m for known in before.values())]),
        places_of(own),
        np.concatenate([NOWHERE, *passed]),
        places,
    )
    part = _part(asked, kept, state, scope, came, own, before)
    for drive_id in touched - {drive.drive_id for drive in came}:
        forget(kept, drive_id)
        state.squares.pop(drive_id, None)
        state.warnings.pop(drive_id, None)
    part.state.put(kept)
    return part


def _part(
    asked: Asked,
    kept: Kept,
    state: State,
    scope: Scope,
    came: Sequence[Drive],
    own: Sequence[Estimate],
    before: Mapping[str, KnownDrive],
) -> Found:
    view, method, config = asked.view, asked.method, asked.config
    others = state.near(scope.read) - scope.drives
    known = {one: drive for one in others if (drive := KnownDrive.of(kept, one)) is not None}
    drives = sorted(
        [*came, *drives_of(view, method, config, kept, others, known)],
        key=lambda drive: (drive.started_ns, drive.drive_id),
    )
    estimates = estimates_of(view, method, {drive.drive_id for drive in drives}, scope.read)
    asked.say("grouping estimates into poles")
    once, gathered, directions = gathered_poles(asked, estimates, drives, known)
    held = keys_held(view, [member for pole in gathered for member in pole.members])
    _check_grouping(gathered, held, scope)
    clicks = clicks_of(view, method, scope.drives)
    marks = marks_of(estimates, clicks | {drive_id: drive.clicks for drive_id, drive in known.items()})
    placed = with_fused_places(
        gathered, once, [drive.driven for drive in drives], kept=kept, only=scope.squares
    ).poles
    where = cells_of(places_of(placed))
    wanted, rivals = are_among(where, scope.results), are_among(where, scope.about)
    mine = [pole for pole, counts in zip(placed, wanted, strict=True) if counts]
    beside = [
        replace(pole, key=held[pole.members[0]])
        for pole, counts, own_ in zip(placed, rivals, wanted, strict=True)
        if counts and not own_
    ]
    named = named_in_part(asked, scope, mine, marks, held, [drive.drive_id for drive in drives])
    poles = sorted([*named, *beside], key=lambda pole: pole.key)
    sites, drives = _sites_about(asked, scope, kept, drives, once)
    compared = compare(asked, poles, sites, drives, state.codes, scope)
    results = compared.results(cells_passed(drives), scope.results)
    gone, counted = put_results(kept, results, scope.results)
    fresh = known_drives(came, own, clicks, directions, kept)
    for drive_id, one in fresh.items():
        one.put(kept, drive_id)
        state.squares[drive_id] = one.squares
    for looked in drives:
        state.warnings.pop(looked.drive_id, None)
    state.warnings.update(warnings_of(drives))
    state = replace(state, revision=view.revision(), totals=state.totals - counted + results.totals)
    there = are_among(cells_of(places_of(compared.findings)), scope.results)
    keys = {member: pole.key for pole in named for member in pole.members}
    old = {f"{drive_id}:{name}" for drive_id, drive in before.items() for name in drive.clicks}
    now = {estimate.member for estimate in own}
    return Found(
        revision=state.revision,
        findings=[one for one, counts in zip(compared.findings, there, strict=True) if counts],
        gone=gone,
        keys=keys,
        members_gone=frozenset(old - now),
        marks=_otherwise(marks, keys, held, scope.drives),
        drives=drives,
        known=known | fresh,
        state=state,
        kept=kept,
        map_aided="",
        has_network=asked.has_network,
    )


def _otherwise(
    marks: Mapping[str, Mark], keys: Mapping[str, str], held: Mapping[str, str], drives: frozenset[str]
) -> dict[str, Mark]:
    """Marks that may not be known as they are now: of touched drives, and of poles with other keys."""
    return {
        member: mark
        for member, mark in marks.items()
        if member in keys and (mark.drive_id in drives or held.get(member) != keys[member])
    }


def gathered_poles(
    asked: Asked, estimates: Sequence[Estimate], drives: Sequence[Drive], known: Mapping[str, KnownDrive]
) -> tuple[list[Estimate], list[ObservedPole], dict[str, frozenset[float]]]:
    """Estimates of which each pole has one a drive and camera, the poles, from where members were seen."""
    config, ids = asked.config, [drive.drive_id for drive in drives]
    directions: dict[str, frozenset[float]] = {}
    if asked.has_network:
        fresh = [one for one in ids if one not in known]
        mine = [one for one in estimates if one.drive_id not in known]
        directions = seen_from(asked.view, mine, asked.method, fresh)
        for drive_id, drive in known.items():
            directions |= drive.seen_from(drive_id)
    pairs = may_be_one(estimates, config)
    once = each_pole_once(estimates, pairs, pictures_of(asked.view, pairs, asked.method))
    return once, observed_poles(once, ids, config, directions), directions


def _check_grouping(poles: Sequence[ObservedPole], held: Mapping[str, str], scope: Scope) -> None:
    """Make sure that estimates far from those that were touched are grouped as they were."""
    from scipy.spatial import cKDTree

    place_m = places_of(poles)
    rest = [
        [held.get(member) for member in pole.members if member.partition(":")[0] not in scope.drives]
        for pole in poles
    ]
    size: dict[str | None, int] = {}
    for keys in rest:
        for key in keys:
            size[key] = size.get(key, 0) + 1
    as_before = [not keys or (len(set(keys)) == 1 and size[keys[0]] == len(keys)) for keys in rest]
    same = np.array(as_before, dtype=np.bool_)
    others = np.flatnonzero(~same & are_among(cells_of(place_m), scope.about))
    if others.size:
        if not len(scope.changed_m):
            raise NotSure
        far, _ = cKDTree(scope.changed_m).query(place_m[others])
        if np.max(far) > NEAR_M:
            raise NotSure


def named_in_part(
    asked: Asked,
    scope: Scope,
    poles: Sequence[ObservedPole],
    marks: Mapping[str, Mark],
    held: Mapping[str, str],
    drive_ids: Sequence[str],
) -> list[ObservedPole]:
    """Give the poles of a part the keys that they would have among all poles.

    Raises
    ------
    NotSure
        One of them has clicks of a pole that stands elsewhere.
    """
    if not poles:
        return []
    members = {member for pole in poles for member in pole.members}
    clicked = {(marks[m].drive_id, marks[m].clicks) for m in members if m in marks}
    known = known_marks_about(asked.view, clicked, drive_ids, scope.about, places_of(poles))
    beside = {key for member, key in held.items() if member not in members}
    strange = {one.pole for one in known} - set(held.values())
    beside |= {
        key
        for member, key in holders_of(asked.view, strange)
        if member not in members and member.partition(":")[0] not in scope.drives
    }
    if any(one.pole in beside for one in known if (one.mark.drive_id, one.mark.clicks) in clicked):
        raise NotSure
    names = [f"{member}{more}" for member in sorted(members) for more in ("", "+", "++", "+++")]
    return with_known_keys(poles, marks, known, beside, ever_used(asked.view, names))


def _sites_about(
    asked: Asked, scope: Scope, kept: Kept, drives: Sequence[Drive], once: Sequence[Estimate]
) -> tuple[list[Site], list[Drive]]:
    """Sites in a part of the store, and the drives with what the sites say of those that were touched."""
    touched = [drive for drive in drives if drive.drive_id in scope.drives]
    sites = sites_that_judge(asked, kept, touched, once, scope.about)
    seen = beside_nvdb(drives, sites, once, kept, scope.drives)
    inside = are_among(cells_of(places_of(sites)), scope.about)
    return [site for site, counts in zip(sites, inside, strict=True) if counts], seen


def where_drives_were(
    drives: Sequence[Drive], poles: Sequence[ObservedPole] | Sequence[Estimate]
) -> FloatArray:
    """Where something was seen, or driven past: EPSG:25833, to some hundred metres."""
    coarse = np.unique(np.concatenate([drive.watcher.coarse for drive in drives]), axis=0) * COARSE_DEG
    east, north = utm33_from_geographic(*coarse.T)
    return np.concatenate([np.stack([east, north], axis=1), places_of(poles)])
