"""Poses of a drive as one compressed column of the store."""

from __future__ import annotations

import ast
import io
import struct
import zipfile
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.trajectory.trajectory import Poses


def blob_from_poses(poses: Poses) -> bytes:
    """Pack valid poses for the store (NumPy ``.npz``, compressed)."""
    keep = poses.valid
    fields = {name: getattr(poses, name)[keep] for name in Poses.__slots__}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **fields)
    return buffer.getvalue()


def poses_from_blob(blob: bytes) -> Poses:
    """Unpack what :func:`blob_from_poses` packed."""
    with zipfile.ZipFile(io.BytesIO(blob)) as packed:
        return Poses(**{name: _array(packed.read(f"{name}.npy")) for name in Poses.__slots__})


def _array(packed: bytes) -> NDArray[Any]:
    """One array of NumPy's format 1.0, whose header NumPy itself reads slowly: a match reads thousands."""
    (length,) = struct.unpack_from("<H", packed, _MAGIC)
    begins = _MAGIC + 2 + length
    dtype, shape = _header(packed[_MAGIC + 2 : begins])
    return np.frombuffer(packed, dtype=dtype, offset=begins).reshape(shape)


_MAGIC = 8


@cache
def _header(text: bytes) -> tuple[np.dtype[Any], tuple[int, ...]]:
    said = ast.literal_eval(text.decode("latin-1"))
    return np.dtype(said["descr"]), said["shape"]
