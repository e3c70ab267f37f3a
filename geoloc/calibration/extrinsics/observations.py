"""What a calibration of extrinsics is made from: tags, and pictures of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from geoloc.arrays import FloatArray, IntArray

CORNER_SIGMA_PX = 0.2
"""A corner of a printed tag, refined to sub-pixels; its residuals give the true figure."""


@dataclass(frozen=True, slots=True)
class Tag:
    """One AprilTag and what a tape or a total station says of it.

    Its own frame: origin in its middle, x right and y down as printed, z into the paper.

    Attributes
    ----------
    id : int
    size_m : float
        Edge of the black square.
    centre_m : float64 (3,)
        In the rig frame (FLU, from the ground below the middle of the rear axle); NaN where not measured.
    centre_sigma_m : float
        Of every measured coordinate.
    on_floor : bool
        Lies on the floor that the car stands on: z is 0.
    marks_m, mark_places_m : float64 (k, 3)
        Other points that were measured, corners for one: in the tag's frame, and where they are in the rig
        frame.
    label : str
        What messages call it; default: by its id.
    """

    id: int
    size_m: float
    centre_m: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    centre_sigma_m: float = 0.005
    on_floor: bool = False
    marks_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    mark_places_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    label: str = ""

    @property
    def name(self) -> str:
        """What messages call it."""
        return self.label or f"tag {self.id}"

    @property
    def is_board(self) -> bool:
        """Whether it is a board, whose corners have numbers, and no single square."""
        return bool(self.label)

    @property
    def has_marks(self) -> bool:
        """Whether other points than its middle were measured."""
        return bool(np.isfinite(self.mark_places_m).any())

    def points_m(self) -> FloatArray:
        """Measured points (1 + k, 3) in the tag's frame: its middle, and the other ones."""
        return np.vstack([np.zeros(3), self.marks_m])

    def places_m(self) -> FloatArray:
        """Where `points_m` were measured in the rig frame (1 + k, 3); NaN where they were not."""
        return np.vstack([self.centre_m, self.mark_places_m])

    def corners_m(self) -> FloatArray:
        """Corners (4, 3) in the tag's frame: top left, top right, bottom right, bottom left."""
        half = self.size_m / 2.0
        return np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])


@dataclass(frozen=True, slots=True)
class TagPicture:
    """The tags that one picture shows.

    Attributes
    ----------
    name : str
        The picture's file, for messages.
    camera : str
    on_car : bool
        False for a camera that was carried around: each of its pictures has a place of its own.
    tag_ids : int64 (n,)
    corners_px : float64 (n, 4, 2)
        In the order of `Tag.corners_m`; (0, 0) is the centre of the first pixel.
    points_m : float64 (n, 4, 3) or None
        The four points in the target's frame where they are not a tag's own corners: of a board, four of its
        inner corners at a time.
    """

    name: str
    camera: str
    on_car: bool
    tag_ids: IntArray
    corners_px: FloatArray
    points_m: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Sigmas:
    """One-sigma figures that are not a tag's own.

    Attributes
    ----------
    corner_px : float
        Start; the adjustment replaces it by what each camera's residuals say.
    floor_m : float
        How flat the floor is where tags lie.
    size : float
        Relative error that all tags' sizes share: a printer's scale.
    """

    corner_px: float = CORNER_SIGMA_PX
    floor_m: float = 0.003
    size: float = 0.001


@dataclass(frozen=True, slots=True)
class Pose:
    """Rotation (3, 3) and translation (3,) in metres of a body in another frame: ``x = R b + t``."""

    R: FloatArray
    t_m: FloatArray

    def after(self, inner: Pose) -> Pose:
        """Pose of what is at `inner` inside this body."""
        return Pose(self.R @ inner.R, self.R @ inner.t_m + self.t_m)

    def inverse(self) -> Pose:
        """The outer frame as seen from this body."""
        return Pose(self.R.T, -self.R.T @ self.t_m)


@dataclass(frozen=True, slots=True)
class Sighting:
    """One tag in one picture, as rays.

    Attributes
    ----------
    camera : str
    view : str
        The camera, or the picture of a camera that was carried around.
    tag : int
    picture : str
    points_m : float64 (4, 3)
        The points in the tag's frame.
    ray : float64 (4, 3)
        Unit rays of the corners in the camera frame.
    px_from_ray : float64 (4, 2, 3)
        Turns a small difference of unit rays into pixels: the pseudo-inverse of the ray's slopes by pixel.
    """

    camera: str
    view: str
    tag: int
    picture: str
    points_m: FloatArray
    ray: FloatArray
    px_from_ray: FloatArray


def by_view(sightings: list[Sighting]) -> Mapping[str, list[Sighting]]:
    """Sightings of each view."""
    found: dict[str, list[Sighting]] = {}
    for sighting in sightings:
        found.setdefault(sighting.view, []).append(sighting)
    return found
