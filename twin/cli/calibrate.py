"""``twin calibrate …``: cameras from pictures of boards and tags."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import JsonOption
from twin.cli.output import bar, note, print_json, print_pairs, print_paths, print_table, warn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geoloc.doubts import Doubt
    from twin.calibrate.intrinsics.report import IntrinsicsReport

app = typer.Typer()


class Windshield(StrEnum):
    """What becomes of the windshield model that a rig has of the calibrated camera."""

    KEEP = "keep"
    DROP = "drop"


_PARAMETER_DIGITS, _SIGMA_DIGITS = 8, 2


SourcesArgument = Annotated[
    list[Path],
    typer.Argument(help="Pictures or films of the board, or folders of them.", metavar="IMAGES|VIDEO"),
]
BoardOption = Annotated[
    str,
    typer.Option(
        help="checkerboard:9x6:0.08 (inner corners, square in metres) or charuco:12x9:0.06:0.045 "
        "(squares, square and marker in metres), then :DICT_… for other markers than DICT_5X5_250."
    ),
]
OutOption = Annotated[
    Path, typer.Option(help="Folder for rig.json, and for a folder of the camera's files and report.")
]
ModelOption = Annotated[
    str, typer.Option(help="ftheta, fisheye, pinhole, ocam, several with commas, or auto: the best of all.")
]
LinearOption = Annotated[
    bool,
    typer.Option(
        "--linear",
        help="ftheta and ocam: always free c and d (pixels not square), not only where that is better.",
    ),
]
RigOption = Annotated[
    Path | None, typer.Option(help="DriveWorks rig to put the camera into; written to OUT/rig.json.")
]
AddOption = Annotated[bool, typer.Option("--add", help="The rig does not have this camera yet: put it in.")]
WindshieldOption = Annotated[
    Windshield | None,
    typer.Option(
        help="Of a camera that has a windshield model in the rig: drop it where the board was seen through"
        " the windscreen, keep it where it was not."
    ),
]
CameraOption = Annotated[str, typer.Option(help="Name of the camera, as in the rig.")]
MaxViewsOption = Annotated[int, typer.Option(min=5, help="Use at most so many views, well spread.")]
EveryOption = Annotated[
    int | None,
    typer.Option(min=1, help="Look at every so manieth frame of a film.  [default: some 240 frames]"),
]
DistanceOption = Annotated[
    list[str] | None,
    typer.Option(
        help="PICTURE=METRES, measured from the camera to the middle of the board: tells a wrong square "
        "size, which the pictures alone cannot."
    ),
]


@app.command(
    "intrinsics",
    epilog="Example: twin calibrate intrinsics pictures --board charuco:12x9:0.06:0.045 --out calibrated",
)
def intrinsics(
    sources: SourcesArgument,
    board: BoardOption,
    out: OutOption = Path("calibrated"),
    model: ModelOption = "auto",
    linear: LinearOption = False,
    rig: RigOption = None,
    add: AddOption = False,
    windshield: WindshieldOption = None,
    camera: CameraOption = "camera",
    max_views: MaxViewsOption = 60,
    every: EveryOption = None,
    distance: DistanceOption = None,
    json_output: JsonOption = False,
) -> None:
    """Calibrate one camera from pictures of a board: model, uncertainty, coverage, and what is wrong."""
    from twin.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from twin.calibrate.intrinsics.report import intrinsics_report
    from twin.calibrate.intrinsics.write import check_rig, write_calibration

    distances_m = _distances(distance or [])
    screen = None if windshield is None else windshield.value
    check_rig(out, camera, rig, add=add, windshield=screen)
    with bar(quiet=json_output) as progress:
        calibration = calibrate_intrinsics(
            sources,
            board,
            model=model,
            linear=linear,
            max_views=max_views,
            every=every,
            distances_m=distances_m,
            progress=progress,
        )
    files, earlier = write_calibration(calibration, out, camera, rig, add=add, windshield=screen)
    if earlier is not None:
        warn(
            f"{out} held another calibration of {camera}: its files are in {earlier.name} now. To compare the"
            " two (twin calibrate diff) give each a folder of its own by --out."
        )
    report = intrinsics_report(calibration, camera)
    if json_output:
        print_json(report.document([str(file) for file in files]))
        return
    _print_report(report)
    _print_written(report, calibration.faults, files)
    _print_next(board, out, files[0], another="" if rig is not None and not add else " --add")


def _distances(texts: list[str]) -> dict[str, float]:
    from twin.errors import ConfigError

    distances = {}
    for text in texts:
        name, equals, metres = text.rpartition("=")
        try:
            distances[name] = float(metres)
        except ValueError:
            equals = ""
        if not equals:
            raise ConfigError(f"--distance is {text}: write PICTURE=METRES, board_01.png=2.50 for one.")
    return distances


def _print_written(report: IntrinsicsReport, faults: Sequence[Doubt], files: Sequence[Path]) -> None:
    from twin.calibrate.intrinsics.report import left_out_lines

    print_paths("Written:", files)
    for fault in faults:
        warn(fault.sentence)
    for line in left_out_lines(report.left_out):
        note(f"Left out: {line}")


def _print_next(board: str, out: Path, rig: Path, *, another: str) -> None:
    note(
        f"Next camera: twin calibrate intrinsics PICTURES --board {board} --camera NAME --rig {rig}{another}"
        f" --out {out}"
    )
    note(f"Next: twin calibrate extrinsics PICTURES --tags layout.toml --rig {rig} --out mounted")


def _print_report(report: IntrinsicsReport) -> None:
    residuals, coverage, pictures = report.residuals, report.coverage, report.pictures
    sigma = coverage.ray_sigma_deg
    print_pairs(
        f"Camera {report.camera}: {report.model}",
        {
            "pictures": f"{pictures.looked_at} looked at, board in {pictures.board_found}, "
            f"{pictures.used} used",
            "corners": f"{residuals.corners:,}, {residuals.rejected} rejected",
            "one corner": f"{residuals.sigma_px:.3f} px",
            "residual angle": f"{residuals.rms_deg:.4f}° RMS, {residuals.max_deg:.4f}° at most",
            "covered": f"{coverage.part_of_the_image:.0%} of the image; nothing is vouched for elsewhere",
            "a ray there": f"known to {sigma.median:.4f}°, {sigma.largest:.4f}° at worst (one sigma)",
        },
    )
    print_table(
        "Parameters",
        ["parameter", "value", "one sigma"],
        [
            (p.name, f"{p.value:.{_PARAMETER_DIGITS}g}", f"{p.sigma:.{_SIGMA_DIGITS}g}")
            for p in report.parameters
        ],
    )
    print_table(
        "Models, by views left out of the fit",
        ["model", "parameters", "held-out RMS [°]", ""],
        [
            (
                m.model,
                m.parameters,
                "–" if m.held_out_rms_deg is None else f"{m.held_out_rms_deg:.5f}",
                "chosen" if m.chosen else m.reason,
            )
            for m in report.models
        ],
    )


@app.command("example", epilog="Example: twin calibrate example board")
def example(
    out: Annotated[Path, typer.Argument(help="A new or an empty folder.", metavar="OUT")],
    camera: Annotated[
        str, typer.Option(help="C1_front60Single, C2_tricam60 or C3_tricam120 of the simulated car.")
    ] = "C3_tricam120",
    pictures: Annotated[int, typer.Option(min=5, help="How many.")] = 24,
    seed: Annotated[int, typer.Option(min=0, help="Draws poses, light and noise.")] = 0,
    json_output: JsonOption = False,
) -> None:
    """Render pictures of a ChArUco board to try `intrinsics` on, and the rig that they were taken with."""
    from twin.calibrate.intrinsics.example import EXAMPLE_BOARD, PICTURES, write_example

    with bar(quiet=json_output) as progress:
        files = write_example(out, camera=camera, n_pictures=pictures, seed=seed, progress=progress)
    if json_output:
        print_json({"board": EXAMPLE_BOARD, "camera": camera, "files": [str(f) for f in files]})
        return
    print_paths("Written:", [files[0], "…", *files[-2:]])
    note(
        f"Next: twin calibrate intrinsics {out / PICTURES} --board {EXAMPLE_BOARD} --camera {camera}"
        " --out calibrated"
    )
