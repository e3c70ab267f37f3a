"""Drives past poles, drawn as `geoloc.fusion` takes their errors to be."""

from __future__ import annotations

import numpy as np

from geoloc.fusion.fuse import Clocks, Passes
from geoloc.trajectory.fix_checks import CODE_LASTS_S

POLES, SPACING_S, SPEED_MPS = 12, 6.0, 15.0
LATE_ALIKE_S, LATE_OWN_S, CLOCK_SIGMA_S = 0.14, 0.05, 0.1


def passes(
    rng: np.random.Generator,
    drives: int,
    *,
    both_ways: bool = True,
    poles: int = POLES,
    lasts_s: float = CODE_LASTS_S,
) -> tuple[Passes, Clocks]:
    """Draw drives past poles that stand at the origin, all as `fuse` takes them to be."""
    parts, clocks = [], []
    prior_s = float(np.hypot(LATE_ALIKE_S, LATE_OWN_S))
    late_of_all = rng.normal() * LATE_ALIKE_S
    common = rng.normal(size=(poles, 2)) * 0.1
    for drive in range(drives):
        back = both_ways and drive % 2 == 1
        epoch_s = np.arange(poles) * SPACING_S
        epoch_s = epoch_s[::-1] if back else epoch_s
        lasts = np.exp(-np.abs(epoch_s[:, None] - epoch_s) / lasts_s)
        track = np.linalg.cholesky(lasts) @ rng.normal(size=(poles, 2)) * 2.0
        late = late_of_all + rng.normal() * LATE_OWN_S
        # Sightings show the clock to a tenth of a second, and the drive draws that towards 0.
        told = late + rng.normal() * CLOCK_SIGMA_S
        sigma_s = (CLOCK_SIGMA_S**-2.0 + prior_s**-2.0) ** -0.5
        found = told * (sigma_s / CLOCK_SIGMA_S) ** 2
        ahead = np.array([-SPEED_MPS if back else SPEED_MPS, 0.0])
        own = rng.normal(size=(poles, 2)) * 0.3
        unit = np.tile(np.eye(2), (poles, 1, 1))
        parts.append(
            Passes(
                np.arange(poles),
                np.full(poles, drive),
                (1e9 * epoch_s).astype(np.int64) + drive * 10**15,
                track + (found - late) * ahead + own + common,
                0.3**2 * unit,
                0.1**2 * unit,
                np.full(poles, 2.0),
                np.tile(ahead, (poles, 1)),
                np.full(poles, lasts_s),
            )
        )
        clocks.append((found, sigma_s, prior_s, prior_s))
    columns = (np.concatenate([getattr(one, name) for one in parts]) for name in Passes.__dataclass_fields__)
    return Passes(*columns), Clocks(np.zeros(drives, dtype=np.int64), *np.array(clocks).T)
