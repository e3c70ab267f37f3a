"""What a DriveWorks rig file says of the car itself: ``rig.vehicle``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_LIMITS_M = {"wheelbase_m": (0.5, 20.0), "wheel_radius_m": (0.1, 2.0), "size_m": (0.5, 30.0)}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The car; None where the rig file does not say, or says what no car is.

    Attributes
    ----------
    wheelbase_m : float or None
        Rear axle to front axle.
    wheel_radius_m : float or None
        Of the rear wheels, their mean.
    size_m : (length, width, height) or None
        The box around the body.
    rear_end_m : float or None
        Where that box begins, along x of the rig frame: behind the rear axle is negative.
    """

    wheelbase_m: float | None = None
    wheel_radius_m: float | None = None
    size_m: tuple[float, float, float] | None = None
    rear_end_m: float | None = None


def vehicle_of_document(document: Mapping[str, Any]) -> Vehicle | None:
    """Read ``rig.vehicle`` of a parsed rig file; None where it holds none, or is marked as not valid.

    Axles are those of DriveWorks 4 and later (``axleFront.position``, ``axleRear.position`` along x), or the
    ``wheelbase`` of the versions before. The body's box begins at ``boundingBoxPosition``, the middle of its
    rear lower edge.

    NVIDIA DriveWorks, "Rig Configuration" and ``dwVehicle`` (``dwVehicleAxleProperties``).
    """
    vehicle = _table(document.get("rig")).get("vehicle")
    value = _table(_table(vehicle).get("value"))
    if not value or _table(vehicle).get("valid") is False:
        return None
    front, rear, body = (_table(value.get(key)) for key in ("axleFront", "axleRear", "body"))
    wheelbase_m = _number(front.get("position")) - _number(rear.get("position"))
    radii = [_number(rear.get(key)) for key in ("wheelRadiusLeft", "wheelRadiusRight")]
    radius_m = sum(radii) / 2.0 if all(map(math.isfinite, radii)) else _number(value.get("wheelRadius"))
    sizes = [_number((body or value).get(key)) for key in ("length", "width", "height")]
    place = body.get("boundingBoxPosition")
    rear_end_m = _number(place[0] if isinstance(place, list) and place else None)
    return Vehicle(
        wheelbase_m=_within(wheelbase_m, "wheelbase_m")
        or _within(_number(value.get("wheelbase")), "wheelbase_m"),
        wheel_radius_m=_within(radius_m, "wheel_radius_m"),
        size_m=(sizes[0], sizes[1], sizes[2]) if all(_within(s, "size_m") for s in sizes) else None,
        rear_end_m=rear_end_m if -10.0 < rear_end_m < 10.0 else None,
    )


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _within(value: float, key: str) -> float | None:
    least, most = _LIMITS_M[key]
    return value if least <= value <= most else None
