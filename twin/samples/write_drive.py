"""Simulated drives → files, in the formats that the readers know."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.rig.rig import rig_document
from geoloc.simulation.simulate import SimulatedDrive
from geoloc.trajectory.trajectory import GnssFixes
from twin.errors import DriveError
from twin.samples.write_cvat import cvat_document

MINUTE_UNITS = 10**7
"""NMEA minutes are written with 7 decimals as on the real car: 0.2 mm."""
NS_PER_US = 1_000
RIG_DECIMALS = 10
"""Decimals of rig numbers: 1e-10 degrees and metres, and the same text from every processor."""


def write_driveworks_trip(drive: SimulatedDrive, folder: Path | str) -> list[Path]:
    """Write a drive as NTNU's car records a trip.

    ``rig.json``, ``gnss*_vehicle.bin`` (NMEA text with host stamps), ``<camera>.h264.timestamps``,
    ``<camera>.xml`` (CVAT 1.1) and a ``drive.toml`` that declares the annotations complete; no video.

    Parameters
    ----------
    drive : SimulatedDrive
    folder : Path or str
        Made if it does not exist; files of an earlier call are replaced.

    Returns
    -------
    list of Path
        The files, in the order written.

    Raises
    ------
    DriveError
        If the folder cannot be written.
    """
    files = {"rig.json": _rig_text(drive)}
    for fixes in drive.gnss:
        name = drive.rig.antennas[fixes.antenna].file or f"{fixes.antenna.partition(':')[0]}_vehicle.bin"
        files[name] = _nmea_text(fixes)
    for camera, stamps in drive.frame_host_ns.items():
        name = drive.rig.cameras[camera].timestamps or f"{camera}.h264.timestamps"
        files[name] = "".join(f"{frame}\t{stamp}\n" for frame, stamp in enumerate(_microseconds(stamps)))
    files |= {f"{camera}.xml": cvat_document(drive, camera) for camera in drive.scenario.cameras}
    files["drive.toml"] = 'annotations_complete = true\ndatum = "EUREF89"\n'
    return _write(Path(folder), files)


def _rig_text(drive: SimulatedDrive) -> str:
    return json.dumps(_rounded(rig_document(drive.rig)), indent=1, ensure_ascii=False) + "\n"


def _rounded(value: Any) -> Any:
    """Round every float of a document; adding zero turns -0.0 into 0.0."""
    if isinstance(value, float):
        return round(value, RIG_DECIMALS) + 0.0
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return [_rounded(item) for item in value] if isinstance(value, list) else value


def _nmea_text(fixes: GnssFixes) -> str:
    """GGA sentences with the host's stamp in µs behind each, CR LF; ellipsoidal heights, as the car's."""
    lines = []
    for i, host_us in enumerate(_microseconds(fixes.host_ns)):
        latitude, longitude = float(fixes.latitude_deg[i]), float(fixes.longitude_deg[i])
        body = ",".join(
            [
                "GPGGA",
                _time_of_day(int(fixes.epoch_ns[i])),
                _degrees_minutes(latitude, 2),
                "S" if latitude < 0 else "N",
                _degrees_minutes(longitude, 3),
                "W" if longitude < 0 else "E",
                str(int(fixes.quality[i])),
                "14,1.1",
                f"{float(fixes.height_m[i]):.2f},M,0.0,M,0.9,0246",
            ]
        )
        checksum = reduce(lambda total, byte: total ^ byte, body.encode("ascii"), 0)
        lines.append(f"${body}*{checksum:02X} {host_us}\r\n")
    return "".join(lines)


def _time_of_day(epoch_ns: int) -> str:
    """``hhmmss.ss``; six decimals for receivers that are not on whole hundredths."""
    moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, UTC)
    rest_us = epoch_ns % 1_000_000_000 // NS_PER_US
    text = f"{moment:%H%M%S}.{rest_us:06d}"
    return text[:-4] if text.endswith("0000") else text


def _degrees_minutes(angle_deg: float, digits: int) -> str:
    """``ddmm.mmmmmmm``, rounded as a whole so that minutes never read 60."""
    units = round(abs(angle_deg) * 60 * MINUTE_UNITS)
    degrees, rest = divmod(units, 60 * MINUTE_UNITS)
    return f"{degrees:0{digits}d}{rest // MINUTE_UNITS:02d}.{rest % MINUTE_UNITS:07d}"


def _microseconds(stamps_ns: NDArray[np.int64]) -> list[int]:
    """Whole µs, as hosts stamp."""
    return [int(us) for us in (stamps_ns + NS_PER_US // 2) // NS_PER_US]


def _write(folder: Path, files: Mapping[str, str]) -> list[Path]:
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            path = folder / name
            path.write_bytes(text.encode("utf-8"))
            paths.append(path)
    except OSError as error:
        raise DriveError(f"The drive cannot be written to {folder}: {error.strerror or error}.") from error
    return paths
