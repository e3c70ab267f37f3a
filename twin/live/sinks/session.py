"""What the page of a drive needs once: the car's cameras, names of signs, its texts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from starlette.routing import Route

from geoloc.rig.rig import RigCamera
from twin.live.engine import LiveCar
from twin.web.base_map import BASE_MAP, BaseMap
from twin.web.messages import answer_of
from twin.words import NO_NAMES, Lang, SignNames, language_from, messages

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response


class CameraRecord(msgspec.Struct, frozen=True):
    """Where a camera sits and what it sees: azimuths clockwise from straight ahead."""

    name: str
    forward_m: float
    left_m: float
    azimuth_deg: float
    half_fov_deg: float


class LiveSession(msgspec.Struct, frozen=True):
    """What the page needs once."""

    lang: str
    messages: dict[str, str]
    names: dict[str, str]
    cameras: list[CameraRecord]
    base_map: BaseMap | None


def session_route(
    car: LiveCar, names: SignNames = NO_NAMES, *, lang: Lang | None = None, base_map: bool = False
) -> Route:
    """Return the route of what the page asks for first.

    Parameters
    ----------
    car : LiveCar
    names : mapping
        Of sign codes.
    lang : Lang, optional
        None for the browser's.
    base_map : bool
        Whether the page may ask Kartverket for map tiles.
    """
    cameras = [_camera(camera) for camera in car.rig.cameras.values()]

    def session(request: Request) -> Response:
        chosen = lang or language_from(request.headers.get("accept-language", ""))
        texts = messages(chosen, "live.") | messages(chosen, "page.map.") | messages(chosen, "page.verdict.")
        return answer_of(LiveSession(chosen, texts, dict(names), cameras, BASE_MAP if base_map else None))

    return Route("/api/session", session)


def _camera(camera: RigCamera) -> CameraRecord:
    """Where it looks in the plane, by the rays of its picture's left and right edge."""
    model = camera.model
    middle = (model.height_px - 1) / 2
    edge_px = np.array([(0.0, middle), (model.width_px - 1.0, middle)])
    rays, _ = model.camera_ray_from_pixel(edge_px)
    forward, left, _ = camera.rig_R_camera @ np.array([0.0, 0.0, 1.0])
    azimuth = -math.degrees(math.atan2(left, forward))
    x, _, z = np.nan_to_num(rays, nan=0.0).T
    half = float(np.abs(np.degrees(np.arctan2(x, z))).mean()) or 30.0
    at = camera.rig_t_camera_m
    return CameraRecord(camera.name, float(at[0]), float(at[1]), azimuth, half)
