"""A receiver's fixes as the engine takes them: what a drive's folder states of them is done to each."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

from geoloc.earth.datum import euref89_from_itrf
from geoloc.errors import GeolocError
from geoloc.live.samples import Fix, gnss_fixes
from geoloc.trajectory.heading import heading_against_course
from twin.drives.track import fixes as recorded
from twin.live.car import EUREF89, Car, year_of

_REMEMBERED, _LOOKED_AT_EVERY = 600, 25
_NAN = math.nan


class Antenna:
    """One receiver: sigma where it states none, headings turned to the car's nose, positions in EUREF89.

    Headings whose offset ``drive.toml`` does not state are held against the course of the car, and used once
    it has driven far enough to show that they are those of its nose.

    Parameters
    ----------
    name : str
    car : Car

    Attributes
    ----------
    left_out : int
        Fixes so far that lie where their datum cannot be brought to EUREF89.
    """

    def __init__(self, name: str, car: Car) -> None:
        self.name, self._settings = name, car.settings
        self._driven: deque[Fix] = deque(maxlen=_REMEMBERED)
        self.left_out = self._seen = 0
        self._trusted = car.settings.heading_offset_deg is not None

    def fixes(self, rows: Iterable[recorded.Fix]) -> list[Fix]:
        """Return fixes for the engine."""
        fixes = []
        for row in rows:
            try:
                fixes.append(self._fix(row))
            except GeolocError:
                self.left_out += 1
        return fixes

    def _fix(self, row: recorded.Fix) -> Fix:
        fix = Fix(
            self.name,
            row.epoch_ns,
            *self._place(row),
            row.quality,
            self._sigma_m(row.sigma_horizontal_m),
            row.sigma_vertical_m,
            *self._heading(row),
            row.velocity_mps,
            row.velocity_sigma_mps,
        )
        return fix if self._is_of_the_nose(fix) else fix._replace(heading_deg=_NAN, heading_sigma_deg=_NAN)

    def _place(self, row: recorded.Fix) -> tuple[float, float, float]:
        place = row.latitude_deg, row.longitude_deg, row.height_m
        if self._settings.datum == EUREF89:
            return place
        moved = euref89_from_itrf(self._settings.datum, *place, year_of(row.epoch_ns))
        return float(moved.latitude_deg), float(moved.longitude_deg), float(moved.height_m)

    def _sigma_m(self, said: float) -> float:
        stated = self._settings.gnss_sigma_m
        return stated if stated is not None and math.isnan(said) else said

    def _heading(self, row: recorded.Fix) -> tuple[float, float]:
        if math.isnan(row.heading_deg):
            return _NAN, _NAN
        sigma_deg = self._settings.heading_sigma_deg
        turned = (row.heading_deg + (self._settings.heading_offset_deg or 0.0)) % 360.0
        return turned, row.heading_sigma_deg if sigma_deg is None else sigma_deg

    def _is_of_the_nose(self, fix: Fix) -> bool:
        """Whether its heading may be used."""
        if self._trusted or math.isnan(fix.heading_deg):
            return True
        if self._driven and fix.epoch_ns <= self._driven[-1].epoch_ns:
            self._driven.clear()  # its clock has stepped back
        self._driven.append(fix)
        self._seen += 1
        if self._seen % _LOOKED_AT_EVERY == 0:
            check = heading_against_course(gnss_fixes(self.name, list(self._driven)))
            self._trusted = check.told and not check.contradicts
            if self._trusted:
                self._driven.clear()
        return self._trusted
