"""``twin calibrate diff``: two calibrations of the same cameras compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.exit_codes import EXIT_OPEN_FINDINGS
from twin.cli.options import JsonOption
from twin.cli.output import note, print_json, print_line, print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from twin.calibrate.difference.compare import CameraCompared

app = typer.Typer()
_FIT = "A folder that intrinsics or extrinsics wrote, or a rig, camera or report file."


@app.command(
    "diff", epilog="Example: twin calibrate diff spring/calibrated autumn/calibrated --plot diff.png"
)
def diff(
    first: Annotated[Path, typer.Argument(help=_FIT, metavar="A")],
    second: Annotated[Path, typer.Argument(help="The same, from other pictures.", metavar="B")],
    camera: Annotated[str | None, typer.Option(help="Only this one; else all that both have.")] = None,
    plot: Annotated[Path | None, typer.Option(help="PNG, SVG or PDF of the differences.")] = None,
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="Exit with 1 if a camera differs, 0 if none does.")
    ] = False,
    json_output: JsonOption = False,
) -> None:
    """Compare two calibrations of a camera in units of their uncertainty: what has changed, and where."""
    from twin.calibrate.difference.compare import compare_calibrations
    from twin.calibrate.difference.plots import draw_difference
    from twin.store.figure_files import check_figure_name

    if plot is not None:
        check_figure_name(plot)
    maps = compare_calibrations(first, second, camera)
    if plot is not None:
        draw_difference(maps, plot)
    found = [one.compared for one in maps]
    if json_output:
        print_json(diff_document(found, plot))
    else:
        _print(found)
        if plot is not None:
            note(f"wrote {plot}")
    if exit_code and any(one.differs for one in found):
        raise typer.Exit(EXIT_OPEN_FINDINGS)


def diff_document(found: Sequence[CameraCompared], plot: Path | None) -> dict[str, object]:
    """The comparison with its sentences, for ``json.dumps``."""
    from dataclasses import asdict

    from twin.calibrate.difference.words import verdict_sentence

    cameras = [{**asdict(one), "sentence": verdict_sentence(one)} for one in found]
    return {"cameras": cameras, "plot": None if plot is None else str(plot)}


def _print(found: Sequence[CameraCompared]) -> None:
    from twin.calibrate.difference.compare import FitVerdict
    from twin.calibrate.difference.words import metres, verdict_sentence

    print_table(
        "Lenses, one common turn taken out",
        [
            "camera",
            "turn [°]",
            "rms [°]",
            "most [°]",
            "most [px]",
            "where",
            "at 20 m: sideways",
            "along",
            "sigmas",
            "by chance",
        ],
        [
            (
                one.camera,
                f"{one.lens.turned_deg:.4f}",
                f"{one.lens.rms_deg:.4f}",
                f"{one.lens.largest_deg:.4f}",
                f"{one.lens.largest_px:.3f}",
                one.lens.where,
                metres(one.lens.sideways_m),
                metres(one.lens.along_m),
                None if one.lens.in_sigmas is None else f"{one.lens.in_sigmas:.1f}",
                None if one.lens.by_chance is None else f"{one.lens.by_chance:.1%}",
            )
            for one in found
        ],
    )
    mounted = [(one.camera, one.mounting) for one in found if one.mounting is not None]
    if mounted:
        print_table(
            "Mounting, B against A, about and along the rig's x, y, z",
            ["camera", "roll, pitch, yaw [°]", "±", "moved [m]", "±", "by chance"],
            [
                (
                    camera,
                    _numbers(m.roll_pitch_yaw_deg, "+.4f"),
                    None if m.sigma_deg is None else _numbers(m.sigma_deg, ".4f"),
                    _numbers(m.moved_m, "+.4f"),
                    None if m.sigma_m is None else _numbers(m.sigma_m, ".4f"),
                    None if m.by_chance is None else f"{m.by_chance:.1%}",
                )
                for camera, m in mounted
            ],
        )
    for one in found:
        print_line(verdict_sentence(one))
    for what, command, cameras in (
        ("lens", "intrinsics", [c.camera for c in found if c.lens.verdict is FitVerdict.NOT_JUDGED]),
        ("mounting", "extrinsics", [c for c, m in mounted if m.verdict is FitVerdict.NOT_JUDGED]),
    ):
        if cameras:
            note(
                f"{', '.join(cameras)}: nothing says whether chance explains the difference of the {what}, "
                f"since not both calibrations keep its covariance. Folders that twin calibrate {command} "
                "wrote do."
            )


def _numbers(values: Sequence[float], form: str) -> str:
    return ", ".join(format(value, form) for value in values)
