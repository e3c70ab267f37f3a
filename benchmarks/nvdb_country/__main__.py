"""Serve generated signs as API Les V4 and Uberiket V1 would, until Ctrl-C."""

from __future__ import annotations

import argparse
import sys
import threading
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from nvdb.replay import ReplayServer
from nvdb_country import GeneratedWorld


def main() -> None:
    """Serve; with ``--touch``, change objects as the lines on stdin say."""
    parser = argparse.ArgumentParser(prog="python benchmarks/nvdb_country", description=__doc__)
    parser.add_argument("counts", type=_two_counts, metavar="POINTS,PLATES", help="how many signs")
    parser.add_argument("--seed", type=int, default=0, help="of the signs (default: %(default)s)")
    parser.add_argument("--port", type=int, default=8096, help="0 takes a free one (default: %(default)s)")
    parser.add_argument(
        "--touch",
        action="store_true",
        help="each line TYPE COUNT on stdin makes the first COUNT objects of a type change, and is answered",
    )
    options = parser.parse_args()
    points, plates = options.counts
    world = GeneratedWorld(points, plates, options.seed)
    with suppress(KeyboardInterrupt), ReplayServer(world, port=options.port) as server:
        counts = ", ".join(f"{number} of type {kind}" for kind, number in server.counts.items())
        print(f"{server.url} serves {counts}; Ctrl-C ends it.", flush=True)
        for line in sys.stdin if options.touch else ():
            type_id, count = (int(word) for word in line.split())
            world.touch(world.ids(type_id, count))
            print("touched", flush=True)
        threading.Event().wait()


def _two_counts(text: str) -> tuple[int, int]:
    points, plates = (int(part) for part in text.split(","))
    if points < 0 or plates < 0 or (plates and not points):
        raise ValueError(text)
    return points, plates


if __name__ == "__main__":
    main()
