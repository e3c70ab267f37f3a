"""Sightings and poses of a located drive as Parquet: small, and read by pandas, DuckDB, Dask and QGIS."""

from __future__ import annotations

import io
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from twin.errors import CURES, FileError, MissingExtraError
from twin.fleet.fetch import is_remote, storage, told
from twin.ingest import LocatedDrive
from twin.store import schema
from twin.store.atomic_files import replace_file

if TYPE_CHECKING:
    import pyarrow as pa


def write_parquet(located: LocatedDrive, place: str) -> tuple[str, str]:
    """Write ``NAME.METHOD.sightings.parquet`` and ``….poses.parquet``, each whole or not at all.

    NAME is the drive's id. Columns are those of the store's table ``sighting`` and of
    :class:`geoloc.trajectory.trajectory.Poses`; their comments go along as metadata.

    Parameters
    ----------
    located : LocatedDrive
    place : str
        A folder, or an address of storage.

    Returns
    -------
    (str, str)
        Where they are.

    Raises
    ------
    MissingExtraError, FileError, StorageError
        pyarrow is not installed; the place cannot be written.
    """
    stem = f"{located.drive.drive_id}.{located.result.method}"
    written = []
    for name, table in (("sightings", _sightings(located)), ("poses", _poses(located))):
        written.append(f"{place.rstrip('/')}/{stem}.{name}.parquet")
        _write(_bytes(table), written[-1])
    return written[0], written[1]


def _sightings(located: LocatedDrive) -> pa.Table:
    import pyarrow as pa

    sightings, n = located.sightings, len(located.sightings)
    columns: dict[str, Any] = {
        "drive_id": np.full(n, located.drive.drive_id),
        "method": np.full(n, located.result.method.value),
        "number": np.arange(n, dtype=np.int32),
        **sightings.columns(),
    }
    shape = [
        pa.field(c.name, _type(c.type), metadata={"comment": c.comment or ""})
        for c in schema.sighting.columns
    ]
    return pa.table([columns[one.name] for one in shape], schema=pa.schema(shape))


def _poses(located: LocatedDrive) -> pa.Table:
    import pyarrow as pa

    poses = located.drive.poses
    return pa.table({one.name: getattr(poses, one.name)[poses.valid] for one in fields(poses)})


def _type(kind: sa.types.TypeEngine[Any]) -> pa.DataType:
    import pyarrow as pa

    by_kind = ((sa.Boolean, pa.bool_()), (sa.BigInteger, pa.int64()), (sa.Integer, pa.int32()))
    for one, found in (*by_kind, (sa.Float, pa.float64())):
        if isinstance(kind, one):
            return found
    return pa.string()


def _bytes(table: pa.Table) -> bytes:
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("Parquet", "pyarrow", "parquet") from error
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _write(content: bytes, address: str) -> None:
    """Object storage takes a file whole; elsewhere it is written aside and renamed."""
    if not is_remote(address):
        try:
            Path(address).parent.mkdir(parents=True, exist_ok=True)
            replace_file(Path(address), content)
        except OSError as error:
            cure = CURES.get(error.errno or 0, "name another folder")
            raise FileError(f"{address} cannot be written ({error.strerror}): {cure}.") from error
        return
    system, path = storage(address)
    with told(address):
        if system.protocol in ("file", ("file", "local")):
            _write(content, path)
        else:
            system.pipe_file(path, content)
