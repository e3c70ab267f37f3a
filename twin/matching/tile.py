"""What is found in one tile of a match of everything: worked out from the tile and a margin about it."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from twin.matching.asked import Asked, sites_of
from twin.matching.cells import CELL_M, NOWHERE, are_among, cells_of, cells_within, coarser
from twin.matching.compare import compare, places_of
from twin.matching.drives import cells_passed, drives_of
from twin.matching.edges import BEYOND_M, Edge, check_edge
from twin.matching.found import gathered_poles, named_in_part
from twin.matching.in_view import VIEWS
from twin.matching.kept import Kept, NotSure, arrays_of, packed_arrays
from twin.matching.left import PER_BLOCK, PER_SQUARE, KnownDrive, put_results
from twin.matching.poles.keys import Mark
from twin.matching.poles.many_drives import with_fused_places
from twin.matching.poles.poles import ObservedPole
from twin.matching.poles.seen_in import keys_held, marks_of
from twin.matching.poles.windows import MARGINS_M, SQUARE_M, squares_within
from twin.matching.reading import estimates_of
from twin.matching.roads import PLACELESS
from twin.matching.scope import NEAR_M, Scope
from twin.matching.sites import Site, mirror_near
from twin.store import schema
from twin.store.store import Row

TILE_M = PER_BLOCK * CELL_M
_COLUMN = 1_000_000
"""A tile's number is its column times this, plus its row."""
_WIDTHS = (2, 4, 8)
"""Cells about a tile in which the rivals of its poles stand: the first that is surely enough."""
_BUFFER_M = 256.0
"""Estimates are read so far beyond the poles that are needed."""
_SITES_M = 512.0
_OF_MARK = ("drive_id", "clicks", "east_m", "north_m", "codes")
_COUNTS = ("place", "cell", "views", "fronts")

Take = Callable[[Collection[str]], Mapping[str, KnownDrive]]
"""Gets what was worked out of drives."""


@dataclass(frozen=True, slots=True)
class WorkedTile:
    """What came of a tile.

    Attributes
    ----------
    is_sure : bool
        Whether nothing hangs on what lies beyond the margin; nothing else is said where something may.
    findings : list of rows of ``change``
    keys : mapping of member to the key of its pole
    marks : mapping of member to Mark
    totals : int64 (n,)
        In the order of `COUNTED`.
    views : mapping of a drive's id to arrays
        What it had in view of places in the tile.
    parts : mapping of (kind, key) to bytes
        Parts for the next match: this tile's alone, and of plates without a place.
    """

    is_sure: bool
    findings: Sequence[Row] = ()
    keys: Mapping[str, str] = field(default_factory=dict)
    marks: Mapping[str, Mark] = field(default_factory=dict)
    totals: IntArray = field(default_factory=lambda: NOWHERE)
    views: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=dict)
    parts: Mapping[tuple[str, str], bytes] = field(default_factory=dict)

    def packed(self) -> bytes:
        """Return it as bytes for the store."""
        said = {
            "is_sure": self.is_sure,
            "findings": self.findings,
            "keys": dict(self.keys),
            "marks": {
                member: list(map(mark.__getattribute__, _OF_MARK)) for member, mark in self.marks.items()
            },
            "parts": list(self.parts),
            "drives": list(self.views),
        }
        arrays: dict[str, NDArray[Any]] = {
            "said": np.frombuffer(json.dumps(said).encode(), np.uint8),
            "totals": self.totals,
        }
        arrays |= {f"part {k}": np.frombuffer(one, np.uint8) for k, one in enumerate(self.parts.values())}
        for k, views in enumerate(self.views.values()):
            arrays |= {f"{name} {k}": array for name, array in views.items()}
        return packed_arrays(arrays)

    @classmethod
    def of(cls, packed: bytes) -> WorkedTile:
        """Take it from what :meth:`packed` gave."""
        arrays = arrays_of(packed)
        said = json.loads(arrays["said"].tobytes())
        return cls(
            is_sure=said["is_sure"],
            findings=said["findings"],
            keys=said["keys"],
            marks={member: _mark(one) for member, one in said["marks"].items()},
            totals=arrays["totals"],
            views={
                drive_id: {name: arrays[f"{name} {k}"] for name in _COUNTS}
                for k, drive_id in enumerate(said["drives"])
            },
            parts={(kind, key): arrays[f"part {k}"].tobytes() for k, (kind, key) in enumerate(said["parts"])},
        )


def worked_tile(
    asked: Asked, number: int, squares: Mapping[str, IntArray], take: Take, kept: Kept
) -> WorkedTile:
    """Work out a tile.

    Parameters
    ----------
    asked : Asked
    number : int
        Of the tile.
    squares : mapping of a drive's id to the squares by which it is found
    take : callable
    kept : Kept
        Of the store: what earlier matches left is used as far as it holds.
    """
    for width in _WIDTHS:
        try:
            return _Tile(asked, number, width, squares, take, kept).worked()
        except NotSure:
            continue
    return WorkedTile(is_sure=False)


class _Tile:
    def __init__(
        self,
        asked: Asked,
        number: int,
        width: int,
        squares: Mapping[str, IntArray],
        take: Take,
        kept: Kept,
    ) -> None:
        self._asked, self._number, self._kept = asked, number, kept
        self._corner = np.array(divmod(number, _COLUMN), dtype=np.float64) * TILE_M
        self._results = cells_within(self._corner, TILE_M, 0.0)
        reach_m = width * CELL_M
        placed = squares_within(self._corner, TILE_M, reach_m + NEAR_M)
        # A pole about the tile is placed with what stands about its square.
        self._needed_m = reach_m + NEAR_M + SQUARE_M + MARGINS_M[-1]
        self._read_m = self._needed_m + _BUFFER_M
        self._scope = Scope(
            drives=frozenset(),
            changed_m=np.zeros((0, 2)),
            squares=dict.fromkeys(placed.tolist(), MARGINS_M[-1]),
            core=NOWHERE,
            results=self._results,
            about=cells_within(self._corner, TILE_M, reach_m),
            read=cells_within(self._corner, TILE_M, self._read_m),
        )
        self._beyond = _near(squares, cells_within(self._corner, TILE_M, self._read_m + BEYOND_M))
        ids = _near(squares, self._scope.read)
        self._known = take(ids)
        view, method, config = asked.view, asked.method, asked.config
        self._drives = drives_of(view, method, config, kept, ids, self._known)

    def worked(self) -> WorkedTile:
        asked, scope, kept = self._asked, self._scope, self._kept
        ids = [drive.drive_id for drive in self._drives]
        estimates = estimates_of(asked.view, asked.method, ids, scope.read)
        edge = Edge(self._corner, TILE_M, self._needed_m, self._read_m)
        check_edge(asked, self._beyond, edge)
        once, gathered, _ = gathered_poles(asked, estimates, self._drives, self._known)
        driven = [drive.driven for drive in self._drives]
        placed = with_fused_places(gathered, once, driven, kept=kept, only=scope.squares).poles
        marks = marks_of(estimates, {one: drive.clicks for one, drive in self._known.items()})
        mine, poles = self._with_keys(gathered, placed, marks)
        compared = compare(asked, poles, self._sites(), self._drives, asked.codes(), scope, forgets=True)
        results = compared.results(cells_passed(self._drives), scope.results)
        put_results(kept, results, None)
        there = are_among(cells_of(places_of(compared.findings)), scope.results)
        keys = {member: pole.key for pole in mine for member in pole.members}
        return WorkedTile(
            is_sure=True,
            findings=[
                one.to_row() for one, counts in zip(compared.findings, there.tolist(), strict=True) if counts
            ],
            keys=keys,
            marks={member: mark for member, mark in marks.items() if member in keys},
            totals=results.totals,
            views={drive.drive_id: self._views(drive.drive_id) for drive in self._drives},
            parts=self._parts(),
        )

    def _with_keys(
        self, gathered: Sequence[ObservedPole], placed: Sequence[ObservedPole], marks: Mapping[str, Mark]
    ) -> tuple[list[ObservedPole], list[ObservedPole]]:
        """Poles of the tile with their keys, and these with those about it, in the order of keys."""
        view, scope = self._asked.view, self._scope
        held = keys_held(view, [member for pole in gathered for member in pole.members])
        where = cells_of(places_of(placed))
        own, near = are_among(where, scope.results).tolist(), are_among(where, scope.about).tolist()
        inside = [pole for pole, counts in zip(placed, own, strict=True) if counts]
        beside = [
            pole for pole, counts, is_own in zip(placed, near, own, strict=True) if counts and not is_own
        ]
        ids = [drive.drive_id for drive in self._drives]
        mine = named_in_part(self._asked, scope, inside, marks, held, ids)
        is_first = not view.rows(sa.select(schema.known_mark.c.id).limit(1))
        size: dict[str, int] = {}
        for key in held.values():
            size[key] = size.get(key, 0) + 1
        others = [replace(pole, key=_key_beside(pole, held, size, is_first=is_first)) for pole in beside]
        return mine, sorted([*mine, *others], key=lambda pole: pole.key)

    def _sites(self) -> list[Site]:
        """Sites in the tile and about it."""
        steps = np.arange(-_SITES_M, TILE_M + 2 * _SITES_M, _SITES_M)
        places = self._corner + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        rows = mirror_near(self._asked.view, places, self._asked.config, _SITES_M)
        sites = sites_of(self._asked, rows, self._kept, anew=True)
        place_m = np.array([(site.east_m, site.north_m) for site in sites]).reshape(-1, 2)
        inside = are_among(cells_of(place_m), self._scope.about).tolist()
        return [site for site, counts in zip(sites, inside, strict=True) if counts]

    def _views(self, drive_id: str) -> dict[str, NDArray[Any]]:
        """What a drive had in view of places in the tile."""
        arrays = self._kept.get(VIEWS, drive_id) or {}
        mine = are_among(arrays["cell"], self._scope.results)
        return {name: arrays[name][mine] for name in _COUNTS}

    def _parts(self) -> dict[tuple[str, str], bytes]:
        """What is kept of this tile alone, and of the plates without a place that belong there."""
        column, row = divmod(self._number, _COLUMN)
        names = [("fused", f"{column}:{row}"), PLACELESS]
        names += [(kind, str(self._number)) for kind in ("results", "faces", "along")]
        used = self._kept.used()
        return {name: used[name] for name in names if name in used}


def _mark(said: Sequence[Any]) -> Mark:
    *_, codes = said
    return Mark(**dict(zip(_OF_MARK, said, strict=True)) | {"codes": tuple(codes)})


def _near(squares: Mapping[str, IntArray], cells: IntArray) -> list[str]:
    """Drives that come near some cells."""
    wanted = np.unique(coarser(cells, PER_SQUARE))
    return [drive_id for drive_id, of_drive in squares.items() if are_among(of_drive, wanted).any()]


def _key_beside(
    pole: ObservedPole, held: Mapping[str, str], size: Mapping[str, int], *, is_first: bool
) -> str:
    """Key of a pole that another tile names: its own first name, or that of before if it is as it was.

    Raises
    ------
    NotSure
    """
    if is_first:
        return pole.members[0]
    keys = [held.get(member) for member in pole.members]
    key = keys[0]
    if key is None or len(set(keys)) > 1 or size[key] != len(keys):
        raise NotSure
    return key
