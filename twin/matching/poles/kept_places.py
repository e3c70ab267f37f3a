"""Places of poles that were put together square by square, kept between matches."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray
from twin.matching.kept import Kept
from twin.matching.poles.windows import corner_of

_BLOCK_M = 8192.0
"""What is kept of so large a square is one row of the store."""


class KeptPlaces:
    """Rows of numbers by the square they are of, and by a digest of all that they rest on.

    Parameters
    ----------
    kept : Kept
    kind : str
        Of the parts in it.
    """

    def __init__(self, kept: Kept, kind: str) -> None:
        self._kept, self._kind = kept, kind
        self._before: dict[str, dict[str, FloatArray]] = {}
        self._now: dict[str, dict[str, FloatArray]] = {}

    def get(self, square: int, rests_on: str) -> FloatArray | None:
        """Return what was kept, one row a pole; None where it has to be worked out."""
        block = _block_of(square)
        if block not in self._before:
            self._before[block] = self._read(block)
        return self._before[block].get(rests_on)

    def put(self, square: int, rests_on: str, rows: FloatArray) -> None:
        """Keep rows (n, 6)."""
        self._now.setdefault(_block_of(square), {})[rests_on] = rows

    def keep(self) -> None:
        """Leave to the next match what was put."""
        for block, parts in self._now.items():
            before = self._before.get(block, {})
            if parts.keys() == before.keys():
                self._kept.get(self._kind, block)
                continue
            keys = np.array([bytes.fromhex(key) for key in parts], dtype="V16")
            lengths = np.array([len(rows) for rows in parts.values()])
            arrays = {"rests_on": keys, "lengths": lengths, "rows": np.concatenate(list(parts.values()))}
            self._kept.put(self._kind, block, arrays)

    def _read(self, block: str) -> dict[str, FloatArray]:
        arrays = self._kept.get(self._kind, block)
        if arrays is None:
            return {}
        keys = [key.tobytes().hex() for key in arrays["rests_on"]]
        parts = np.split(arrays["rows"], np.cumsum(arrays["lengths"])[:-1])
        return dict(zip(keys, parts, strict=True))


def _block_of(square: int) -> str:
    column, row = np.floor(corner_of(square) / _BLOCK_M).astype(int).tolist()
    return f"{column}:{row}"
