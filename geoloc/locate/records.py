"""What is seen and what comes of it: sightings, and their positions with covariance."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, TextArray


class Kind(StrEnum):
    """What the pixel of a sighting shows."""

    FOOT = "foot"
    """Where the pole meets the ground, so that the road's plane, or the terrain, says something too."""
    BOX = "box"
    """The middle of a sign's face: a bearing alone."""


@dataclass(frozen=True, slots=True)
class Sightings:
    """Pixels of objects in frames.

    Attributes
    ----------
    camera : str (n,)
        Name of the camera in the rig.
    pixel_px : float64 (n, 2)
        Foot of the pole; (0, 0) is the centre of the first pixel.
    """

    camera: TextArray
    pixel_px: FloatArray


@dataclass(frozen=True, slots=True)
class Located:
    """Positions of sightings.

    Rows that could not be located are NaN, with the reason in `rejected`.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float64 (n,)
        Foot of the object; `height_m` ellipsoidal.
    covariance_m2 : float64 (n, 2, 2)
        Total, east and true north.
    random_m2 : float64 (n, 2, 2)
        The part that is independent from frame to frame.
    systematic_m : float64 (n, 2, k)
        One column a systematic source, scaled to one sigma: ``covariance = random + S Sᵀ``. The same column
        is the same error in every sighting.
    source : tuple of str
        Names of the k columns, e.g. ``boresight pitch C3_tricam120``, ``time``.
    range_m : float64 (n,)
        Horizontal distance from the camera to the foot.
    rejected : str (n,)
        A `geoloc.reasons.Reason`; "" where located.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    covariance_m2: FloatArray
    random_m2: FloatArray
    systematic_m: FloatArray
    source: tuple[str, ...]
    range_m: FloatArray
    rejected: TextArray

    @property
    def valid(self) -> BoolArray:
        """True where the sighting was located."""
        return np.asarray(self.rejected == "")
