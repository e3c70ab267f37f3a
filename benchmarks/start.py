"""How long each command takes until it says something, on the demo's store, against the bars.

Measured is the processor's time: what else runs on the machine does not count. Reads ``/proc``: Linux.

    python benchmarks/start.py
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import sqlalchemy as sa

from twin.samples.demo import sample_folder
from twin.store import schema
from twin.store.store import Store

HELP_S, COMMAND_S = 0.3, 1.0
# Nobody answers there: what is timed is the start, not the network.
NO_API = "http://127.0.0.1:9"


def main() -> int:
    """Print a line for each command; 1 if one misses its bar."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    missed = 0
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary) / "demo"
        subprocess.run([*_TWIN, "demo", "--out", str(out)], check=True, capture_output=True)
        print("| command | processor's time until the first output [s] | bar [s] |\n|---|---|---|")
        for arguments in _commands(out):
            bar = HELP_S if arguments[0].startswith("-") else COMMAND_S
            spent = statistics.median(_until_first_output(arguments) for _ in range(runs))
            missed += spent > bar
            print(f"| twin {arguments[0]} | {spent:.2f} | {bar} |", flush=True)
    return 1 if missed else 0


_TWIN = (sys.executable, "-m", "twin")


def _commands(out: Path) -> list[list[str]]:
    store = ["--store", str(out / "demo.db")]
    with Store.open(out / "demo.db", create=False) as opened:
        finding = opened.rows(sa.select(schema.change.c.change_id).limit(1))[0]["change_id"]
    drive = str(out / "trip_trondheim")
    return [
        ["--help"],
        ["--version"],
        ["sync-nvdb", "--api-url", NO_API, *store],
        ["inspect", drive],
        ["ingest-drive", drive, "--store", str(out / "new.db")],
        ["drives", *store],
        ["match", *store],
        ["explain", finding, *store],
        ["evidence", *store],
        ["review", "--no-open", *store],
        ["annotate", "--no-open", drive],
        ["decide", "defer", finding, *store],
        ["confidence", *store],
        ["export", str(out / "again"), *store],
        ["qgis", str(out)],
        ["submit", str(out), "--api-url", NO_API, *store],
        ["status", *store],
        ["show", "P01", *store],
        ["evaluate", str(sample_folder() / "truth.csv"), *store],
        ["trajectory", drive, "--out", str(out / "path.csv")],
        ["simulate", str(out / "simulated")],
        ["demo", "--out", str(out / "demo")],
    ]


def _until_first_output(arguments: list[str]) -> float:
    """Seconds of user and system time when the first byte arrives; the command is ended then."""
    reading, writing = os.pipe()
    process = subprocess.Popen(
        [*_TWIN, *arguments], stdin=subprocess.DEVNULL, stdout=writing, stderr=writing, env=_UNBUFFERED
    )
    os.close(writing)
    try:
        os.read(reading, 1)
        # Fields 14 and 15 of proc(5), counted behind the name in brackets.
        fields = Path(f"/proc/{process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    finally:
        process.kill()
        process.wait()
        os.close(reading)
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


_UNBUFFERED = {**os.environ, "PYTHONUNBUFFERED": "1"}

if __name__ == "__main__":
    sys.exit(main())
