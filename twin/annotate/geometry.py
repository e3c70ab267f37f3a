"""Where a sign stands by its clicks, where it must appear in other pictures, and which to click next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.errors import GeolocError
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.locate.single_frame import locate_single_frame
from geoloc.locate.visibility import points_in_rig, seen_by
from geoloc.rig.rig import Rig
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.frames.stamp_files import NO_STAMP

FARTHEST_M = 60.0
"""Further away nobody sees a foot to the pixel."""
CLICKS = 6
"""So many clicks a sign are offered; docs/annotate.md measures what they give."""
FACTORS = (1.0, 1.5, 2.3, 1.25, 1.9, 3.0)
"""Distances at which clicks are offered, in those of the nearest picture of the camera: near ones say where
across the road a sign stands, far ones how the camera is mounted. One camera alone gets all of them."""
_MARGIN_PX = 60.0
"""Nearer to the edge of a picture than this no click is offered: the sign may just be outside."""
_ALIKE = 1.2
"""A click counts for an offer whose distance it has to within this factor."""
_CAMERA_WEIGHT = 0.5
"""How much the cameras' usual miss counts beside one click of the sign itself."""


class Click(NamedTuple):
    """One measured mark."""

    object: str
    camera: str
    frame: int
    kind: Kind
    pixel_px: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sign stands, in the datum of the drive's own track.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float
        Of its foot; of the middle of its face where only that was marked.
    is_face : bool
    sigma_m : float
        Of the plan position; NaN of a single click.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    is_face: bool
    sigma_m: float


class Seen(NamedTuple):
    """A place in the pictures of one camera that have it in view: a row each.

    Attributes
    ----------
    frame : int64 (k,)
    pixel_px : float64 (k, 2)
    range_m : float64 (k,)
    """

    frame: IntArray
    pixel_px: FloatArray
    range_m: FloatArray


class Offer(NamedTuple):
    """A picture that is worth a click."""

    camera: str
    frame: int
    range_m: float


_NOTHING = Seen(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0))


class Geometry:
    """A drive's poses at its pictures.

    Parameters
    ----------
    rig : Rig
    trajectory : Trajectory or None
        Without one nothing has a place.
    frames, epoch_ns : mapping of camera to int64 (k,)
        Pictures and when they were exposed.
    """

    def __init__(
        self,
        rig: Rig,
        trajectory: Trajectory | None,
        frames: Mapping[str, IntArray],
        epoch_ns: Mapping[str, IntArray],
    ) -> None:
        self._rig = rig
        self._trajectory = trajectory
        self._frames = frames
        self._epochs = epoch_ns
        self._poses = (
            {}
            if trajectory is None
            else {camera: _known(trajectory.poses_at(epochs), epochs) for camera, epochs in epoch_ns.items()}
        )

    def place(self, clicks: Sequence[Click]) -> Place | None:
        """Place one sign by its clicks: by its feet if it has any, else by its faces.

        One foot meets the road's plane; several clicks are crossed by the adjustment that ingest-drive runs.

        Returns
        -------
        Place or None
            None where they do not give one: a foot above the horizon, one face, pictures without poses.
        """
        feet = [click for click in clicks if click.kind is Kind.FOOT]
        used = [click for click in feet or clicks if self._row(click.camera, click.frame) is not None]
        if self._trajectory is None or not used:
            return None
        return self._crossed(used) if len(used) > 1 else self._on_the_road(used[0])

    def seen(self, place: Place, camera: str, margin_px: float = 0.0) -> Seen:
        """Project a place into all pictures of a camera that have it in view, so far from their edges."""
        poses = self._poses.get(camera)
        if poses is None:
            return _NOTHING
        rows = np.flatnonzero(poses.valid)
        one = np.ones(rows.size)
        point = points_in_rig(
            poses, rows, one * place.latitude_deg, one * place.longitude_deg, one * place.height_m
        )
        pixel, range_m, shown = seen_by(self._rig.camera(camera), point, margin_px)
        shown &= range_m <= FARTHEST_M
        return Seen(self._frames[camera][rows[shown]], pixel[shown], range_m[shown])

    def misses(self, place: Place, clicks: Sequence[Click]) -> dict[Click, FloatArray]:
        """Clicked minus projected, pixels, of clicks of the kind that the place is of."""
        found: dict[Click, FloatArray] = {}
        for camera in {click.camera for click in clicks}:
            seen = self.seen(place, camera)
            rows = {frame: k for k, frame in enumerate(seen.frame.tolist())}
            for click in clicks:
                is_of_place = (click.kind is Kind.BOX) == place.is_face
                if click.camera == camera and click.frame in rows and is_of_place:
                    found[click] = np.asarray(click.pixel_px) - seen.pixel_px[rows[click.frame]]
        return found

    def offers(self, place: Place, clicks: Sequence[Click]) -> list[Offer]:
        """Pictures to click next, the best first; none when `CLICKS` are reached."""
        wanted: list[tuple[int, Offer]] = []
        views = {camera: self.seen(place, camera, _MARGIN_PX) for camera in self._poses}
        nearness = {camera: seen.range_m.min(initial=np.inf) for camera, seen in views.items()}.__getitem__
        # Two cameras at the most, those that come nearest: each is to be clicked near and far.
        chosen = sorted((camera for camera in views if views[camera].frame.size), key=nearness)[:2]
        for camera in chosen:
            seen = views[camera]
            own = {click.frame for click in clicks if click.camera == camera}
            left = [seen.range_m[seen.frame == frame][0] for frame in own if (seen.frame == frame).any()]
            taken = set(own)
            for order, factor in enumerate(FACTORS[: CLICKS // len(chosen)]):
                target = factor * float(seen.range_m.min())
                near = [r for r in left if max(r / target, target / r) <= _ALIKE]
                if near:
                    left.remove(min(near, key=lambda r: abs(r - target)))
                    continue
                free = np.array([frame not in taken for frame in seen.frame.tolist()], dtype=np.bool_)
                if free.any():
                    k = int(np.argmin(np.where(free, np.abs(seen.range_m - target), np.inf)))
                    taken.add(int(seen.frame[k]))
                    wanted.append((order, Offer(camera, int(seen.frame[k]), float(seen.range_m[k]))))
        wanted.sort(key=lambda one: one[0])
        return [offer for _, offer in wanted][: max(CLICKS - len(clicks), 0)]

    def _row(self, camera: str, frame: int) -> int | None:
        poses = self._poses.get(camera)
        if poses is None:
            return None
        row = int(np.searchsorted(self._frames[camera], frame))
        is_there = row < self._frames[camera].size and self._frames[camera][row] == frame
        return row if is_there and poses.valid[row] else None

    def _sightings(self, clicks: Sequence[Click]) -> tuple[Sightings, IntArray]:
        rows = [self._row(click.camera, click.frame) or 0 for click in clicks]
        epochs = [self._epochs[click.camera][row] for click, row in zip(clicks, rows, strict=True)]
        cameras = np.array([click.camera for click in clicks])
        pixels = np.array([click.pixel_px for click in clicks], dtype=np.float64)
        return Sightings(cameras, pixels), np.array(epochs, dtype=np.int64)

    def _on_the_road(self, click: Click) -> Place | None:
        if click.kind is not Kind.FOOT or self._trajectory is None:
            return None
        sightings, epoch_ns = self._sightings([click])
        found = locate_single_frame(self._rig, sightings, self._trajectory.poses_at(epoch_ns))
        if not found.valid[0]:
            return None
        place = (float(found.latitude_deg[0]), float(found.longitude_deg[0]), float(found.height_m[0]))
        return Place(*place, is_face=False, sigma_m=float("nan"))

    def _crossed(self, clicks: Sequence[Click]) -> Place | None:
        if self._trajectory is None:
            return None
        sightings, epoch_ns = self._sightings(clicks)
        same = np.zeros(len(clicks), dtype=np.int64)
        kinds = np.array([click.kind.value for click in clicks])
        try:
            found = adjust(Observations(self._rig, sightings, kinds, same, epoch_ns, self._trajectory))
        except GeolocError:
            return None
        if found.reason[0]:
            return None
        place = (float(found.latitude_deg[0]), float(found.longitude_deg[0]), float(found.height_m[0]))
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(found.covariance_m2[0])[-1]))
        return Place(*place, is_face=clicks[0].kind is Kind.BOX, sigma_m=sigma_m)


def correction_px(own: Mapping[Click, FloatArray], of_camera: FloatArray, frame: int) -> FloatArray:
    """What to add to a projection in a picture of a camera.

    Cameras are mounted a little otherwise than their calibration says, which moves all that they see alike.

    Parameters
    ----------
    own : mapping of Click to float64 (2,)
        Misses of the sign's own clicks in this camera.
    of_camera : float64 (2,)
        Mean miss of other signs' clicks in it; NaN where there are none.
    frame : int
        Nearer clicks count for more.
    """
    total, weight = np.zeros(2), 0.0
    if np.isfinite(of_camera).all():
        total, weight = total + _CAMERA_WEIGHT * of_camera, weight + _CAMERA_WEIGHT
    near = min((abs(click.frame - frame) for click in own), default=0)
    for click, miss in own.items():
        share = (1.0 + near) / (1.0 + abs(click.frame - frame))
        total, weight = total + share * miss, weight + share
    return total / weight if weight else total


def _known(poses: Poses, epoch_ns: IntArray) -> Poses:
    stamped: BoolArray = epoch_ns != NO_STAMP
    return replace(poses, valid=poses.valid & stamped)
