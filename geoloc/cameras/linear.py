"""Linear terms between the ideal image plane and the pixels: a sensor not quite square to its lens."""

from __future__ import annotations

from typing import NamedTuple

from geoloc.cameras.base import Columns, FloatArray

_SINGULAR = 1e-6


class LinearTerms(NamedTuple):
    """``[u - cx, v - cy] = [[c, d], [e, 1]] @ [x, y]``: column first, as NVIDIA DriveWorks has it.

    OCamCalib puts the row first: ``geoloc.calibration_files.ocamcalib`` converts.
    """

    c: float
    d: float
    e: float

    @property
    def identity(self) -> bool:
        """Whether they change nothing."""
        return self == (1.0, 0.0, 0.0)

    @property
    def determinant(self) -> float:
        """Of the matrix."""
        return self.c - self.d * self.e

    @property
    def singular(self) -> bool:
        """Whether the matrix has no usable inverse."""
        return not abs(self.determinant) >= _SINGULAR

    def offset_from_plane(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels from the principal point of points in the plane."""
        return self.c * x + self.d * y, self.e * x + y

    def plane_from_offset(self, du_px: FloatArray, dv_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points in the plane of pixels from the principal point."""
        if self.identity:
            return du_px, dv_px
        det = self.determinant
        return (du_px - self.d * dv_px) / det, (self.c * dv_px - self.e * du_px) / det

    def by_pixel(self, by_x: Columns, by_y: Columns) -> tuple[Columns, Columns]:
        """Derivatives by u and v from those by x and y."""
        if self.identity:
            return by_x, by_y
        det = self.determinant
        pairs = list(zip(by_x, by_y, strict=True))
        by_u = Columns(*((x - self.e * y) / det for x, y in pairs))
        by_v = Columns(*((self.c * y - self.d * x) / det for x, y in pairs))
        return by_u, by_v
