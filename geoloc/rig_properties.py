"""Entries of a DriveWorks rig file: numbers in strings, polynomials, rotations, run-length masks."""

from __future__ import annotations

import base64
import binascii
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from geoloc.cameras import CameraModel, FThetaCamera, PinholeCamera
from geoloc.errors import CalibrationError
from geoloc.geodesy import rotation_from_rpy

FloatArray = NDArray[np.float64]

_TRANSFORM_KEYS = ("nominalSensor2Rig_FLU", "sensor2Rig_FLU", "nominalSensor2Rig", "sensor2Rig")
_POLYNOMIAL_TYPES = {"pixeldistance-to-angle": "theta_from_r", "angle-to-pixeldistance": "r_from_theta"}
_MASK_KEY = "data/rle16-base64"
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
                f"Sensor {name} in {source} has no protocol: write camera.virtual for a recorded camera or "
                "gps.virtual for a recorded antenna."
            )
        return cls(name.strip(), protocol.split(".")[0].strip().lower(), sensor, source)

    def error(self, key: str, what: str) -> CalibrationError:
        """Build the error that says what is wrong with one key of this sensor."""
        return CalibrationError(f"{key} of sensor {self.name} in {self.source} {what}")

    def parameter(self) -> dict[str, str]:
        """``key=value,key=value`` of ``parameter``."""
        pairs = (pair.partition("=") for pair in str(self.sensor.get("parameter") or "").split(","))
        return {key.strip(): value.strip() for key, found, value in pairs if found and value.strip()}

    def property(self, *keys: str) -> str | None:
        """First of these properties that is there and not blank; values are strings, blanks around them."""
        properties = self.sensor.get("properties")
        if not isinstance(properties, Mapping):
            return None
        for key in keys:
            value = properties.get(key)
            if value is not None and str(value).strip():
                return str(value).strip()
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
            raise self.error(key, f'is "{text}": expected finite numbers with blanks between them.')
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
            raise self.error(key, f"is {value}: expected a list of {length} finite numbers.")
        return vector

    def transform(self) -> tuple[str, Mapping[str, Any]]:
        """Key and content of the extrinsics that count."""
        for key in _TRANSFORM_KEYS:
            transform = self.sensor.get(key)
            if isinstance(transform, Mapping):
                return key, transform
        raise self.error(
            _TRANSFORM_KEYS[0],
            'is missing: add {"roll-pitch-yaw": [roll, pitch, yaw] in degrees, "t": [x, y, z] in metres}.',
        )

    def rotation(self, key: str, transform: object) -> FloatArray:
        """Rotation of ``roll-pitch-yaw`` (degrees) or ``quaternion`` (x, y, z, w)."""
        if isinstance(transform, Mapping) and "roll-pitch-yaw" in transform:
            angles = self.vector(f"{key}.roll-pitch-yaw", transform["roll-pitch-yaw"], 3)
            return rotation_from_rpy(angles[0], angles[1], angles[2])
        if isinstance(transform, Mapping) and "quaternion" in transform:
            quaternion = self.vector(f"{key}.quaternion", transform["quaternion"], 4)
            norm = float(np.linalg.norm(quaternion))
            if abs(norm - 1.0) > 1e-2:
                raise self.error(f"{key}.quaternion", f"has length {norm:.4g}: expected a unit quaternion.")
            return _rotation_from_quaternion(quaternion / norm)
        raise self.error(key, "has neither roll-pitch-yaw nor quaternion: add one of them.")

    def unsupported_model(self) -> str | None:
        """Why this camera's model cannot be computed with, or None if it can."""
        model = self.property("Model", "model")
        if model is None:
            return "its properties name no Model, so it has no intrinsics"
        if model.lower() not in {"ftheta", "pinhole"}:
            return f"its camera model is {model}, and only ftheta and pinhole are supported"
        if self.property("windshield-horizontal-polynomial", "windshield-vertical-polynomial") is not None:
            return "it has a windshield model, without which its rays would be wrong"
        return None

    def camera_model(self) -> CameraModel:
        """Intrinsics from the properties; only where `unsupported_model` found nothing."""
        ftheta = (self.property("Model", "model") or "").lower() == "ftheta"
        build = self._ftheta() if ftheta else self._pinhole()
        try:
            return build()
        except CalibrationError as error:
            raise self.error("The intrinsics", f"cannot be used: {error}.") from error

    def _size(self, key: str) -> int:
        value = self.number(key)
        if value != int(value) or value <= 0:
            raise self.error(key, f"is {value:g}: expected a positive number of pixels.")
        return int(value)

    def _ftheta(self) -> Callable[[], CameraModel]:
        direction, coefficients = self._ftheta_polynomial()
        return partial(
            FThetaCamera,
            width_px=self._size("width"),
            height_px=self._size("height"),
            cx_px=self.number("cx"),
            cy_px=self.number("cy"),
            theta_from_r=coefficients if direction == "theta_from_r" else None,
            r_from_theta=coefficients if direction == "r_from_theta" else None,
            c=self.number("linear-c", default=1.0),
            d=self.number("linear-d", default=0.0),
            e=self.number("linear-e", default=0.0),
        )

    def _ftheta_polynomial(self) -> tuple[str, tuple[float, ...]]:
        """The reference polynomial: ``polynomial`` where it is given, else the older ``bw-poly``."""
        text = self.property("polynomial")
        if text is not None:
            kind = (self.property("polynomial-type") or "").lower()
            if kind not in _POLYNOMIAL_TYPES:
                raise self.error(
                    "polynomial-type", f'is "{kind}": expected {" or ".join(_POLYNOMIAL_TYPES)}.'
                )
            return _POLYNOMIAL_TYPES[kind], self.numbers("polynomial", text)
        text = self.property("bw-poly")
        if text is None:
            raise self.error("polynomial or bw-poly", "is missing: export the rig with its intrinsics.")
        return "theta_from_r", self.numbers("bw-poly", text)

    def _pinhole(self) -> Callable[[], CameraModel]:
        distortion = self.numbers("distortion", self.property("distortion") or "", 0, 3, 4, 5, 8)
        if len(distortion) == 3:
            # DriveWorks' own three: radial alone, without OpenCV's tangential pair in the middle.
            distortion = (distortion[0], distortion[1], 0.0, 0.0, distortion[2])
        return partial(
            PinholeCamera,
            width_px=self._size("width"),
            height_px=self._size("height"),
            fx_px=self.number("fx", "focal-x", "focalX"),
            fy_px=self.number("fy", "focal-y", "focalY"),
            cx_px=self.number("cx"),
            cy_px=self.number("cy"),
            distortion=distortion,
        )

    def ego_mask(self) -> NDArray[np.bool_] | None:
        """``car-mask``, true on the car.

        Base64 of runs (uint16 little-endian count, uint8 value), row by row; value 0 is the car.
        """
        document = self.sensor.get("car-mask")
        if not isinstance(document, Mapping) or _MASK_KEY not in document:
            return None
        resolution = self.vector("car-mask.resolution", document.get("resolution"), 2)
        width, height = int(resolution[0]), int(resolution[1])
        if width <= 0 or height <= 0 or (resolution != [width, height]).any():
            raise self.error("car-mask.resolution", f"is {resolution.tolist()}: expected width and height.")
        try:
            data = base64.b64decode(str(document[_MASK_KEY]), validate=True)
        except binascii.Error as error:
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


def model_properties(name: str, model: CameraModel) -> dict[str, str]:
    """Write intrinsics as ``properties``: the inverse of `SensorEntry.camera_model`."""
    properties = {"Model": model.model, "width": str(model.width_px), "height": str(model.height_px)}
    if isinstance(model, FThetaCamera):
        forward = model.theta_from_r is None
        kind = "angle-to-pixeldistance" if forward else "pixeldistance-to-angle"
        polynomial = (model.r_from_theta if forward else model.theta_from_r) or ()
        return {
            **properties,
            **_texts({"cx": (model.cx_px,), "cy": (model.cy_px,), "polynomial": polynomial}),
            "polynomial-type": kind,
            **_texts({"linear-c": (model.c,), "linear-d": (model.d,), "linear-e": (model.e,)}),
        }
    if isinstance(model, PinholeCamera):
        numbers = {"cx": (model.cx_px,), "cy": (model.cy_px,), "fx": (model.fx_px,), "fy": (model.fy_px,)}
        return {**properties, **_texts({**numbers, "distortion": model.distortion})}
    raise CalibrationError(f"The camera model {model.model} of {name} cannot be written to a rig file.")


def _texts(properties: Mapping[str, tuple[float, ...]]) -> dict[str, str]:
    """Numbers as rig files spell them: strings with blanks between, exact to the last bit."""
    # float() first: the repr of a NumPy scalar is not a number.
    return {key: " ".join(repr(float(n)) for n in numbers) for key, numbers in properties.items()}


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
