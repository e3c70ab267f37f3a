"""What can go wrong in geolocation.

::

    GeolocError
    ├── CalibrationError       a rig or camera model that cannot be read or used
    └── TrajectoryError        fixes or poses that make no trajectory
"""

from __future__ import annotations


class GeolocError(Exception):
    """Base of every error that ``geoloc`` raises."""


class CalibrationError(GeolocError):
    """A rig or camera calibration that cannot be read, or that contradicts itself."""


class TrajectoryError(GeolocError):
    """Fixes or poses from which no trajectory can be built."""
