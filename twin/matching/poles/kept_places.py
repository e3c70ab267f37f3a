"""Places of poles that were put together square by square, kept between matches."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from twin.matching.kept import Kept
from twin.matching.poles.windows import corner_of

_BLOCK_M = 8192.0
"""What is kept of so large a square is one row of the store."""


@dataclass(slots=True)
class _Square:
    """What is kept of one square: how far about it was looked, and how many poles stand in it.

    ``groups``: names of poles with their rows of numbers, by a digest of all that these rest on.
    """

    margin_m: float
    poles: int
    groups: dict[str, tuple[list[str], FloatArray]] = field(default_factory=dict)


class KeptPlaces:
    """Rows of numbers, one a pole, by the square that it stands in and by a digest of all that they rest on.

    Parameters
    ----------
    kept : Kept
    kind : str
        Of the parts in it.
    """

    def __init__(self, kept: Kept, kind: str) -> None:
        self._kept, self._kind = kept, kind
        self._before: dict[str, dict[int, _Square]] = {}
        self._now: dict[str, dict[int, _Square]] = {}

    def get(self, square: int, rests_on: str) -> FloatArray | None:
        """Return what was kept, one row a pole; None where it has to be worked out."""
        before = self._block(square).get(square)
        found = None if before is None else before.groups.get(rests_on)
        return None if found is None else found[1]

    def put(self, square: int, rests_on: str, names: Iterable[str], rows: FloatArray) -> None:
        """Keep rows (n, 6) of the poles of these names."""
        self._now[_block_of(square)][square].groups[rests_on] = (list(names), rows)

    def looked(self, square: int, margin_m: float, poles: int) -> None:
        """Keep how far about a square was looked, and how many poles stand in it."""
        self._now.setdefault(_block_of(square), {})[square] = _Square(margin_m, poles)

    def margin_m(self, square: int) -> float | None:
        """How far about a square the last match looked; None where no pole stood."""
        before = self._block(square).get(square)
        return None if before is None else before.margin_m

    def poles(self, square: int) -> int:
        """How many poles stood in a square at the last match."""
        before = self._block(square).get(square)
        return 0 if before is None else before.poles

    def of_pole(self, square: int, name: str) -> FloatArray | None:
        """Return the row (6,) of a pole as the last match kept it."""
        before = self._block(square).get(square)
        for names, rows in () if before is None else before.groups.values():
            if name in names:
                return np.asarray(rows[names.index(name)])
        return None

    def keep(self, only: Collection[int] | None = None) -> None:
        """Leave to the next match what was put; of squares that were not looked at, what was there."""
        for block in {*self._now, *map(_block_of, only or ())}:
            before = self._block_named(block)
            now = dict(self._now.get(block, {}))
            if only is not None:
                now |= {number: one for number, one in before.items() if number not in only}
            if _keys(now) == _keys(before):
                self._kept.get(self._kind, block)
            elif now:
                self._kept.put(self._kind, block, _packed(now))
            else:
                self._kept.drop(self._kind, block)

    def _block(self, square: int) -> dict[int, _Square]:
        return self._block_named(_block_of(square))

    def _block_named(self, block: str) -> dict[int, _Square]:
        if block not in self._before:
            arrays = self._kept.get(self._kind, block)
            self._before[block] = {} if arrays is None else _unpacked(dict(arrays))
        return self._before[block]


def _keys(squares: dict[int, _Square]) -> dict[int, tuple[float, int, frozenset[str]]]:
    return {number: (one.margin_m, one.poles, frozenset(one.groups)) for number, one in squares.items()}


def _packed(squares: dict[int, _Square]) -> dict[str, np.ndarray]:
    ordered = sorted(squares.items())
    groups = [(number, key, *part) for number, one in ordered for key, part in sorted(one.groups.items())]
    names = [name.encode() for _, _, some, _ in groups for name in some]
    return {
        "square": np.array([number for number, _ in ordered], dtype=np.int64),
        "margin_m": np.array([one.margin_m for _, one in ordered]),
        "poles": np.array([one.poles for _, one in ordered], dtype=np.int64),
        "of_square": np.array([number for number, *_ in groups], dtype=np.int64),
        "rests_on": np.array([bytes.fromhex(key) for _, key, *_ in groups], dtype="V16"),
        "length": np.array([len(rows) for *_, rows in groups], dtype=np.int64),
        "name": np.array(names, dtype=np.bytes_),
        "row": np.concatenate([np.zeros((0, 6)), *(rows for *_, rows in groups)]),
    }


def _unpacked(arrays: dict[str, np.ndarray]) -> dict[int, _Square]:
    columns = (arrays[name].tolist() for name in ("square", "margin_m", "poles"))
    found = {number: _Square(*said) for number, *said in zip(*columns, strict=True)}
    names = [name.decode() for name in arrays["name"].tolist()]
    ends: IntArray = np.cumsum(arrays["length"])
    for number, key, end, length in zip(
        arrays["of_square"].tolist(),
        arrays["rests_on"],
        ends.tolist(),
        arrays["length"].tolist(),
        strict=True,
    ):
        part = names[end - length : end], arrays["row"][end - length : end]
        found[number].groups[key.tobytes().hex()] = part
    return found


def _block_of(square: int) -> str:
    column, row = np.floor(corner_of(square) / _BLOCK_M).astype(int).tolist()
    return f"{column}:{row}"
