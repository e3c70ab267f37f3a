"""Poses of a drive as one compressed column of the store."""

from __future__ import annotations

import io

import numpy as np

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
    with np.load(io.BytesIO(blob), allow_pickle=False) as arrays:
        return Poses(**{name: arrays[name] for name in Poses.__slots__})
