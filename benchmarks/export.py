"""What an export costs beyond writing the same rows with pyogrio.

Usage: python benchmarks/export.py [--changes 100000] [--rounds 3] [--accepted 0] [--profile]

A store of its own is filled with findings: a Skiltpunkt and a Skiltplate, an estimate and a change a pole,
every verdict among them, seen by a hundred drives. ``export_findings`` reads it, works out ellipses, moves
and degrees, and writes both GeoPackages (with styles and project) and the GeoJSON. The baseline is pyogrio's
``write_dataframe`` alone, of the same columns and rows, from frames in memory, into the same formats. Both
run in processes of their own, turn by turn. ``CPU`` is the processor's time of each: it holds while the
machine has other work too. Peak memory is each process's own, with its imports and, for the baseline, the
frames. Run it with OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import cProfile
import multiprocessing
import pickle
import pstats
import resource
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import sqlalchemy as sa

from twin.cli.output import print_table
from twin.matching.save import save_changes
from twin.mirror.raw import packed
from twin.store import schema
from twin.store.kinds import Method, Verdict
from twin.store.records import Finding
from twin.store.store import Store

Times = tuple[float, float]
Run = tuple[float, float, float]

N_DRIVES = 100
METHOD = Method.ADJUSTED
SPACING_M = 60.0
START_NS = 1_780_000_000_000_000_000
VERDICTS = [verdict for verdict in Verdict if verdict is not Verdict.NOT_OBSERVABLE]
SHARES = (0.80, 0.05, 0.05, 0.05, 0.03, 0.02)
_OBJECT = {
    "version": 1,
    "start_date": "2010-01-01",
    "own_geometry": True,
    "accuracy_cm": 30.0,
    "capture_method": "fot",
    "road_reference": "KV2210 S1D1 m120",
    "kommuner": [5001],
    "stedfesting": [{"veglenkesekvensid": 3041771, "relativ_posisjon": 0.5}],
    "problems": [],
    "synced_at": "2026-06-10T08:00:00Z",
    "last_modified": "2024-03-01T10:00:00",
}


def _drive(number: int) -> dict[str, Any]:
    import shapely

    line = shapely.LineString([(270_000 + 10 * i, 7_000_000 + 60 * number) for i in range(2000)])
    return {
        "drive_id": f"{number:012x}",
        "name": f"trip {number}",
        "started_ns": START_NS + number * 3_600_000_000_000,
        "ended_ns": START_NS + (number + 1) * 3_600_000_000_000,
        "datum": "EUREF89",
        "annotations_complete": True,
        "n_frames": 108_000,
        "n_annotations": 20_000,
        "length_m": 20_000.0,
        "line": shapely.to_wkb(line),
        "rig": b"",
        "poses": b"",
        "content_sha256": f"{number:064x}",
        "fix_quality": {},
        "cameras": ["C1"],
        "warnings": [],
        "skipped": [],
        "software": "benchmark",
    }


def _raw(kind: int, nvdb_id: int) -> bytes:
    """Make an object as API Les gives it, with what undoing a change set needs."""
    metadata = {"type": {"id": kind}, "versjon": 1, "startdato": "2010-01-01"}
    code = {"id": 5530, "navn": "Skiltnummer", "verdi": "362.50", "enum_id": 8874}
    values = [{**code, "egenskapstype": "Tekstenum"}] if kind == 96 else []
    return packed({"id": nvdb_id, "metadata": metadata, "egenskaper": values})


def _pole(
    number: int, verdict: str, place: np.ndarray[Any, Any], seen: np.ndarray[Any, Any]
) -> dict[str, Any]:
    """Rows of one pole by table; `seen` is where the drive found it."""
    drive_id, key = f"{number % N_DRIVES:012x}", f"{number:012x}"
    east, north = seen.tolist()
    at = {"east_m": east, "north_m": north}
    covariance = {"cov_ee_m2": 0.0064, "cov_en_m2": 0.001, "cov_nn_m2": 0.0049}
    point, plate, code = 10 * number + 1, 10 * number + 2, "362.50"
    recorded = {**_OBJECT, "east_m": float(place[0]), "north_m": float(place[1])}
    known, missed = verdict != "new", verdict == "missing"
    rows: dict[str, Any] = {
        "change": {
            "change_id": key,
            "verdict": verdict,
            "reason": f"Skiltpunkt {point} ({code}) stands where NVDB has it, as far as can be told.",
            "confidence": 0.97,
            "nvdb_type": 96 if verdict == "wrong_type" else 95,
            "nvdb_id": (plate if verdict == "wrong_type" else point) if known else None,
            "nvdb_version": 1 if known else None,
            "skiltnummer_nvdb": code if known else "",
            "skiltnummer_seen": "" if missed else "362.60" if verdict == "wrong_type" else code,
            "distance_m": float(np.hypot(*(seen - place))) if known and not missed else None,
            "distance_sigma_m": 0.1 if known and not missed else None,
            "drive_ids": drive_id,
            "cameras": "C2_tricam60,C3_tricam120",
            "n_sightings": 0 if missed else 24,
            "terms": {"log_odds": {"place": 3.2, "code": 4.1}, "nvdb_sigma_m": 0.3, "pole": str(number)},
            **(dict(zip(at, place.tolist(), strict=True)) if missed else at),
            **(dict.fromkeys(covariance) if missed else covariance),
        }
    }
    if known:
        raw = {kind: _raw(kind, number) for kind, number in ((95, point), (96, plate))}
        rows["skiltpunkt"] = {"nvdb_id": point, "plate_ids": [plate], "raw": raw[95], **recorded}
        rows["skiltplate"] = {
            "nvdb_id": plate,
            "point_id": point,
            "skiltnummer": code,
            "raw": raw[96],
            **recorded,
        }
    if not missed:
        rows["estimate"] = {
            "estimate_id": f"{drive_id}:P{number}",
            "drive_id": drive_id,
            "object": f"P{number}",
            "label": "skilt",
            "skiltnummer": rows["change"]["skiltnummer_seen"],
            "method": METHOD,
            "height_m": 65.0,
            "sigma_height_m": 0.1,
            "n_sightings": 24,
            "n_frames": 20,
            "n_cameras": 2,
            "cameras": ["C1", "C2"],
            "first_ns": START_NS + number * 1_000_000,
            "last_ns": START_NS + number * 1_000_000 + 4_000_000_000,
            "range_min_m": 6.5,
            "n_rejected": 0,
            "flags": "",
            "budget": {},
            **at,
            **covariance,
        }
    return rows


def fill(path: Path, n_changes: int, n_accepted: int) -> None:
    """Make a matched store with `n_changes` findings, of which `n_accepted` are accepted."""
    from twin.decisions.record import decide

    rng = np.random.default_rng(1)
    verdicts = rng.choice(VERDICTS, n_changes, p=SHARES).tolist()
    side = int(np.ceil(np.sqrt(n_changes)))
    at = np.arange(n_changes)
    place = np.stack([270_000 + SPACING_M * (at % side), 7_000_000 + SPACING_M * (at // side)], axis=1)
    place = place + rng.uniform(-20, 20, place.shape)
    seen = place + rng.normal(0, 0.1, place.shape)
    seen[np.array(verdicts) == "moved"] += 3.0
    poles = [_pole(i, verdicts[i], place[i], seen[i]) for i in range(n_changes)]
    with Store.open(path) as store:
        with store.transaction() as connection:
            connection.execute(sa.insert(schema.drive), [_drive(i) for i in range(N_DRIVES)])
            for name in ("skiltpunkt", "skiltplate", "estimate"):
                rows = [pole[name] for pole in poles if name in pole]
                connection.execute(sa.insert(schema.metadata.tables[name]), rows)
        keys = {pole["estimate"]["estimate_id"]: str(i) for i, pole in enumerate(poles) if "estimate" in pole}
        run = {"method": METHOD, "at": "2026-06-10T08:00:00Z", "config_sha256": "9f" * 32}
        settings = {"software": "nvdb-twin 0.1.0"}
        save_changes(
            store, [Finding.from_row(p["change"]) for p in poles], keys, {**run, "settings": settings}
        )
        accepted = [p["change"]["change_id"] for p in poles if p["change"]["verdict"] == "wrong_type"]
        if n_accepted:
            decide(store, accepted[:n_accepted], "accept", by="benchmark")


def export(store: Path, folder: Path, profile: bool) -> None:
    """Do what ``twin export --project`` does."""
    from twin.export import export_findings

    with Store.open(store, create=False) as opened:
        if not profile:
            export_findings(opened, folder, project=True)
            return
        profiler = cProfile.Profile()
        profiler.runcall(export_findings, opened, folder, project=True)
        pstats.Stats(profiler, stream=sys.stderr).sort_stats("cumulative").print_stats(45)


def frames(store: Path, pickled: Path) -> None:
    """Keep the frames that an export writes, for the baseline."""
    from twin.export.derived_layers import file_layers, in_wgs84
    from twin.export.from_store import layers_from_store
    from twin.export.layers import normalised

    with Store.open(store, create=False) as opened:
        metres = file_layers(normalised(layers_from_store(opened, METHOD)))
    pickled.write_bytes(pickle.dumps((metres, in_wgs84(metres))))


def _bare(pickled: Path, folder: Path) -> Times:
    import pyogrio

    metres, degrees = pickle.loads(pickled.read_bytes())
    begin = _clocks()
    for name, layers in (("a.gpkg", metres), ("b.gpkg", degrees)):
        for layer, frame in layers.items():
            pyogrio.write_dataframe(frame, folder / name, layer=layer, driver="GPKG")
    pyogrio.write_dataframe(degrees["changes"], folder / "c.geojson", driver="GeoJSON")
    return _since(begin)


def _ours(store: Path, folder: Path, profile: bool) -> Times:
    import geopandas  # noqa: F401
    import pyogrio  # noqa: F401

    import twin.export  # noqa: F401 - imports are not what is measured

    begin = _clocks()
    export(store, folder, profile)
    return _since(begin)


def _clocks() -> Times:
    return time.perf_counter(), time.process_time()


def _since(begin: Times) -> Times:
    wall, cpu = _clocks()
    return wall - begin[0], cpu - begin[1]


def _peak_mb() -> float:
    """Peak memory of this process; the system's own count would begin with that of the process before it."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


def _measured(queue: Any, work: Callable[..., Times], arguments: tuple[Any, ...]) -> None:
    times = work(*arguments)
    queue.put((*times, _peak_mb()))


def apart(work: Callable[..., Times], *arguments: Any) -> Run:
    """Seconds by the clock and of the processor, and peak memory in MB, of a process of its own."""
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    process = context.Process(target=_measured, args=(queue, work, arguments))
    process.start()
    found: Run = queue.get()
    process.join()
    return found


def main() -> None:
    """Fill, measure turn by turn, print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--changes", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--accepted", type=int, default=0, help="of wrong type, which become change sets")
    parser.add_argument("--profile", action="store_true")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store, pickled = folder / "twin.db", folder / "frames"
        fill(store, chosen.changes, chosen.accepted)
        frames(store, pickled)
        times: dict[str, list[Run]] = {"export_findings": [], "bare pyogrio": []}
        out = folder / "out"
        turns: dict[str, Callable[[], Run]] = {
            "bare pyogrio": lambda: apart(_bare, pickled, out),
            "export_findings": lambda: apart(_ours, store, out, chosen.profile),
        }
        for _ in range(chosen.rounds):
            for what, work in turns.items():
                out.mkdir()
                times[what].append(work())
                size = {path.name: path.stat().st_size / 1e6 for path in out.iterdir()}
                shutil.rmtree(out)
        _print(times, size)


def _print(runs: Mapping[str, list[Run]], size: Mapping[str, float]) -> None:
    wall, cpu = ({what: statistics.median(run[i] for run in of) for what, of in runs.items()} for i in (0, 1))
    print_table(
        "An export against bare writes of the same rows",
        ["", "median [s]", "CPU [s]", "peak memory [MB]"],
        [(what, wall[what], cpu[what], int(max(run[2] for run in of))) for what, of in runs.items()],
    )
    for name, median in (("time", wall), ("CPU", cpu)):
        print(f"ratio of {name}: {median['export_findings'] / median['bare pyogrio']:.2f}")
    print("files [MB]:", ", ".join(f"{name} {megabytes:.1f}" for name, megabytes in sorted(size.items())))


if __name__ == "__main__":
    main()
