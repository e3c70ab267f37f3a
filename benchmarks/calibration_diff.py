"""Measures `twin calibrate diff`: pairs of calibrations from different rendered pictures of one lens.

Usage: python benchmarks/calibration_diff.py [--pairs 10]

Each pair is compared as it is, where only chance parts the two, and with the second lens's focal length made
0.05 % longer, which no chance explains. Bars: of the first at least 80 % agree (the verdict's own rule calls
1 % of them different), of the second all differ.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from geoloc.calibration.intrinsics import Intrinsics, calibrate_intrinsics
from geoloc.calibration.intrinsics.coverage import map_pixels
from geoloc.calibration.intrinsics.known_lens import lens_of_fit
from geoloc.calibration.lens_difference import LensDifference, lens_difference
from twin.calibrate.boards.boards import board_from_text
from twin.calibrate.boards.detect import detect
from twin.calibrate.difference.compare import BY_CHANCE
from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, example_camera, rendered
from twin.cli.output import console, print_table

PICTURES = 16
LONGER = 1.0005
LEAST_AGREE = 0.8


def calibrated(seed: int) -> Intrinsics:
    """Calibrate the example's camera from pictures of its own."""
    camera, board, views = example_camera(), board_from_text(EXAMPLE_BOARD), []
    for number, picture in enumerate(rendered(camera, board, PICTURES, np.random.default_rng(seed))):
        seen = detect(picture, board, f"{number}")
        if seen is not None:
            views.append(seen.view)
    return calibrate_intrinsics(views, camera.width_px, camera.height_px, models=("ftheta",))


def compared(first: Intrinsics, second: Intrinsics, longer: float) -> LensDifference:
    """Compare two, the second's rays so much nearer the axis."""
    pixel = map_pixels(first.coverage.width_px, first.coverage.height_px)
    both = first.coverage.covers(pixel) & second.coverage.covers(pixel)
    a, b = lens_of_fit(first.fit), lens_of_fit(second.fit)
    b = replace(b, k=b.k / np.where(np.arange(len(b.k)) < 2, 1.0, longer))
    return lens_difference(a.camera, b.camera, pixel[both], (a, b))


def main() -> None:
    """Compare all pairs and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=10)
    n_pairs = parser.parse_args().pairs
    rows, told = [], {1.0: 0, LONGER: 0}
    for pair in range(n_pairs):
        first, second = calibrated(1000 + 2 * pair), calibrated(1001 + 2 * pair)
        for longer in told:
            found = compared(first, second, longer)
            by_chance, square = float(found.by_chance or 0.0), float(found.mean_square or np.inf)
            told[longer] += by_chance < BY_CHANCE
            most = float(np.degrees(np.nanmax(found.angle_rad)))
            rows.append((pair, f"{longer:.4f}", f"{most:.5f}", f"{square**0.5:.2f}", f"{by_chance:.1e}"))
        console(stderr=True).print(f"{pair + 1} of {n_pairs}", end="\r")
    print_table("Pairs", ["pair", "longer", "most [°]", "sigmas", "by chance"], rows)
    agree = 1.0 - told[1.0] / n_pairs
    print(f"Only chance parts them, and they agree: {agree:.0%}.")
    print(f"A lens {LONGER - 1.0:.2%} longer is told: {told[LONGER] / n_pairs:.0%}.")
    if agree < LEAST_AGREE or told[LONGER] < n_pairs:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
