"""Drives due north past poles, and what they say of these."""

from __future__ import annotations

from functools import partial

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.trajectory.trajectory import Poses
from twin.matching.config import MatchConfig
from twin.matching.poles.many_drives import Driven, headings_at
from twin.store.records import Correction, Corrections, Estimate

CONFIG = MatchConfig()
# On the central meridian, where the grid's north is the true one.
EAST_M, NORTH_M = 500_000.0, 7_030_000.0
BUDGET = {"pixels": (0.01, 0.0, 0.01), "ground": (0.01, 0.0, 0.01), "gnss": (0.04, 0.0, 0.04)}


def driven(drive_id: str, *, adjusted: bool = True) -> Driven:
    """A drive due north past all poles, 10 m in a second."""
    epoch_ns = np.arange(10, dtype=np.int64) * 1_000_000_000
    lat, lon = geographic_from_utm33(np.full(10, EAST_M - 5.0), NORTH_M + 10.0 * np.arange(10))
    zero = np.zeros(10)
    names = (*("roll", "pitch", "heading", "speed"), *("sh", "sv", "sr", "sp", "sy"))
    poses = Poses(epoch_ns, lat, lon, *(zero for _ in names), zero, np.ones(10, bool), np.full(10, ""))
    clock = Correction(0.0, 5.0)
    found = Corrections(1.0, clock, clock, {}, 5.0) if adjusted else None
    return Driven(drive_id, lambda: poses, partial(headings_at, poses), found, "car", drive_id)


def estimate(drive_id: str, name: str, north: float, east: float = 0.0) -> Estimate:
    """What a drive says of a pole."""
    return Estimate(
        drive_id=drive_id,
        object=name,
        codes=("202",),
        east_m=EAST_M + east,
        north_m=NORTH_M + north,
        covariance_m2=(0.06, 0.0, 0.06),
        cameras=("C1",),
        n_sightings=5,
        last_ns=int(1e8 * north),
        budget=BUDGET,
    )
