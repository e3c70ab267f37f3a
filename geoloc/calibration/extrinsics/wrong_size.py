"""Tags of another size than the layout says, told from those that were moved or measured wrongly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.initial_guess import tag_poses
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.calibration.extrinsics.observations import Sighting, Sigmas, Tag
from geoloc.calibration.extrinsics.outliers import NetworkFit

_SURE = 5.0
_LEAST_PART, _MOST_PART = 0.005, 0.25
_FITS = 2.0
"""Sigmas (RMS) within which all that was seen and measured of a tag must fit with its own size."""
_ROUNDS = 12
_STEP = 1e-7


@dataclass(frozen=True, slots=True)
class OwnSize:
    """How much larger a tag is than the layout says, as a part, with one sigma."""

    part: float
    sigma: float


def own_sizes(
    fitted: NetworkFit, sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas
) -> dict[int, OwnSize]:
    """Find tags that do not fit as stated, and do with a size of their own.

    The cameras stay where the other tags put them. A tag's pose and size are fitted to its corners in all
    pictures, those that were left out too, and to what was measured of it. A flat tag that lies higher than
    the floor looks as a larger one on it does: of those, only `bumps` are told.
    """
    out = {s.tag for s, used in zip(sightings, fitted.used, strict=True) if not used}
    found = {}
    for number in sorted((out | fitted.misplaced.keys()) - fitted.bumps.keys()):
        mine = [s for s in sightings if s.tag == number and s.view in fitted.state.views]
        size = _own_size(fitted, tags[number], mine, sigmas) if mine and not tags[number].is_board else None
        if size is not None:
            found[number] = size
    return found


def _own_size(fitted: NetworkFit, tag: Tag, mine: Sequence[Sighting], sigmas: Sigmas) -> OwnSize | None:
    corner_px = {s.camera: fitted.network.corner_px[s.camera] for s in mine}
    network = Network(mine, {tag.id: tag}, replace(sigmas, size=1.0), corner_px)
    views = {s.view: fitted.state.views[s.view] for s in mine}
    starts = [views[s.view].after(pose) for s in mine for pose in tag_poses(s)]
    ends = [_fit(network, NetworkState(views, {tag.id: start}, fitted.state.scale)) for start in starts]
    if not ends:
        return None
    best = min(ends, key=lambda end: end.strain)
    part = (1.0 + best.scale) / (1.0 + fitted.state.scale) - 1.0
    if best.strain > _FITS or not max(_SURE * best.sigma, _LEAST_PART) < abs(part) < _MOST_PART:
        return None
    return OwnSize(part, best.sigma)


@dataclass(frozen=True, slots=True)
class _End:
    strain: float
    scale: float
    sigma: float


def _fit(network: Network, state: NetworkState) -> _End:
    """Fit one tag's pose and the scale, by Gauss and Newton; the views stay."""
    at = network.tag_columns(network.tag_ids[0])
    columns = np.append(np.arange(at.start, at.stop), network.n_unknowns - 1)
    for _ in range(_ROUNDS):
        equations = network.equations(state)
        design: FloatArray = equations.jacobian[:, columns].toarray()
        step = np.zeros(network.n_unknowns)
        step[columns] = -np.linalg.lstsq(design, equations.residual, rcond=None)[0]
        state = network.moved(state, step)
        if np.abs(step).max() < _STEP:
            break
    residual = network.equations(state).residual
    told = np.abs(design).max(axis=1) > 0.0
    strain = float(np.sqrt(residual[told] @ residual[told] / max(int(told.sum()) - len(columns), 1)))
    return _End(strain, state.scale, float(np.sqrt(np.linalg.pinv(design.T @ design)[-1, -1])))
