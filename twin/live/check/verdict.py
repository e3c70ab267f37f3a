"""What the check says of a sign, and how that is written."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from twin.live.features import ellipse_of, point, rounded, utc
from twin.words import Why, why_to_json


class Standing(StrEnum):
    """How a sign stands against NVDB, as far as is known now."""

    EXPECTED = "expected"
    """NVDB has it ahead, or had it in view, and nothing can be said of it yet, or no longer."""
    UNCHANGED = "unchanged"
    MOVED = "moved"
    NEW = "new"
    WRONG_TYPE = "wrong_type"
    MISSING = "missing"
    WITHDRAWN = "withdrawn"
    """What was said of an object or of a plate holds no longer."""


class Verdict(NamedTuple):
    """What is said of one sign.

    Attributes
    ----------
    id : str
        ``95:1042500101`` of what NVDB has (its type and id), else the object as the engine calls it, with
        ``/CODE`` for a plate that NVDB lacks on a pole that it knows.
    standing : Standing
    was : Standing or None
        What was said before; None if nothing was.
    why : Why or None
        The reason as a kind with facts, as a match gives it; None for what is only expected.
    is_final : bool
        What it rests on changes no more, unless the sign is passed again.
    confidence : float
        Probability that it is right; NaN for what is expected or withdrawn.
    nvdb_type, nvdb_id : int or None
    pole : str
        The object that was seen, as the engine calls it; "" if none was.
    skiltnummer_seen, skiltnummer_nvdb : tuple of str
    east_m, north_m : float
        EPSG:25833, where it stands: as measured, or as NVDB has it for what was not seen.
    covariance_m2 : float64 (2, 2) or None
        East and true north, of the measured place.
    distance_m, distance_sigma_m : float or None
        Of the measured place from NVDB's.
    nvdb_m : (float, float) or None
        NVDB's place, EPSG:25833.
    first_seen_ns : int
        UTC of the first exposure that shows it; 0 if none does.
    at_ns : int
        When it was said, by the host's clock.
    """

    id: str
    standing: Standing
    was: Standing | None
    why: Why | None
    is_final: bool
    confidence: float
    nvdb_type: int | None
    nvdb_id: int | None
    pole: str
    skiltnummer_seen: tuple[str, ...]
    skiltnummer_nvdb: tuple[str, ...]
    east_m: float
    north_m: float
    covariance_m2: FloatArray | None
    distance_m: float | None
    distance_sigma_m: float | None
    nvdb_m: tuple[float, float] | None
    first_seen_ns: int
    at_ns: int

    @property
    def lasts(self) -> bool:
        """Whether it is worth keeping: all but what is only expected."""
        return self.standing is not Standing.EXPECTED or self.was is not None

    def feature(self) -> dict[str, Any]:
        """Return a GeoJSON feature: WGS84 as geometry, EPSG:25833 among the properties."""
        return {
            "type": "Feature",
            "id": self.id,
            "geometry": _point(self.east_m, self.north_m),
            "properties": {
                "verdict": self.standing.value,
                "was": None if self.was is None else self.was.value,
                "why": None if self.why is None else why_to_json(self.why),
                "final": self.is_final,
                "confidence": rounded(self.confidence),
                "nvdb_type": self.nvdb_type,
                "nvdb_id": self.nvdb_id,
                "pole": self.pole or None,
                "skiltnummer_seen": ";".join(self.skiltnummer_seen),
                "skiltnummer_nvdb": ";".join(self.skiltnummer_nvdb),
                "distance_m": _metres(self.distance_m),
                "distance_sigma_m": _metres(self.distance_sigma_m),
                "nvdb": None if self.nvdb_m is None else _point(*self.nvdb_m)["coordinates"],
                "first_seen": utc(self.first_seen_ns) if self.first_seen_ns else None,
                "at": utc(self.at_ns),
                "easting": rounded(self.east_m),
                "northing": rounded(self.north_m),
                **({} if self.covariance_m2 is None else ellipse_of(self.covariance_m2)),
            },
        }


def _point(east_m: float, north_m: float) -> dict[str, Any]:
    latitude, longitude = geographic_from_utm33(np.array([east_m]), np.array([north_m]))
    return point(float(longitude[0]), float(latitude[0]))


def _metres(value: float | None) -> float | None:
    return None if value is None else rounded(value)
