"""Time, memory and growth of matching: a country of plates against what a fleet saw.

Usage: python benchmarks/matching.py [--observed 100000] [--plates 1150000]

From estimates and a store to findings: grouping of estimates into poles, the mirror near them, sites,
assignment, verdicts; what the drives had in view is not part of it. The signs are those of
benchmarks/municipality.py, tile after tile, so density and clusters stay real; the observed ones lie in the
first tiles, estimated by two drives each. Run it with OMP_NUM_THREADS=1.
The last column says what a sign costs against the first row: 1.0 throughout is linear growth.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import sqlalchemy as sa
from municipality_world import BLOCK_M, BLOCKS, NVDB_SIGMA_M, World, make_world

from twin.cli.output import print_table
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.poles.poles import observed_poles
from twin.matching.sites import mirror_near, sites_from_mirror
from twin.matching.verdicts.judge import judge
from twin.store import schema
from twin.store.records import Estimate
from twin.store.store import Store

TILE = 5000
GAP_M = 1000.0
_T = TypeVar("_T")


def _tile_origin(tile: int) -> np.ndarray[Any, Any]:
    side = BLOCKS * BLOCK_M + GAP_M
    return np.array([tile % 16 * side, tile // 16 * side])


def fill_mirror(store: Store, world: World, n_plates: int, first_id: int = 0) -> None:
    """Put plates into the store, one tile after the other."""
    number, tile = 0, 0
    while number < n_plates:
        shifted = world.recorded + _tile_origin(tile)
        points, plates = [], []
        for k in np.flatnonzero(world.known).tolist():
            nvdb_id = first_id + tile * TILE + k + 1
            own = {**_OBJECT, "east_m": float(shifted[k, 0]), "north_m": float(shifted[k, 1])}
            ids = [10 * nvdb_id + i for i in range(len(world.nvdb_codes[k]))]
            points.append({"nvdb_id": nvdb_id, "plate_ids": ids, **own})
            plates += [
                {"nvdb_id": i, "point_id": nvdb_id, "skiltnummer": code, **own}
                for i, code in zip(ids, world.nvdb_codes[k], strict=True)
            ]
        with store.transaction() as connection:
            connection.execute(sa.insert(schema.skiltpunkt), points)
            connection.execute(sa.insert(schema.skiltplate), plates)
        number, tile = number + len(plates), tile + 1


_OBJECT = {
    "version": 1,
    "start_date": "2010-01-01",
    "own_geometry": True,
    "accuracy_cm": 100 * NVDB_SIGMA_M,
    "capture_method": "sat",
    "kommuner": [5001],
    "stedfesting": [],
    "problems": [],
    "raw": b"-" * 700,
    "synced_at": "2026-06-10T08:00:00Z",
}


def estimate_rows(world: World, n_observed: int, rng: np.random.Generator) -> list[Estimate]:
    """What two drives a tile estimated."""
    found: list[Estimate] = []
    standing = np.flatnonzero(world.stands)
    for number in range(n_observed):
        tile, k = divmod(number, standing.size)
        row = int(standing[k])
        for drive in range(2):
            east, north = (world.place[row] + _tile_origin(tile) + rng.normal(0, 0.08, 2)).tolist()
            found.append(
                Estimate(
                    drive_id=f"T{tile:03}{drive}",
                    object=f"P{row}",
                    east_m=east,
                    north_m=north,
                    covariance_m2=(0.0064, 0.0, 0.0064),
                    codes=tuple(world.codes[row]),
                    cameras=("C1",),
                    n_sightings=20,
                    first_ns=1_780_000_000_000_000_000,
                    last_ns=1_780_000_000_000_000_000,
                )
            )
    return found


def run(n_observed: int, n_plates: int) -> dict[str, float]:
    """Seconds of each step, in a store of its own."""
    rng = np.random.default_rng(1)
    world, config = make_world(TILE, rng), MatchConfig()
    estimates = estimate_rows(world, n_observed, rng)
    order = sorted({estimate.drive_id for estimate in estimates})
    seconds: dict[str, float] = {}

    def timed(step: str, work: Callable[[], _T]) -> _T:
        start = time.perf_counter()
        result = work()
        seconds[step] = time.perf_counter() - start
        return result

    with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "twin.db") as store:
        fill_mirror(store, world, n_plates)
        poles = timed("poles", lambda: observed_poles(estimates, order, config))
        places = np.array([(pole.east_m, pole.north_m) for pole in poles])
        with store.snapshot() as view:
            points, plates = timed("read", lambda: mirror_near(view, places, config))
    sites = timed("sites", lambda: sites_from_mirror(points, plates, config))
    p_unannotated = np.full(len(sites), config.p_missed)
    assignment = timed("assign", lambda: assign(poles, sites, p_unannotated, config))
    views, drives = np.full(len(sites), 50), [["T"]] * len(sites)
    timed("judge", lambda: judge(poles, sites, assignment, views, drives, config))
    return {**seconds, "all": sum(seconds.values()), "sites_n": len(sites), "gb": _peak_gb()}


def _peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--observed", type=int, default=100_000)
    parser.add_argument("--plates", type=int, default=1_150_000)
    options = parser.parse_args()
    steps = ("poles", "read", "sites", "assign", "judge", "all")
    rows, first = [], 0.0
    for share in (0.1, 0.3, 1.0):
        observed, plates = round(options.observed * share), round(options.plates * share)
        result = run(observed, plates)
        each = result["all"] / observed
        first = first or each
        rows.append(
            [
                f"{observed:,}",
                f"{plates:,}",
                *(f"{result[step]:.1f}" for step in steps),
                f"{result['gb']:.1f}",
                f"{each / first:.2f}",
            ]
        )
    columns = ["observed", "plates", *(f"{s} [s]" for s in steps), "peak memory [GB]", "per sign"]
    print_table("Matching", columns, rows, right_from=0)


if __name__ == "__main__":
    main()
