"""Labels whose errors last: how much less many of them say than as many clicks.

Projected 3D boxes, boxes propagated from picture to picture and a detector's smoothed boxes repeat the error
of the last label in the next. Their residuals are then alike over seconds, which those of clicks are not.
"""

from __future__ import annotations

import numpy as np

from geoloc.adjustment.equations import System
from geoloc.adjustment.scene import Scene
from geoloc.arrays import BoolArray, FloatArray
from geoloc.trajectory.interpolation import NANOSECONDS

_LASTS_S = 2.0
_MOST_LAGS = 30
_PROBES = 8
# Of what independent clicks would show by chance.
_CERTAIN = 4.0


def repeated_share(scene: Scene, system: System, residual: FloatArray, used: BoolArray) -> float:
    """How many labels say as much as one independent one: 1 for clicks.

    The sum of the autocorrelations of the residuals of one object in one camera over two seconds, less what
    independent errors would leave after the same adjustment: it takes some of them up, and makes neighbours
    alike, or opposite.

    Parameters
    ----------
    scene : Scene
    system : System
        The equations at the solution.
    residual : float64 (n, 2)
        Normalised.
    used : bool (n,)
    """
    rows = np.flatnonzero(used)
    order = rows[np.lexsort((scene.epoch_ns[rows], scene.camera[rows], scene.point[rows]))]
    track = scene.point[order] * len(scene.cameras) + scene.camera[order]
    time_s = (scene.epoch_ns[order] - scene.epoch_ns.min()) / NANOSECONDS
    pairs = []
    for lag in range(1, min(_MOST_LAGS, order.size - 1) + 1):
        left = np.flatnonzero((track[lag:] == track[:-lag]) & (time_s[lag:] - time_s[:-lag] <= _LASTS_S))
        if not left.size:
            break
        pairs.append((left, left + lag))
    if not pairs:
        return 1.0
    before, after = (np.concatenate(side) for side in zip(*pairs, strict=True))

    def alike(values: FloatArray) -> float:
        of_tracks = values[order]
        return float(2.0 * np.sum(of_tracks[before] * of_tracks[after]) / np.sum(of_tracks**2))

    weighed = np.repeat(used, 2)
    rng = np.random.default_rng(0)
    by_chance = []
    for _ in range(_PROBES):
        noise = np.where(weighed, rng.normal(size=weighed.size), 0.0)
        left_over = noise - system.jacobian @ system.factor.solve(system.jacobian.T @ noise)
        by_chance.append(alike(left_over.reshape(-1, 2)))
    more = alike(residual) - float(np.mean(by_chance))
    return 1.0 + more if more > _CERTAIN * np.std(by_chance, ddof=1) else 1.0
