"""What a person should know of an adjustment: a clock, a shutter, a terrain that do not fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoloc.adjustment.model import Model
from geoloc.adjustment.result import (
    AdjustmentDoubt,
    Correction,
)
from geoloc.adjustment.solve import Solution
from geoloc.adjustment.task import Solved
from geoloc.adjustment.unknowns import READOUT, TIME
from geoloc.doubts import Doubt
from geoloc.earth.terrain import Terrain
from geoloc.locate.error_budget import ErrorBudget

# Slower than this no clock moves anything.
_SLOW_MPS = 2.0
# Outside this the rolling shutter takes up something else.
_READOUTS_MS = (-15.0, 50.0)


def unchecked_clock(budget: ErrorBudget, at: Solved) -> Iterator[Doubt]:
    """Say that this drive cannot show whether its stamps are right."""
    speed_mps = float(np.median(np.hypot(*at.seen.scene.body.velocity_mps[:, :2].T)))
    if speed_mps < _SLOW_MPS:
        return
    yield Doubt(
        AdjustmentDoubt.CLOCK_UNCHECKED,
        "The camera clock cannot be checked: with fixes without corrections this drive does not tell the"
        f" time. Clock and receiver are taken as good to {budget.time_ms:.0f} ms together; each 0.1 s beyond"
        f" that moves all positions by {0.1 * speed_mps:.1f} m along the road. State [errors] time_ms if the"
        " stamps are not that good; corrections (RTK) would show it.",
    )


def wrong_clock(at: Solved, unsure_s: float) -> Doubt:
    """Say by how much the stamps must be off, good to `unsure_s` besides what was solved."""
    later, sigma = 1e3 * at.clock_s, 1e3 * float(np.hypot(np.sqrt(at.found.shared[TIME, TIME]), unsure_s))
    return Doubt(
        AdjustmentDoubt.CLOCK,
        f"The camera clock does not fit the track: {later:+.0f} ± {sigma:.0f} ms were added to it. Do not"
        " trust the positions before the cause is found: a start, a time zone, frames that are missing. If"
        " nothing else tells the time, state [errors] time_ms = 1000; copying this number would count the"
        " drive twice.",
    )


def doubted_clock(rays: Correction, budget: ErrorBudget, at: Solved) -> Doubt:
    """Say what the bearings ask of the clock (milliseconds) where that may yet be chance."""
    return Doubt(
        AdjustmentDoubt.CLOCK_DOUBTED,
        f"The camera clock is doubted: the bearings ask for {rays.value:+.0f} ± {rays.sigma:.0f} ms, and it"
        f" was stated to {budget.time_ms:.0f} ms. {1e3 * at.clock_s:+.0f} ms were added to it, and the"
        " ellipses were made longer along the road by what the bearings ask for: check camera_offset_ms and"
        " the frame stamps.",
    )


def doubts_of(model: Model, solution: Solution, terrain: Terrain | None) -> Iterator[Doubt]:
    """What a person should know of a solution."""
    readout_ms = 1e3 * (model.readout_s + float(solution.x[READOUT]))
    if not _READOUTS_MS[0] < readout_ms < _READOUTS_MS[1]:
        yield Doubt(
            AdjustmentDoubt.SHUTTER,
            f"The rolling shutter that fits best would take {readout_ms:.0f} ms, which no camera does: check"
            " camera_offset_ms, the frame stamps and the calibration.",
        )
    if terrain is None:
        return
    feet, used = int(model.scene.is_foot.sum()), 0 if model.terrain is None else model.terrain.point.size
    if used < feet:
        yield Doubt(
            AdjustmentDoubt.TERRAIN_UNUSED,
            f"The terrain was used for {used} of {feet} feet: elsewhere it has no height, or lies more than"
            " 2 m from the car's own, and the plane of the road was used.",
        )
