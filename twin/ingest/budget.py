"""The error budget of a drive: what it states, what was asked for, and how well its clocks are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from geoloc.adjustment.result import Adjusted
from geoloc.doubts import Doubt
from geoloc.locate.single_frame import ErrorBudget
from twin.drives.drive import Drive
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.notes import DriveDoubt
from twin.drives.folder.stated_errors import TERMS, can_be, wanted
from twin.drives.frames.clocks import StatedClock
from twin.errors import ConfigError

_WELL_KNOWN_MS = 50.0
_NOTICED = 3.0


class StatesErrors(Protocol):
    """A drive, or a car that will make one."""

    @property
    def clock(self) -> StatedClock | None:
        """Return why its cameras' stamps are not known as well as usual; None where they are."""

    @property
    def errors(self) -> Mapping[str, float]:
        """Return the terms of the error budget that it states."""


def budget_of(drive: StatesErrors, budget: ErrorBudget | None, errors: Mapping[str, float]) -> ErrorBudget:
    """One sigma of each source.

    Parameters
    ----------
    drive : Drive, or another that states its errors
    budget : ErrorBudget or None
        In place of the usual one and of what the drive states.
    errors : mapping of term to one sigma
        Asked for: counts before anything else.

    Raises
    ------
    ConfigError
        For a term that there is not, or a value that it cannot have.
    """
    for term, value in errors.items():
        if term not in TERMS:
            raise ConfigError(f"There is no error {term!r}: state one of {', '.join(TERMS)}.")
        if not can_be(term, value):
            raise ConfigError(f"The error {term} cannot be {value:g}: it must be {wanted(term)}.")
    if budget is not None:
        return replace(budget, **errors)
    usual = ErrorBudget()
    stated_ms = 0.0 if drive.clock is None else drive.clock.sigma_ms
    time_ms = float(np.hypot(usual.time_ms, stated_ms))
    return replace(usual, **{"time_ms": time_ms, **drive.errors, **errors})


def lens_doubts(adjusted: Adjusted | None) -> tuple[Doubt, ...]:
    """Say what the drive shows of focal lengths that nobody calibrated."""
    return tuple(
        Doubt(
            DriveDoubt.RIG,
            f"The focal length of {camera}, which nobody calibrated, was taken as {found.value:+.1f} % off"
            " the stated one, as fits this drive best. It is no calibration: with fixes of metres it takes up"
            " their errors too.",
        )
        for camera, found in (adjusted.focal_percent if adjusted else {}).items()
    )


def clock_doubts(drive: Drive, budget: ErrorBudget, adjusted: Adjusted | None) -> tuple[Doubt, ...]:
    """Say what became of a camera clock that was known to the second or so."""
    if drive.clock is None or budget.time_ms < drive.clock.sigma_ms or adjusted is None:
        return ()
    clock = adjusted.time_offset_ms
    if clock.sigma > _WELL_KNOWN_MS:
        rest = (
            f"this drive shows it to {clock.sigma / 1e3:.2f} s only, and the ellipses are as long along the"
            f" road: state [errors] time_ms in {SETTINGS_FILE} if it is better known"
        )
    elif abs(clock.value) > _NOTICED * clock.sigma:
        # As a prior of the same drive it would count twice: sigmas of 1/sqrt(2), around the same error.
        rest = (
            f"the drive shows that it is off, and {clock.value:+.0f} ± {clock.sigma:.0f} ms were added,"
            " with that sigma in the ellipses: nothing needs to be written. Give camera_offset_ms and"
            f" [errors] time_ms in {SETTINGS_FILE} only from another measurement"
        )
    else:
        return ()
    return (Doubt(DriveDoubt.CLOCK, f"{drive.clock.sentence()}; {rest}."),)
