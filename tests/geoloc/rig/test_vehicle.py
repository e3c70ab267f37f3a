"""What a rig file says of the car itself."""

from __future__ import annotations

import math
from typing import Any

import pytest

from geoloc.rig.vehicle import Vehicle, vehicle_of_document

AXLES = {
    "axleFront": {"position": 2.7, "track": 1.58},
    "axleRear": {"position": 0.0, "wheelRadiusLeft": 0.32, "wheelRadiusRight": 0.34},
    "body": {"length": 4.4, "width": 1.8, "height": 1.6, "boundingBoxPosition": [-0.9, 0.0, 0.0]},
}


def document(value: object, valid: object = True) -> dict[str, Any]:
    """Return a rig file without sensors."""
    return {"rig": {"sensors": [], "vehicle": {"valid": valid, "value": value}}, "version": 7}


def test_vehicle_of_driveworks_is_read() -> None:
    """Axles along x, the mean of the rear wheels, and the box around the body."""
    vehicle = vehicle_of_document(document(AXLES))
    assert vehicle == Vehicle(2.7, pytest.approx(0.33), (4.4, 1.8, 1.6), -0.9)


def test_older_files_state_the_wheelbase_itself() -> None:
    """As DriveWorks before 4 wrote it, beside the size of the car."""
    old = {"wheelbase": 2.85, "wheelRadius": 0.34, "length": 4.9, "width": 1.87, "height": 1.45}
    assert vehicle_of_document(document(old)) == Vehicle(2.85, 0.34, (4.9, 1.87, 1.45))


@pytest.mark.parametrize(
    "value",
    [None, [], {}, "car", {"axleFront": 3, "axleRear": []}, AXLES | {"axleFront": {"position": math.nan}}],
)
def test_what_no_car_is_is_not_taken(value: object) -> None:
    """Anything may stand there; no wheelbase is made up."""
    vehicle = vehicle_of_document(document(value))
    assert vehicle is None or vehicle.wheelbase_m is None
    assert vehicle_of_document(document(AXLES, valid=False)) is None
