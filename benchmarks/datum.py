"""What is lost without grids: ITRF to EUREF89 by the European transformation against the official one.

Usage: python benchmarks/datum.py   (needs the grids of docs/datum-and-heights.md)
"""

from __future__ import annotations

import sys

import numpy as np

from geoloc.earth import datum
from geoloc.earth.geodesy import inverse
from geoloc.earth.heights import nn2000_from_ellipsoidal
from twin.cli.output import print_table

PLACES = {
    "Oslo": (59.91, 10.75),
    "Bergen": (60.39, 5.32),
    "Trondheim": (63.42, 10.40),
    "Bodø": (67.28, 14.40),
    "Tromsø": (69.65, 18.96),
}
YEARS = (2016.0, 2026.9, 2035.0)


def main() -> None:
    """Print the differences by place and year, and the range of the geoid in Norway."""
    official, european = datum._by_grids("ITRF2020"), datum._gridless("ITRF2020")  # noqa: SLF001
    if official is None:
        sys.exit("The NKG2020 grids are not installed: see docs/datum-and-heights.md.")
    rows = []
    for name, (lat, lon) in PLACES.items():
        cells = []
        for year in YEARS:
            x, y, z, _ = official.transform(lon, lat, 80.0, year)
            x2, y2, z2, _ = european.transform(lon, lat, 80.0, year)
            cells.append(f"{inverse(y, x, y2, x2)[1]:.3f} / {z2 - z:.3f}")
        rows.append((name, *cells))
    years = [f"{year:g}" for year in YEARS]
    print_table("Without grids minus official: horizontally / up, metres", ["place", *years], rows)
    lat, lon = np.meshgrid(np.arange(57.5, 71.5, 0.1), np.arange(4.0, 31.5, 0.1))
    geoid = -nn2000_from_ellipsoidal(lat, lon, 0.0).height_m
    print_table("HREF2018B, metres", ["lowest", "highest"], [(np.nanmin(geoid), np.nanmax(geoid))])


if __name__ == "__main__":
    main()
