"""What makes one doubt that a survey is of the drives that it is compared with, or in the height system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.reports.object_errors import ObjectError

_GEOID_M = (15.0, 50.0)
"""The geoid lies 17 to 48 m above the ellipsoid in Norway: what NN2000 and ellipsoidal heights differ by."""
_ALIKE_M = 1.0


@dataclass(frozen=True, slots=True)
class SurveyDoubt:
    """One reason to look again at the survey before its errors are believed.

    Attributes
    ----------
    kind : str
        ``elsewhere``: half the estimates of a drive, by its best method, lie farther from their surveyed
        positions than --within, and outside their 95 % ellipses. ``height_system``: the heights of a drive
        differ by 15 to 50 m, all alike, as ellipsoidal heights do from NN2000.
    drive_id : str
        The drive.
    metres : float
        Median horizontal distance, or estimate minus survey in height.
    """

    kind: Literal["elsewhere", "height_system"]
    drive_id: str
    metres: float


def survey_doubts(errors: Sequence[ObjectError], within_m: float) -> tuple[SurveyDoubt, ...]:
    """Look for what speaks against a survey, a drive at a time.

    Parameters
    ----------
    errors : sequence of ObjectError
        Of all methods.
    within_m : float
        An estimate farther from its surveyed position may be of another object.
    """
    doubts: list[SurveyDoubt] = []
    for drive_id in sorted({one.drive_id for one in errors}):
        mine = [one for one in errors if one.drive_id == drive_id]
        found = _elsewhere(drive_id, mine, within_m), _height_system(drive_id, mine)
        doubts += [doubt for doubt in found if doubt is not None]
    return tuple(doubts)


def _elsewhere(drive_id: str, errors: Sequence[ObjectError], within_m: float) -> SurveyDoubt | None:
    by_method = [[one for one in errors if one.method == name] for name in {one.method for one in errors}]
    best = min(by_method, key=lambda mine: float(np.median([one.error_m for one in mine])))
    metres = float(np.median([one.error_m for one in best]))
    inside = sum(one.inside95 is not False for one in best)
    if metres <= within_m or 2 * inside >= len(best):
        return None
    return SurveyDoubt("elsewhere", drive_id, metres)


def _height_system(drive_id: str, errors: Sequence[ObjectError]) -> SurveyDoubt | None:
    heights = np.array([one.error_height_m for one in errors if one.error_height_m is not None])
    if not heights.size:
        return None
    metres = float(np.median(heights))
    # Half of them alike are enough: single ones may be off for other reasons.
    alike = float(np.median(np.abs(heights - metres))) < _ALIKE_M
    if not (alike and _GEOID_M[0] < abs(metres) < _GEOID_M[1]):
        return None
    return SurveyDoubt("height_system", drive_id, metres)
