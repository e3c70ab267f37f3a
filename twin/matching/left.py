"""What a match leaves of drives and findings, so that the next one need only look at what was touched."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from twin.matching.cells import CELL_M, NOWHERE, are_among, coarser, widened
from twin.matching.kept import Kept
from twin.matching.poles.ahead import Ahead
from twin.matching.poles.seen_in import directions_from

_STATE, _DRIVE, _BLOCK = "state", "drive", "results"
PER_SQUARE = 16
"""Cells along a side of the squares by which drives are found: about a kilometre."""
PER_BLOCK = 128
"""Cells along a side of the squares whose findings are one row of the store: about 8 km."""
COUNTED = ("poles", "sites", "in view", "outdated", "alone")
"""Of poles, sites and so on each has its cell in what is left; "alone" are poles that NVDB does not have."""
LAYOUT = 4
"""Of what is left: what another one left is not looked at."""


@dataclass(frozen=True, slots=True)
class KnownDrive:
    """What the last match knows of a drive.

    Attributes
    ----------
    recorded, car : str
        What tells its poses, and its rig, from any others.
    touched : int64 (k,)
        Cells of which it may have had some part in view.
    place_m : float64 (n, 2)
        Of its estimates.
    clicks : mapping of an object's id to what was clicked for it
    ahead : Ahead or None
        As all its signs stand against NVDB's.
    estimates_sha256 : str
    squares : int64 (m,)
        By which it is found (:func:`squares_of_drive`).
    seen_ns : int64 (j,)
        Epochs at which it saw its estimates last, each once, ascending.
    heading_deg : float64 (j,)
        Of the car, from true north, at these.
    directions : int64 (i,)
        From which each object of `clicks` was seen, a bit for each 30° from true north; 0 without a network.
    """

    recorded: str
    car: str
    touched: IntArray
    place_m: FloatArray
    clicks: Mapping[str, str]
    ahead: Ahead | None
    estimates_sha256: str
    squares: IntArray
    seen_ns: IntArray
    heading_deg: FloatArray
    directions: IntArray

    def headings(self, epoch_ns: IntArray) -> FloatArray | None:
        """Heading (n,) of the car at epochs; None where it is not known of each."""
        at = np.searchsorted(self.seen_ns, epoch_ns)
        if not self.seen_ns.size or (self.seen_ns[np.minimum(at, self.seen_ns.size - 1)] != epoch_ns).any():
            return None
        return np.asarray(self.heading_deg[at])

    def seen_from(self, drive_id: str) -> dict[str, frozenset[float]]:
        """Directions by member, as :func:`twin.matching.poles.seen_in.seen_from` gives them."""
        return {
            f"{drive_id}:{name}": directions_from(bits)
            for name, bits in zip(self.clicks, self.directions.tolist(), strict=True)
        }

    def put(self, kept: Kept, drive_id: str) -> None:
        """Leave it to the next match."""
        kept.put(
            _DRIVE,
            drive_id,
            {
                "said": _texts([self.recorded, self.car, self.estimates_sha256]),
                "touched": self.touched,
                "place_m": self.place_m,
                "objects": _texts(self.clicks),
                "clicks": _texts(self.clicks.values()),
                "ahead": np.array(self.ahead or (), dtype=np.float64),
                "squares": self.squares,
                "seen_ns": self.seen_ns,
                "heading_deg": self.heading_deg,
                "directions": self.directions,
            },
        )

    @classmethod
    def of(cls, kept: Kept, drive_id: str) -> KnownDrive | None:
        """Take it from what the last match left."""
        arrays = kept.get(_DRIVE, drive_id)
        if arrays is None:
            return None
        recorded, car, estimates_sha256 = _told(arrays["said"])
        clicks = zip(_told(arrays["objects"]), _told(arrays["clicks"]), strict=True)
        shift = arrays["ahead"].tolist()
        return cls(
            recorded,
            car,
            arrays["touched"],
            arrays["place_m"],
            dict(clicks),
            Ahead(*shift) if shift else None,
            estimates_sha256,
            arrays["squares"],
            arrays["seen_ns"],
            arrays["heading_deg"],
            arrays["directions"],
        )

    @staticmethod
    def drop(kept: Kept, drive_id: str) -> None:
        """Forget a drive that is gone."""
        kept.drop(_DRIVE, drive_id)


@dataclass(slots=True)
class State:
    """Of which store and which settings the last match is.

    Attributes
    ----------
    rests_on : str
        Digest of everything that findings rest on but drives and NVDB's signs.
    revision : int
    totals : int64 (5,)
        How many there are, in the order of `COUNTED`.
    codes : mapping of a sign code to the log odds that it costs for being common
    squares : mapping of a drive's id to the squares by which it is found
    warnings : mapping of a drive's id to when it began and what is to be known of it
        Of drives of which there is something.
    """

    rests_on: str
    revision: int
    totals: IntArray
    codes: Mapping[str, float]
    squares: dict[str, IntArray] = field(default_factory=dict)
    warnings: dict[str, tuple[int, list[str]]] = field(default_factory=dict)

    def near(self, cells: IntArray) -> set[str]:
        """Drives that come near some of these cells."""
        wanted = np.unique(coarser(cells, PER_SQUARE))
        names = list(self.squares)
        if not names:
            return set()
        lengths = [len(of_drive) for of_drive in self.squares.values()]
        hit = are_among(np.concatenate(list(self.squares.values())), wanted)
        number = np.repeat(np.arange(len(names)), lengths)
        return {names[k] for k in np.unique(number[hit]).tolist()}

    def beside_drives(self, cells: IntArray) -> IntArray:
        """Those of the cells that lie in the neighbourhood of some drive."""
        squares = widened(np.concatenate([NOWHERE, *self.squares.values()]), 1)
        return cells[are_among(coarser(cells, PER_SQUARE), squares)]

    def put(self, kept: Kept) -> None:
        """Leave it to the next match."""
        lengths = np.array([len(one) for one in self.squares.values()], dtype=np.int64)
        kept.put(
            _STATE,
            "",
            {
                "rests_on": _texts([self.rests_on]),
                "revision": np.array(self.revision),
                "totals": self.totals,
                "codes": _texts(self.codes),
                "odds": np.array(list(self.codes.values()), dtype=np.float64),
                "drives": _texts(self.squares),
                "lengths": lengths,
                "squares": np.concatenate([NOWHERE, *self.squares.values()]),
                "warnings": _texts([json.dumps(self.warnings)]),
            },
        )

    @classmethod
    def of(cls, kept: Kept) -> State | None:
        """Take it from what the last match left."""
        arrays = kept.get(_STATE, "")
        if arrays is None:
            return None
        squares = np.split(arrays["squares"], np.cumsum(arrays["lengths"])[:-1])
        names = _told(arrays["drives"])
        return cls(
            _told(arrays["rests_on"])[0],
            int(arrays["revision"]),
            arrays["totals"],
            dict(zip(_told(arrays["codes"]), arrays["odds"].tolist(), strict=True)),
            dict(zip(names, squares[: len(names)], strict=True)),
            {name: (began, told) for name, (began, told) in json.loads(_told(arrays["warnings"])[0]).items()},
        )


@dataclass(frozen=True, slots=True)
class Results:
    """What was found in cells: ids of findings, each with its cell, and the cell of what was counted.

    Attributes
    ----------
    change_ids : sequence of str
    cells : int64 (n,)
        Of these.
    counted : sequence of int64 (k,)
        The cells of all that was counted, in the order of `COUNTED`.
    """

    change_ids: Sequence[str]
    cells: IntArray
    counted: Sequence[IntArray]

    @property
    def totals(self) -> IntArray:
        """How many of each were counted."""
        return np.array([len(cells) for cells in self.counted], dtype=np.int64)


def put_results(kept: Kept, now: Results, only: IntArray | None) -> tuple[list[str], IntArray]:
    """Leave results to the next match; those of before in other cells than `only` stay.

    Returns
    -------
    gone : list of str
        Ids of findings of before in the cells of `only`.
    totals : int64 (5,)
        What was counted there before.
    """
    gone: list[str] = []
    before_there = np.zeros(len(COUNTED), dtype=np.int64)
    every = np.concatenate([now.cells, *now.counted, only if only is not None else NOWHERE])
    of_block = coarser(now.cells, PER_BLOCK)
    ids = np.array([name.encode() for name in now.change_ids], dtype=np.bytes_)
    for block in np.unique(coarser(every, PER_BLOCK)).tolist():
        mine = of_block == block
        arrays: dict[str, NDArray[Any]] = {"id": ids[mine], "cell": now.cells[mine]}
        for name, cells in zip(COUNTED, now.counted, strict=True):
            arrays[name] = cells[coarser(cells, PER_BLOCK) == block]
        before = None if only is None else kept.get(_BLOCK, str(block))
        if before is not None and only is not None:
            there = are_among(before["cell"], only)
            gone += _told(before["id"][there])
            arrays["id"] = np.concatenate([arrays["id"], before["id"][~there]])
            arrays["cell"] = np.concatenate([arrays["cell"], before["cell"][~there]])
            for k, name in enumerate(COUNTED):
                inside = are_among(before[name], only)
                before_there[k] += int(inside.sum())
                arrays[name] = np.concatenate([arrays[name], before[name][~inside]])
        if any(one.size for one in arrays.values()):
            kept.put(_BLOCK, str(block), {key: np.asarray(one) for key, one in arrays.items()})
        else:
            kept.drop(_BLOCK, str(block))
    return gone, before_there


def squares_of_drive(cells: IntArray) -> IntArray:
    """Squares by which a drive is found in some of the cells that concern it."""
    return np.unique(coarser(cells, PER_SQUARE))


def cells_counted(kept: Kept, name: str, about: IntArray, within_m: float) -> IntArray:
    """Cells of what the last match counted by this name: all within so far of some cells, and some beyond."""
    blocks = widened(coarser(about, PER_BLOCK), math.ceil(within_m / (PER_BLOCK * CELL_M)))
    found = [arrays[name] for one in blocks.tolist() if (arrays := kept.get(_BLOCK, str(one))) is not None]
    return np.unique(np.concatenate([NOWHERE, *found]))


def _texts(words: Iterable[str]) -> NDArray[np.bytes_]:
    return np.array([word.encode() for word in words], dtype=np.bytes_)


def _told(words: NDArray[Any]) -> list[str]:
    return [word.decode() for word in words.tolist()]
