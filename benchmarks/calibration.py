"""Measures `twin calibrate intrinsics`: boards rendered through known lenses, calibrated, compared.

Usage: python benchmarks/calibration.py [--views 40] [--rig RIG.json] [--only NAME] [--keep FOLDER]
       python benchmarks/calibration.py --detectors | --own-noise 20 | --independent 30

Without --rig the simulated car's lenses; with it the named cameras of a DriveWorks rig. Boards are rendered
by the lens's inverse (rays), with blur, uneven light and grey-level noise; to every detected corner 0.1 px of
noise is added, in 60 draws. The error is the angle between the true and the calibrated ray of a pixel, over
every eighth covered pixel: as it is, and after the one rotation that an extrinsic calibration takes up.
NEES is the squared error of the parameters over what their covariance promises, each: 1 if sigmas hold.
--detectors compares the corners of OpenCV's detectors, as they come and refined, with where they truly are.
--own-noise adds nothing to corners: it draws the noise of the pictures' grey values anew, and detects again.
--independent draws everything anew, the boards' poses too; bar: NEES from 0.75 to 1.3, within its own error.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geoloc.arrays import ByteArray
from geoloc.calibration.intrinsics import Fit, Intrinsics, View, angle_between, calibrate_intrinsics
from geoloc.calibration.intrinsics.fit import fit
from geoloc.calibration.intrinsics.radial_lenses import FThetaLens
from geoloc.calibration.intrinsics.views import corners_of
from geoloc.cameras import CameraModel, FisheyeCamera, FThetaCamera
from geoloc.rig.rig import read_rig
from geoloc.simulation.car import CAMERAS
from geoloc.simulation.pictures.board_views import draw_board_poses
from geoloc.simulation.pictures.render import Plane, render_planes
from twin.calibrate.boards.boards import Board, board_from_text
from twin.calibrate.boards.detect import detect
from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, N_PICTURES, example_camera, rendered
from twin.cli.output import console, print_table

NOISE_PX, GREY_NOISE = 0.1, 2.0
DRAWS = 60
FINEST, FINE = "charuco:36x25:0.03:0.0225:DICT_5X5_1000", "charuco:24x17:0.05:0.037"
SMALL = "checkerboard:9x6:0.08"
NARROW_BARS_DEG, WIDE_BARS_DEG = (0.003, 0.02), (0.01, 0.05)
NAMES = ("C1_front60Single", "C2_tricam60", "C3_tricam120")


@dataclass(frozen=True)
class Case:
    """One camera, one board, how it is shown, and the bars for mean and largest error."""

    name: str
    camera: CameraModel
    board: str
    fill: tuple[float, float]
    tilt_deg: tuple[float, float]
    inside: float
    bars_deg: tuple[float, float]


def cases(rig: Path | None) -> Iterator[Case]:
    """The three forward cameras, the wide one with the small board too, and a lens of another family."""
    known = {name: made[0] for name, made in CAMERAS.items()}
    if rig is not None:
        known = {name: camera.model for name, camera in read_rig(rig).cameras.items()}  # type: ignore[misc]
    for name in NAMES:
        if name.endswith("120"):
            yield Case(name, known[name], FINE, (0.7, 1.4), (10.0, 50.0), 0.55, WIDE_BARS_DEG)
        else:
            # A narrow lens shows little perspective, which is what tells the principal point.
            yield Case(name, known[name], FINEST, (1.0, 2.0), (35.0, 60.0), 0.4, NARROW_BARS_DEG)
    wide = known[NAMES[2]]
    yield Case(f"{NAMES[2]}, 9x6 board", wide, SMALL, (0.3, 0.7), (10.0, 50.0), 1.0, WIDE_BARS_DEG)
    fisheye = FisheyeCamera(1920, 1208, 1004.0, 1003.2, 968.4, 617.9, (-0.021, -0.008, 0.004, -0.0013))
    yield Case("a Kannala-Brandt lens", fisheye, FINE, (0.7, 1.4), (10.0, 50.0), 0.55, WIDE_BARS_DEG)


def pictures(case: Case, n: int, keep: Path | None) -> Iterator[ByteArray]:
    """Render n pictures; if a folder is given, they are kept there for another run."""
    import cv2

    folder = None if keep is None else keep / f"{case.name}-{case.board.split(':')[1]}-{n}"
    if folder is not None and (folder / f"{n - 1}.png").exists():
        for number in range(n):
            yield np.asarray(cv2.imread(str(folder / f"{number}.png"), cv2.IMREAD_GRAYSCALE))
        return
    board, rng = board_from_text(case.board), np.random.default_rng(1)
    made = rendered(case.camera, board, n, rng, fill=case.fill, tilt_deg=case.tilt_deg, inside=case.inside)
    for number, picture in enumerate(made):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / f"{number}.png"), picture)
        yield picture


def detected(case: Case, n: int, keep: Path | None) -> list[View]:
    """Corners in n pictures."""
    board, views = board_from_text(case.board), []
    for number, picture in enumerate(pictures(case, n, keep)):
        seen = detect(picture, board, f"{case.name} {number}")
        if seen is not None:
            views.append(seen.view)
        console(stderr=True).print(f"{case.name}: {number + 1} of {n}", end="\r")
    return views


def noisy(views: list[View], rng: np.random.Generator) -> list[View]:
    """Add white noise to every corner."""
    return [
        replace(v, pixel_px=v.pixel_px + rng.normal(scale=NOISE_PX, size=v.pixel_px.shape)) for v in views
    ]


@dataclass(frozen=True)
class Draw:
    """Errors of one draw of noise, in degrees, and its NEES a parameter."""

    mean: float
    largest: float
    turned_mean: float
    turned_largest: float
    nees: float


def draws(case: Case, views: list[View], made: Intrinsics, noise_px: float, n: int) -> list[Draw]:
    """Fit the chosen model to fresh noise, and compare its rays with the true ones where boards were seen."""
    corners, rng = made.fit.bundle.corners, np.random.default_rng(3)
    clean = np.concatenate([v.pixel_px for v in views if v.name in made.views])
    u, v = np.meshgrid(np.arange(0.0, case.camera.width_px, 8.0), np.arange(0.0, case.camera.height_px, 8.0))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    pixel = pixel[made.coverage.covers(pixel)]
    true, found = case.camera.camera_ray_from_pixel(pixel)[0], []
    for _ in range(n):
        redrawn = replace(corners, pixel_px=clean + rng.normal(scale=noise_px, size=clean.shape))
        again = fit(made.fit.lens, redrawn, made.fit.curve(), made.fit.adjusted.state.poses)
        ours = again.camera.camera_ray_from_pixel(pixel)[0]
        turn, _ = Rotation.align_vectors(true, ours)
        raw, turned = angle_between(true, ours), angle_between(true, turn.apply(ours))
        mean, largest = np.degrees([raw.mean(), raw.max()]).tolist()
        turned_mean, turned_largest = np.degrees([turned.mean(), turned.max()]).tolist()
        found.append(Draw(mean, largest, turned_mean, turned_largest, nees(case, again)))
    return found


def nees(case: Case, made: Fit) -> float:
    """Normalised squared error a parameter; NaN where the true camera has other parameters."""
    true = case.camera
    if not isinstance(true, FThetaCamera) or not isinstance(made.lens, FThetaLens):
        return float("nan")
    coefficients = true.theta_from_r or ()
    if len(coefficients) - 1 != made.lens.degree:
        return float("nan")
    off = made.adjusted.state.lens - np.array([true.cx_px, true.cy_px, *coefficients[1:]]) / made.lens.units
    return float(off @ np.linalg.solve(made.adjusted.covariance, off)) / len(off)


def _known(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"


def opencv_corners(image: ByteArray, board: Board, half_window_px: int) -> np.ndarray:
    """Corners (k, 2) of OpenCV's detector, refined by `cornerSubPix` if a window is given."""
    import cv2

    if board.kind == "checkerboard":
        _, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows))
    else:
        corners, *_ = cv2.aruco.CharucoDetector(board.aruco()).detectBoard(image)
    if corners is not None and half_window_px:
        size = (half_window_px, half_window_px)
        corners = cv2.cornerSubPix(image, corners.astype(np.float32), size, (-1, -1), (3, 50, 1e-4))
    return np.reshape([] if corners is None else corners, (-1, 2)).astype(np.float64)


def corner_errors(text: str, n: int) -> dict[str, np.ndarray]:
    """Errors (k, 2) of corners in n rendered pictures of a board, in pixels, detector by detector."""
    board, camera, rng = board_from_text(text), example_camera(), np.random.default_rng(11)
    texture, size = board.texture()
    errors: dict[str, list[np.ndarray]] = {}
    name = "findChessboardCornersSB" if board.kind == "checkerboard" else "CharucoDetector"
    for rotation, position in draw_board_poses(camera, size, n, rng, fill=(0.4, 0.7)):
        image = render_planes(camera, [Plane(texture, size, rotation, position)], rng=rng)
        place = board.corners_m(np.arange(board.n_corners)) + board.texture_offset_m
        point = np.column_stack([place, np.zeros(len(place))]) @ rotation.T + position
        true, seen = camera.pixel_from_camera_point(point)[0], detect(image, board, "picture")
        found = {f"{text}, {name}": opencv_corners(image, board, 0)}
        for half in (3, 5):
            found[f"the same, cornerSubPix, half window {half}"] = opencv_corners(image, board, half)
        found["the same, fitted saddle"] = np.empty((0, 2)) if seen is None else seen.view.pixel_px
        for what, pixel in found.items():
            # Counted from any corner of a checkerboard, the nearest true corner is the one that is meant.
            nearest = np.linalg.norm(pixel[:, None] - true, axis=-1).argmin(axis=1)
            errors.setdefault(what, []).append(pixel - true[nearest])
    return {what: np.concatenate(parts) for what, parts in errors.items()}


def compare_detectors() -> None:
    """Print bias and spread of the detectors' corners."""
    rows = []
    for text in (SMALL, EXAMPLE_BOARD):
        for what, off in corner_errors(text, 20).items():
            bias = " / ".join(f"{value:+.4f}" for value in off.mean(axis=0))
            worst = np.linalg.norm(off, axis=1)
            spread = (
                f"{np.sqrt((off**2).mean()):.4f}",
                *(f"{np.quantile(worst, q):.3f}" for q in (0.99, 1.0)),
            )
            rows.append((what, len(off), bias, *spread))
    columns = ["corners from", "corners", "bias u / v", "RMS", "99 %", "largest"]
    print_table("Detected corners [px]", columns, rows)


def own_noise(n: int) -> None:
    """Print NEES over n draws of the grey values' noise, in the pictures of `twin calibrate example`."""
    camera, board, rng = example_camera(), board_from_text(EXAMPLE_BOARD), np.random.default_rng(0)
    clean = [image.astype(np.float64) for image in rendered(camera, board, N_PICTURES, rng, noise=0.0)]
    case, found, spread, start = (
        Case("example", camera, EXAMPLE_BOARD, (0, 0), (0, 0), 0, (0, 0)),
        [],
        [],
        None,
    )
    for _ in range(n):
        drawn = [np.clip(np.rint(i + rng.normal(scale=GREY_NOISE, size=i.shape)), 0, 255) for i in clean]
        seen = [detect(image.astype(np.uint8), board, str(k)) for k, image in enumerate(drawn)]
        views = [s.view for s in seen if s is not None]
        if start is None:
            start = calibrate_intrinsics(views, camera.width_px, camera.height_px, models=("ftheta",)).fit
        again = fit(start.lens, corners_of(views), start.curve(), start.adjusted.state.poses)
        found.append(nees(case, again))
        spread.append(again.adjusted.sigma_px)
    uncertain = np.std(found, ddof=1) / np.sqrt(n)
    print(
        f"The pictures' own noise, {n} draws: one corner {np.mean(spread):.4f} px, "
        f"NEES {np.mean(found):.2f} ± {uncertain:.2f}"
    )


def independent(n: int) -> None:
    """Print NEES over n calibrations that share nothing but the lens of `twin calibrate example`."""
    camera, board = example_camera(), board_from_text(EXAMPLE_BOARD)
    case, found = Case("example", camera, EXAMPLE_BOARD, (0, 0), (0, 0), 0, (0, 0)), []
    for seed in range(n):
        pictures_ = rendered(camera, board, N_PICTURES, np.random.default_rng(100 + seed))
        seen = [detect(image, board, str(k)) for k, image in enumerate(pictures_)]
        views = [s.view for s in seen if s is not None]
        made = calibrate_intrinsics(views, camera.width_px, camera.height_px, models=("ftheta",))
        found.append(nees(case, made.fit))
        console(stderr=True).print(f"{seed + 1} of {n}", end="\r")
    known = np.array(found)[np.isfinite(found)]
    uncertain = float(np.std(known, ddof=1) / np.sqrt(len(known)))
    print(f"Independent calibrations, {len(known)}: NEES {known.mean():.2f} ± {uncertain:.2f}")
    if not 0.75 - uncertain < known.mean() < 1.3 + uncertain:
        raise SystemExit("NEES misses its bar")


def main() -> None:
    """Calibrate every case and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=40)
    parser.add_argument("--rig", type=Path)
    parser.add_argument("--only", help="Cases whose name contains this.")
    parser.add_argument(
        "--keep", type=Path, help="Folder for the pictures, so that another run need not render."
    )
    parser.add_argument("--detectors", action="store_true", help="Compare the corners of the detectors.")
    parser.add_argument("--own-noise", type=int, metavar="DRAWS", help="NEES for the pictures' noise alone.")
    parser.add_argument(
        "--independent", type=int, metavar="N", help="NEES over calibrations that share only the lens."
    )
    options = parser.parse_args()
    if options.detectors:
        compare_detectors()
        return
    if options.independent:
        independent(options.independent)
        return
    if options.own_noise:
        own_noise(options.own_noise)
        return
    rows, models = [], []
    for case in cases(options.rig):
        if options.only and options.only not in case.name:
            continue
        views = detected(case, options.views, options.keep)
        made = calibrate_intrinsics(
            noisy(views, np.random.default_rng(2)), case.camera.width_px, case.camera.height_px
        )
        found, (as_it_is,) = draws(case, views, made, NOISE_PX, DRAWS), draws(case, views, made, 0.0, 1)
        met = sum(d.mean <= case.bars_deg[0] and d.largest <= case.bars_deg[1] for d in found)
        average = {name: float(np.mean([getattr(d, name) for d in found])) for name in Draw.__annotations__}
        rows.append(
            (
                case.name,
                made.fit.label,
                f"{len(made.views)} / {len(made.fit.adjusted.inlier):,}",
                f"{made.coverage.fraction:.0%}",
                f"{average['mean']:.4f} / {average['largest']:.4f}",
                f"{average['turned_mean']:.4f} / {average['turned_largest']:.4f}",
                f"{case.bars_deg[0]:g} / {case.bars_deg[1]:g}",
                f"{met} of {DRAWS}",
                _known(average["nees"]),
                f"{as_it_is.mean:.4f} / {as_it_is.largest:.4f}",
                _known(as_it_is.nees),
            )
        )
        models += [
            (case.name, c.label, c.n_parameters, f"{c.held_out_deg:.5f}", c.reason) for c in made.candidates
        ]
        for fault in made.faults:
            print(f"{case.name}: {fault.sentence}")
    print_table(
        f"Calibrated against true rays [°], {NOISE_PX} px of noise a corner, mean of {DRAWS} draws",
        [
            "camera",
            "model",
            "views / corners",
            "covered",
            "mean / max",
            "but for a rotation",
            "bars",
            "draws within",
            "NEES",
            "without added noise",
            "NEES then",
        ],
        rows,
    )
    print_table("Models", ["camera", "model", "parameters", "held-out RMS [°]", ""], models)


if __name__ == "__main__":
    main()
