"""How much stedfesting costs beyond the bare search for the nearest link.

100,000 points beside roads against 100,000 generated links of 2 to 9 vertices. The baseline is
``shapely.STRtree.query_nearest`` on the same points, links and tree, in the same run: it says which link is
nearest and nothing else. Ours adds the foot, the position along the 3-D length, side, azimuths, meter value
and road reference. Only the ratio means anything; the rates depend on the machine.

    python benchmarks/stedfest.py [--points 100000] [--links 100000] [--rounds 3]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from datetime import date
from typing import Any

import numpy as np
import shapely

from geoloc.arrays import FloatArray
from nvdb.vegnett import Vegnett, stedfester

SEED = 20260504
DAY = date(2026, 5, 4)
MAX_DISTANCE_M = 50.0
LINKS_PER_KM2 = 40
"""About what a Norwegian town has, segments counted."""


def generated(n: int, rng: np.random.Generator) -> Vegnett:
    """`n` crooked links with heights, strewn over a square."""
    side = 1000.0 * np.sqrt(n / LINKS_PER_KM2)
    counts = rng.integers(2, 10, n)
    line = np.repeat(np.arange(n), counts)
    turn = rng.uniform(0, 2 * np.pi, n)[line] + rng.normal(0, 0.3, len(line))
    steps = 20.0 * np.column_stack([np.sin(turn), np.cos(turn), rng.normal(0, 0.03, len(line))])
    walked = np.cumsum(steps, axis=0)
    first = np.cumsum(counts) - counts
    origin = rng.uniform(0, 1, (n, 3)) * [side, side, 300.0] + np.array([200_000.0, 6_700_000.0, 0.0])
    geometri = shapely.linestrings(walked - walked[first][line] + origin[line], indices=line)
    length = shapely.length(geometri)
    start = rng.uniform(0, 0.9, n)
    fra = np.round(rng.uniform(0, 9000, n), 3)
    text = np.full(n, "", dtype=np.object_)
    return Vegnett(
        veglenkesekvensid=np.arange(n) + 1_000_000,
        veglenkenummer=np.ones(n, dtype=np.int64),
        segmentnummer=np.ones(n, dtype=np.int64),
        startposisjon=start,
        sluttposisjon=start + 0.1,
        geometri=geometri,
        startdato=np.full(n, "2000-01-01", dtype="datetime64[D]"),
        sluttdato=np.full(n, "NaT", dtype="datetime64[D]"),
        konnektering=np.zeros(n, dtype=np.bool_),
        detaljert=np.zeros(n, dtype=np.bool_),
        type_veg=text,
        detaljniva=text,
        vegkategori=text,
        trafikantgruppe=text,
        kortform=np.array(
            [f"FV{i} S1D1 m{a:.0f}-{a + d:.0f}" for i, (a, d) in enumerate(zip(fra, length, strict=True))],
            dtype=np.object_,
        ),
        retning=rng.choice([-1, 1], n),
        fra_meter=fra,
        til_meter=fra + length,
    )


def beside_roads(nett: Vegnett, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """`n` points as signs stand: some metres beside a vertex of a link, one in twenty somewhere far off."""
    vertices = shapely.get_coordinates(nett.geometri)
    points = vertices[rng.integers(0, len(vertices), n)] + rng.normal(0, 4.0, (n, 2))
    far = rng.random(n) < 0.05
    points[far] += rng.normal(0, 2000.0, (np.count_nonzero(far), 2))
    return points[:, 0], points[:, 1]


def best(work: Callable[[], Any], rounds: int) -> float:
    """Shortest time of several rounds, seconds."""
    times = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Stedfesting against a bare STRtree.query_nearest.")
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--links", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    rng = np.random.default_rng(SEED)
    nett = generated(options.links, rng)
    east, north = beside_roads(nett, options.points, rng)

    tree = shapely.STRtree(nett.geometri)
    tree.query_nearest(
        shapely.points(east[:1], north[:1])
    )  # builds the tree, which GEOS does when first asked
    index = stedfester(nett, on_date=DAY)
    index.stedfest(east[:1], north[:1])

    def bare() -> None:
        tree.query_nearest(shapely.points(east, north), max_distance=MAX_DISTANCE_M)

    baseline_s = best(bare, options.rounds)
    ours_s = best(lambda: index.stedfest(east, north, max_distance_m=MAX_DISTANCE_M), options.rounds)
    whole_s = best(
        lambda: stedfester(nett, on_date=DAY).stedfest(east, north, max_distance_m=MAX_DISTANCE_M),
        options.rounds,
    )
    found = np.count_nonzero(index.stedfest(east, north, max_distance_m=MAX_DISTANCE_M).found)

    print(f"{options.points} points ({found} placed), {options.links} links, seed {SEED}")
    print(f"{'':34}{'points/s':>12}{'time ratio':>12}")
    for name, seconds in (
        ("bare STRtree.query_nearest", baseline_s),
        ("stedfest, index kept", ours_s),
        ("stedfest, index made each time", whole_s),
    ):
        print(f"{name:34}{options.points / seconds:12.0f}{seconds / baseline_s:12.2f}")


if __name__ == "__main__":
    main()
