"""What a drive cost: measured metres and marks, times what they cost the user."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from twin.reports.drive_list import DriveItem


@dataclass(frozen=True, slots=True)
class Rates:
    """The user's own figures; None where one is not given.

    Attributes
    ----------
    per_km : float or None
        Money for a kilometre driven: car, driver, equipment.
    per_hour : float or None
        Money for an hour of annotation.
    seconds_per_mark : float or None
        An annotator's time for a point or box, looking included.
    """

    per_km: float | None = None
    per_hour: float | None = None
    seconds_per_mark: float | None = None


@dataclass(frozen=True, slots=True)
class DriveCost:
    """What one drive cost.

    Attributes
    ----------
    length_km : float
        Driven, measured from the track.
    n_marks : int
        Points and boxes that somebody set, counted in the annotation files.
    hours : float or None
        Marks times the user's seconds a mark.
    driving : float or None
        Kilometres times the user's money a kilometre.
    annotating : float or None
        Hours times the user's money an hour.
    total : float or None
        Of both; null where a figure of the user is not given.
    per_km : float or None
        Total by kilometre driven.
    """

    length_km: float
    n_marks: int
    hours: float | None
    driving: float | None
    annotating: float | None
    total: float | None
    per_km: float | None


def cost_of(items: Sequence[DriveItem], rates: Rates) -> DriveCost:
    """Work out what some drives cost together."""
    length_km = sum(item.length_m for item in items) / 1e3
    n_marks = sum(item.n_annotations for item in items)
    hours = None if rates.seconds_per_mark is None else n_marks * rates.seconds_per_mark / 3600.0
    driving = None if rates.per_km is None else length_km * rates.per_km
    annotating = None if hours is None or rates.per_hour is None else hours * rates.per_hour
    total = None if driving is None or annotating is None else driving + annotating
    per_km = None if total is None or not length_km else total / length_km
    return DriveCost(length_km, n_marks, hours, driving, annotating, total, per_km)
