"""The adjustment without what does not fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from geoloc.arrays import BoolArray
from geoloc.calibration.extrinsics.initial_guess import tag_poses
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.calibration.extrinsics.observations import Sighting, Sigmas, Tag
from geoloc.calibration.extrinsics.solve import adjust_network, covariance_of
from geoloc.calibration.extrinsics.tilted_floor import Floor, lean_of_floor
from geoloc.errors import CalibrationError

OUTLIER_SIGMAS = 6.0
"""A tag whose worst corner is further off, in a picture, is left out: a hand on the tag, a wrong id."""
MISPLACED_SIGMAS = 5.0
"""A measured place that is further from where the pictures put the tag is a slip of the tape."""
_ANY_SIZE = 0.2
"""Sigma of the tags' scale that lets the pictures say it."""
_SWAPPED_PART = 0.25
"""Of their distance: so near to each other's places are two tags whose ids were exchanged."""
_LEAST_SPARE = 0.02
"""Part of a measurement's variance that the rest must be able to check."""


@dataclass(frozen=True, slots=True)
class NetworkFit:
    """The adjustment without what does not fit.

    Attributes
    ----------
    network : Network
    state : NetworkState
    used : bool (n,)
        Of the sightings.
    misplaced, bumps : mapping of tag to metres
        As `Extrinsics` has them.
    swapped : tuple of pairs of tags
        Each was found where the other one was measured.
    floor : Floor or None
    """

    network: Network
    state: NetworkState
    used: BoolArray
    misplaced: Mapping[int, float]
    bumps: Mapping[int, float]
    swapped: tuple[tuple[int, int], ...]
    floor: Floor | None


def fit_without_outliers(
    sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas, state: NetworkState
) -> NetworkFit:
    """Leave out, one after the other, the measurement that fits worst.

    Where a tag's corners do not fit, what was measured of its place is suspected first; the picture only if
    they do not fit without it either, and then the place is trusted again. Two tags whose places were
    exchanged pull others with them: they are left out from the start once they are known.

    Parameters
    ----------
    sightings : sequence of Sighting
    tags : mapping of id to Tag
    sigmas : Sigmas
    state : NetworkState
        To start from.

    Raises
    ------
    CalibrationError
        If nothing is left.
    """
    found = _without_misfits(sightings, tags, sigmas, state)
    swapped = _swapped(sightings, tags, found)
    if not swapped:
        return found
    both = {tag for pair in swapped for tag in pair}
    rest = {number: _unmeasured(tag) if number in both else tag for number, tag in tags.items()}
    found = _without_misfits(sightings, rest, sigmas, state)
    misplaced, _ = _contradictions(tags, both, found.state)
    return replace(found, misplaced={**misplaced, **found.misplaced}, swapped=swapped)


def _without_misfits(
    sightings: Sequence[Sighting],
    tags: Mapping[int, Tag],
    sigmas: Sigmas,
    state: NetworkState,
) -> NetworkFit:
    used = np.ones(len(sightings), dtype=np.bool_)
    suspected: set[int] = set()
    network, state = adjust_network(sightings, tags, replace(sigmas, size=_ANY_SIZE), state, robust=True)
    scale_sigma = float(np.sqrt(covariance_of(network, state)[-1, -1]))
    if abs(state.scale) > max(MISPLACED_SIGMAS * scale_sigma, 3.0 * sigmas.size):
        # Printed in another size than the layout says: the size is what the pictures tell.
        sigmas = replace(sigmas, size=_ANY_SIZE)
    network, state = adjust_network(sightings, tags, sigmas, state, robust=True)
    floor = lean_of_floor(network, state)
    if floor is not None and floor.leans:
        tags = {number: replace(tag, on_floor=False) for number, tag in tags.items()}
    while True:
        kept = [s for s, good in zip(sightings, used, strict=True) if good]
        if not kept:
            raise CalibrationError(
                "No tag fits the others: check the tags' size and ids, and that nothing was moved."
            )
        now = {tag: _unmeasured(t) if tag in suspected else t for tag, t in tags.items()}
        state = _within(state, kept)
        network, state = adjust_network(kept, now, sigmas, state, robust=True)
        worst, strain = _worst_sighting(network, state)
        if strain > OUTLIER_SIGMAS:
            tag = kept[worst].tag
            if tag not in suspected and _is_measured(tags[tag]):
                suspected.add(tag)
            else:
                suspected.discard(tag)
                used[np.flatnonzero(used)[worst]] = False
            continue
        worst_tag, strain = _worst_place(network, state)
        if strain <= MISPLACED_SIGMAS:
            break
        suspected.add(worst_tag)
    network, state = adjust_network(kept, now, sigmas, state, robust=False)
    misplaced, bumps = _contradictions(tags, suspected, state)
    return NetworkFit(network, state, used, misplaced, bumps, (), floor)


def _swapped(
    sightings: Sequence[Sighting], tags: Mapping[int, Tag], found: NetworkFit
) -> tuple[tuple[int, int], ...]:
    """Pairs of tags that do not fit, of which pictures show each near the other one's measured place."""
    out = {s.tag for s, used in zip(sightings, found.used, strict=True) if not used} | found.misplaced.keys()
    here = {}
    for tag in sorted(t for t in out if np.isfinite(tags[t].centre_m).all()):
        mine = [s for s in sightings if s.tag == tag and s.view in found.state.views]
        seen = [found.state.views[s.view].after(pose).t_m for s in mine for pose in tag_poses(s)]
        if seen:
            here[tag] = np.median(seen, axis=0)
    pairs = []
    for first, second in combinations(here, 2):
        stated = np.stack([tags[first].centre_m, tags[second].centre_m])
        apart_m = float(np.linalg.norm(stated[0] - stated[1]))
        off_m = np.linalg.norm(np.stack([here[second], here[first]]) - stated, axis=1)
        if off_m.max() < _SWAPPED_PART * apart_m:
            pairs.append((first, second))
    return tuple(pairs)


def _contradictions(
    tags: Mapping[int, Tag], suspected: set[int], state: NetworkState
) -> tuple[dict[int, float], dict[int, float]]:
    """How far suspected tags are from where they were measured, and above the floor."""
    seen = sorted(suspected & state.tags.keys())
    misplaced = {}
    for t in seen:
        here = tags[t].points_m() @ state.tags[t].R.T + state.tags[t].t_m
        if np.isfinite(tags[t].places_m()).any():
            off = np.nan_to_num(here - tags[t].places_m())
            misplaced[t] = float(np.linalg.norm(off, axis=1).max())
    return misplaced, {t: float(state.tags[t].t_m[2]) for t in seen if tags[t].on_floor}


def _is_measured(tag: Tag) -> bool:
    return bool(np.isfinite(tag.places_m()).any() or tag.on_floor)


def _unmeasured(tag: Tag) -> Tag:
    nowhere = np.full_like(tag.mark_places_m, np.nan)
    return replace(tag, centre_m=np.full(3, np.nan), mark_places_m=nowhere, on_floor=False)


def _worst_sighting(network: Network, state: NetworkState) -> tuple[int, float]:
    """The sighting with the worst corner, and how many sigmas that is off."""
    sigma_px = np.array([network.corner_px[s.camera] for s in network.sightings])
    off = np.abs(network.corner_residuals_px(state)).max(axis=(1, 2)) / sigma_px
    return int(off.argmax()), float(off.max())


def _worst_place(network: Network, state: NetworkState) -> tuple[int, float]:
    """The tag whose measured place, or place on the floor, contradicts the rest most, and by how many sigmas.

    Baarda's test: what is left between a measurement and the adjusted value, over the sigma that it should
    have. A measurement that nothing checks has nothing left, and is never suspected.
    """
    covariance = covariance_of(network, state)
    worst, most = -1, 0.0
    for tag in network.tag_ids:
        measured, at = network.tags[tag], network.tag_columns(tag)
        rest, by_pose, _ = network.measured(measured, state)
        prior = np.full_like(rest, measured.centre_sigma_m**2)
        if measured.on_floor:
            rest[0, 2], prior[0, 2] = state.tags[tag].t_m[2], network.sigmas.floor_m**2 / 4.0
        known = np.einsum("kij,jl,kil->ki", by_pose, covariance[at, at], by_pose)
        spare = prior - known
        tested = np.isfinite(rest) & (spare > _LEAST_SPARE * prior)
        strain = float((np.abs(rest[tested]) / np.sqrt(spare[tested])).max(initial=0.0))
        if strain > most:
            worst, most = tag, strain
    return worst, most


def _within(state: NetworkState, kept: Sequence[Sighting]) -> NetworkState:
    views, tags = {s.view for s in kept}, {s.tag for s in kept}
    return replace(
        state,
        views={name: pose for name, pose in state.views.items() if name in views},
        tags={tag: pose for tag, pose in state.tags.items() if tag in tags},
    )
