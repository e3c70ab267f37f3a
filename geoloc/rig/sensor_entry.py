"""Entries of a DriveWorks rig file: numbers in strings, rotations, run-length masks."""

from __future__ import annotations

import base64
import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.errors import CalibrationError

_MASK_KEY = "data/rle16-base64"
LARGEST_MASK_PX = 100_000_000
"""Pixels of a car mask: no camera has more, and few runs could ask for terabytes."""
_LONGEST_RUN = 0xFFFF
_EGO, _SCENE = 0, 1


@dataclass(frozen=True, slots=True)
class SensorEntry:
    """One element of ``rig.sensors``, and what an error message needs to name it."""

    name: str
    kind: str
    """First part of the protocol: ``camera``, ``gps``, ``can``, …"""
    sensor: Mapping[str, Any]
    source: str

    @classmethod
    def of(cls, sensor: object, index: int, source: str) -> Self:
        """Check that the element is an object with a name and a protocol."""
        if not isinstance(sensor, Mapping):
            raise CalibrationError(f"Sensor number {index + 1} in {source} is not an object.")
        name, protocol = sensor.get("name"), sensor.get("protocol")
        if not isinstance(name, str) or not name.strip():
            raise CalibrationError(f"Sensor number {index + 1} in {source} has no name: give it one.")
        if not isinstance(protocol, str):
            raise CalibrationError(
                f"Sensor {name:.80} in {source} has no protocol: write camera.virtual for a recorded camera"
                " or gps.virtual for a recorded antenna."
            )
        return cls(name.strip(), protocol.split(".")[0].strip().lower(), sensor, source)

    def error(self, key: str, what: str) -> CalibrationError:
        """Build the error that says what is wrong with one key of this sensor."""
        return CalibrationError(f"{key} of sensor {self.name:.80} in {self.source} {what}")

    def parameter(self) -> dict[str, str]:
        """``key=value,key=value`` of ``parameter``."""
        pairs = (pair.partition("=") for pair in str(self.sensor.get("parameter") or "").split(","))
        return {key.strip(): value.strip() for key, found, value in pairs if found and value.strip()}

    def property(self, *keys: str) -> str | None:
        """First of these properties that is there and not blank; values are strings, blanks around them.

        A list, as which some programs write a polynomial, is its items with blanks between.
        """
        properties = self.sensor.get("properties")
        if not isinstance(properties, Mapping):
            return None
        for key in keys:
            value = properties.get(key)
            text = " ".join(map(str, value)) if isinstance(value, list) else str(value).strip()
            if value is not None and text:
                return text
        return None

    def number(self, *keys: str, default: float | None = None) -> float:
        """One property as a finite number."""
        text = self.property(*keys)
        if text is None:
            if default is not None:
                return default
            raise self.error(" or ".join(keys), "is missing: export the rig with its intrinsics.")
        return self.numbers(keys[0], text, 1)[0]

    def numbers(self, key: str, text: str, *counts: int) -> tuple[float, ...]:
        """Whitespace-separated finite numbers; as many as one of `counts`, if given."""
        try:
            values = tuple(float(word) for word in text.replace(",", " ").split())
        except ValueError:
            values = (math.nan,)
        if not all(math.isfinite(value) for value in values):
            raise self.error(key, f'is "{text:.60}": expected finite numbers with blanks between them.')
        if counts and len(values) not in counts:
            expected = " or ".join(str(count) for count in counts)
            raise self.error(key, f"has {len(values)} numbers: expected {expected}.")
        return values

    def vector(self, key: str, value: object, length: int) -> FloatArray:
        """A JSON list of finite numbers."""
        try:
            vector = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            vector = np.array(np.nan)
        if vector.shape != (length,) or not np.isfinite(vector).all():
            raise self.error(key, f"is {reprlib.repr(value)}: expected a list of {length} finite numbers.")
        return vector

    def rotation(self, key: str, transform: object) -> FloatArray:
        """Rotation of ``roll-pitch-yaw`` (degrees) or ``quaternion`` (x, y, z, w)."""
        if isinstance(transform, Mapping) and "roll-pitch-yaw" in transform:
            angles = self.vector(f"{key}.roll-pitch-yaw", transform["roll-pitch-yaw"], 3)
            return rotation_from_rpy(angles[0], angles[1], angles[2])
        if isinstance(transform, Mapping) and "quaternion" in transform:
            quaternion = self.vector(f"{key}.quaternion", transform["quaternion"], 4)
            norm = math.hypot(*quaternion)
            if abs(norm - 1.0) > 1e-2:
                raise self.error(f"{key}.quaternion", f"has length {norm:.4g}: expected a unit quaternion.")
            return _rotation_from_quaternion(quaternion / norm)
        raise self.error(key, "has neither roll-pitch-yaw nor quaternion: add one of them.")

    def size(self, key: str) -> int:
        """One side of the image."""
        value = self.number(key)
        if value != int(value) or value <= 0:
            raise self.error(key, f"is {value:g}: expected a positive number of pixels.")
        return int(value)

    def ego_mask(self) -> NDArray[np.bool_] | None:
        """``car-mask``, true on the car.

        Base64 of runs (uint16 little-endian count, uint8 value), row by row; value 0 is the car.
        """
        document = self.sensor.get("car-mask")
        if not isinstance(document, Mapping) or _MASK_KEY not in document:
            return None
        resolution = self.vector("car-mask.resolution", document.get("resolution"), 2)
        width, height = int(resolution[0]), int(resolution[1])
        if min(resolution) <= 0 or width * height > LARGEST_MASK_PX or (resolution != [width, height]).any():
            raise self.error("car-mask.resolution", f"is {resolution.tolist()}: expected width and height.")
        try:
            data = base64.b64decode(str(document[_MASK_KEY]), validate=True)
        except ValueError as error:
            raise self.error("car-mask", f"is not base64 ({error}): export the rig again.") from error
        run = np.dtype([("count", "<u2"), ("value", "u1")])
        if len(data) % run.itemsize:
            raise self.error("car-mask", f"has {len(data)} bytes, not a multiple of 3: export the rig again.")
        runs = np.frombuffer(data, dtype=run)
        total = int(runs["count"].sum(dtype=np.int64))
        if total != width * height:
            raise self.error(
                "car-mask", f"decodes to {total} pixels, not {width} x {height}: export the rig again."
            )
        return np.repeat(runs["value"] == _EGO, runs["count"]).reshape(height, width)


def mask_document(ego_mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Write a mask as ``car-mask``: the inverse of `SensorEntry.ego_mask`."""
    flat = np.asarray(ego_mask, dtype=np.bool_).ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=~flat[:1]))
    runs = bytearray()
    for start, length in zip(starts, np.diff(starts, append=flat.size), strict=True):
        value = _EGO if flat[start] else _SCENE
        whole, rest = divmod(int(length), _LONGEST_RUN)
        for count in [_LONGEST_RUN] * whole + [rest] * (rest > 0):
            runs += count.to_bytes(2, "little") + bytes([value])
    height, width = ego_mask.shape
    return {_MASK_KEY: base64.b64encode(bytes(runs)).decode("ascii"), "resolution": [width, height]}


def _rotation_from_quaternion(quaternion: FloatArray) -> FloatArray:
    """Rotation matrix of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
