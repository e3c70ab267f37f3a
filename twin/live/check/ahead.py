"""NVDB's signs about the car: of a country's mirror the few square kilometres that it drives through."""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from twin.errors import StoreError, TwinError
from twin.matching.config import MatchConfig
from twin.matching.likelihood import cost_of_common
from twin.matching.sites import Site, along_the_road, codes_of_mirror, mirror_near, sites_from_mirror
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store.store import Store

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from nvdb.vegnett import Vegnett

_log = logging.getLogger("twin.live")
_EARLY_M = 300.0
"""So near to the edge of its square the signs about the next one are read: ten seconds at 30 m/s."""

Square = tuple[int, int]


class SignsAhead(Protocol):
    """NVDB's signs about a place."""

    common: Mapping[str, float]
    """What codes that are common cost, as `twin.matching.likelihood.cost_of_common` gives it."""

    def move(self, place_m: FloatArray) -> bool:
        """Tell where the car is, EPSG:25833; return whether the signs about it are known."""

    def near(self, places_m: FloatArray, reach_m: float) -> list[Site]:
        """Return the signs within so far of any of some places (n, 2), in the order of their ids."""

    def is_mirrored(self, places_m: FloatArray) -> BoolArray:
        """Whether NVDB has any sign in the neighbourhood of each place (n, 2)."""

    def close(self) -> None:
        """Read nothing more."""


class SignTree:
    """Signs, and which of them are near.

    Parameters
    ----------
    sites : sequence of Site
    """

    def __init__(self, sites: Sequence[Site]) -> None:
        self._sites = list(sites)
        self._tree: cKDTree | None = None
        if self._sites:
            from scipy.spatial import cKDTree

            self._tree = cKDTree(np.array([(site.east_m, site.north_m) for site in self._sites]))

    def __len__(self) -> int:
        return len(self._sites)

    def near(self, places_m: FloatArray, reach_m: float) -> list[Site]:
        """As `SignsAhead.near`."""
        if self._tree is None or not len(places_m):
            return []
        near: Any = self._tree.query_ball_point(places_m, reach_m)
        return [self._sites[j] for j in sorted(set(chain.from_iterable(near)))]

    def distance_m(self, places_m: FloatArray) -> FloatArray:
        """How far the nearest one is from each place; infinite where there is none."""
        if self._tree is None:
            return np.full(len(places_m), np.inf)
        return np.asarray(self._tree.query(places_m)[0])


class MirrorAhead:
    """The store's signs, read by squares of a kilometre: that of the car and the eight about it.

    The next nine are read beside, by a thread of their own, when the car comes near the edge. Who moves on
    waits for them: what the check says depends on the drive, and never on how fast a disk answers. Where the
    store cannot be read, it is tried again with each move.

    Parameters
    ----------
    store : Store
        Stays open as long as this does.
    config : MatchConfig

    Raises
    ------
    StoreError
        The store holds no signs of NVDB.
    """

    def __init__(self, store: Store, config: MatchConfig) -> None:
        self._store, self._config = store, config
        self._size_m = max(config.mirrored_m, 2 * _EARLY_M)
        with store.snapshot() as view:
            if view.fact("mirror") is None:
                raise StoreError(
                    f"The store {store.name} holds no signs of NVDB: run `twin sync-nvdb` first, or leave out"
                    " --check."
                )
            self.common: Mapping[str, float] = cost_of_common(codes_of_mirror(view), config)
            self._roads = _Roads.of(store, view.fact(VEGNETT))
        # What matching imports when it needs it would hold up the first frames.
        import scipy.optimize
        import scipy.spatial  # noqa: F401

        self._reader = ThreadPoolExecutor(1, "mirror")
        self._read: dict[Square, Future[SignTree]] = {}
        self._here = SignTree(())

    def move(self, place_m: FloatArray) -> bool:
        """As `SignsAhead.move`."""
        here = self._square(place_m)
        about = {self._square(place_m + _EARLY_M * np.array(step)) for step in _STEPS}
        for square in about - self._read.keys():
            self._read[square] = self._reader.submit(self._signs, square)
        for square in self._read.keys() - about:
            self._read.pop(square).cancel()
        try:
            self._here = self._read[here].result()
        except TwinError as error:
            _log.warning("%s", error)
            del self._read[here]
            return False
        return True

    def near(self, places_m: FloatArray, reach_m: float) -> list[Site]:
        """As `SignsAhead.near`; signs a kilometre and more from the car may be left out."""
        return self._here.near(places_m, reach_m)

    def is_mirrored(self, places_m: FloatArray) -> BoolArray:
        """As `SignsAhead.is_mirrored`."""
        return np.asarray(self._here.distance_m(places_m) <= self._config.mirrored_m)

    def close(self) -> None:
        """As `SignsAhead.close`."""
        self._reader.shutdown(cancel_futures=True)

    def _square(self, place_m: FloatArray) -> Square:
        column, row = np.floor(place_m / self._size_m).astype(np.int64).tolist()
        return column, row

    def _signs(self, square: Square) -> SignTree:
        middle_m = (np.array([square]) + 0.5) * self._size_m
        with self._store.snapshot() as view:
            points, plates = mirror_near(view, middle_m, self._config, self._size_m)
        if self._roads is None:
            return SignTree(sites_from_mirror(points, plates, self._config))
        faces = self._roads.faces_of([row["nvdb_id"] for row in plates])
        sites = sites_from_mirror(points, plates, self._config, faces)
        return SignTree(along_the_road(sites, self._roads.nett, self._roads.day))


_STEPS = tuple((east, north) for east in (-1, 0, 1) for north in (-1, 0, 1))


class _Roads(NamedTuple):
    """The road network, and which way the mirrored plates face: rows of two azimuths by id."""

    nett: Vegnett
    day: dt.date | None
    ids: IntArray
    faces_deg: FloatArray

    @classmethod
    def of(cls, store: Store, fact: Mapping[str, str] | None) -> _Roads | None:
        """Read the network; None where the store has none."""
        if fact is None:
            return None
        from twin.mirror.vegnett import facing, load_vegnett

        # As the roads were when they were read, as a match has them.
        day = dt.date.fromisoformat(fact["fetched_at"][:10]) if "fetched_at" in fact else None
        faces = sorted(facing(store, on_date=day).items())
        ids = np.array([plate for plate, _ in faces], dtype=np.int64)
        return cls(load_vegnett(store), day, ids, np.array([both for _, both in faces]).reshape(-1, 2))

    def faces_of(self, plates: Sequence[int]) -> dict[int, tuple[float, float]]:
        """Azimuths of the faces of some plates, of those that are known."""
        wanted = np.array(plates, dtype=np.int64)
        at = np.minimum(np.searchsorted(self.ids, wanted), max(self.ids.size - 1, 0))
        known = self.ids[at] == wanted if self.ids.size else np.zeros(wanted.size, dtype=bool)
        rows = zip(wanted[known].tolist(), self.faces_deg[at[known]].tolist(), strict=True)
        return {plate: (first, second) for plate, (first, second) in rows}
