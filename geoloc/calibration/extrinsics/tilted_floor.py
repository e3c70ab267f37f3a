"""Whether the floor is level, as far as tags that do not lie on it can tell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.calibration.extrinsics.solve import covariance_of, solve_network

FLAT_DEG = 0.25
"""A floor that leans more is not used; 0.5° is enough to spoil an extrinsic calibration."""
_FREE_M = 0.5
_SURE = 3.0
_BUMP_SIGMAS = 4.0
_MIN_TAGS = 3
_MIN_SPREAD_M = 0.3


@dataclass(frozen=True, slots=True)
class Floor:
    """The plane through the floor tags against the rig frame of all other measurements."""

    lean_deg: float
    sigma_deg: float

    @property
    def leans(self) -> bool:
        """Whether it leans for certain, and by enough to matter."""
        return self.lean_deg > max(FLAT_DEG, _SURE * self.sigma_deg)


def lean_of_floor(network: Network, state: NetworkState) -> Floor | None:
    """Fit a plane to the floor tags when nothing says that they lie at z = 0.

    Returns
    -------
    Floor or None
        None with fewer than three floor tags, or with all on one line.
    """
    floor = [t for t in network.tag_ids if network.tags[t].on_floor]
    if len(floor) < _MIN_TAGS:
        return None
    free = Network(
        network.sightings, network.tags, replace(network.sigmas, floor_m=_FREE_M), network.corner_px
    )
    state = solve_network(free, state)
    place = np.array([state.tags[t].t_m for t in floor])
    if np.linalg.svd(place[:, :2] - place[:, :2].mean(axis=0), compute_uv=False)[1] < _MIN_SPREAD_M:
        return None
    rows = [free.tag_columns(t).start + 5 for t in floor]
    # How flat the floor is where each tag lies comes on top of how well its height is seen. The car stands on
    # it too: the rig's origin is a point of the floor.
    covariance = np.zeros((len(floor) + 1, len(floor) + 1))
    covariance[1:, 1:] = covariance_of(free, state)[np.ix_(rows, rows)]
    covariance += network.sigmas.floor_m**2 * np.eye(len(floor) + 1)
    return _plane(np.vstack([np.zeros(3), place]), covariance)


def _plane(place: FloatArray, covariance: FloatArray) -> Floor | None:
    """Slope of the plane through most of the points: one that lies off it is a bump, and not a lean."""
    kept = np.arange(len(place))
    while len(kept) >= _MIN_TAGS:
        design = np.column_stack([np.ones(len(kept)), place[kept, :2]])
        fit = np.linalg.pinv(design)
        plane = fit @ place[kept, 2]
        rest = np.eye(len(kept)) - design @ fit
        sigma = np.sqrt(np.diag(rest @ covariance[np.ix_(kept, kept)] @ rest.T))
        # Three points have no rest: their plane goes through them.
        off = (
            np.abs(rest @ place[kept, 2]) / np.maximum(sigma, 1e-9) if len(kept) > _MIN_TAGS else np.zeros(1)
        )
        if off.max() <= _BUMP_SIGMAS:
            slope_covariance = (fit @ covariance[np.ix_(kept, kept)] @ fit.T)[1:, 1:]
            return Floor(
                lean_deg=float(np.rad2deg(np.hypot(*plane[1:]))),
                sigma_deg=float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(slope_covariance)[-1]))),
            )
        kept = np.delete(kept, off.argmax())
    return None
