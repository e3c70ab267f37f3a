"""The error budget: one sigma of each source, and how far that moves a foot on the road."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.cameras.nominal import LensSigmas, lens_moves
from geoloc.locate.feet import Axes, Enu, Feet
from geoloc.rig.rig import RigCamera
from geoloc.trajectory.poses import Poses

Pair = tuple[FloatArray, FloatArray]

_RADIANS = np.pi / 180.0

LENS_SOURCES = ("focal length", "centre across", "centre down", "distortion", "distortion outside")
LIKELY_READOUT_MS = 16.0
"""Global shutters take 0, sensors of 30 frames a second up to 33 ms."""


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """One-sigma noise of each source, and why (``docs/error-budget.md``).

    Random sources are independent from frame to frame; systematic ones are the same for all frames of a
    camera or of a drive, so that averaging does not remove them.
    """

    pixel_px: float = 1.5
    """Annotator and detector, random."""
    pitch_jitter_deg: float = 0.15
    """Body motion against the ground plane, random."""
    roll_jitter_deg: float = 0.15
    """Body motion against the ground plane, random."""
    ground_height_m: float = 0.05
    """Kerb and camber: the foot's height over the rig's plane, systematic for an object."""
    ground_slope_deg: float = 0.4
    """Grade of the road between car and object, systematic for an object."""
    ground_fall: float = 0.03
    """Fall across the road, a share of the distance to the side: a crown between car and object, or
    superelevation that ends at the shoulder. Systematic for an object; only single frames use it."""
    boresight_deg: float = 0.2
    """Mounting error of a camera about each axis, systematic for a camera."""
    time_ms: float = 5.0
    """Camera clock against GNSS, systematic for a drive."""
    lever_arm_m: float = 0.015
    """Antenna positions on the car, systematic for a drive: a tape measure on a car body."""
    camera_position_m: float = 0.01
    """Position of a camera in the rig, systematic for a camera: what extrinsic calibration reaches."""
    readout_ms: float = 10.0
    """Rolling shutter, top to bottom, where the drive does not state it: one sigma about `LIKELY_READOUT_MS`,
    systematic for a drive. Only `adjust` uses it."""
    focal_share: float = 0.0
    """Focal length of every camera, a share of it, systematic for a camera; 0: as each camera states its own
    (`geoloc.cameras.nominal.LensSigmas`), exact where it was calibrated. So are the next two."""
    centre_px: float = 0.0
    """Principal point, each axis."""
    distortion_share: float = 0.0
    """Distance from the centre, half the picture's longer side away, as a share of it."""
    box_share: float = 0.05
    """Noise of a box's centre as a share of its height, beside `pixel_px`: random. Only `adjust` uses it."""

    def lens_of(self, camera: RigCamera) -> LensSigmas:
        """How far a camera's lens may be off: as stated here, else as the camera states it."""
        stated = (self.focal_share, self.centre_px, self.distortion_share)
        own = camera.lens
        kept = (own.focal_share, own.centre_px, own.distortion_share)
        return LensSigmas(*(mine or its for mine, its in zip(stated, kept, strict=True)))


class SourceMoves(NamedTuple):
    """How far one sigma of each source moves feet, east and north: float64 (n,) each."""

    random: list[Pair]
    of_camera: dict[str, Pair]
    shared: dict[str, Pair]


def source_moves(
    camera: RigCamera, feet: Feet, axes: Axes, enu_m: Enu, poses: Poses, budget: ErrorBudget
) -> SourceMoves:
    """Work out the moves of one camera's feet, made with the slopes of their rays."""
    moves, (east, north, up) = FootMoves(camera, feet), enu_m
    (fe, fn, fu), (le, ln, _) = axes.forward, axes.left
    none = np.zeros_like(east)

    def enu(sigma: float, move: Move) -> Pair:
        return sigma * (fe * move.x + le * move.y), sigma * (fn * move.x + ln * move.y)

    def scaled(sigma: float | FloatArray, e: FloatArray, n: FloatArray) -> Pair:
        return sigma * e, sigma * n

    random = [
        enu(budget.pixel_px, moves.by_pixel(0)),
        enu(budget.pixel_px, moves.by_pixel(1)),
        enu(_RADIANS * budget.pitch_jitter_deg, moves.by_pitch()),
        enu(_RADIANS * budget.roll_jitter_deg, moves.by_roll()),
    ]
    boresight = _RADIANS * budget.boresight_deg
    of_camera = {
        "boresight pitch": enu(boresight, moves.by_boresight(0)),
        "boresight yaw": enu(boresight, moves.by_boresight(1)),
        "boresight roll": enu(boresight, moves.by_boresight(2)),
        "camera height": enu(budget.camera_position_m, moves.by_camera_height()),
    }
    lens = budget.lens_of(camera)
    if not lens.is_exact:
        shift = lens_moves(camera.model, feet.pixel_px)
        for k, (what, sigma) in enumerate(zip(LENS_SOURCES, lens.of_errors(), strict=True)):
            u, v = (moves.by_pixel(axis) for axis in (0, 1))
            both = Move(*(shift[:, 0, k] * a + shift[:, 1, k] * b for a, b in zip(u, v, strict=True)))
            of_camera[what] = enu(sigma, both)
    climb = np.hypot(_RADIANS * budget.ground_slope_deg * moves.reach_m(), budget.ground_fall * feet.y_m)
    # A foot that stands higher moves along its ray and, on a tilted road, sideways with the road's normal.
    rise_e, rise_n = (
        own + axis for own, axis in zip(enu(1.0, moves.by_ground_height()), axes.normal, strict=True)
    )
    shared = {
        "time": scaled(budget.time_ms * 1e-3 * poses.speed_mps, fe, fn),
        "gnss east": (poses.sigma_horizontal_m, none),
        "gnss north": (none, poses.sigma_horizontal_m),
        "heading": scaled(_RADIANS * poses.sigma_heading_deg, north, -east),
        # The plane turns with the pose: no sliding along rays, the point keeps its place on the plane. The
        # axis of pitch lies level, to the left of the heading; that of roll is the rig's own x.
        "pose pitch": scaled(_RADIANS * poses.sigma_pitch_deg * up, *axes.heading),
        "pose roll": scaled(_RADIANS * poses.sigma_roll_deg, fn * up - fu * north, fu * east - fe * up),
        "lever arm x": scaled(budget.lever_arm_m, fe, fn),
        "lever arm y": scaled(budget.lever_arm_m, le, ln),
        "ground height": scaled(budget.ground_height_m, rise_e, rise_n),
        "ground slope": scaled(climb, rise_e, rise_n),
    }
    return SourceMoves(random, of_camera, shared)


class Move(NamedTuple):
    """Moves of feet within the rig's plane, metres along its x and y axes."""

    x: FloatArray
    y: FloatArray


class FootMoves:
    """How the feet of one camera move; the methods name what is wrong."""

    def __init__(self, camera: RigCamera, feet: Feet) -> None:
        self._camera, self._feet = camera, feet
        self._height_m = float(camera.rig_t_camera_m[2])

    def _slide(self, x: FloatArray | float, y: FloatArray | float, z: FloatArray | float) -> Move:
        """Bring displaced points back to the plane along their rays."""
        return Move(np.asarray(x - z * self._feet.slope_x), np.asarray(y - z * self._feet.slope_y))

    def by_pixel(self, column: int) -> Move:
        """A pixel of u (0) or v (1)."""
        f = self._feet
        by = f.by_v if column else f.by_u
        if by is None:
            raise ValueError("the feet were made without the slopes of their rays")
        length = self._height_m * np.sqrt(1.0 + f.slope_x * f.slope_x + f.slope_y * f.slope_y)
        return self._slide(length * by.x, length * by.y, length * by.z)

    def by_roll(self) -> Move:
        """A radian of the car's body about the rig's x."""
        return self._slide(0.0, 0.0, self._feet.y_m)

    def by_pitch(self) -> Move:
        """A radian of the car's body about the rig's y."""
        return self._slide(0.0, 0.0, -self._feet.x_m)

    def by_boresight(self, axis: int) -> Move:
        """A radian of the camera in its mount about its own x (pitch), y (yaw) or z (roll)."""
        f, down = self._feet, -self._height_m
        rx, ry, rz = self._camera.rig_R_camera[:, axis].tolist()
        # The axis times the way from the camera to the foot, (slope_x, slope_y, 1) · -height.
        return self._slide(
            down * (ry - rz * f.slope_y),
            down * (rz * f.slope_x - rx),
            down * (rx * f.slope_y - ry * f.slope_x),
        )

    def by_camera_height(self) -> Move:
        """A metre that the camera sits higher."""
        return self._slide(0.0, 0.0, 1.0)

    def by_ground_height(self) -> Move:
        """A metre that the foot stands above the plane; its own rise comes on top."""
        return Move(self._feet.slope_x, self._feet.slope_y)

    def reach_m(self) -> FloatArray:
        """Rise of the foot a radian that the road between car and foot climbs."""
        return np.asarray(np.sqrt(self._feet.x_m**2 + self._feet.y_m**2))
