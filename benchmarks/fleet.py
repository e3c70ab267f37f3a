"""What one more drive costs a fleet's store: the processor's time and memory of `match`, by drives in it.

Usage: python benchmarks/fleet.py [--drives 10 50 200] [--stores FOLDER] [--profile]

Stores are filled with drives of 16 km past the signs of benchmarks/municipality_world.py: forty drives a
municipality of 5,000 signs, one municipality beside the other. A drive has its track, rig and sightings, and
says which errors its estimates share, so that drives past one pole are tied together as real ones are. There
is no road network.

Each store is matched; then one more drive comes, in the first municipality, and it is matched again; then
NVDB has moved ten signs there, and it is matched again; last `--all` works everything out anew and says
whether the kept parts agree. Municipalities beyond the fifth are copies of four of these. Every match runs
in a process of its own. Seconds are the processor's, which hold while the machine has other work too; `ratio`
is to the store with the fewest drives. Run it with OMP_NUM_THREADS=1.

Bars: one more drive costs at most 1.5 times what it costs the smallest store, and takes under 500 MB; the
first match of 200 drives takes at most 20 s and 1 GB; `--all` agrees.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import multiprocessing
import pstats
import resource
import shutil
import tempfile
import time
import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import sqlalchemy as sa
from matching import fill_mirror
from municipality_world import (
    BLOCK_M,
    BLOCKS,
    START_NS,
    STEP_M,
    Fleet,
    World,
    drive_around,
    make_world,
    sites_of,
)
from rich.progress import track

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, utm33_from_geographic
from geoloc.rig.rig import rig_document
from geoloc.simulation.car import simulated_rig
from geoloc.trajectory.poses import Poses
from twin.cli.output import console, print_table
from twin.matching.match_store import match
from twin.mirror.touched import places_of
from twin.store import schema
from twin.store.kinds import Method
from twin.store.poses import blob_from_poses, poses_from_blob
from twin.store.records import Correction, Corrections, Estimate
from twin.store.store import Row, Store

DRIVES_A_TILE = 40
DRAWN_TILES = 5
"""Municipalities beyond these are copies of the last four."""
SIGNS_A_TILE = 5000
TILE_M = BLOCKS * BLOCK_M + 1000.0
CHANGED_SIGNS = 10
STEP_NS = round(STEP_M / 13.0 * 1e9)
SIGHTINGS = 10
CAMERA = "C1_front60Single"
KNOWN = Correction(0.0, 5.0)
CORRECTIONS = Corrections(1.0, KNOWN, KNOWN, {}, camera_prior_ms=10.0, camera_solved_ms=5.0)


class Run(NamedTuple):
    """Processor's seconds, peak memory and number of findings of one match; what `--all` says."""

    seconds: float
    peak_mb: float
    n_findings: int
    kept_agree: bool | None


def fill(
    path: Path | str, n_drives: int, n_signs: int = SIGNS_A_TILE, at_m: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Make a store with so many drives, and beside it one with the drive that comes next."""
    n_tiles = -(-n_drives // DRIVES_A_TILE)
    rig = zlib.compress(json.dumps(rig_document(simulated_rig())).encode())
    with Store.open(path) as store:
        for tile in range(min(n_tiles, DRAWN_TILES)):
            world = make_world(n_signs, np.random.default_rng(tile))
            _fill_tile(store, world, tile, min(DRIVES_A_TILE, n_drives - tile * DRIVES_A_TILE), rig, at_m)
        for tile in range(DRAWN_TILES, n_tiles):
            _copy_tile(store, 1 + tile % (DRAWN_TILES - 1), tile)
        with store.transaction() as connection:
            store.put_fact(connection, "mirror", {"synced_at": "2026-06-10T08:00:00Z"})


def _fill_tile(
    store: Store, world: World, tile: int, n_drives: int, rig: bytes, at_m: tuple[float, float]
) -> None:
    origin = np.array([tile * TILE_M, 0.0]) + at_m
    fill_mirror(store, _moved(world, origin), int(world.known.sum()), first_id=tile * SIGNS_A_TILE)
    # One more in the first tile: the drive that is to come.
    n = n_drives + (tile == 0)
    fleet = drive_around(world, sites_of(world)[0], max(n, 2), 0.002, np.random.default_rng(100 + tile))
    for number in range(n):
        drive_id = f"T{tile:02}{number:03}"
        is_next = tile == 0 and number == n_drives
        started_ns = START_NS + (1000 if is_next else number) * 9 * 86_400_000_000_000
        _put_drive(store, _of_drive(fleet, number), drive_id, started_ns, origin, rig, aside=is_next)


def _copy_tile(store: Store, drawn: int, tile: int) -> None:
    """Put another municipality as far east as its number says: the same one under other names."""
    east_m, here, there = (tile - drawn) * TILE_M, f"T{drawn:02}", f"T{tile:02}"
    with store.transaction() as connection:
        for table in (schema.drive_method, schema.estimate, schema.sighting):
            own = table.c
            new: dict[str, Any] = {
                n: there + sa.func.substr(own[n], 4) for n in ("drive_id", "estimate_id") if n in own
            }
            if "east_m" in own:
                new["east_m"] = own.east_m + east_m
            columns = [new.get(c.name, c).label(c.name) for c in table.columns]
            asked = sa.select(*columns).where(own.drive_id.startswith(here))
            connection.execute(sa.insert(table).from_select(own.keys(), asked))
        for table, times in ((schema.skiltpunkt, 1), (schema.skiltplate, 10)):
            first = times * (drawn * SIGNS_A_TILE + 1)
            inside = table.c.nvdb_id.between(first, first + times * SIGNS_A_TILE - 1)
            rows = store.view(connection).rows(sa.select(table).where(inside))
            connection.execute(sa.insert(table), [_renamed(row, east_m, tile - drawn) for row in rows])
        t = schema.drive
        for row in store.view(connection).rows(sa.select(t).where(t.c.drive_id.startswith(here))):
            poses = poses_from_blob(row["poses"])
            moved = _in_tile(poses, int(poses.epoch_ns[0]), np.array([east_m, 0.0]))
            name = there + row["drive_id"][3:]
            new = {"drive_id": name, "name": name, "content_sha256": name, "poses": blob_from_poses(moved)}
            connection.execute(sa.insert(t), [{**row, **new}])


def _renamed(row: Row, east_m: float, tiles: int) -> dict[str, Any]:
    """A sign of NVDB so many municipalities further east; plates have the tenfold ids of their points."""
    points, plates = tiles * SIGNS_A_TILE, 10 * tiles * SIGNS_A_TILE
    if "plate_ids" in row:
        ids = {"nvdb_id": row["nvdb_id"] + points, "plate_ids": [one + plates for one in row["plate_ids"]]}
    else:
        ids = {"nvdb_id": row["nvdb_id"] + plates, "point_id": row["point_id"] + points}
    return {**row, **ids, "east_m": row["east_m"] + east_m}


def _moved(world: World, origin: FloatArray) -> World:
    return replace(world, place=world.place + origin, recorded=world.recorded + origin)


def _of_drive(fleet: Fleet, number: int) -> tuple[Poses, list[Estimate]]:
    name = fleet.order[number]
    return fleet.tracks[number], [one for one in fleet.estimates if one.drive_id == name]


def _put_drive(
    store: Store,
    seen: tuple[Poses, list[Estimate]],
    drive_id: str,
    started_ns: int,
    origin: FloatArray,
    rig: bytes,
    *,
    aside: bool,
) -> None:
    poses, estimates = _in_tile(seen[0], started_ns, origin), []
    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    for one in seen[1]:
        place = np.array([one.east_m, one.north_m]) + origin
        nearest = int(np.argmin(np.hypot(east - place[0], north - place[1])))
        half = [0.5 * value for value in one.covariance_m2]
        estimates.append(
            replace(
                one,
                drive_id=drive_id,
                estimate_id=f"{drive_id}:{one.object}:adjusted",
                east_m=float(place[0]),
                north_m=float(place[1]),
                height_m=100.0,
                range_min_m=8.0,
                first_ns=int(poses.epoch_ns[nearest]) - 2_000_000_000,
                last_ns=int(poses.epoch_ns[nearest]),
                budget={"gnss": (half[0], half[1], half[2]), "pixels": (half[0], half[1], half[2])},
            ).to_row()
        )
    rows: dict[sa.Table, Sequence[Any]] = {
        schema.drive: [_drive_row(drive_id, started_ns, poses, rig)],
        schema.drive_method: [
            {
                "drive_id": drive_id,
                "method": Method.ADJUSTED,
                "n_unplaced": 0,
                "corrections": CORRECTIONS.to_json(),
            }
        ],
        schema.estimate: estimates,
        schema.sighting: [row for one in estimates for row in _sightings(one)],
    }
    with store.transaction() as connection:
        for table, values in rows.items():
            target = schema.KEPT[table] if aside else table
            number = {"annotation_set": 1} if aside else {}
            defaults = {"misfits": [], "absence_gap": ""} if table is schema.drive_method else {}
            if values:
                connection.execute(sa.insert(target), [{**defaults, **row, **number} for row in values])


def _in_tile(poses: Poses, started_ns: int, origin: FloatArray) -> Poses:
    place = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=1) + origin
    lat, lon = geographic_from_utm33(*place.T)
    epoch_ns = started_ns + STEP_NS * np.arange(len(lat), dtype=np.int64)
    return replace(poses, epoch_ns=epoch_ns, latitude_deg=lat, longitude_deg=lon)


def _drive_row(drive_id: str, started_ns: int, poses: Poses, rig: bytes) -> dict[str, Any]:
    return {
        "drive_id": drive_id,
        "name": drive_id,
        "started_ns": started_ns,
        "ended_ns": int(poses.epoch_ns[-1]),
        "datum": "EUREF89",
        "annotations_complete": True,
        "n_frames": len(poses.epoch_ns),
        "n_annotations": 3000,
        "length_m": 16_000.0,
        "line": b"",
        "rig": rig,
        "poses": blob_from_poses(poses),
        "content_sha256": drive_id,
        "fix_quality": {},
        "cameras": list(simulated_rig().cameras),
        "warnings": [],
        "skipped": {},
        "software": "benchmark",
    }


def _sightings(estimate: dict[str, Any]) -> list[dict[str, Any]]:
    number = 1000 * int(estimate["object"])
    return [
        {
            "drive_id": estimate["drive_id"],
            "method": Method.ADJUSTED,
            "number": number + k,
            "object": estimate["object"],
            "camera": CAMERA,
            "frame": estimate["last_ns"] // 100_000_000 % 100_000 + k,
            "epoch_ns": estimate["last_ns"] - 100_000_000 * k,
            "kind": "foot",
            "u_px": 900.0 + 10.0 * k,
            "v_px": 600.0 + k,
            "rejected": "",
            "is_measured": True,
        }
        for k in range(SIGHTINGS)
    ]


def let_next_come(path: Path) -> None:
    """Put the drive that was kept aside among the others."""
    with Store.open(path) as store, store.transaction() as connection:
        come = connection.execute(sa.select(schema.KEPT[schema.drive].c.drive_id)).scalars().all()
        for table, kept in schema.KEPT.items():
            names = [column.name for column in table.columns]
            asked = sa.select(*(kept.c[name] for name in names))
            connection.execute(sa.insert(table).from_select(names, asked))
            connection.execute(sa.delete(kept))
        store.touch(connection, come)


def let_signs_change(path: Path) -> None:
    """Let NVDB move signs of the first municipality, as a sync would."""
    with Store.open(path) as store, store.transaction() as connection:
        ids = {95: frozenset(range(100, 5000, 5000 // CHANGED_SIGNS)), 96: frozenset[int]()}
        before = places_of(connection, ids)
        for table, number in ((schema.skiltpunkt, "nvdb_id"), (schema.skiltplate, "point_id")):
            moved = sa.update(table).where(table.c[number].in_(ids[95]))
            connection.execute(moved.values(east_m=table.c.east_m + 2.5))
        store.touch(connection, places=before | places_of(connection, ids))


def measured(path: Path, profile: Path | None = None, *, anew: bool = False) -> Run:
    """Match a store in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_match, (path, profile, anew))


def _match(path: Path, profile: Path | None, anew: bool) -> Run:
    start = time.process_time()
    with Store.open(path) as store, cProfile.Profile() if profile else nullcontext() as profiler:
        report = match(store, anew=anew)
    seconds = time.process_time() - start
    if profile is not None and profiler is not None:
        profiler.dump_stats(profile)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Run(seconds, peak_mb, sum(report.verdicts.values()), report.kept_agree)


def run(folder: Path, n_drives: int, *, profile: bool) -> list[Run]:
    """The first match of a store, those after one more drive and a sync, and one of everything."""
    made, path = folder / f"{n_drives}.db", folder / "now.db"
    if not made.exists():
        part = made.with_suffix(".part")
        fill(part, n_drives)
        part.rename(made)
    shutil.copy(made, path)
    runs = [measured(path)]
    let_next_come(path)
    runs.append(measured(path, folder / f"{n_drives}.prof" if profile else None))
    let_signs_change(path)
    runs.append(measured(path))
    runs.append(measured(path, anew=True))
    path.unlink()
    return runs


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--drives", type=int, nargs="+", default=[10, 50, 200])
    parser.add_argument("--stores", type=Path, help="folder in which the filled stores are kept")
    parser.add_argument("--profile", action="store_true", help="say where the time goes; it counts as time")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.stores or Path(temporary)
        folder.mkdir(exist_ok=True)
        runs = {
            n: run(folder, n, profile=options.profile)
            for n in track(options.drives, "stores", console=console())
        }
        for n in options.drives if options.profile else ():
            pstats.Stats(str(folder / f"{n}.prof")).sort_stats("cumulative").print_stats(45)
    smallest = runs[options.drives[0]][1].seconds
    rows = [
        [
            f"{n:,}",
            f"{one.n_findings:,}",
            f"{first.seconds:.1f}",
            f"{first.peak_mb:,.0f}",
            f"{one.seconds:.1f}",
            f"{one.peak_mb:,.0f}",
            f"{one.seconds / smallest:.2f}",
            f"{sync.seconds:.1f}",
            "yes" if everything.kept_agree else "NO",
        ]
        for n, (first, one, sync, everything) in runs.items()
    ]
    columns = [
        "drives",
        "findings",
        "first [s]",
        "[MB]",
        "one more drive [s]",
        "[MB]",
        "ratio",
        f"{CHANGED_SIGNS} signs changed [s]",
        "--all agrees",
    ]
    print_table("Matching a fleet's store", columns, rows, right_from=0)


if __name__ == "__main__":
    main()
