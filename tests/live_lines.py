"""Something that is said of a drive, for tests of where it goes."""

from __future__ import annotations

import numpy as np

from twin.live.check import Standing, Verdict
from twin.live.estimates import Estimate, State

SAID_NS = 1_781_078_448_000_000_000


def estimate(name: str, state: State, label: str = "", at_ns: int = SAID_NS) -> Estimate:
    """An estimate of an object in Trondheim."""
    return Estimate(
        id=name,
        object=name,
        label=label,
        skiltnummer="362.50",
        text="",
        state=state,
        latitude_deg=63.41,
        longitude_deg=10.45,
        height_m=100.0,
        covariance_m2=np.diag([0.04, 0.01]),
        sigma_height_m=0.1,
        sightings=3,
        cameras=("front",),
        first_seen_ns=at_ns - 10**9,
        last_seen_ns=at_ns,
        at_ns=at_ns,
    )


def verdict(name: str, standing: Standing, at_ns: int = SAID_NS) -> Verdict:
    """What is said of a sign of NVDB."""
    return Verdict(
        id=name,
        standing=standing,
        was=None,
        why=None,
        is_final=False,
        confidence=0.97,
        nvdb_type=95,
        nvdb_id=7,
        pole="P1",
        skiltnummer_seen=("362.50",),
        skiltnummer_nvdb=("362.50",),
        east_m=270_000.0,
        north_m=7_040_000.0,
        covariance_m2=np.diag([0.04, 0.01]),
        distance_m=0.4,
        distance_sigma_m=0.2,
        nvdb_m=(270_000.4, 7_040_000.0),
        first_seen_ns=at_ns,
        at_ns=at_ns,
    )
