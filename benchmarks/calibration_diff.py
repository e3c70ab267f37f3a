"""Measures `twin calibrate diff`: pairs of calibrations from different rendered pictures of one lens.

Usage: python benchmarks/calibration_diff.py [--pairs 10]

Each pair is compared as it is, where only chance parts the two, and with the second lens's focal length made
0.05 % longer, which no chance explains. Bars: of the first at least 80 % agree (the verdict's own rule calls 1 %
of them different), of the second all differ.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from geoloc.calibration.intrinsics import Intrinsics, calibrate_intrinsics
from geoloc.calibration.intrinsics.coverage import map_pixels
from geoloc.calibration.intrinsics.known_lens import KnownLens, lens_of_fit
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


def compared(first: Intrinsics, second: Intrinsics, longer: float) -> LensDifference | None:
    """Compare two, the second's rays so much nearer the axis."""
    pixel = map_pixels(first.coverage.width_px, first.coverage.height_px)
    both = first.coverage.covers(pixel) & second.coverage.covers(pixel)
    a, b = lens_of_fit(first.fit), lens_of_fit(second.fit)
    scale = np.where(np.arange(len(b.k)) < 2, 1.0, longer)
    other = KnownLens(b.lens, b.k / scale, b.covariance)
    return lens_difference(a.camera, other.camera, pixel[both], (a, replace(other)))


def main() -> None:
    """Compare all pairs and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=10)
    n_pairs = parser.parse_args().pairs
    rows, verdicts = [], {1.0: 0, LONGER: 0}
    for pair in range(n_pairs):
        first, second = calibrated(1000 + 2 * pair), calibrated(1001 + 2 * pair)
        for longer in verdicts:
            found = compared(first, second, longer)
            if found is None or found.by_chance is None or found.mean_square is None:
                continue
            verdicts[longer] += found.by_chance < BY_CHANCE
            largest = float(np.degrees(np.nanmax(found.angle_rad)))
            sigmas = float(np.sqrt(found.mean_square))
            rows.append((pair, f"{longer:.4f}", f"{largest:.5f}", f"{sigmas:.2f}", f"{found.by_chance:.1e}"))
        console(stderr=True).print(f"{pair + 1} of {n_pairs}", end="\r")
    print_table("Pairs", ["pair", "longer", "most [°]", "sigmas", "by chance"], rows)
    agree, told = 1.0 - verdicts[1.0] / n_pairs, verdicts[LONGER] / n_pairs
    print(
        f"agree where only chance parts them: {agree:.0%}; a lens {LONGER - 1:.2%} longer is told: {told:.0%}"
    )
    if agree < LEAST_AGREE or told < 1.0:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
