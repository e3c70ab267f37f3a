"""In how many images drives had places in view: worked out once for each drive and place, and kept."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, metres_per_degree, utm33_from_geographic
from geoloc.locate.visibility import views
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import Poses
from twin.matching.cells import NOWHERE, Grid, are_among, cells_about, cells_of, cells_touched
from twin.matching.config import MatchConfig
from twin.matching.kept import Kept, digest
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site

VIEWS = "views"
"""Kind of the parts that are kept of drives."""
_MOST_FACES, _MOST_DIRECTIONS = 6, 12
_SIDEWAYS, _ALIKE = 0.0, float(np.nextafter(0.5, 0.0))
"""Cosine that is to be exceeded: of a plate's face less than 90° off; of where a pole was seen from 60°."""
COARSE_DEG = 0.002
"""To so many degrees it is enough to know where a drive was, to read NVDB's signs near it."""
_WIDER = 1.1
"""A metre of the grid is a metre on the ground to a few per cent."""


@dataclass(frozen=True, slots=True)
class PlaceViews:
    """Camera images that had places in view, in which the camera stood in a given direction from them.

    Attributes
    ----------
    place : int64 (k,)
        Index of the place, one row an image.
    azimuth_deg : float64 (k,)
        From the place to the camera, from true north.
    """

    place: IntArray
    azimuth_deg: FloatArray


def views_of_places(
    rig: Rig,
    poses: Poses,
    east: FloatArray,
    north: FloatArray,
    config: MatchConfig,
    *,
    cameras: Sequence[str],
) -> PlaceViews:
    """Find the camera images that had each place (EPSG:25833) in view, and where the car stood from it."""
    place, azimuth = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    if len(east):
        lat, lon = geographic_from_utm33(east, north)
        for seen in views(rig, poses, lat, lon, max_range_m=config.view_range_m, cameras=list(cameras)):
            per_east, per_north = metres_per_degree(lat[seen.site])
            de = (poses.longitude_deg[seen.pose] - lon[seen.site]) * per_east
            dn = (poses.latitude_deg[seen.pose] - lat[seen.site]) * per_north
            place.append(seen.site)
            azimuth.append(np.rad2deg(np.arctan2(de, dn)) % 360.0)
    return PlaceViews(np.concatenate(place), np.concatenate(azimuth))


@dataclass(frozen=True, slots=True)
class Places:
    """Places that drives are asked about.

    Attributes
    ----------
    place_m : float64 (n, 2)
        EPSG:25833.
    fronts_deg : float64 (n, k)
        Azimuths from true north from which a place is seen from its front; NaN beyond the last one. Where
        none is known every side counts as the front.
    beyond : float
        Cosine of the angle to such an azimuth below which a view is one of the front, exclusive.
    """

    place_m: FloatArray
    fronts_deg: FloatArray
    beyond: float

    @classmethod
    def of_sites(cls, sites: Sequence[Site]) -> Places:
        """Sites, whose front some plate shows; a plate of unknown direction may show it anywhere."""
        fronts = np.full((len(sites), _MOST_FACES), np.nan)
        for j, site in enumerate(sites):
            known = sorted(
                {face for plate in site.plates for face in plate.faces_deg if not math.isnan(face)}
            )
            if known and all(not math.isnan(plate.faces_deg[0]) for plate in site.plates):
                # More directions than columns cannot all look away.
                fronts[j, : len(known)] = known[:_MOST_FACES]
        return cls(_coordinates(sites), fronts, _SIDEWAYS)

    @classmethod
    def of_poles(cls, poles: Sequence[ObservedPole]) -> Places:
        """Poles, whose front is within 60° of a direction in which they were seen."""
        fronts = np.full((len(poles), _MOST_DIRECTIONS), np.nan)
        for k, pole in enumerate(poles):
            fronts[k, : len(pole.seen_from_deg)] = sorted(pole.seen_from_deg)
        # To a decimetre: where one more drive has moved a pole by less, what others had in view is known.
        return cls(np.round(_coordinates(poles), 1), fronts, _ALIKE)

    def part(self, rows: IntArray) -> Places:
        """Some of them."""
        return Places(self.place_m[rows], self.fronts_deg[rows], self.beyond)

    def are_fronts(self, found: PlaceViews) -> BoolArray:
        """Which views are of the place's front."""
        turned = np.deg2rad(found.azimuth_deg[:, np.newaxis] - self.fronts_deg[found.place])
        return np.asarray(
            (np.cos(turned) > self.beyond).any(axis=1) | np.isnan(self.fronts_deg[found.place, 0])
        )

    def count(self, found: PlaceViews) -> Counts:
        """Count the views of each place."""
        n = len(self.place_m)
        of_front = found.place[self.are_fronts(found)]
        return Counts(np.bincount(found.place, minlength=n), np.bincount(of_front, minlength=n))


def _coordinates(places: Sequence[Site] | Sequence[ObservedPole]) -> FloatArray:
    return np.array([(place.east_m, place.north_m) for place in places], dtype=np.float64).reshape(-1, 2)


class Counts(NamedTuple):
    """Images of one drive in which each place was in view (n,), and those of them of its front (n,)."""

    views: IntArray
    fronts: IntArray


class Asked:
    """Places by their cells, and by all that a drive's views of them depend on.

    Parameters
    ----------
    places : Places
    """

    def __init__(self, places: Places) -> None:
        self.places = places
        rows = np.column_stack(
            [places.place_m, places.fronts_deg, np.full(len(places.place_m), places.beyond)]
        )
        hashes = [hashlib.blake2b(row.tobytes(), digest_size=16).digest() for row in rows]
        self.keys: NDArray[np.bytes_] = np.array(hashes, dtype="S16")
        self.cells = cells_of(places.place_m)
        self.grid = Grid(places.place_m)


class Watcher:
    """One drive's cameras as they passed places.

    Parameters
    ----------
    drive_id : str
    rig, poses : callables
        Read only if something has to be worked out.
    content : bytes
        What tells this rig and these poses from any others.
    cameras : sequence of str
        Those that were annotated.
    config : MatchConfig
        Of which the views depend on `view_range_m`.
    """

    def __init__(
        self,
        drive_id: str,
        rig: Callable[[], Rig],
        poses: Callable[[], Poses],
        content: bytes,
        cameras: Sequence[str],
        config: MatchConfig,
        kept: Kept,
    ) -> None:
        self._rig, self._poses, self._cameras, self._config = rig, poses, tuple(cameras), config
        self.content = content
        self._drive_id, self._kept = drive_id, kept
        rests_on = digest(content, "\n".join(cameras).encode(), repr(config.view_range_m).encode())
        known = kept.get(VIEWS, drive_id)
        self._is_new = known is None or known["rests_on"].item() != rests_on
        if known is None or self._is_new:
            known = {
                "rests_on": np.array(rests_on),
                **self._cells(),
                "coarse": self._coarse(),
                "place": np.zeros(0, dtype="S16"),
                "cell": NOWHERE,
                "views": np.zeros(0, dtype=np.int64),
                "fronts": np.zeros(0, dtype=np.int64),
            }
        self._known = known
        self._used: list[tuple[NDArray[np.bytes_], IntArray, Counts]] = []

    @property
    def cells(self) -> IntArray:
        """Cells of which it may have had some part in view."""
        return np.asarray(self._known["touched"])

    @property
    def coarse(self) -> FloatArray:
        """Where the drive was, latitude and longitude (n, 2), in units of `COARSE_DEG`."""
        return np.asarray(self._known["coarse"])

    def past(self, asked: Asked, wanted: BoolArray | None = None) -> Counts:
        """Count the images that had each place in view; 0 where a place is not wanted."""
        near = asked.grid.inside(self._known["cells"])
        if wanted is not None:
            near = near[wanted[near]]
        keys, known = asked.keys[near], self._known["place"]
        at = np.searchsorted(known, keys)
        there = (
            known[np.minimum(at, known.size - 1)] == keys if known.size else np.zeros(near.size, dtype=bool)
        )
        found = Counts(*(np.zeros(near.size, dtype=np.int64) for _ in Counts._fields))
        new = asked.places.part(near[~there])
        for name, column, fresh in zip(Counts._fields, found, self._counted(new), strict=True):
            column[there], column[~there] = self._known[name][at[there]], fresh
        self._used.append((keys, asked.cells[near], found))
        whole = Counts(*(np.zeros(len(asked.keys), dtype=np.int64) for _ in Counts._fields))
        for column, values in zip(whole, found, strict=True):
            column[near] = values
        return whole

    def keep(self, about: IntArray | None = None) -> None:
        """Leave what was asked for to the next match.

        Parameters
        ----------
        about : int64 (n,), optional
            Cells of all that was asked for; what is known of places elsewhere stays.
        """
        kept = self._known
        stays = (
            np.zeros(0, dtype=np.int64) if about is None else np.flatnonzero(~are_among(kept["cell"], about))
        )
        used = [
            *self._used,
            (kept["place"][stays], kept["cell"][stays], Counts(kept["views"][stays], kept["fronts"][stays])),
        ]
        keys, first = np.unique(np.concatenate([keys for keys, _, _ in used]), return_index=True)
        if self._is_new or not np.array_equal(keys, kept["place"]):
            cell = np.concatenate([cells for _, cells, _ in used])[first]
            counts = (np.concatenate(of_all)[first] for of_all in zip(*(c for _, _, c in used), strict=True))
            views, fronts = counts
            self._kept.put(
                VIEWS,
                self._drive_id,
                {**kept, "place": keys, "cell": cell, "views": views, "fronts": fronts},
            )

    def leave(self) -> None:
        """Leave where it drove, and what of before holds, to whoever asks for places."""
        self._kept.put(VIEWS, self._drive_id, self._known)

    def _counted(self, places: Places) -> Counts:
        if not len(places.place_m):
            return Counts(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
        east, north = places.place_m.T
        poses = self._poses()
        return places.count(
            views_of_places(self._rig(), poses, east, north, self._config, cameras=self._cameras)
        )

    def _coarse(self) -> FloatArray:
        poses = self._poses()
        place = np.stack([poses.latitude_deg, poses.longitude_deg], axis=1)
        return np.unique(np.round(place / COARSE_DEG), axis=0)

    def _cells(self) -> dict[str, IntArray]:
        """Cells that hold every place that can have been in view, and those that it did touch."""
        poses, rig = self._poses(), self._rig()
        arms = [float(np.hypot(*rig.camera(name).rig_t_camera_m[:2])) for name in self._cameras]
        reach = _WIDER * (self._config.view_range_m + max(arms, default=0.0))
        driven = np.stack(
            utm33_from_geographic(poses.latitude_deg[poses.valid], poses.longitude_deg[poses.valid]), axis=1
        )
        return {"cells": cells_about(driven, reach), "touched": cells_touched(driven, reach)}
