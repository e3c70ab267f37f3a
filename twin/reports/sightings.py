"""The sightings of one object, as the store keeps them, and what each camera had of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray, TextArray
from geoloc.earth.geodesy import wrap_deg
from geoloc.rig.rig import Rig

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Frames:
    """The sightings of one object, in order of time.

    Attributes
    ----------
    camera, kind, rejected : str (n,)
        `kind` is ``foot`` or ``box``; `rejected` is "" where the sighting took part, else the reason.
    frame, epoch_ns : int64 (n,)
    pixel_px : float64 (n, 2)
    range_m, speed_mps : float64 (n,)
        NaN where unknown.
    residual_px : float64 (n, 2)
        Seen minus expected, right and down. NaN for methods of one frame.
    eye_m : float64 (n, 2)
        The camera's place, EPSG:25833. NaN for methods of one frame.
    alone_m : float64 (n, 2)
        Where this sighting alone puts the object, EPSG:25833. NaN where it cannot.
    turn_deg : float64 (n,)
        How much further to the right than the estimate the camera saw the object, as an angle in plan.
        NaN where `residual_px` is.
    """

    camera: TextArray
    frame: IntArray
    epoch_ns: IntArray
    kind: TextArray
    pixel_px: FloatArray
    range_m: FloatArray
    speed_mps: FloatArray
    residual_px: FloatArray
    eye_m: FloatArray
    alone_m: FloatArray
    turn_deg: FloatArray
    rejected: TextArray

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which took part, as far as the store keeps it."""
        return np.asarray(self.rejected == "")


@dataclass(frozen=True, slots=True)
class CameraShare:
    """What one camera saw of the object: counts, and the span of range and RMS residual of those used."""

    camera: str
    n_used: int
    n_rejected: int
    range_min_m: float
    range_max_m: float
    rms_px: float


def frames_of(rows: Sequence[Row], rig: Rig) -> Frames:
    """Bring rows of the table ``sighting`` and the drive's rig together."""

    def numbers(*names: str) -> FloatArray:
        # None becomes NaN.
        return np.array([[row[name] for name in names] for row in rows], dtype=np.float64).reshape(
            len(rows), len(names)
        )

    def texts(name: str) -> TextArray:
        return np.array([row[name] for row in rows], dtype=np.str_)

    def whole(name: str) -> IntArray:
        return np.array([row[name] for row in rows], dtype=np.int64)

    residual = numbers("residual_u_px", "residual_v_px")
    camera, pixel = texts("camera"), numbers("u_px", "v_px")
    return Frames(
        camera=camera,
        frame=whole("frame"),
        epoch_ns=whole("epoch_ns"),
        kind=texts("kind"),
        pixel_px=pixel,
        range_m=numbers("range_m")[:, 0],
        speed_mps=numbers("speed_mps")[:, 0],
        residual_px=residual,
        eye_m=numbers("eye_east_m", "eye_north_m"),
        alone_m=numbers("east_m", "north_m"),
        turn_deg=_turn_deg(rig, camera, pixel, residual),
        rejected=texts("rejected"),
    )


def _turn_deg(rig: Rig, camera: TextArray, pixel_px: FloatArray, residual_px: FloatArray) -> FloatArray:
    """Angle in the rig's plane, clockwise from above, from the expected to the seen ray."""
    turn = np.full(camera.size, np.nan)
    has_residual = np.isfinite(residual_px).all(axis=1)
    for name in np.unique(camera[has_residual]):
        rows = np.flatnonzero(has_residual & (camera == name))
        sighted, expected = (
            _azimuth_deg(rig, str(name), pixel)
            for pixel in (pixel_px[rows], pixel_px[rows] - residual_px[rows])
        )
        turn[rows] = wrap_deg(sighted - expected)
    return turn


def _azimuth_deg(rig: Rig, name: str, pixel_px: FloatArray) -> FloatArray:
    camera = rig.camera(name)
    ray = camera.model.camera_ray_from_pixel(pixel_px)[0] @ camera.rig_R_camera.T
    return np.asarray(np.degrees(np.arctan2(-ray[:, 1], ray[:, 0])))


def cameras_of(frames: Frames) -> tuple[CameraShare, ...]:
    """Count what each camera had, in alphabetical order."""
    shares = []
    for name in np.unique(frames.camera):
        mine = frames.camera == name
        used = mine & frames.used
        ranges = frames.range_m[used & np.isfinite(frames.range_m)]
        square = np.sum(frames.residual_px[used] ** 2, axis=1)
        square = square[np.isfinite(square)]
        shares.append(
            CameraShare(
                camera=str(name),
                n_used=int(used.sum()),
                n_rejected=int((mine & ~used).sum()),
                range_min_m=float(ranges.min()) if ranges.size else float("nan"),
                range_max_m=float(ranges.max()) if ranges.size else float("nan"),
                # Of one axis, as a pixel's sigma is.
                rms_px=float(np.sqrt(square.mean() / 2.0)) if square.size else float("nan"),
            )
        )
    return tuple(shares)
