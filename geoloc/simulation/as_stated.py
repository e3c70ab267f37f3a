"""Worlds whose every error is as large, and lasts as long, as an error budget and the estimator's priors say.

A sigma is right if it holds there. Against other worlds it can be careful, or not careful enough, by what
these draw less or more of; that says nothing of how it was worked out. The numbers here are those of
docs/error-budget.md, copied by hand: a prior that is changed there and not here shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from geoloc.simulation.beside import GroundBeside
from geoloc.simulation.noise import NoiseSpec, stream
from geoloc.simulation.scenarios import Scenario

ROWS, LIKELY_READOUT_MS = 1208, 16.0
UP = 1.7
BETWEEN_ANTENNAS_M = 0.02
LEAN_IN_BENDS = 0.06


@dataclass(frozen=True, slots=True)
class StatedFixes:
    """What fixes are off, one sigma an axis, and the shares of it: new at every fix, for 10 s, and longer."""

    sigma_m: float
    white_share: float
    reflected_share: float
    lasting_share: float
    lasts_s: float
    late_ms: tuple[float, float] = (0.0, 0.0)
    """By how much the receiver is late, and one sigma of that."""


# What two antennas share of a fixed solution is all that is left.
CARRIER_PHASE = StatedFixes(0.015, 0.4, 0.33, float(np.sqrt(1.0 - 0.4**2 - 0.33**2)), 100.0)
# Fixes of 10 s count as one in what is new; what lasts all day is in none of these.
CODE = StatedFixes(2.0, 0.0, 0.4, 0.9, 120.0, late_ms=(120.0, 90.0))


class _Stated(Protocol):
    """The terms of an error budget that are drawn, one sigma each (docs/error-budget.md)."""

    @property
    def pixel_px(self) -> float: ...
    @property
    def pitch_jitter_deg(self) -> float: ...
    @property
    def roll_jitter_deg(self) -> float: ...
    @property
    def ground_height_m(self) -> float: ...
    @property
    def ground_slope_deg(self) -> float: ...
    @property
    def ground_fall(self) -> float: ...
    @property
    def boresight_deg(self) -> float: ...
    @property
    def time_ms(self) -> float: ...
    @property
    def lever_arm_m(self) -> float: ...
    @property
    def camera_position_m(self) -> float: ...
    @property
    def readout_ms(self) -> float: ...


def as_stated(
    world: Scenario,
    antennas: int,
    seed: int,
    stated: _Stated,
    fixes: StatedFixes = CARRIER_PHASE,
    crossfall: float | None = None,
) -> Scenario:
    """Give a world the errors that are stated, and none that are not.

    Parameters
    ----------
    world : Scenario
        Its bends, poles, speeds and cameras stay.
    antennas : int
        How many of them the estimator gets: one is off by `lever_arm_m`, several also against one another.
    seed : int
        Of what is drawn once for a drive and has no place in the specifications.
    stated : ErrorBudget
        Or what has its fields: nothing of the estimator is imported here.
    fixes : StatedFixes
        Fixes that are late look like frames that are early: both, without the mean of the one, are drawn with
        the camera clock. That mean is for whoever stamps the fixes.
    crossfall : float, optional
        What the road's mean crossfall is off, in sigmas. Default: drawn.
    """
    once = stream(seed, "as stated").normal(size=5)
    once[0] = once[0] if crossfall is None else crossfall
    knots = np.array(world.road.curvature)
    speed = max(v for _, v in world.motion.speed)
    lateral = float(np.abs(knots[:, 1]).max()) * speed**2
    road = replace(
        world.road,
        grade_percent=0.0,
        hills=(),
        roughness_m3=0.0,
        climb_deg=2.5,
        is_crowned=False,
        turns_about_m=world.motion.lane_offset_m,
        crossfall_percent=2.0 + 1.5 * once[0],
        crossfall_spread=0.0,
        crossfall_wander_percent=3.0,
        crossfall_lasts_m=300.0,
        superelevation_percent=100.0 * LEAN_IN_BENDS * lateral * once[1],
    )
    motion = replace(world.motion, wheelbase_m=2.0 * (1.4 + 0.2 * once[2]))
    readout_ms = LIKELY_READOUT_MS + stated.readout_ms * once[3]
    ground = GroundBeside(
        height_m=stated.ground_height_m,
        slope=float(np.tan(np.radians(stated.ground_slope_deg))),
        fall=stated.ground_fall,
    )
    noise = replace(
        _noise(stated, antennas, fixes), row_delay_us=1e3 * readout_ms / ROWS, pitching_axis=0.03 * once[4]
    )
    return replace(world, road=road, motion=motion, noise=noise, beside=ground)


def _noise(stated: _Stated, antennas: int, fixes: StatedFixes) -> NoiseSpec:
    white_m, reflected_m, lasting_m = (
        share * fixes.sigma_m for share in (fixes.white_share, fixes.reflected_share, fixes.lasting_share)
    )
    apart = BETWEEN_ANTENNAS_M if antennas > 1 else 0.0
    return replace(
        NoiseSpec(),
        gnss_white_horizontal_m=white_m,
        gnss_white_vertical_m=white_m * UP,
        gnss_multipath_m=reflected_m,
        gnss_multipath_up=UP,
        gnss_multipath_tau_s=10.0,
        gnss_slow_horizontal_m=lasting_m,
        gnss_slow_vertical_m=lasting_m * UP,
        gnss_slow_tau_s=fixes.lasts_s,
        frame_offset_ms=float(np.hypot(stated.time_ms, fixes.late_ms[1])),
        frame_jitter_ms=0.0,
        boresight_deg=stated.boresight_deg,
        camera_position_m=stated.camera_position_m,
        focal_relative=0.0,
        principal_point_px=0.0,
        lever_arm_m=apart,
        rig_origin_m=float(np.sqrt(stated.lever_arm_m**2 - apart**2 / antennas)),
        pitch_jitter_deg=stated.pitch_jitter_deg,
        roll_jitter_deg=stated.roll_jitter_deg,
        idle_jitter_deg=0.0,
        bounce_lasts_s=0.15,
        pitch_unrest_deg=0.15,
        roll_unrest_deg=0.3,
        sideways_mps=0.01,
        sideways_deg=0.1,
        dive_deg_per_mps2=0.0,
        roll_deg_per_mps2=0.0,
        slip_deg_per_mps2=0.25,
        slip_sigma_deg_per_mps2=0.15,
        heave_m=0.0,
        annotation_px=stated.pixel_px,
        blunder_rate=0.0,
    )
