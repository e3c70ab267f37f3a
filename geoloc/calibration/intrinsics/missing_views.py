"""Which views of a board a calibration still lacks: where in the picture, tilted which way, how near."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.calibration.intrinsics.coverage import coverage_of, map_pixels
from geoloc.calibration.intrinsics.initial_guess import angle_between, first_guess
from geoloc.calibration.intrinsics.selection import alike
from geoloc.calibration.intrinsics.views import View, corners_of

WANTED_VIEWS = 30
_ZONE_VIEWS = 3
"""Boards over a place of a ninth of the picture, on average."""
_TILTED_VIEWS, _LEAST_TILT_DEG, _MOST_TILT_DEG = 4, 15.0, 60.0
_NEAR_VIEWS, _NEAR_PART = 6, 0.45
_MIDDLING_VIEWS, _MIDDLING_PART = 4, 0.25
_TURNED_VIEWS = 3
_ZONES = 3


class Tilt(StrEnum):
    """Which edge of the board is nearer the camera, as the picture shows it."""

    LEFT = "left"
    RIGHT = "right"
    TOP = "top"
    BOTTOM = "bottom"


class Reach(StrEnum):
    """How much of the picture's width the board takes."""

    NEAR = "near"
    """About half or more."""
    MIDDLING = "middling"
    """About a third."""
    FAR = "far"
    """Less: its corners tell little of the lens."""


class Count(StrEnum):
    """What else is counted of the views."""

    TURNED = "turned"
    """By a quarter turn."""
    ALL = "all"


@dataclass(frozen=True, slots=True)
class ShownView:
    """What one view shows.

    Attributes
    ----------
    tilt_deg : float
        Between the board's normal and the line of sight.
    tilt : Tilt or None
        None where it is held straight (below 15°), or so flat that corners are lost (above 60°).
    reach : Reach
    turned : bool
        By a quarter turn, more or less, about its own normal.
    """

    tilt_deg: float
    tilt: Tilt | None
    reach: Reach
    turned: bool


@dataclass(frozen=True, slots=True)
class NextView:
    """A view to take next; None where any will do.

    Attributes
    ----------
    zone : int
        Ninth of the picture, row by row from the top left.
    tilt : Tilt or None
    reach : Reach or None
    turned : bool
    """

    zone: int
    tilt: Tilt | None
    reach: Reach | None
    turned: bool


@dataclass(frozen=True, slots=True)
class ShownViews:
    """What all views show, and what is missing.

    Attributes
    ----------
    views : tuple of ShownView
        Those that differ.
    n_alike : int
        Views that show the board just as another one does.
    zone_views : float64 (3, 3)
        How many views cover a place of each ninth, on average.
    covered : int64 (rows, columns)
        How many views cover each cell of `map_pixels`.
    lacking : mapping of Tilt, Reach or Count to int
        Kind of view → how many are missing.
    lacking_zones : mapping of int to int
        Ninth of the picture, row by row from the top left → how many views are missing there.
    """

    views: tuple[ShownView, ...]
    n_alike: int
    zone_views: FloatArray
    covered: IntArray
    lacking: Counter[Tilt | Reach | Count]
    lacking_zones: Counter[int]

    @property
    def n_missing(self) -> int:
        """How many views more are needed: one view can make up for several lacks."""
        zones = self.lacking_zones.total()
        tilts = sum(self.lacking[tilt] for tilt in Tilt)
        reaches = sum(self.lacking[reach] for reach in Reach)
        # A board lies over two ninths or so, and is tilted one way.
        return max(-(-zones // 2), tilts, reaches, self.lacking[Count.TURNED], self.lacking[Count.ALL])

    def next_views(self, n: int) -> tuple[NextView, ...]:
        """Give the n views that help most, each as if those before it had been taken."""
        left, zones, found = self.lacking.copy(), self.zone_views.ravel().copy(), list[NextView]()
        while len(found) < min(n, self.n_missing):
            zone = int(zones.argmin())
            tilt = max(Tilt, key=lambda t: left[t])
            reach = max(Reach, key=lambda r: left[r])
            wants_turned = left[Count.TURNED] > 0
            view = NextView(
                zone, tilt if left[tilt] > 0 else None, reach if left[reach] > 0 else None, wants_turned
            )
            found.append(view)
            zones[zone] += 1
            left -= Counter({tilt: 1, reach: 1, Count.TURNED: 1})
        return tuple(found)


def shown_views(views: Sequence[View], width_px: int, height_px: int) -> ShownViews:
    """Look at what views of a board show.

    Tilts come from poses with the first camera that fits (`first_guess`): good to some degrees.

    Raises
    ------
    CalibrationError
        If the boards are seen from behind: the pictures are mirrored.
    """
    copies = alike(views, width_px, np.full(len(views), np.nan))
    kept = [view for number, view in enumerate(views) if number not in copies]
    cells = map_pixels(width_px, height_px)
    covered = np.zeros(cells.shape[:2], dtype=np.int64)
    shown = []
    if kept:
        corners = corners_of(kept)
        _, poses = first_guess(corners, width_px, height_px)
        middle = poses.position_m + poses.rotation @ np.append(corners.middle_m, 0.0)
        for number, view in enumerate(kept):
            mine = coverage_of(corners_of([view]), np.ones(len(view.pixel_px), bool), width_px, height_px)
            covered += mine.covers(cells)
            shown.append(_shown(view, poses.rotation[number], middle[number], width_px))
    zone_views = np.array(
        [
            [part.mean() for part in np.array_split(band, _ZONES, axis=1)]
            for band in np.array_split(covered, _ZONES)
        ]
    )
    return ShownViews(
        tuple(shown), len(copies), zone_views, covered, _lacking(shown), _lacking_zones(zone_views)
    )


def _shown(view: View, rotation: FloatArray, middle_m: FloatArray, width_px: int) -> ShownView:
    sight, normal = middle_m / np.linalg.norm(middle_m), rotation[:, 2]
    angle = float(np.degrees(angle_between(normal, sight)))
    # Where the normal leans to, the board comes nearer.
    right, down = (normal - sight)[:2]
    if abs(right) > abs(down):
        edge = Tilt.RIGHT if right > 0.0 else Tilt.LEFT
    else:
        edge = Tilt.BOTTOM if down > 0.0 else Tilt.TOP
    part = float(np.ptp(view.pixel_px, axis=0).max()) / width_px
    reach = Reach.NEAR if part >= _NEAR_PART else Reach.MIDDLING if part >= _MIDDLING_PART else Reach.FAR
    return ShownView(
        tilt_deg=angle,
        tilt=edge if _LEAST_TILT_DEG <= angle <= _MOST_TILT_DEG else None,
        reach=reach,
        turned=bool(abs(rotation[1, 0]) > abs(rotation[0, 0])),
    )


def _lacking(shown: Sequence[ShownView]) -> Counter[Tilt | Reach | Count]:
    wanted: Counter[Tilt | Reach | Count] = Counter(dict.fromkeys(Tilt, _TILTED_VIEWS))
    wanted.update({Reach.NEAR: _NEAR_VIEWS, Reach.MIDDLING: _MIDDLING_VIEWS})
    wanted.update({Count.TURNED: _TURNED_VIEWS, Count.ALL: WANTED_VIEWS})
    seen: Counter[Tilt | Reach | Count] = Counter(s.tilt for s in shown if s.tilt is not None)
    seen.update(s.reach for s in shown)
    seen.update({Count.TURNED: sum(s.turned for s in shown), Count.ALL: len(shown)})
    return wanted - seen


def _lacking_zones(zone_views: FloatArray) -> Counter[int]:
    return Counter({zone: max(_ZONE_VIEWS - int(n), 0) for zone, n in enumerate(zone_views.ravel().tolist())})
