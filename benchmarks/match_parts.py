"""What a first match costs in one piece and in parts: the processor's seconds, and that both say the same.

Usage: python benchmarks/match_parts.py [--drives 50] [--store FILE]

The store is that of benchmarks/fleet.py. `n workers` is what the parts would take on so many free cores: each
next part goes to whoever is free first, tiles come after all drives, the match that puts them together last.
Run it with OMP_NUM_THREADS=1.

Bar: findings, names of poles and what is kept are the same bit for bit.
"""

from __future__ import annotations

import argparse
import heapq
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import sqlalchemy as sa
from fleet import fill

from twin.cli.output import print_table
from twin.matching import match, tiles
from twin.store import schema
from twin.store.store import Store

LEFT = (schema.change, schema.pole_key, schema.known_mark, schema.kept_part)


def left(store: Store) -> list[object]:
    """What a match says, and what it leaves to the next one."""
    return [store.rows(sa.select(table).order_by(*table.primary_key)) for table in LEFT]


def in_parts(store: Store) -> tuple[list[list[float]], float]:
    """Seconds of each part, by stages, and of putting them together."""
    stages = []
    while parts := tiles.parts_to_do(store, least=1):
        took = []
        for name in parts.names:
            start = time.process_time()
            worked = tiles.work_out(store.address, parts.method, parts.plan, name)
            took.append(time.process_time() - start)
            with store.transaction() as connection:
                tiles.stage(connection, parts.plan, worked)
        stages.append(took)
    start = time.process_time()
    match(store)
    return stages, time.process_time() - start


def spread(parts: Sequence[float], workers: int) -> float:
    """How long parts take on so many cores."""
    free = [0.0] * workers
    for seconds in parts:
        heapq.heapreplace(free, free[0] + seconds)
    return max(free)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--drives", type=int, default=50)
    parser.add_argument("--store", type=Path, help="filled already; it is copied")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        one, many = Path(folder) / "one.db", Path(folder) / "many.db"
        if options.store:
            shutil.copy(options.store, one)
        else:
            fill(one, options.drives)
        shutil.copy(one, many)
        with Store.open(many) as store:  # first: what is imported once counts for the parts
            stages, together = in_parts(store)
            found = left(store)
        with Store.open(one) as store:
            start = time.process_time()
            match(store)
            whole = time.process_time() - start
            is_same = left(store) == found
    by_workers = {n: sum(spread(stage, n) for stage in stages) + together for n in (1, 2, 4, 8)}
    rows = [["one match", f"{whole:.1f}"], *([f"{n} workers", f"{s:.1f}"] for n, s in by_workers.items())]
    rows += [["longest part", f"{max(map(max, stages)):.1f}"], ["putting together", f"{together:.1f}"]]
    print_table(f"First match of {options.drives} drives", ["", "s"], rows, right_from=1)
    print("the same" if is_same else "NOT THE SAME")


if __name__ == "__main__":
    main()
