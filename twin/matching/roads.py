"""What the road beside a sign says of it, kept: a country's network is not read for a few signs."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from geoloc.arrays import FloatArray
from nvdb.vegnett import Vegnett
from twin.matching.cells import cells_of, coarser
from twin.matching.kept import Kept, arrays_of, digest, packed_arrays
from twin.matching.sites import Site, along_the_road
from twin.mirror.names import KATALOG_FACT
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store.store import Row, Snapshot, Store

Faces = dict[int, tuple[float, float]]

_PER_BLOCK = 128
"""Cells along a side of the squares of which one row is kept: about 8 km."""
_NOWHERE = ""
PLACELESS = ("faces", _NOWHERE)
"""Kind and key under which plates without a place are kept."""


class Roads:
    """The road network of a store, as it was on the day on which it was fetched.

    Findings do not change from one day to the next by themselves.

    Parameters
    ----------
    store : Store
    view : Snapshot
        Of it, with a road network.
    kept : Kept
    anew : bool
        Whether all is worked out, since somebody may have changed the network and not said so.
    """

    def __init__(self, store: Store, view: Snapshot, kept: Kept, *, anew: bool) -> None:
        fact = view.fact(VEGNETT) or {}
        self._store, self._kept, self._anew = store, kept, anew
        self._day = dt.date.fromisoformat(fact["fetched_at"][:10]) if "fetched_at" in fact else None
        day = self._day or dt.datetime.now(dt.UTC).date()
        said = json.dumps([fact, view.fact(KATALOG_FACT), day.isoformat()], sort_keys=True)
        self._rests_on = digest(said.encode())

    @cached_property
    def _network(self) -> Vegnett:
        from twin.mirror.vegnett import load_vegnett

        return load_vegnett(self._store)

    def faces(self, plates: Sequence[Row]) -> Faces:
        """Azimuths of the faces of plates by id, as :func:`twin.mirror.vegnett.facing` gives them."""

        def work_out(rows: Sequence[int]) -> FloatArray:
            from twin.mirror.vegnett import facing

            ids = [plates[k]["nvdb_id"] for k in rows]
            found = facing(self._store, on_date=self._day, plates=ids, network=self._network)
            return np.array([found[one] for one in ids]).reshape(-1, 2)

        said = [repr([row[name] for name in _RESTS_ON]) for row in plates]
        place = [(row["east_m"], row["north_m"]) for row in plates]
        found = self._each("faces", said, place, work_out)
        return {row["nvdb_id"]: (one[0], one[1]) for row, one in zip(plates, found.tolist(), strict=True)}

    def along(self, sites: Sequence[Site]) -> list[Site]:
        """Give the sites that NVDB only has on the centre line the direction of their road."""
        loose = [k for k, site in enumerate(sites) if not site.own_geometry]
        place = [(sites[k].east_m, sites[k].north_m) for k in loose]

        def work_out(rows: Sequence[int]) -> FloatArray:
            some = along_the_road([sites[loose[k]] for k in rows], self._network, self._day)
            return np.array([(site.road_azimuth_deg, np.nan) for site in some])

        placed = list(sites)
        found = self._each("along", [repr(at) for at in place], place, work_out)
        for k, degrees in zip(loose, found[:, 0].tolist(), strict=True):
            placed[k] = replace(sites[k], road_azimuth_deg=degrees)
        return placed

    def _each(
        self,
        kind: str,
        said: Sequence[str],
        place: Sequence[tuple[float | None, float | None]],
        work_out: Callable[[Sequence[int]], FloatArray],
    ) -> FloatArray:
        """Two numbers (n, 2) for each thing that is said: as kept, or worked out for those that are not."""
        names = [digest(one.encode()) for one in said]
        blocks = [_block(*at) for at in place]
        before = {block: self._before(kind, block) for block in sorted(set(blocks))}
        fresh = [
            k for k, (name, block) in enumerate(zip(names, blocks, strict=True)) if name not in before[block]
        ]
        for k, numbers in zip(fresh, work_out(fresh) if fresh else (), strict=True):
            before[blocks[k]][names[k]] = numbers
        for block in sorted({blocks[k] for k in fresh}):
            arrays = {
                "rests_on": np.array(self._rests_on),
                "name": np.array([name.encode() for name in before[block]], dtype=np.bytes_),
                "numbers": np.array(list(before[block].values())),
            }
            self._kept.put(kind, block, arrays)
        found = [before[block][name] for name, block in zip(names, blocks, strict=True)]
        return np.array(found).reshape(-1, 2)

    def _before(self, kind: str, block: str) -> dict[str, FloatArray]:
        arrays = None if self._anew else self._kept.get(kind, block)
        if arrays is None or arrays["rests_on"].item() != self._rests_on:
            return {}
        return dict(zip((name.decode() for name in arrays["name"].tolist()), arrays["numbers"], strict=True))


def joined(parts: Iterable[bytes]) -> bytes:
    """What several processes kept of roads under one name, as one part."""
    kept = [arrays_of(part) for part in parts]
    found = {
        name: row for one in kept for name, row in zip(one["name"].tolist(), one["numbers"], strict=True)
    }
    return packed_arrays(
        {
            "rests_on": kept[0]["rests_on"],
            "name": np.array(list(found), dtype=np.bytes_),
            "numbers": np.array(list(found.values())),
        }
    )


_RESTS_ON = ("nvdb_id", "ansiktsside", "own_geometry", "east_m", "north_m", "stedfesting")


def _block(east_m: float | None, north_m: float | None) -> str:
    if east_m is None or north_m is None:
        return _NOWHERE
    return str(coarser(cells_of(np.array([[east_m, north_m]])), _PER_BLOCK)[0])
