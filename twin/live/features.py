"""What all that is said has in common as GeoJSON: places, ellipses, moments."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.locate.combine import SIGMAS_95, ellipse

if TYPE_CHECKING:
    from twin.live.ports import Said

_DECIMALS_DEG, _DECIMALS_M = 9, 4


def line_of(said: Said) -> str:
    """Write what is said as one line of JSON."""
    return json.dumps(said.feature(), ensure_ascii=False, allow_nan=False)


def point(longitude_deg: float, latitude_deg: float) -> dict[str, Any]:
    """Write a place as GeoJSON has it, to a tenth of a millimetre."""
    return {
        "type": "Point",
        "coordinates": [round(longitude_deg, _DECIMALS_DEG), round(latitude_deg, _DECIMALS_DEG)],
    }


def grid_m(latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Easting and northing of a place, EPSG:25833."""
    east, north = utm33_from_geographic(np.array([latitude_deg]), np.array([longitude_deg]))
    return float(east[0]), float(north[0])


def ellipse_of(covariance_m2: FloatArray) -> dict[str, float | None]:
    """Write a covariance, east and true north, as an ellipse: of one sigma, and of 95 %."""
    major, minor, azimuth = (float(x) for x in ellipse(covariance_m2))
    sigma_east, sigma_north = np.sqrt(np.diag(covariance_m2)).tolist()
    values = {
        "sigma_major_m": major,
        "sigma_minor_m": minor,
        "sigma_azimuth_deg": azimuth,
        "major95_m": SIGMAS_95 * major,
        "minor95_m": SIGMAS_95 * minor,
        "sigma_east_m": sigma_east,
        "sigma_north_m": sigma_north,
    }
    return {name: rounded(value) for name, value in values.items()}


def rounded(value: float) -> float | None:
    """Round metres and degrees; None for what is not known."""
    return round(value, _DECIMALS_M) if math.isfinite(value) else None


def utc(epoch_ns: int) -> str:
    """``2026-05-28T20:26:40.125Z``."""
    moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{epoch_ns // 1_000_000 % 1000:03d}Z"
