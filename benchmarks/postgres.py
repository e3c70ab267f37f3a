"""PostgreSQL with PostGIS against SQLite on one machine: ingest, match and export; five reviewers at once.

Usage: python benchmarks/postgres.py [--drives 10] [--rounds 3]

Both stores hold the same: drives past the 5,000 signs of a municipality (benchmarks/fleet.py), and the
sample's drive, which is ingested anew each time. The two take turns, and the quickest of their rounds counts,
as the machine may have other work. The server is one of its own, in a temporary folder, with what is written
synced to the disk as SQLite's is.

Then five reviewers decide about every second finding of the database while the drive is ingested and all is
matched again; what they are refused because the match is out of date they ask for again. A reader lists the
findings all the while.

Bars: PostgreSQL takes at most 1.5 times as long as SQLite; no decision that was given is missing from the
log; no reading takes more than a second longer than it does alone.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

import shapely
import sqlalchemy as sa
from fleet import fill

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from postgres_server import running

from twin.cli.output import note, print_table
from twin.decisions.record import decide
from twin.errors import TwinError
from twin.export import export_findings
from twin.ingest import ingest_drive
from twin.matching.match_store import match
from twin.mirror.raw import packed
from twin.samples.demo import sample_folder
from twin.store import schema
from twin.store.store import Store

REVIEWERS = 5
PLATES = 1_000_000_000
BAR = 1.5
LONGEST_WAIT_S = 1.0


def steps(address: str, folder: Path) -> dict[str, Callable[[], object]]:
    """What is timed, in its order."""
    drive = sample_folder() / "trip_trondheim"

    def on(work: Callable[[Store], object]) -> Callable[[], object]:
        def run() -> object:
            with Store.open(address) as store:
                return work(store)

        return run

    return {
        "ingest": on(lambda store: ingest_drive(store, drive)),
        "match, all anew": on(lambda store: match(store, anew=True)),
        "match again": on(match),
        "export": on(lambda store: export_findings(store, folder)),
    }


def let_be_exported(address: str) -> None:
    """Give signs an object as NVDB would and plates ids of their own, and drives a line: an export asks."""
    line = shapely.to_wkb(shapely.LineString([(0.0, 0.0), (1.0, 1.0)]))
    point, plate = schema.skiltpunkt, schema.skiltplate
    with Store.open(address) as store, store.transaction() as connection:
        connection.execute(sa.update(schema.drive).values(line=line))
        connection.execute(sa.update(plate).values(raw=packed({}), nvdb_id=plate.c.nvdb_id + PLATES))
        rows = connection.execute(sa.select(point.c.nvdb_id, point.c.plate_ids)).all()
        own = sa.update(point).where(point.c.nvdb_id == sa.bindparam("point"))
        plates = [{"point": number, "plate_ids": [one + PLATES for one in ids]} for number, ids in rows]
        connection.execute(own.values(raw=packed({})), plates)


def compared(addresses: Sequence[str], folder: Path, rounds: int) -> dict[str, list[float]]:
    """Seconds of each step on each store: the least of the rounds."""
    works = [steps(address, folder / str(number)) for number, address in enumerate(addresses)]
    least: dict[str, list[float]] = {}
    for number in range(rounds):
        for name in works[0]:
            note(f"round {number + 1}: {name}")
            for at, work in enumerate(works):
                start = time.perf_counter()
                work[name]()
                seconds = time.perf_counter() - start
                best = least.setdefault(name, [float("inf")] * len(works))
                best[at] = min(best[at], seconds)
    return least


def ingest_and_match(address: str) -> None:
    """What goes on while people review."""
    for name in ("ingest", "match again"):
        steps(address, Path())[name]()


class Desk:
    """Reviewers, and a reader, of one store."""

    def __init__(self, address: str) -> None:
        self._address = address
        self.given: list[tuple[str, str]] = []
        self.refused = 0
        self.slowest_s = 0.0

    def review(self, name: str, change_ids: Sequence[str]) -> None:
        """Decide one by one; what was refused is asked again."""
        with Store.open(self._address) as store:
            for change_id in change_ids:
                while True:
                    try:
                        decide(store, [change_id], "accept", by=name)
                    except TwinError:
                        self.refused += 1
                        time.sleep(0.2)
                    else:
                        break
                self.given.append((name, change_id))

    def work(self, change_ids: Sequence[str]) -> None:
        """Let them all work while a drive is ingested and matched."""
        threads = [
            threading.Thread(target=self.review, args=(f"reviewer {k}", change_ids[k::REVIEWERS]))
            for k in range(REVIEWERS)
        ]
        other = multiprocessing.get_context("spawn").Process(target=ingest_and_match, args=(self._address,))
        # Its own process: threads of one would wait for one another, and not for the database.
        with multiprocessing.get_context("spawn").Pool(1) as pool, Store.open(self._address) as store:
            ends = store.count(schema.decision_log) + len(change_ids)
            reading = pool.apply_async(slowest_listing_s, (self._address, ends))
            workers: list[BaseProcess | threading.Thread] = [other, *threads]
            for one in workers:
                one.start()
            for one in workers:
                one.join()
            self.slowest_s = reading.get()


def listing_s(store: Store) -> float:
    """Seconds that a list of findings with their decisions takes."""
    start = time.perf_counter()
    change, said = schema.change.c, schema.decision
    joined = schema.change.outerjoin(said, said.c.change_id == change.change_id)
    store.rows(sa.select(change.change_id, said.c.decision).select_from(joined).limit(100))
    return time.perf_counter() - start


def slowest_listing_s(address: str, n_decisions: int) -> float:
    """List findings until the log has so many entries, and return how long the slowest took."""
    slowest_s = 0.0
    with Store.open(address) as store:
        while store.count(schema.decision_log) < n_decisions:
            slowest_s = max(slowest_s, listing_s(store))
    return slowest_s


def reviewed(address: str) -> tuple[Desk, int, float]:
    """The desk after its work, how many of its decisions the log lacks, and a reading's time alone."""
    with Store.open(address) as store:
        alone_s = max(listing_s(store) for _ in range(20))
        ids = [row["change_id"] for row in store.rows(sa.select(schema.change.c.change_id))]
    desk = Desk(address)
    desk.work(sorted(ids)[::20])
    log = schema.decision_log.c
    with Store.open(address) as store:
        kept = {(row["by"], row["change_id"]) for row in store.rows(sa.select(log.by, log.change_id))}
    return desk, len(set(desk.given) - kept), alone_s


def within(ratio: float) -> str:
    """Say whether a ratio is within the bar."""
    return "ok" if ratio <= BAR else "ABOVE"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--drives", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, running(fsync="on", synchronous_commit="on") as server:
        folder = Path(temporary)
        addresses = [str(folder / "twin.db"), server.new()]
        for address in addresses:
            fill(address, options.drives)
            let_be_exported(address)
        least = compared(addresses, folder, options.rounds)
        rows = [
            (
                name,
                f"{ours:.2f}",
                f"{theirs:.2f}",
                f"{theirs / ours:.2f}",
                "ok" if theirs <= BAR * ours else "ABOVE",
            )
            for name, (ours, theirs) in least.items()
        ]
        title = f"{options.drives} drives, 5,000 signs"
        print_table(title, ["", "SQLite [s]", "PostGIS [s]", "ratio", "bar 1.5"], rows, right_from=1)
        desk, lost, alone_s = reviewed(addresses[1])
        told = [
            ("decisions given", f"{len(desk.given):,}"),
            ("of these not in the log (bar 0)", str(lost)),
            ("refused and asked again", str(desk.refused)),
            ("slowest reading, alone [s]", f"{alone_s:.3f}"),
            (f"slowest reading meanwhile [s] (bar + {LONGEST_WAIT_S:g})", f"{desk.slowest_s:.3f}"),
        ]
        print_table("Five reviewers and an ingest at once", ["", ""], told, right_from=1)


if __name__ == "__main__":
    main()
