"""``twin calibrate extrinsics``, ``verify`` and ``from-drives``: where the cameras sit on the car."""

from __future__ import annotations

import datetime as dt
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.cli.options import DEFAULT_STORE, EpsgOption, JsonOption, StoreOption
from twin.cli.output import bar, note, print_json, print_pairs, print_paths, print_table, steps, warn

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from twin.calibrate.drives.history import Histories
    from twin.calibrate.drives.verify import Verification
    from twin.calibrate.extrinsics.calibrate import ExtrinsicsReport

app = typer.Typer()


@app.command(
    "extrinsics",
    epilog="Example: twin calibrate extrinsics pictures --tags layout.toml --rig calibrated/rig.json",
)
def extrinsics(
    images: Annotated[
        Path,
        typer.Argument(help="Folder of pictures; names or sub-folders name the camera.", metavar="IMAGES"),
    ],
    tags: Annotated[Path, typer.Option(help="What stands around the car: layout.toml.")],
    rig: Annotated[
        Path,
        typer.Option(
            help="The cameras' intrinsics: a DriveWorks rig file, a drive folder or its drive.toml, or a "
            "calibration file (Kalibr, OpenCV, OCamCalib, OpenSfM, mrcal)."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for rig.json, the report and its picture.")] = Path(
        "mounted"
    ),
    hand: Annotated[
        Path | None, typer.Option(help="Calibration file of a camera that was carried around the car.")
    ] = None,
    json_output: JsonOption = False,
) -> None:
    """Find where the cameras sit on the car, from pictures of AprilTags around it."""
    from twin.calibrate.extrinsics.calibrate import calibrate_rig

    with bar(quiet=json_output) as progress:
        report = calibrate_rig(images, tags, rig, out, hand=hand, progress=progress)
    if json_output:
        print_json(report)
        return
    _print_extrinsics(report)
    for text in report.notes:
        note(text)
    for text in report.doubts:
        warn(text)
    if report.drive_tables:
        typer.echo(f"For drive.toml, over its tables of these names:\n{report.drive_tables}", nl=False)
    print_paths("Written:", report.files)
    note(f"Next: {_to_ingest(report.drive, report.rig_file, report.files)}")


def _to_ingest(drive: Path | None, rig_file: str, files: Sequence[Path]) -> str:
    """What brings a new rig into a drive: the first of the files, or the tables among them."""
    tables = [file for file in files if file.suffix == ".toml"]
    if drive is None:
        return f"put {files[0]} into the drive's folder as its rig file, then twin ingest-drive DRIVE"
    if tables:
        return (
            f"paste {tables[0]} over those tables of {drive / 'drive.toml'}, then twin ingest-drive {drive}"
        )
    if files[0].resolve() == (drive / rig_file).resolve():
        return f"twin ingest-drive {drive}"
    return f"put {files[0]} in the place of {drive / rig_file}, then twin ingest-drive {drive}"


def _print_extrinsics(report: ExtrinsicsReport) -> None:
    from geoloc.calibration.extrinsics.doubts import OPEN_DEG, OPEN_M

    print_table(
        "Cameras in the rig frame, with one sigma",
        ["camera", "roll, pitch, yaw [°]", "±", "x, y, z [m]", "±", "turned", "moved", "tags", "residual"],
        [
            (
                camera.camera,
                _numbers(camera.roll_pitch_yaw_deg, 3),
                _sigmas(camera.sigma_deg, 3, OPEN_DEG),
                _numbers(camera.position_m, 4),
                _sigmas(camera.sigma_m, 4, OPEN_M),
                None if camera.turned_deg is None else f"{camera.turned_deg:.2f}°",
                None if camera.moved_m is None else f"{camera.moved_m:.3f} m",
                f"{camera.n_tags - camera.n_left_out} of {camera.n_tags}",
                f"{camera.rms_px:.2f} px",
            )
            for camera in report.cameras
        ],
    )


@app.command("example-yard", epilog="Example: twin calibrate example-yard yard")
def example_yard(
    out: Annotated[Path, typer.Argument(help="A new or an empty folder.", metavar="OUT")],
    seed: Annotated[int, typer.Option(min=0, help="Draws the yard, its survey, light and noise.")] = 0,
    floor_lean: Annotated[
        float, typer.Option(min=-5.0, max=5.0, help="Slope of the floor, degrees, to see it found.")
    ] = 0.0,
    json_output: JsonOption = False,
) -> None:
    """Render a yard with AprilTags to try `extrinsics` on, with a drawn rig and the true one."""
    from twin.calibrate.extrinsics.example import DRAWN_RIG, LAYOUT, write_yard
    from twin.calibrate.intrinsics.example import PICTURES

    with bar(quiet=json_output) as progress:
        files = write_yard(out, seed=seed, floor_lean_deg=floor_lean, progress=progress)
    if json_output:
        print_json({"files": [str(f) for f in files]})
        return
    print_paths("Written:", files)
    note(
        f"Next: twin calibrate extrinsics {out / PICTURES} --tags {out / LAYOUT} --rig {out / DRAWN_RIG}"
        " --out mounted"
    )


@app.command(
    "verify", epilog="Example: twin calibrate verify trip --known known.csv --apply rig_corrected.json"
)
def verify(
    drive: Annotated[
        Path, typer.Argument(help="A drive past objects at surveyed positions.", metavar="DRIVE")
    ],
    known: Annotated[Path, typer.Option(help="CSV with object, easting, northing.")],
    epsg: EpsgOption = None,
    apply: Annotated[
        Path | None,
        typer.Option(
            help="Write the drive's rig here, with the corrections that are to be expected to help."
        ),
    ] = None,
    level: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=5.0,
            help="The ground at the objects is plane with that below the car to so many degrees, as a yard's "
            "floor is: 0.1.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="PNG, SVG or PDF of the errors by distance, before and after."),
    ] = None,
    json_output: JsonOption = False,
) -> None:
    """Check the cameras against objects at surveyed positions: errors by distance, and what mends them."""
    from twin.calibrate.drives.plots import draw_verification
    from twin.calibrate.drives.verify import verify_drive

    with steps(quiet=json_output) as say:
        verification = verify_drive(drive, known, apply=apply, level_deg=level, epsg=epsg, progress=say)
    if plot is not None:
        draw_verification(verification, plot)
    if json_output:
        document = {k: v for k, v in asdict(verification).items() if k != "errors_at"}
        print_json({**document, "plot": None if plot is None else str(plot)})
        return
    _print_verification(verification)
    if plot is not None:
        note(f"wrote {plot}")
    note(f"Next: {_after_verify(verification, drive, known, level, epsg)}")


def _after_verify(
    verification: Verification, drive: Path, known: Path, level: float | None, epsg: int | None
) -> str:
    if verification.doubt:
        return f"look at {known} and the rig file, then twin calibrate verify {drive} --known {known}"
    if verification.rig is not None and verification.advised:
        files = [verification.rig] if verification.tables is None else [verification.rig, verification.tables]
        return _to_ingest(drive, verification.rig_file, files)
    if verification.advised:
        given = "" if level is None else f" --level {level:g}"
        given += "" if epsg is None else f" --epsg {epsg}"
        return f"twin calibrate verify {drive} --known {known}{given} --apply rig_corrected.json"
    return f"twin ingest-drive {drive}"


def _print_verification(verification: Verification) -> None:
    print_table(
        f"{verification.drive}: horizontal error of single frames, median",
        ["camera", "distance [m]", "n", "now [m]", "turned [m]"],
        [(e.camera, f"{e.distance_m:.1f}", e.n, e.before_m, e.after_m) for e in verification.errors],
    )
    print_table(
        "Turn of each camera that fits best, about its own axes",
        ["camera", "pitch [°]", "yaw [°]", "roll [°]", "pixels now", "turned", "objects", "sightings"],
        [
            (
                turn.camera,
                f"{turn.pitch_deg:+.3f} ± {turn.sigma_pitch_deg:.3f}",
                f"{turn.yaw_deg:+.3f} ± {turn.sigma_yaw_deg:.3f}",
                f"{turn.roll_deg:+.3f} ± {turn.sigma_roll_deg:.3f}",
                f"{turn.before_px:.1f}",
                f"{turn.after_px:.1f}",
                turn.n_objects,
                turn.n_sightings,
            )
            for turn in verification.turns.values()
        ],
    )
    for warning in (*verification.warnings, *filter(None, [verification.doubt])):
        warn(warning)
    if verification.not_seen:
        note(f"Not annotated in this drive: {', '.join(verification.not_seen)}.")
    note("Positive pitch looks up, positive yaw right; in rig files and drive.toml it is down and left.")
    _print_correction(verification)


def _print_correction(verification: Verification) -> None:
    for name in verification.advised:
        turn = verification.mounting[name]
        parts = (
            ("pitch", turn.pitch_deg, turn.sigma_pitch_deg),
            ("yaw", turn.yaw_deg, turn.sigma_yaw_deg),
            ("roll", turn.roll_deg, turn.sigma_roll_deg),
        )
        told = ", ".join(f"{axis} {value:+.2f} ± {sigma:.2f}°" for axis, value, sigma in parts)
        note(
            f"{name} is off by its mounting: {told}; corrected so it sits nearer to the truth with"
            f" {verification.chance[name]:.0%} probability."
        )
    if verification.doubt:
        note("Nothing of this can be applied.")
    elif not verification.advised:
        note(
            "No camera needs a correction: none is off by 0.02° or more and has a chance of four in five to"
            " sit nearer to the truth after it."
        )
    elif verification.rig is None:
        note("--apply FILE writes the corrected rig.")
    if verification.drive_tables:
        typer.echo(f"For drive.toml, over its tables of these names:\n{verification.drive_tables}", nl=False)
    if verification.rig is not None:
        note(f"wrote {verification.rig}, with {', '.join(verification.advised) or 'nothing'} corrected")
    if verification.tables is not None:
        note(f"wrote {verification.tables}, the same for drive.toml")


@app.command("from-drives", epilog="Example: twin calibrate from-drives --plot cameras.png")
def from_drives(
    apply: Annotated[
        Path | None,
        typer.Option(
            help="Write the newest drive's rig here, with the corrections that are to be expected to help."
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="PNG, SVG or PDF of each camera's angles.")] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Follow the cameras' mounting over the drives in the store, and warn of one that was moved."""
    from twin.calibrate.drives.history import cameras_from_drives
    from twin.calibrate.drives.plots import draw_histories
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        histories = cameras_from_drives(opened, apply=apply)
    if plot is not None:
        draw_histories(histories, plot)
    if json_output:
        print_json({**asdict(histories), "plot": None if plot is None else str(plot)})
        return
    _print_histories(histories)
    if plot is not None:
        note(f"wrote {plot}")


def _print_histories(histories: Histories) -> None:
    print_table(
        "Cameras by drive, against the newest drive's rig file",
        ["camera", "drive", "", "pitch [°]", "yaw [°]", "roll [°]"],
        [
            (history.camera, drive.name, _day(drive.started_ns), *_angles(drive.turn_deg, drive.sigma_deg))
            for history in histories.cameras
            for drive in history.drives
        ],
        right_from=3,
    )
    means: dict[str, Any] = {
        f"{h.camera}, {_drives(len(h.drives) - h.since)}": "pitch {}°, yaw {}°, roll {}°".format(
            *_angles(h.turn_deg, h.sigma_deg)
        )
        for h in histories.cameras
    }
    print_pairs("Mean since it last moved (positive pitch looks up, positive yaw right)", means)
    for warning in histories.warnings:
        warn(warning)
    if histories.rig is not None:
        corrected = ", ".join(histories.advised) or "nothing"
        note(f"wrote {histories.rig}, with {corrected} corrected")
    elif histories.advised:
        note(f"Off by their mounting: {', '.join(histories.advised)}. --apply FILE writes the corrected rig.")


def _drives(count: int) -> str:
    return "1 drive" if count == 1 else f"{count} drives"


def _day(epoch_ns: int) -> str:
    return f"{dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC):%Y-%m-%d}"


def _angles(turn: tuple[float, ...], sigma: tuple[float, ...]) -> list[str]:
    return [f"{value:+.3f} ± {one:.3f}" for value, one in zip(turn, sigma, strict=True)]


def _numbers(values: Iterable[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _sigmas(values: Iterable[float], digits: int, most: float) -> str:
    """One sigma each; what the tags leave open has none to speak of."""
    return ", ".join("open" if value > most else f"{value:.{digits}f}" for value in values)
