"""What a DriveWorks trip does not say by name is found by content.

A trip of the NTNU car is a flat folder: a rig file (JSON, whatever its name), ``<camera>.h264`` with
``<camera>.h264.timestamps``, ``gnss*_vehicle.bin`` (NMEA text), and beside them the annotators' CVAT exports.
"""

from __future__ import annotations

import json
from typing import Any

from geoloc.rig import Rig, RigCamera, looks_like_rig
from twin.drives.camera_names import named_in, plain
from twin.drives.cvat import is_cvat
from twin.drives.folder import DriveFolder
from twin.drives.nmea import iter_sentences
from twin.drives.settings import SETTINGS_FILE
from twin.errors import DriveError

LARGEST_RIG_BYTES = 50_000_000
"""No rig file comes near it; larger JSON files are something else and are not opened."""

# Files that are never NMEA, whatever their first bytes: looking into them costs time for nothing.
_NOT_NMEA = (".json", ".xml", ".toml", ".timestamps", ".h264", ".mp4", ".png", ".jpg", ".pcap", ".csv")


def find_rig(folder: DriveFolder) -> str:
    """Name of the folder's rig file, found by content.

    Raises
    ------
    DriveError
        If there is none, or if two differ.
    """
    rigs: dict[str, Any] = {}
    broken = []
    for name in folder.names(".json"):
        if len(folder.head(name, LARGEST_RIG_BYTES + 1)) > LARGEST_RIG_BYTES:
            continue
        try:
            document = json.loads(folder.peek(name).decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            broken.append(f"{name} is not JSON ({error})")
            continue
        if looks_like_rig(document):
            rigs[name] = document
    if not rigs:
        raise DriveError(_no_drive(folder, broken))
    first, *others = rigs
    for other in others:
        if rigs[other] != rigs[first]:
            raise DriveError(
                f"{first} and {other} are two different rigs: name the right one in {SETTINGS_FILE},"
                f' rig = "{first}".'
            )
    return first


def _no_drive(folder: DriveFolder, broken: list[str]) -> str:
    names = folder.names()
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    reason = f" ({'; '.join(broken)})" if broken else ""
    return (
        f"{folder.root} holds no drive: looked for {SETTINGS_FILE} that names a rig, and for a DriveWorks rig"
        f" file (*.json with rig.sensors){reason}; found {shown or 'no files'}. Add the rig file of the car."
    )


def find_gnss(folder: DriveFolder, rig: Rig) -> tuple[dict[str, str], list[str]]:
    """Find the GNSS recording of each antenna: as the rig names it, else what looks like NMEA.

    Returns
    -------
    files : dict of antenna name to file name
        Empty if there is none. An antenna that the rig does not know is named after its file.
    warnings : list of str
        One sentence for each recording that the rig names and the folder lacks.

    Raises
    ------
    DriveError
        If it is not clear which antenna a recording belongs to.
    """
    files: dict[str, str] = {}
    absent: dict[str, str] = {}
    for antenna in rig.antennas.values():
        found = folder.found(antenna.file)
        if found:
            files[antenna.name] = found
        elif antenna.file:
            absent[antenna.name] = antenna.file
    if not files:
        files = _sniffed_gnss(folder, rig)
    warnings = [
        f"{rig.source} names {file} as the recording of {antenna}, but it is not in the folder: the drive is"
        " read without it."
        for antenna, file in absent.items()
        if files and antenna not in files
    ]
    return files, warnings


def _sniffed_gnss(folder: DriveFolder, rig: Rig) -> dict[str, str]:
    recordings = [name for name in folder.names() if not name.lower().endswith(_NOT_NMEA)]
    recordings = [name for name in recordings if looks_like_nmea(folder.head(name))]
    if not rig.antennas:
        return {name.rpartition(".")[0] or name: name for name in recordings}
    if len(rig.antennas) == 1 and len(recordings) == 1:
        return {next(iter(rig.antennas)): recordings[0]}
    files: dict[str, str] = {}
    for name in recordings:
        antennas = named_in(name, rig.antennas)
        if len(antennas) != 1 or antennas[0] in files:
            raise DriveError(
                f"{name} is a GNSS recording, but not which antenna's: write"
                f' [gnss] files = {{"<antenna>" = "{name}"}} in {SETTINGS_FILE}; the antennas of {rig.source}'
                f" are {', '.join(rig.antennas)}."
            )
        files[antennas[0]] = name
    return files


def find_timestamps(folder: DriveFolder, camera: RigCamera) -> str | None:
    """File of a camera's frame stamps: as the rig names it, else ``<camera>*.timestamps``; None if absent.

    Raises
    ------
    DriveError
        If several files could be meant.
    """
    found = folder.found(camera.timestamps)
    if found:
        return found
    candidates = [name for name in folder.names(".timestamps") if plain(name).startswith(plain(camera.name))]
    # C1 begins C10 as well: the whole name must be there.
    candidates = [name for name in candidates if named_in(name, [camera.name])]
    if len(candidates) > 1:
        raise DriveError(
            f"{' and '.join(candidates)} could both hold the time stamps of {camera.name}: name one under"
            f" [timestamps] in {SETTINGS_FILE}."
        )
    return candidates[0] if candidates else None


def find_annotations(folder: DriveFolder) -> list[str]:
    """Names of the CVAT exports in the folder, found by content."""
    return [name for name in folder.names(".xml") if is_cvat(folder.head(name))]


def looks_like_nmea(head: bytes) -> bool:
    """Whether the beginning of a file holds a sound GGA, RMC or ZDA sentence."""
    if b"\0" in head or b"$" not in head:
        return False
    return any(sentence.kind in ("GGA", "RMC", "ZDA") for sentence in iter_sentences(head))
