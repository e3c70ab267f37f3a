"""Sensors of a DriveWorks rig file, good ones with changes."""

from __future__ import annotations

from typing import Any

from geoloc.rig.rig import RigCamera, rig_from_document

FTHETA = {
    "Model": "ftheta",
    "width": "1920",
    "height": "1208",
    "cx": "950.25",
    "cy": "610.5",
    "bw-poly": "0.000000000000000 1.0e-3 2.0e-8 4.0e-11 1.2e-14 ",
}
LEVEL = {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [1.8, 0.2, 1.5]}


def camera_sensor(**changes: Any) -> dict[str, Any]:
    """Build one good camera entry with changes; None removes a key."""
    sensor = {
        "name": "front",
        "protocol": "camera.virtual",
        "parameter": "video=front.h264,timestamp=front.h264.timestamps",
        "properties": FTHETA,
        "nominalSensor2Rig_FLU": LEVEL,
    }
    return {key: value for key, value in {**sensor, **changes}.items() if value is not None}


def gps_sensor(name: str = "gnss50:vehicle", **changes: Any) -> dict[str, Any]:
    """Build one good antenna entry with changes."""
    return {
        "name": name,
        "protocol": "gps.virtual",
        "parameter": "file=gnss50_vehicle.bin,output-timestamp=smoothed",
        "properties": None,
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, -0.0, 0.0], "t": [0.5, -0.4, 1.6]},
        **changes,
    }


def document(*sensors: dict[str, Any]) -> dict[str, Any]:
    """Wrap sensors as a rig file does."""
    return {"rig": {"sensors": list(sensors), "vehicle": {"valid": True}, "vehicleio": []}, "version": 7}


def front(**changes: Any) -> RigCamera:
    """Read one camera entry with changes."""
    return rig_from_document(document(camera_sensor(**changes)), "car.json").camera("front")
