"""What keeping a mirror costs beyond fetching and parsing the same pages.

Generated signs are served from a process of their own. The baseline is a bare loop of ``requests.get`` and
``json.loads`` over the pages; ours (`twin sync-nvdb`) also checks, reads, packs and stores every object and
publishes the mirror. The bare loop waits for the server; ours has the next page on its way while it stores
the present one, so with a second core a part of that wait costs it nothing. ``CPU ratio`` compares the
processors' time of the two clients alone, without their waits: it holds while the machine has other work too.
Only the ratios mean anything; the times depend on the machine.

    python benchmarks/mirror.py [--sizes 3000,7000 30000,70000] [--country] [--rounds 2] [--source les-v4]
    python benchmarks/mirror.py --peer PYTHON

``--peer`` names a Python that has ``nvdbapi-v3`` and ``geopandas`` (its requirement ``urllib3<2`` rules ours
out), and compares the time from the first request to a table that can be asked, as its users make one:
``nvdbFagdata(type).to_records()``, a DataFrame, ``shapely.wkt``, a GeoDataFrame. It was written for API Les
V3, so the address and the two answers that V4 no longer gives are put in its way; nothing else is changed.
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import requests

COUNTRY = (573_299, 1_153_655)
HEADERS = {"X-Client": "benchmark"}
TOUCHED = 1000

PEER = """
import json, sys, time
import geopandas, nvdbapiv3, pandas
from nvdbapiv3.apiforbindelse import apiforbindelse
from shapely import wkt

def velgmiljo(self, miljo=None):
    self.miljo, self.apiurl = miljo, sys.argv[1]

class Fagdata(nvdbapiv3.nvdbFagdata):
    def anrope(self, path, **options):
        if path.startswith("vegobjekttyper/"):
            return {}
        answer = super().anrope(path, **options)
        return {"lengde": None, **answer} if path.endswith("/statistikk") else answer

apiforbindelse.velgmiljo = velgmiljo
begin, tables = time.perf_counter(), []
for kind in (95, 96):
    search = Fagdata(kind)
    search.filter({"srid": "5973", "antall": 1000})
    table = pandas.DataFrame(search.to_records())
    table["geometry"] = table["geometri"].apply(wkt.loads)
    tables.append(geopandas.GeoDataFrame(table, geometry="geometry", crs=5973))
print(json.dumps([time.perf_counter() - begin, sum(map(len, tables))]))
"""


@contextmanager
def served(points: int, plates: int) -> Iterator[tuple[str, Callable[[int, int], None]]]:
    """Serve generated signs from another process; gives the URL, and a way to change TYPE, COUNT of them."""
    country = str(Path(__file__).with_name("nvdb_country"))
    command = [sys.executable, country, f"{points},{plates}", "--port", "0", "--touch"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        lines, answers = server.stdin, server.stdout

        def touch(type_id: int, count: int) -> None:
            lines.write(f"{type_id} {count}\n")
            answers.readline()

        try:
            yield answers.readline().split()[0], touch
        finally:
            server.terminate()


def bare(url: str, source: str, most: int = 10**9) -> int:
    """Fetch and parse every page, until `most` objects have come, and no more; gives their number."""
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
            if not page[name] or start is None or n >= most:
                break
    return n


def mirrored(url: str, source: str, store_path: str) -> dict[str, float]:
    """Sync once, in this process; gives seconds, objects, changed objects and requests."""
    from nvdb.area import Area
    from twin.cli.mirror import COLLECT_AFTER
    from twin.mirror.sync import sync_nvdb
    from twin.store.store import Store

    n_requests, send = 0, requests.Session.send

    def counted(self: requests.Session, request: requests.PreparedRequest, **options: Any) -> Any:
        nonlocal n_requests
        n_requests += 1
        return send(self, request, **options)

    requests.Session.send = counted  # type: ignore[method-assign]
    with Store.open(store_path) as store:
        begin, begin_cpu = time.perf_counter(), time.process_time()
        gc.set_threshold(*COLLECT_AFTER)  # as the command does
        result = sync_nvdb(store, Area(), api_url=url, source=source)
        seconds, cpu_s = time.perf_counter() - begin, time.process_time() - begin_cpu
    n = result.skiltpunkt + result.skiltplate
    spent = {"seconds": seconds, "cpu_s": cpu_s, "requests": n_requests}
    return {**spent, "objects": n, "changed": result.changed}


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
        bare(url, source, 10_000)  # the server's first answers are slow
        begin, begin_cpu = time.perf_counter(), time.process_time()
        answer: dict[str, float] = {"objects": bare(url, source)}
        answer |= {"seconds": time.perf_counter() - begin, "cpu_s": time.process_time() - begin_cpu}
    else:
        answer = mirrored(url, source, store_path)
    answer["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(answer))


def one_size(points: int, plates: int, source: str, rounds: int, peer: str | None) -> None:
    """Measure one size of country and print its line."""
    with served(points, plates) as (url, touch), tempfile.TemporaryDirectory() as folder:
        bares, fills = [], []
        for number in range(rounds):
            bares.append(job("bare", url, source))
            fills.append(job("sync", url, source, f"{folder}/{number}.twin"))
        n = points + plates
        assert all(fill["objects"] == n for fill in fills)
        base_s, fill_s = (min(run["seconds"] for run in runs) for runs in (bares, fills))
        base_cpu_s, fill_cpu_s = (min(run["cpu_s"] for run in runs) for runs in (bares, fills))
        store = f"{folder}/0.twin"
        job("sync", url, source, store)  # follows the changes; the store is settled then
        empty = job("sync", url, source, store)
        touch(96, min(TOUCHED, plates))
        change = job("sync", url, source, store)
        assert change["changed"] == min(TOUCHED, plates)
        peer_ratio = f"{peer_seconds(peer, url, n) / fill_s:.1f}" if peer else "-"
        print(
            f"{n:>9,} {base_s:>11.1f} {fill_s:>7.1f} {fill_s / base_s:>6.2f}"
            f" {fill_cpu_s / base_cpu_s:>9.2f} {fill_s / n * 1e6:>9.0f}"
            f" {max(fill['peak_mb'] for fill in fills):>8.0f} {Path(store).stat().st_size / 1e6:>9.0f}"
            f" {empty['requests']:>9.0f} {empty['seconds'] * 1e3:>8.0f} {change['seconds'] * 1e3:>10.0f}"
            f" {peer_ratio:>10}",
            flush=True,
        )


def peer_seconds(peer: str, url: str, n: int) -> float:
    """Seconds that nvdbapi-v3 takes from the same pages to GeoDataFrames."""
    done = subprocess.run([peer, "-c", PEER, url], stdout=subprocess.PIPE, text=True, check=True)
    seconds, n_records = json.loads(done.stdout.splitlines()[-1])
    assert n_records == n
    return float(seconds)


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
    print(f"source {options.source}")
    print(
        f"{'objects':>9} {'bare loop s':>11} {'sync s':>7} {'ratio':>6} {'CPU ratio':>9} {'µs/object':>9}"
        f" {'peak MB':>8} {'store MB':>9} {'no news: n':>9} {'ms':>7} {f'{TOUCHED} new ms':>10}"
        f" {'peer/sync':>10}"
    )
    for points, plates in options.sizes:
        one_size(points, plates, options.source, options.rounds, options.peer)
    if options.country:
        one_size(*COUNTRY, options.source, 1, None)


if __name__ == "__main__":
    main()
