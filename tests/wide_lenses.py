"""Wide lenses of rarer models, which several tests write and read."""

from __future__ import annotations

from geoloc.cameras import Fisheye624Camera, FovCamera

FISHEYE624 = Fisheye624Camera(
    1280,
    960,
    460.0,
    461.5,
    636.2,
    483.7,
    (0.02, -0.01, 5e-3, -2e-3, 3e-4, -2e-5, 3e-4, -2e-4, 6e-4, 3e-4, -7e-4, 2e-4),
)
FOV = FovCamera(1280, 960, 685.7, 689.2, 631.3, 485.1, 0.898)
