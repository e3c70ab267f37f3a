"""What the engine says of an object, and how that is written."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, NamedTuple

from geoloc.arrays import FloatArray
from twin.live.features import ellipse_of, grid_m, point, rounded, utc


class State(StrEnum):
    """How far an estimate has come."""

    FIRST = "first"
    """From one frame alone."""
    REFINED = "refined"
    """From all frames so far; the object may be in view."""
    FINAL = "final"
    """The object has left the window: this estimate changes no more."""
    LOST = "lost"
    """It has left the window, and no position was found."""


class Estimate(NamedTuple):
    """Where an object is, by what has been seen of it so far.

    Attributes
    ----------
    id : str
        The object as its source calls it, else a number of the engine's own; ``#2`` and so on follows where
        it is passed again.
    object : str or None
        As its source calls it.
    label, skiltnummer, text : str
        Of its first detection that has one.
    state : State
    latitude_deg, longitude_deg, height_m : float
        `height_m` ellipsoidal; NaN for a state of `LOST`.
    covariance_m2 : float64 (2, 2)
        East and true north.
    sigma_height_m : float
        NaN from one frame.
    sightings : int
    first_seen_ns, last_seen_ns : int
        UTC of exposures.
    at_ns : int
        When it was worked out, by the host's clock.
    cameras : tuple of str
        Those that saw it, in the order of their names.
    """

    id: str
    object: str | None
    label: str
    skiltnummer: str
    text: str
    state: State
    latitude_deg: float
    longitude_deg: float
    height_m: float
    covariance_m2: FloatArray
    sigma_height_m: float
    sightings: int
    first_seen_ns: int
    last_seen_ns: int
    at_ns: int
    cameras: tuple[str, ...] = ()

    @property
    def lasts(self) -> bool:
        """Whether it changes no more."""
        return self.state in (State.FINAL, State.LOST)

    def feature(self) -> dict[str, Any]:
        """Return a GeoJSON feature: WGS84 as geometry, EPSG:25833 among the properties."""
        known = math.isfinite(self.latitude_deg)
        return {
            "type": "Feature",
            "id": self.id,
            "geometry": point(self.longitude_deg, self.latitude_deg) if known else None,
            "properties": {
                "state": self.state.value,
                "object": self.object,
                "label": self.label,
                "skiltnummer": self.skiltnummer,
                "n_sightings": self.sightings,
                "cameras": list(self.cameras),
                "first_seen": utc(self.first_seen_ns),
                "last_seen": utc(self.last_seen_ns),
                "at": utc(self.at_ns),
                **(self._place() if known else {}),
            },
        }

    def _place(self) -> dict[str, float | None]:
        easting, northing = grid_m(self.latitude_deg, self.longitude_deg)
        return {
            "easting": rounded(easting),
            "northing": rounded(northing),
            "height_m": rounded(self.height_m),
            **ellipse_of(self.covariance_m2),
            "sigma_height_m": rounded(self.sigma_height_m),
        }
