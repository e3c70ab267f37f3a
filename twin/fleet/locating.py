"""What a fleet's process does with one drive: fetch, locate, write Parquet. It knows no store."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from geoloc.errors import GeolocError
from twin.drives.detection.run import DetectorOptions
from twin.errors import FetchError, RefusedError, StorageError, StoreError, TwinError
from twin.fleet.fetch import Source
from twin.fleet.parquet import write_parquet
from twin.ingest import LocatedDrive, LocateOptions, locate_drive
from twin.store.kinds import Fault


@dataclass(frozen=True, slots=True)
class Located:
    """A drive that was located, and by what its files are known again."""

    drive: LocatedDrive
    fingerprint: str


@dataclass(frozen=True, slots=True)
class Unchanged:
    """No file of the drive has changed since it was done."""


@dataclass(frozen=True, slots=True)
class Failed:
    """Why a drive could not be located."""

    fault: Fault
    reason: str


def locate_at(address: str, options: Mapping[str, Any], known: str) -> Located | Unchanged | Failed:
    """Locate the drive at an address: the work that any process on any machine can do.

    Parameters
    ----------
    address : str
    options : mapping
        JSON, as :func:`twin.fleet.ingest_options` makes it.
    known : str
        Fingerprint of the drive's files when it was last done by the same options; "" if it never was.
    """
    try:
        source = Source(address, options.get("leave_out", ()))
        fingerprint = source.fingerprint()
        if fingerprint and fingerprint == known:
            return Unchanged()
        with source.fetched() as folder:
            drive = replace(locate_drive(folder, **_locate_options(options)), folder=address)
        if place := options.get("parquet"):
            write_parquet(drive, place)
    except Exception as error:  # it goes to another process, which may not have the exception's class
        return failure(error)
    return Located(drive, fingerprint)


def failure(error: Exception) -> Failed:
    """Return an exception as a kind and a sentence."""
    kinds = (
        (FetchError, Fault.LACKING),
        (StorageError, Fault.STORAGE),
        (RefusedError, Fault.REFUSED),
        (StoreError, Fault.STORE),
        (TwinError, Fault.DRIVE),
        (GeolocError, Fault.DRIVE),
        (MemoryError, Fault.MEMORY),
    )
    for kind, fault in kinds:
        if isinstance(error, kind):
            return Failed(fault, str(error) or type(error).__name__)
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(last.filename).name}:{last.lineno}"
    return Failed(Fault.BUG, f"An error in twin itself ({type(error).__name__} in {where}): {error}")


def _locate_options(options: Mapping[str, Any]) -> LocateOptions:
    """What `locate_drive` takes, of JSON."""
    asked: Any = {name: options[name] for name in LocateOptions.__annotations__ if name in options}
    if detector := asked.get("detector"):
        asked["detector"] = DetectorOptions(Path(detector["model"]), detector["every"], detector["threshold"])
    return cast("LocateOptions", asked)
