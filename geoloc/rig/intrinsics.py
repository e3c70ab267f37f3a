"""Intrinsics in a DriveWorks rig file: ``properties`` of a camera → CameraModel, and back.

``ftheta`` and ``pinhole`` are as real rig files have them. The documentation names ``ocam`` too but no real
file was found: its keys are the nearest guess. ``fisheye``, ``fisheye624``, ``fov`` and ``omni`` are this
project's own, so that a rig of any car can be written down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geoloc.cameras import (
    CameraModel,
    Fisheye624Camera,
    FisheyeCamera,
    FovCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
    Windshield,
    WindshieldCamera,
)
from geoloc.cameras.planar import PlanarCamera
from geoloc.cameras.radial import RadialCamera
from geoloc.errors import CalibrationError
from geoloc.rig.sensor_entry import SensorEntry

LENS_KEYS = ("focal-share-sigma", "centre-px-sigma", "distortion-share-sigma")
"""Properties of a camera that say how far its intrinsics may be off; this project's own."""
_POLYNOMIAL_TYPES = {"pixeldistance-to-angle": "theta_from_r", "angle-to-pixeldistance": "r_from_theta"}


def unsupported_model(entry: SensorEntry) -> str | None:
    """Why a camera's model cannot be computed with, or None if it can."""
    model = entry.property("Model", "model")
    if model is None:
        return "its properties name no Model, so it has no intrinsics"
    if model.lower() not in _READERS:
        *others, last = _READERS
        return f"its camera model is {model:.60}, and only {', '.join(others)} and {last} are supported"
    try:
        _windshield(entry)
    except CalibrationError as error:
        return f"its windshield model cannot be used ({str(error).rstrip('.')})"
    if model.lower() == "ocam":
        # The keys are guessed: a file that has others must not stop the rest of its rig.
        try:
            camera_model(entry)
        except CalibrationError as error:
            return f"its ocam properties are not as expected ({str(error).rstrip('.')})"
    return None


def camera_model(entry: SensorEntry) -> CameraModel:
    """Intrinsics from the properties; only where `unsupported_model` found nothing.

    Raises
    ------
    CalibrationError
        If a property is missing, malformed, or makes no camera.
    """
    build = _READERS[(entry.property("Model", "model") or "").lower()](entry)
    size = {"width_px": entry.size("width"), "height_px": entry.size("height")}
    centre = {"cx_px": entry.number("cx"), "cy_px": entry.number("cy")}
    try:
        lens = build(**size, **centre)
    except CalibrationError as error:
        raise entry.error("The intrinsics", f"cannot be used: {error}.") from error
    windshield = _windshield(entry)
    return lens if windshield is None else WindshieldCamera(lens, windshield)


def model_properties(name: str, model: CameraModel) -> dict[str, str]:
    """Write intrinsics as ``properties``: the inverse of `camera_model`, exact to the last bit.

    Parameters
    ----------
    name : str
        The camera's, for the message.
    """
    if isinstance(model, WindshieldCamera):
        return {**model_properties(name, model.lens), **_windshield_properties(model.windshield)}
    properties = {"Model": model.model, "width": str(model.width_px), "height": str(model.height_px)}
    if isinstance(model, FThetaCamera):
        forward = model.theta_from_r is None
        polynomial = (model.r_from_theta if forward else model.theta_from_r) or ()
        kind = "angle-to-pixeldistance" if forward else "pixeldistance-to-angle"
        terms = {"linear-c": (model.c,), "linear-d": (model.d,), "linear-e": (model.e,)}
        lens = {**_texts({"polynomial": polynomial}), "polynomial-type": kind}
        return {**properties, **_centre(model), **lens, **_texts(terms)}
    if isinstance(model, OcamCamera):
        terms = {"c": (model.c,), "d": (model.d,), "e": (model.e,)}
        return {**properties, **_centre(model), **_texts({"polynomial": model.polynomial, **terms})}
    if isinstance(model, FovCamera):
        lens = _texts({"fx": (model.fx_px,), "fy": (model.fy_px,), "omega": (model.omega_rad,)})
        return {**properties, **_centre(model), **lens}
    if isinstance(model, PinholeCamera | FisheyeCamera | Fisheye624Camera | OmniCamera):
        shape = ("xi", "alpha", "beta") if isinstance(model, OmniCamera) else ()
        focal = {"fx": (model.fx_px,), "fy": (model.fy_px,), "distortion": model.distortion}
        return {
            **properties,
            **_centre(model),
            **_texts({**{key: (getattr(model, key),) for key in shape}, **focal}),
        }
    raise CalibrationError(f"The camera model {model.model} of {name} cannot be written to a rig file.")


def with_model(properties: Mapping[str, Any], name: str, model: CameraModel) -> dict[str, Any]:
    """Give the properties of a camera another model; what is none of its intrinsics stays as it is.

    A camera that had its polynomial as ``bw-poly``, as older DriveWorks wrote it, has the new one so. A
    windshield model that was there goes with the old lens, and so does how far that may be off.

    Parameters
    ----------
    properties : mapping
        As the rig file has them; not changed.
    name : str
        The camera's, for the message.
    model : CameraModel
    """
    new: dict[str, Any] = dict(model_properties(name, model))
    was_older = "bw-poly" in properties and "polynomial" not in properties
    if was_older and new.get("polynomial-type") == _OLDER_TYPE:
        identity = {"linear-c": "1.0", "linear-d": "0.0", "linear-e": "0.0"}
        unsaid = all(new[key] == value and key not in properties for key, value in identity.items())
        dropped = {"polynomial", "polynomial-type", *(identity if unsaid else ())}
        new = {**{k: v for k, v in new.items() if k not in dropped}, "bw-poly": new["polynomial"]}
    kept = {key: value for key, value in properties.items() if key not in _INTRINSIC_KEYS | WINDSHIELD_KEYS}
    return {**kept, **new}


_OLDER_TYPE = "pixeldistance-to-angle"
_INTRINSIC_KEYS = frozenset(
    {"Model", "model", "width", "height", "cx", "cy", "fx", "fy", "focal-x", "focalX", "focal-y", "focalY"}
    | {"xi", "alpha", "beta", "omega", "c", "d", "e", "linear-c", "linear-d", "linear-e"}
    | {"distortion", "poly", "polynomial", "polynomial-type", "bw-poly", *LENS_KEYS}
)

_HORIZONTAL, _VERTICAL = "windshield-horizontal-polynomial", "windshield-vertical-polynomial"
_POLYNOMIALS = (_HORIZONTAL, _VERTICAL, f"{_HORIZONTAL}-approx-inverse", f"{_VERTICAL}-approx-inverse")
_DIRECTION = "windshield-polynomial-type"
_DIRECTIONS = ("forward", "backward")
WINDSHIELD_KEYS = frozenset({*_POLYNOMIALS, _DIRECTION})
"""Properties of a camera that say how the windscreen before it bends its rays."""


def is_behind_windshield(entry: SensorEntry) -> bool:
    """Whether a camera has a windshield model that bends its rays, or one that cannot be read."""
    try:
        return _windshield(entry) is not None
    except CalibrationError:
        return True


def _windshield(entry: SensorEntry) -> Windshield | None:
    """The screen before a camera; None where there is none, or one that bends nothing."""
    polynomials = [entry.numbers(key, entry.property(key) or "") for key in _POLYNOMIALS]
    horizontal, vertical, horizontal_inverse, vertical_inverse = polynomials
    if not any((*horizontal, *vertical)):
        return None
    direction = (entry.property(_DIRECTION) or _DIRECTIONS[0]).lower()
    if direction not in _DIRECTIONS:
        raise entry.error(_DIRECTION, f'is "{direction:.60}": expected {" or ".join(_DIRECTIONS)}.')
    forward = direction == _DIRECTIONS[0]
    windshield = Windshield(horizontal, vertical, forward, horizontal_inverse, vertical_inverse)
    return None if windshield.is_identity else windshield


def _windshield_properties(screen: Windshield) -> dict[str, str]:
    numbers = (screen.horizontal, screen.vertical, screen.horizontal_inverse, screen.vertical_inverse)
    given = {key: tuple_ for key, tuple_ in zip(_POLYNOMIALS, numbers, strict=True) if tuple_}
    return {**_texts(given), _DIRECTION: _DIRECTIONS[0 if screen.forward else 1]}


_Build = Callable[..., CameraModel]


def _ftheta(entry: SensorEntry) -> _Build:
    direction, coefficients = _ftheta_polynomial(entry)
    return partial(
        FThetaCamera,
        theta_from_r=coefficients if direction == "theta_from_r" else None,
        r_from_theta=coefficients if direction == "r_from_theta" else None,
        c=entry.number("linear-c", default=1.0),
        d=entry.number("linear-d", default=0.0),
        e=entry.number("linear-e", default=0.0),
    )


def _ftheta_polynomial(entry: SensorEntry) -> tuple[str, tuple[float, ...]]:
    """The reference polynomial: ``polynomial`` where it is given, else the older ``bw-poly``."""
    text = entry.property("polynomial")
    if text is not None:
        kind = (entry.property("polynomial-type") or "").lower()
        if kind not in _POLYNOMIAL_TYPES:
            raise entry.error(
                "polynomial-type", f'is "{kind:.60}": expected {" or ".join(_POLYNOMIAL_TYPES)}.'
            )
        return _POLYNOMIAL_TYPES[kind], entry.numbers("polynomial", text)
    text = entry.property("bw-poly")
    if text is None:
        raise entry.error("polynomial or bw-poly", "is missing: export the rig with its intrinsics.")
    return "theta_from_r", entry.numbers("bw-poly", text)


def _ocam(entry: SensorEntry) -> _Build:
    """OCamCalib's polynomial; one of the other sign has its depth forward instead of backward."""
    text = entry.property("polynomial", "poly")
    if text is None:
        raise entry.error("polynomial", "is missing: export the rig with its intrinsics.")
    polynomial = entry.numbers("polynomial", text)
    sign = -1.0 if polynomial[0] > 0.0 else 1.0
    return partial(
        OcamCamera,
        polynomial=tuple(sign * coefficient for coefficient in polynomial),
        c=entry.number("c", "linear-c", default=1.0),
        d=entry.number("d", "linear-d", default=0.0),
        e=entry.number("e", "linear-e", default=0.0),
    )


def _pinhole(entry: SensorEntry) -> _Build:
    distortion = entry.numbers("distortion", entry.property("distortion") or "", 0, 3, 4, 5, 8, 12)
    if len(distortion) == 3:
        # DriveWorks' own three: radial alone, without OpenCV's tangential pair in the middle.
        distortion = (distortion[0], distortion[1], 0.0, 0.0, distortion[2])
    fx_px, fy_px = _focal(entry)
    return partial(PinholeCamera, fx_px=fx_px, fy_px=fy_px, distortion=distortion)


def _fisheye(entry: SensorEntry) -> _Build:
    distortion = entry.numbers("distortion", entry.property("distortion") or "", *range(5))
    fx_px, fy_px = _focal(entry)
    return partial(FisheyeCamera, fx_px=fx_px, fy_px=fy_px, distortion=distortion)


def _fisheye624(entry: SensorEntry) -> _Build:
    distortion = entry.numbers("distortion", entry.property("distortion") or "", *range(13))
    fx_px, fy_px = _focal(entry)
    return partial(Fisheye624Camera, fx_px=fx_px, fy_px=fy_px, distortion=distortion)


def _fov(entry: SensorEntry) -> _Build:
    fx_px, fy_px = _focal(entry)
    return partial(FovCamera, fx_px=fx_px, fy_px=fy_px, omega_rad=entry.number("omega"))


def _omni(entry: SensorEntry) -> _Build:
    distortion = entry.numbers("distortion", entry.property("distortion") or "", 0, 4, 5, 8, 12)
    fx_px, fy_px = _focal(entry)
    return partial(
        OmniCamera,
        xi=entry.number("xi"),
        fx_px=fx_px,
        fy_px=fy_px,
        distortion=distortion,
        alpha=entry.number("alpha", default=0.0),
        beta=entry.number("beta", default=1.0),
    )


def _focal(entry: SensorEntry) -> tuple[float, float]:
    return entry.number("fx", "focal-x", "focalX"), entry.number("fy", "focal-y", "focalY")


_READERS: dict[str, Callable[[SensorEntry], _Build]] = {
    "ftheta": _ftheta,
    "pinhole": _pinhole,
    "ocam": _ocam,
    "fisheye": _fisheye,
    "fisheye624": _fisheye624,
    "fov": _fov,
    "omni": _omni,
}


def _centre(model: RadialCamera | PlanarCamera | FisheyeCamera) -> dict[str, str]:
    return _texts({"cx": (model.cx_px,), "cy": (model.cy_px,)})


def _texts(properties: Mapping[str, tuple[float, ...]]) -> dict[str, str]:
    """Numbers as rig files spell them: strings with blanks between, exact to the last bit."""
    # float() first: the repr of a NumPy scalar is not a number.
    return {key: " ".join(repr(float(n)) for n in numbers) for key, numbers in properties.items()}
