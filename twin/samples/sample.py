"""The sample in ``data/``: a simulated drive near Trondheim and an invented NVDB around it.

Remake it with ``python -m twin.samples.sample data``; the same seed gives the same bytes.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.simulation.noise import stream
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from nvdb.datakatalog import SKILTPLATE, SKILTPUNKT
from twin.errors import TwinError
from twin.samples.sample_nvdb import (
    MAIN_LINK,
    MAIN_ROAD,
    SIDE_LINK,
    SIDE_ROAD,
    NvdbPole,
    pages,
    skiltplate_documents,
    skiltpunkt_document,
    vegnett_page,
)
from twin.samples.write_cvat import LABEL
from twin.samples.write_drive import write_driveworks_trip

SEED = 20260610
TRIP, SECOND_TRIP = "trip_trondheim", "trip_trondheim_2"
GEOID_M = 39.42
"""HREF2018B at the sample road: ellipsoidal height minus NN2000."""
FIRST_POINT_ID, FIRST_PLATE_ID = 1042500101, 1042600101
MOVED, NEW, WRONG_TYPE = "P07", "P04", "P12"
MOVED_BY_M = 3.0
NVDB_CODE_OF_WRONG_TYPE = "362.60"
MISSING = (306.0, -5.3, "516")
"""Station, offset and code of a pole that NVDB has and the road has not."""
OUT_OF_VIEW = (
    (225.0, -232.0, "204", True),
    (228.0, -246.0, "362.30", True),
    (180.0, 238.0, "202", True),
    (60.0, -262.0, "406", True),
    (232.0, -258.0, "302", False),
)
"""Station, offset, code and own geometry of signs on side roads, more than 200 m from the drive."""
SECOND_START_NS = int(datetime(2026, 9, 14, 9, 30, tzinfo=UTC).timestamp()) * 1_000_000_000
SECOND_STATION_M, SECOND_DURATION_S = 270.0, 11.6
"""The second drive passes the last third of the road only, from P10 to P13: small, and enough to disagree."""
SECOND_SEED = 3
"""Added to the sample's: an ordinary drive of the eight tried, neither the best nor the worst."""
MISREAD, CODES_MISREAD = "P13", "404.2;906V"
"""What the second drive's annotator set: the arrow the other way."""
QUALITY = (("sat", 10, 0.1), ("sat", 20, 0.2), ("dig", 30, 0.3), ("ukj", 100, 0.3))
"""Capture method, stated accuracy in cm, and how far the position truly is off in metres."""


def make_sample(folder: Path | str, seed: int = SEED) -> list[Path]:
    """Make the sample: drive, NVDB pages, truth and the changes that are to be found.

    Parameters
    ----------
    folder : Path or str
        ``data`` of the source tree. Files that the sample consists of are replaced, others stay.
    seed : int
        The shipped sample is made with the default.

    Returns
    -------
    list of Path
        The files made.

    Raises
    ------
    TwinError
        If the folder cannot be written.
    """
    folder = Path(folder)
    drives = sample_drives(seed)
    drive = drives[TRIP]
    poles = _nvdb_poles(drive, seed)
    files = [file for name, one in drives.items() for file in write_driveworks_trip(one, folder / name)]
    points = pages(SKILTPUNKT, [skiltpunkt_document(pole) for pole in poles.values()])
    plates = pages(SKILTPLATE, [plate for pole in poles.values() for plate in skiltplate_documents(pole)])
    texts = {f"nvdb/skiltpunkt_95_page{i}.json": _json(page) for i, page in enumerate(points, start=1)}
    texts |= {f"nvdb/skiltplate_96_page{i}.json": _json(page) for i, page in enumerate(plates, start=1)}
    texts["nvdb/vegnett_page1.json"] = _json(vegnett_page(_main_road(drive, seed)))
    texts["truth.csv"] = _csv(("object", "label", "easting", "northing"), _truth(drive))
    texts["expected_changes.csv"] = _csv(
        ("verdict", "nvdb_type", "nvdb_id", "object", "skiltnummer_nvdb", "skiltnummer_seen"),
        _expected(drive, poles),
    )
    return [*files, *(_write(folder / name, text) for name, text in texts.items())]


def sample_drives(seed: int = SEED) -> dict[str, SimulatedDrive]:
    """Simulate the drives of the sample, by the names of their folders.

    The second passes part of the road three months later, and its annotator misread a sign.
    """
    world = scenario("sample")
    again = replace(
        world,
        name=SECOND_TRIP,
        road=replace(world.road, seed=seed),
        motion=replace(
            world.motion,
            start_station_m=SECOND_STATION_M,
            duration_s=SECOND_DURATION_S,
            speed=world.motion.speed[:1],
        ),
        start_utc_ns=SECOND_START_NS,
    )
    second = simulate_drive(again, seed + SECOND_SEED)
    codes = np.where(second.objects.object == MISREAD, CODES_MISREAD, second.objects.skiltnummer)
    return {
        TRIP: simulate_drive(replace(world, name=TRIP), seed),
        SECOND_TRIP: replace(second, objects=replace(second.objects, skiltnummer=codes)),
    }


def _main_road(drive: SimulatedDrive, seed: int) -> list[tuple[float, float, float, float]]:
    """Meter along the main road, east, north and NN2000 height of its centre line, every 5 m."""
    road = Road(drive.scenario.road, seed)
    return [
        (meter, east, north, height - GEOID_M)
        for meter in np.arange(0.0, road.spec.length_m + 1.0, 5.0).tolist()
        for east, north, height in [_place(road, meter, 0.0)]
    ]


def _nvdb_poles(drive: SimulatedDrive, seed: int) -> dict[str, NvdbPole]:
    """Return what NVDB has: object id (or a key of its own for what the drive cannot show) → pole."""
    road = Road(drive.scenario.road, seed)
    rng = stream(seed, "nvdb")
    wanted = [(p.object, p.station_m, p.offset_m, p.skiltnummer, True) for p in drive.scenario.poles]
    wanted = [row for row in wanted if row[0] != NEW] + [("missing", *MISSING, True)]
    wanted += [(f"side {i}", *row) for i, row in enumerate(OUT_OF_VIEW, start=1)]
    poles: dict[str, NvdbPole] = {}
    plate_id = FIRST_PLATE_ID
    for i, (key, station, offset, skiltnummer, own) in enumerate(wanted):
        codes = (NVDB_CODE_OF_WRONG_TYPE,) if key == WRONG_TYPE else tuple(skiltnummer.split(";"))
        quality = QUALITY[0 if key == MOVED else i % len(QUALITY)]
        along = station + (MOVED_BY_M if key == MOVED else 0.0)
        bearing = float(rng.uniform(0.0, 2.0 * np.pi))
        poles[key] = replace(
            _pole(road, along, offset, quality, bearing, side_road=key.startswith("side")),
            point_id=FIRST_POINT_ID + i,
            plate_ids=tuple(range(plate_id, plate_id + len(codes))),
            codes=codes,
            own_geometry=own,
        )
        plate_id += len(codes)
    return poles


def _pole(
    road: Road,
    station_m: float,
    offset_m: float,
    quality: tuple[str, int, float],
    bearing_rad: float,
    *,
    side_road: bool,
) -> NvdbPole:
    """Return a pole without plates or ids, as far off its place as its quality says."""
    method, accuracy_cm, error_m = quality
    east, north, height = _place(road, station_m, offset_m)
    # The side roads' centre lines are not modelled: each runs through its signs.
    centre_east, centre_north, _ = _place(road, station_m, offset_m if side_road else 0.0)
    return NvdbPole(
        point_id=0,
        plate_ids=(),
        codes=(),
        east_m=east + error_m * float(np.sin(bearing_rad)),
        north_m=north + error_m * float(np.cos(bearing_rad)),
        height_m=None if method == "ukj" else height - GEOID_M,
        own_geometry=True,
        accuracy_cm=accuracy_cm,
        capture_method=method,
        road=SIDE_ROAD if side_road else MAIN_ROAD,
        link_id=SIDE_LINK if side_road else MAIN_LINK,
        meter=station_m,
        right=offset_m < 0.0,
        centre_east_m=centre_east,
        centre_north_m=centre_north,
    )


def _place(road: Road, station_m: float, offset_m: float) -> tuple[float, float, float]:
    """East and north in EPSG:25833 and ellipsoidal height of a place on or beside the road."""
    station, offset = np.array([station_m]), np.array([offset_m])
    up = road.surface_m(station, offset)
    enu = np.concatenate([road.plan_m(station, offset), up[:, None]], axis=-1)
    latitude, longitude, height = road.frame.geographic_from_enu(enu)
    east, north = utm33_from_geographic(latitude, longitude)
    return float(east[0]), float(north[0]), float(height[0])


def _truth(drive: SimulatedDrive) -> Iterable[Sequence[str]]:
    objects = drive.objects
    for name, east, north in zip(objects.object, objects.east_utm33_m, objects.north_utm33_m, strict=True):
        yield str(name), LABEL, f"{east:.3f}", f"{north:.3f}"


def _expected(drive: SimulatedDrive, poles: Mapping[str, NvdbPole]) -> Iterable[Sequence[str]]:
    """One row a pole; a wrong type is a finding about the plate, the other verdicts are about the pole."""
    for pole in drive.scenario.poles:
        known = poles.get(pole.object)
        if known is None:
            yield "new", str(SKILTPUNKT), "", pole.object, "", pole.skiltnummer
        elif pole.object == MISREAD:
            seen, ids = CODES_MISREAD.split(";", maxsplit=1)[0], (str(SKILTPLATE), str(known.plate_ids[0]))
            yield "review", *ids, pole.object, known.codes[0], f"{known.codes[0]} or {seen}"
        elif pole.object == WRONG_TYPE:
            ids = str(SKILTPLATE), str(known.plate_ids[0])
            yield "wrong_type", *ids, pole.object, known.codes[0], pole.skiltnummer
        else:
            verdict = "moved" if pole.object == MOVED else "unchanged"
            ids = str(SKILTPUNKT), str(known.point_id)
            yield verdict, *ids, pole.object, ";".join(known.codes), pole.skiltnummer
    gone = poles["missing"]
    yield "missing", str(SKILTPUNKT), str(gone.point_id), "", ";".join(gone.codes), ""


def _json(document: Mapping[str, Any]) -> str:
    """Compact, but one object a line: small, and a difference shows where it is."""
    lines = ",\n".join(
        json.dumps(item, ensure_ascii=False, separators=(",", ":")) for item in document["objekter"]
    )
    metadata = json.dumps(document["metadata"], ensure_ascii=False, separators=(",", ":"))
    return f'{{"objekter":[\n{lines}\n],\n"metadata":{metadata}}}\n'


def _csv(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode("utf-8"))
    except OSError as error:
        raise TwinError(f"The sample cannot be written to {path}: {error.strerror or error}.") from error
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``python -m twin.samples.sample FOLDER``."""
    parser = argparse.ArgumentParser(
        prog="python -m twin.samples.sample", description="Make the sample drive and NVDB."
    )
    parser.add_argument("folder", type=Path, help="where to, e.g. data")
    parser.add_argument("--seed", type=int, default=SEED, help="default: %(default)s, the shipped sample")
    options = parser.parse_args(arguments)
    try:
        files = make_sample(options.folder, options.seed)
    except TwinError as error:
        parser.exit(1, f"{error}\n")
    size = sum(path.stat().st_size for path in files)
    sys.stdout.write(f"{len(files)} files, {size / 1000:.0f} kB in {options.folder}\n")


if __name__ == "__main__":
    main()
