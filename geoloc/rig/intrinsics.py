"""Intrinsics in a DriveWorks rig file: ``properties`` of a camera → CameraModel, and back.

``ftheta`` and ``pinhole`` are as real rig files have them. The documentation names ``ocam`` too but no real
file was found: its keys are the nearest guess. ``fisheye``, ``fisheye624``, ``fov`` and ``omni`` are this
project's own, so that a rig of any car can be written down.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from geoloc.cameras import (
    CameraModel,
    Fisheye624Camera,
    FisheyeCamera,
    FovCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
)
from geoloc.cameras.planar import PlanarCamera
from geoloc.cameras.radial import RadialCamera
from geoloc.errors import CalibrationError
from geoloc.rig.sensor_entry import SensorEntry

_POLYNOMIAL_TYPES = {"pixeldistance-to-angle": "theta_from_r", "angle-to-pixeldistance": "r_from_theta"}


def unsupported_model(entry: SensorEntry) -> str | None:
    """Why a camera's model cannot be computed with, or None if it can."""
    model = entry.property("Model", "model")
    if model is None:
        return "its properties name no Model, so it has no intrinsics"
    if model.lower() not in _READERS:
        *others, last = _READERS
        return f"its camera model is {model:.60}, and only {', '.join(others)} and {last} are supported"
    if entry.property("windshield-horizontal-polynomial", "windshield-vertical-polynomial") is not None:
        return "it has a windshield model, without which its rays would be wrong"
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
        return build(**size, **centre)
    except CalibrationError as error:
        raise entry.error("The intrinsics", f"cannot be used: {error}.") from error


def model_properties(name: str, model: CameraModel) -> dict[str, str]:
    """Write intrinsics as ``properties``: the inverse of `camera_model`, exact to the last bit.

    Parameters
    ----------
    name : str
        The camera's, for the message.
    """
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
