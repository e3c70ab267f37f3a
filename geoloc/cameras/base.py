"""The protocol behind which every camera model stands."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@runtime_checkable
class CameraModel(Protocol):
    """Intrinsics of one camera: pixels from camera points and rays from pixels.

    Camera frame RDF: x right, y down, z forward. Pixel (0, 0) is the *centre* of the first pixel, as in
    OpenCV. All methods take any leading batch axes. Values outside the model's domain come back as NaN
    with ``False`` in the mask: a default coordinate is never invented.
    """

    @property
    def model(self) -> str:
        """Name of the model as rig files spell it: ``ftheta``, ``pinhole``."""
        ...

    @property
    def width_px(self) -> int:
        """Image width."""
        ...

    @property
    def height_px(self) -> int:
        """Image height."""
        ...

    @property
    def horizontal_fov_rad(self) -> float:
        """Angle between the rays of the left and right image edge in the row of the principal point."""
        ...

    def pixel_from_camera_point(self, point_camera: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Project points ``(..., 3)`` (any length, RDF) to pixels ``(..., 2)`` with a mask ``(...)``.

        The mask is true where the point is inside the model's domain *and* falls on the image.
        """
        ...

    def camera_ray_from_pixel(self, pixel_px: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit rays ``(..., 3)`` (RDF) of pixels ``(..., 2)`` with a mask ``(...)``.

        The mask is true where the pixel lies on the image and inside the model's domain.
        """
        ...
