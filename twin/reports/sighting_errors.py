"""The error of each single sighting against the survey of its object, as the paper counts errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.locate.accuracy import nees
from twin.reports.object_errors import INSIDE_95, Way, known
from twin.reports.pairing import Placed
from twin.reports.truth import Truth


@dataclass(frozen=True, slots=True)
class SightingError:
    """Position that one sighting alone gives, minus the survey.

    Attributes
    ----------
    distance_m : float
        From the rig's origin to the surveyed position when the picture was taken.
    range_m, speed_mps : float or None
        From the camera to where the method puts the object; of the car. None where unknown.
    error_m : float
        Horizontal.
    inside95 : bool or None
        Whether the survey lies inside the 95 % ellipse; None where the sighting has none.
    """

    method: str
    drive_id: str
    object: str
    truth: str
    camera: str
    distance_m: float
    range_m: float | None
    speed_mps: float | None
    error_m: float
    inside95: bool | None


def sighting_errors(
    pairs: Sequence[tuple[Placed, Truth]], ways: Mapping[str, Way]
) -> tuple[SightingError, ...]:
    """Compare single sightings with the survey, one by one.

    Parameters
    ----------
    pairs : sequence of (Placed, Truth)
        Sightings with a position and a camera.
    ways : mapping of drive id → Way
        Of every drive that has sightings.
    """
    if not pairs:
        return ()
    drives = np.array([placed.drive_id for placed, _ in pairs])
    truth_m = np.array([(truth.east_m, truth.north_m) for _, truth in pairs])
    offset = np.array([(placed.east_m, placed.north_m) for placed, _ in pairs]) - truth_m
    covariance = np.array([placed.covariance_m2 for placed, _ in pairs])[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    epoch_ns = np.array([placed.epoch_ns for placed, _ in pairs])
    distance = np.empty(len(pairs))
    for drive in np.unique(drives):
        own = drives == drive
        distance[own] = np.hypot(*(ways[str(drive)].at(epoch_ns[own]) - truth_m[own]).T)
    squares, error = nees(offset, covariance), np.hypot(*offset.T)
    return tuple(
        SightingError(
            *(placed.method, placed.drive_id, placed.object, truth.object, placed.camera),
            *(float(distance[i]), known(placed.range_m), known(placed.speed_mps), float(error[i])),
            bool(squares[i] <= INSIDE_95) if np.isfinite(squares[i]) else None,
        )
        for i, (placed, truth) in enumerate(pairs)
    )
