"""Surveyed positions to measure estimates by, and the file that they come from."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.earth.heights import ellipsoidal_from_nn2000
from twin.errors import TruthError
from twin.tables import NotTextError, Table

if TYPE_CHECKING:
    from pyproj import CRS

_REQUIRED = ("object", "easting", "northing")
UTM33 = 25833
_NN2000 = 5941
_MEANT = {
    **{name: name for name in ("object", "easting", "northing", "height")},
    **dict.fromkeys(("objekt", "id", "name", "navn"), "object"),
    **dict.fromkeys(("east", "øst", "ost", "x", "e", "east_m"), "easting"),
    **dict.fromkeys(("north", "nord", "y", "n", "north_m"), "northing"),
    **dict.fromkeys(("lon", "long", "longitude", "lengdegrad"), "easting (with --epsg 4258)"),
    **dict.fromkeys(("lat", "latitude", "breddegrad"), "northing (with --epsg 4258)"),
    **dict.fromkeys(("z", "høyde", "hoyde"), "height"),
}
"""What others call a column, in lower case → what it is here."""
_EAST_M, _NORTH_M = (-2_000_000.0, 2_000_000.0), (6_300_000.0, 8_200_000.0)
"""Of Norway in any of the zones from 31 to 36: which zone it is only a drive can tell."""


@dataclass(frozen=True, slots=True)
class Truth:
    """One surveyed object, EPSG:25833.

    `drive_id` is "" where the file does not tell drives apart, `label` where it has none. `height_m` is
    ellipsoidal, None where the file has none. `epsg` is the system of the file's own numbers.
    """

    object: str
    drive_id: str
    east_m: float
    north_m: float
    label: str = ""
    height_m: float | None = None
    epsg: int = UTM33


def read_truth(path: Path | str, *, epsg: int | None = None) -> list[Truth]:
    """Read surveyed positions: CSV with the columns object, label, easting, northing.

    A column ``drive_id`` is optional; without it an object's truth holds for every drive in the store. So is
    ``label``; one that begins with a sign code ("362.50;808") helps to pair by position. So is ``height``, of
    the foot, metres above the ellipsoid; a cell of it may be empty. So is ``epsg``, the coordinate system of
    a row: 25832, for one; of a system with NN2000 (5972, 5973, 5975) heights are brought to the ellipsoid.
    Any CSV that a spreadsheet saves is read (:mod:`twin.tables`).

    Parameters
    ----------
    path : Path
    epsg : int, optional
        The coordinate system of rows that do not state theirs; by default EPSG:25833. Of a geographic one
        easting is the longitude, northing the latitude, in degrees.

    Raises
    ------
    TruthError
        No such file, a missing column, a number that is none, an object that stands in two places, a place
        that is not in Norway, or a height that cannot be brought to the ellipsoid: file, line and cure.
    """
    path = Path(path)
    try:
        table = Table(path.read_bytes())
    except OSError as error:
        raise TruthError(
            f"The truth file {path} cannot be read ({error.strerror}): check its name."
        ) from error
    except (NotTextError, csv.Error) as error:
        raise TruthError(f"The truth file {path} is no table ({error}): save it as CSV.") from error
    missing = [name for name in _REQUIRED if name not in table.header]
    if missing:
        columns = "column" if len(missing) == 1 else "columns"
        renamed = [
            f"{name} is {meant}" for name in table.header if (meant := _MEANT.get(name.lower(), name)) != name
        ]
        cure = f" Rename columns: {', '.join(renamed)}." if renamed else ""
        raise TruthError(
            f"The truth file {path} lacks the {columns} {', '.join(missing)}: it needs object, easting and "
            "northing (EPSG:25833), and may have label, height, drive_id and epsg; commas, semicolons or "
            f"tabs part them.{cure}"
        )
    rows: list[Truth] = []
    lines: list[int] = []
    try:
        for row in table.by_name():
            rows.append(_truth(row, table, f"{path}, line {table.line}", epsg))
            lines.append(table.line)
    except csv.Error as error:
        raise TruthError(f"{path}, line {table.line}: this is not CSV ({error}): save it again.") from error
    if not rows:
        raise TruthError(f"The truth file {path} has no rows: give one a surveyed object.")
    _check_once(rows, lines, path)
    return _ellipsoidal(rows, _in_utm33(rows, path), path)


def between(points: FloatArray, source: int, target: int) -> FloatArray:
    """Transform positions from one coordinate system to another; east or longitude stands first.

    Parameters
    ----------
    points : float64 (n, 2)
    source, target : int
        EPSG codes.

    Returns
    -------
    float64 (n, 2)
        Infinite where a system does not reach.

    Raises
    ------
    TruthError
        PROJ knows no such system.
    """
    if source == target:
        return points
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        transformer = Transformer.from_crs(source, target, always_xy=True)
    except ProjError as error:
        raise TruthError(
            f"EPSG:{source} is no coordinate system that PROJ can turn into EPSG:{target}: 25832 is UTM zone "
            "32, 25833 zone 33, 4258 degrees (easting is the longitude)."
        ) from error
    return np.column_stack(transformer.transform(*points.T))


def _check_once(rows: Sequence[Truth], lines: Sequence[int], path: Path) -> None:
    """Refuse an object that a drive has in two places: nothing tells which of them is right."""
    first: dict[tuple[str, str], tuple[Truth, int]] = {}
    for one, line in zip(rows, lines, strict=True):
        other, before = first.setdefault((one.drive_id, one.object), (one, line))
        if one.object and (one.east_m, one.north_m, one.epsg) != (other.east_m, other.north_m, other.epsg):
            raise TruthError(
                f"{path}, lines {before} and {line}: object {one.object} stands in two places: remove one of "
                "the lines, or tell drives apart by a column drive_id."
            )


def _ellipsoidal(rows: Sequence[Truth], in_utm33: list[Truth], path: Path) -> list[Truth]:
    """Bring heights of systems that state NN2000 to the ellipsoid; refuse those of other height systems."""
    found = list(in_utm33)
    for epsg in sorted({one.epsg for one in rows}):
        mine = [i for i, one in enumerate(in_utm33) if one.epsg == epsg and one.height_m is not None]
        vertical = _vertical(epsg)
        if vertical is None or not mine:
            continue
        cure = "leave the heights out, or give ellipsoidal ones"
        if vertical.to_epsg() != _NN2000:
            raise TruthError(f"{path}: heights of EPSG:{epsg} are in {vertical.name}: {cure}.")
        at = np.array([(found[i].east_m, found[i].north_m) for i in mine])
        moved = ellipsoidal_from_nn2000(
            *geographic_from_utm33(*at.T), np.array([found[i].height_m for i in mine], dtype=np.float64)
        )
        if not np.isfinite(moved.height_m).all():
            raise TruthError(f"{path}: heights of EPSG:{epsg} are NN2000. {moved.how} Install it, or {cure}.")
        for i, height_m in zip(mine, moved.height_m.tolist(), strict=True):
            found[i] = replace(found[i], height_m=height_m)
    return found


def _vertical(epsg: int) -> CRS | None:
    """The height system that a coordinate system states; None where heights are above the ellipsoid."""
    from pyproj import CRS

    parts = CRS.from_epsg(epsg).sub_crs_list
    return parts[1] if len(parts) == 2 else None


def _truth(row: Mapping[str, str], table: Table, where: str, epsg: int | None) -> Truth:
    """One row, still in its own system."""
    if empty := [name for name in ("easting", "northing") if not row[name]]:
        raise TruthError(f"{where}: {' and '.join(empty)} {'is' if len(empty) == 1 else 'are'} empty.")
    try:
        east, north = (float(table.plain(row[name])) for name in ("easting", "northing"))
    except ValueError as error:
        raise TruthError(f"{where}: easting and northing must be numbers ({error}).") from error
    try:
        text = table.plain(row.get("height", ""))
        height = float(text) if text else None
    except ValueError as error:
        raise TruthError(f"{where}: height must be a number or empty ({error}).") from error
    stated = row.get("epsg", "").upper().removeprefix("EPSG:")
    if stated and not stated.isdecimal():
        raise TruthError(f"{where}: epsg must be the number of a coordinate system, as 25832, not {stated}.")
    if stated and epsg is not None and int(stated) != epsg:
        raise TruthError(f"{where}: its epsg is {stated}, but --epsg says {epsg}: leave the option out.")
    system = int(stated) if stated else epsg or UTM33
    if wrong := _misread(east, north, system):
        raise TruthError(f"{where}: {wrong}")
    return Truth(row["object"], row.get("drive_id", ""), east, north, row.get("label", ""), height, system)


def _misread(east: float, north: float, epsg: int) -> str:
    """What easting and northing of a row seem to be instead; "" where they may be what they say."""
    if epsg != UTM33:
        return ""
    told = f"easting {east:.9g} and northing {north:.9g}"
    if _inside(east, _EAST_M) and _inside(north, _NORTH_M):
        return ""
    if _inside(north, _EAST_M) and _inside(east, _NORTH_M):
        return f"{told} are swapped, north first: exchange the names of the two columns."
    if abs(east) <= 180.0 and abs(north) <= 180.0:
        first = "longitude and latitude" if east < north else "latitude and longitude"
        swap = "" if east < north else ", and exchange the names of the two columns: easting is the longitude"
        return f"{told} are {first}: say so by --epsg 4258 or in a column epsg{swap}."
    return f"{told} are not in Norway in EPSG:25833: check the coordinate system, or state it (--epsg)."


def _inside(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] < value < limits[1]


def _in_utm33(rows: Sequence[Truth], path: Path) -> list[Truth]:
    points = np.array([(one.east_m, one.north_m) for one in rows])
    systems = np.array([one.epsg for one in rows])
    for epsg in np.unique(systems).tolist():
        points[systems == epsg] = between(points[systems == epsg], epsg, UTM33)
    for one, (east, north) in zip(rows, points.tolist(), strict=True):
        if not (_inside(east, _EAST_M) and _inside(north, _NORTH_M)):
            raise TruthError(
                f"{path}: object {one.object} ({one.east_m:g}, {one.north_m:g}) is not in Norway in "
                f"EPSG:{one.epsg}: check the system, and that the columns are not swapped."
            )
    return [
        replace(one, east_m=east, north_m=north)
        for one, (east, north) in zip(rows, points.tolist(), strict=True)
    ]
