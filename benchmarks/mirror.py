"""What keeping a mirror costs beyond fetching and parsing the same pages.

Generated signs are served from a process of their own. The baseline is a bare loop of ``requests.get`` and
``json.loads`` over the pages; ours (`twin sync-nvdb`) also checks, reads, packs and stores every object and
publishes the mirror. Only the ratios mean anything; the times depend on the machine.

    python benchmarks/mirror.py [--sizes 3000,7000 30000,70000] [--country] [--rounds 3] [--source les-v4]
    python benchmarks/mirror.py --peer PYTHON

``--peer`` names a Python that has ``nvdbapi-v3`` and ``geopandas`` (its requirement ``urllib3<2`` rules ours
out), and compares the time from the first request to a table that can be asked.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import requests

COUNTRY = (573_299, 1_153_655)
HEADERS = {"X-Client": "benchmark"}
TOUCHED = 1000

PEER = """
import json, sys, time
import geopandas, pandas, requests, nvdbapiv3
from shapely import from_wkt
url, begin, tables = sys.argv[1], time.perf_counter(), []
for kind in (95, 96):
    records, start = [], None
    while True:
        query = {"inkluder": "alle", "srid": "5973", "antall": 1000, **({"start": start} if start else {})}
        page = requests.get(f"{url}/vegobjekter/{kind}", params=query, headers={"X-Client": "peer"}).json()
        if not page["objekter"]:
            break
        records += nvdbapiv3.nvdbfagdata2records(page["objekter"], vegsegmenter=False, geometri=True)
        start = page["metadata"]["neste"]["start"]
    table = pandas.DataFrame(records)
    tables.append(geopandas.GeoDataFrame(table, geometry=from_wkt(table["geometri"]), crs=5973))
print(json.dumps([time.perf_counter() - begin, sum(map(len, tables))]))
"""


@contextmanager
def served(points: int, plates: int) -> Iterator[str]:
    """Serve generated signs from another process; gives the URL."""
    command = [sys.executable, "-m", "nvdb.replay", "--generate", f"{points},{plates}", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[0]
        finally:
            server.terminate()


def bare(url: str, source: str) -> int:
    """Fetch and parse every page, and do nothing with it; gives the number of objects."""
    session, n = requests.Session(), 0
    session.headers.update(HEADERS)
    session.trust_env = False
    for kind in (95, 96):
        start: str | None = None
        while True:
            query: dict[str, str | int] = {"inkluder": "alle", "antall": 1000}
            path, name = f"/uberiket/api/v1/vegobjekter/{kind}", "vegobjekter"
            if source == "les-v4":
                query["srid"], path, name = "5973", f"/vegobjekter/{kind}", "objekter"
            if start is not None:
                query["start"] = start
            page: dict[str, Any] = json.loads(session.get(f"{url}{path}", params=query).content)
            n += len(page[name])
            start = page["metadata"].get("neste", {}).get("start")
            if not page[name] or start is None:
                break
    return n


def mirrored(url: str, source: str, store_path: str) -> dict[str, float]:
    """Sync once, in this process; gives seconds, objects and events."""
    from nvdb.area import Area
    from twin.store import Store
    from twin.sync import sync_nvdb

    with Store.open(store_path) as store:
        begin = time.perf_counter()
        result = sync_nvdb(store, Area(), api_url=url, source=source)
        seconds = time.perf_counter() - begin
    return {"seconds": seconds, "objects": result.skiltpunkt + result.skiltplate, "changed": result.changed}


def job(*arguments: str) -> dict[str, float]:
    """Run one job in a process of its own, and add its peak memory, MB."""
    done = subprocess.run(
        [sys.executable, __file__, "--job", *arguments], stdout=subprocess.PIPE, text=True, check=True
    )
    answer: dict[str, float] = json.loads(done.stdout)
    return answer


def run_job(name: str, url: str, source: str, store_path: str = "") -> None:
    """Do what :func:`job` asked for, and print the numbers."""
    if name == "bare":
        bare(url, source)  # the server's first answers are slow
        begin = time.perf_counter()
        n = bare(url, source)
        answer: dict[str, float] = {"seconds": time.perf_counter() - begin, "objects": n}
    else:
        answer = mirrored(url, source, store_path)
    answer["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(answer))


def one_size(points: int, plates: int, source: str, rounds: int, peer: str | None) -> None:
    """Measure one size of country and print its line."""
    with served(points, plates) as url, tempfile.TemporaryDirectory() as folder:
        bares, fills = [], []
        for number in range(rounds):
            bares.append(job("bare", url, source)["seconds"])
            fills.append(job("sync", url, source, f"{folder}/{number}.twin"))
        n = points + plates
        assert all(fill["objects"] == n for fill in fills)
        base_s, fill_s = min(bares), min(fill["seconds"] for fill in fills)
        store = f"{folder}/0.twin"
        job("sync", url, source, store)  # follows the changes; the store is settled then
        empty = job("sync", url, source, store)
        touch = {"type": "96", "antall": str(min(TOUCHED, plates))}
        requests.post(f"{url}/replay/touch", params=touch, headers=HEADERS, timeout=60).raise_for_status()
        change = job("sync", url, source, store)
        size_mb = Path(store).stat().st_size / 1e6
        print(
            f"{n:>9,} {base_s / n * 1e6:>9.0f} {fill_s / n * 1e6:>9.0f} {fill_s / base_s:>7.2f}"
            f" {max(fill['peak_mb'] for fill in fills):>8.0f} {size_mb:>9.0f}"
            f" {empty['seconds']:>8.2f} {change['seconds']:>9.2f} {change['changed']:>8.0f}",
            flush=True,
        )
        if peer:
            compare(peer, url, fill_s)


def compare(peer: str, url: str, ours_s: float) -> None:
    """Let nvdbapi-v3 read the same pages, and print how often ours is faster."""
    done = subprocess.run([peer, "-c", PEER, url], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        print(f"          {peer} could not run nvdbapi-v3")
        return
    seconds, n = json.loads(done.stdout.splitlines()[-1])
    print(
        f"          nvdbapi-v3 to GeoDataFrames: {seconds:.1f} s for {n:,}; {seconds / ours_s:.1f} times ours"
    )


def _pair(text: str) -> tuple[int, int]:
    points, plates = (int(part) for part in text.split(","))
    return points, plates


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="A mirror against a bare loop of requests and json.")
    parser.add_argument("--sizes", nargs="+", type=_pair, default=[(3_000, 7_000), (30_000, 70_000)])
    parser.add_argument("--country", action="store_true", help=f"also {COUNTRY[0]:,} points and their plates")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--source", choices=["les-v4", "uberiket"], default="les-v4")
    parser.add_argument("--peer", metavar="PYTHON", help="a Python with nvdbapi-v3 and geopandas")
    parser.add_argument("--job", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job:
        run_job(*options.job)
        return
    print(
        f"source {options.source}; bare loop and sync in µs an object, memory and store in MB, the rest in s"
    )
    print(
        f"{'objects':>9} {'bare loop':>9} {'sync':>9} {'ratio':>7} {'peak MB':>8} {'store MB':>9}"
        f" {'no news':>8} {f'{TOUCHED} new':>9} {'changed':>8}"
    )
    for points, plates in options.sizes:
        one_size(points, plates, options.source, options.rounds, options.peer)
    if options.country:
        one_size(*COUNTRY, options.source, 1, None)


if __name__ == "__main__":
    main()
