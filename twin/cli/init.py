"""``twin init``: the first ``drive.toml`` of a folder from a dashcam, an action camera or a telephone."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.output import note, steps, warn
from twin.errors import to_type

if TYPE_CHECKING:
    from twin.drives.starting.found import Found
    from twin.drives.starting.settings_text import Answers

app = typer.Typer()


@app.command("init", epilog="Example: twin init my-drive --lens 'gopro hero9-12 wide' --height 1.25")
def init(
    folder: Annotated[Path, typer.Argument(help="The folder with the recording.", metavar="FOLDER")],
    lens: Annotated[
        str | None,
        typer.Option(
            help="Camera model, field of view across the longer side in degrees, or a calibration file.",
            show_default=False,
        ),
    ] = None,
    height: Annotated[
        float | None, typer.Option(help="Of the camera over the road, metres.", show_default=False)
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(help="When the video began, 2026-06-10T09:59:59+02:00.", show_default=False),
    ] = None,
    clock_sigma: Annotated[
        float | None, typer.Option(help="How well that is known, seconds.", show_default=False)
    ] = None,
    annotations: Annotated[
        str | None, typer.Option(help="A file of annotations in the folder.", show_default=False)
    ] = None,
    complete: Annotated[
        bool | None,
        typer.Option(
            "--complete/--not-complete", help="Every sign in view is annotated.", show_default=False
        ),
    ] = None,
    video: Annotated[
        str | None, typer.Option(help="Which video, where there are several.", show_default=False)
    ] = None,
    gnss: Annotated[
        str | None, typer.Option(help="Which GNSS recording, where there are several.", show_default=False)
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Ask nothing: take what was found, and say it.")
    ] = False,
    replace_file: Annotated[
        bool, typer.Option("--replace", help="Write a new drive.toml; the old one is kept beside it.")
    ] = False,
) -> None:
    """Write drive.toml for a folder with a video and a GNSS track: looks, asks at most six questions."""
    from twin.drives.inspection.inspect import inspect_drive
    from twin.drives.starting.found import look
    from twin.drives.starting.settings_text import settings_text, usual_answers
    from twin.drives.starting.write import refuse_if_there, write_settings

    refuse_if_there(folder, replace=replace_file)
    with steps() as say:
        found = look(folder, video=video, gnss=gnss, progress=say)
    usual = usual_answers(found)
    given = replace(
        usual,
        lens=usual.lens if lens is None else lens,
        height_m=height,
        start_ns=None if start is None else _instant(start),
        clock_s=usual.clock_s if clock_sigma is None else clock_sigma,
        annotations=annotations or "",
        complete=bool(complete),
    )
    _tell(found)
    asked = {
        "lens": lens,
        "height": height,
        "clock": clock_sigma,
        "annotations": annotations,
        "all": complete,
    }
    open_questions = {name for name, value in asked.items() if value is None}
    asks = not yes and sys.stdin.isatty()
    answers = _ask(found, given, open_questions) if asks else given
    for path in write_settings(folder, settings_text(found, answers), replace=replace_file):
        note(f"wrote {path}")
    if open_questions and not asks:
        _tell_defaults(found, given, open_questions)
    with steps() as say:
        inspection = inspect_drive(folder, progress=say)
    if inspection.warnings:
        note(f"What the folder lacks, and what that costs: twin inspect {folder}")
    for refusal in inspection.refusals:
        note(f"twin ingest-drive would refuse: {refusal}")
    ingest, annotate = (to_type("twin", command, folder) for command in ("ingest-drive", "annotate"))
    if found.annotations or answers.annotations:
        note(f"Next: {ingest}")
    else:
        note(f"No annotations yet. Next: {annotate}, then {ingest}")


def _instant(text: str) -> int:
    """Epoch of an instant with its zone."""
    from datetime import UTC, datetime, timedelta

    from twin.errors import ConfigError

    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = datetime.min  # noqa: DTZ901 - refused below, as it has no zone
    if moment.tzinfo is None:
        raise ConfigError(f"--start {text:.60} is no instant with its zone: 2026-06-10T09:59:59+02:00, or Z.")
    return (moment - datetime.fromtimestamp(0, UTC)) // timedelta(microseconds=1) * 1000


def _tell(found: Found) -> None:
    """Say what was found, before anything is asked."""
    width, height = found.size_px
    note(f"Camera {found.camera}: {found.video}, {width} x {height} pixels.")
    if height > width:
        warn(
            f"{found.video} is upright: it sees little to the sides, and loses near signs. Mount"
            " the camera with the longer side level. A field of view is still stated across the longer side."
        )
    if found.track is not None:
        note(f"Track: {found.track}.")
    if found.start is not None:
        outside = "" if found.start.fits else " The video then lies OUTSIDE the track."
        note(f"The video's start is known by {found.start.why}.{outside}")


def _tell_defaults(found: Found, answers: Answers, unasked: set[str]) -> None:
    from twin.drives.starting.settings_text import HEIGHT_M, MOUNTED_DEG, UNKNOWN_FOV_DEG

    lens = answers.lens or f"unknown: {UNKNOWN_FOV_DEG:g}° across the longer side, to 15 % (--lens)"
    told = {
        "lens": f"lens {lens}",
        "height": f"camera {HEIGHT_M:g} m over the road (--height), level to {MOUNTED_DEG:g}°",
        "clock": f"clock known to {answers.clock_s:g} s (--clock-sigma)",
        "annotations": f"annotations {', '.join(found.annotations) or 'none yet'} (--annotations)",
        "all": "annotations not complete (--complete)",
    }
    note("Taken without asking: " + "; ".join(text for name, text in told.items() if name in unasked) + ".")


def _ask(found: Found, given: Answers, questions: set[str]) -> Answers:
    """Ask what no option says; Enter takes what stands in brackets."""
    from geoloc.cameras.nominal import nominal_lenses
    from twin.drives.starting.settings_text import HEIGHT_M, UNKNOWN_FOV_DEG

    answers = given
    if given.start_ns is None and not (found.start and found.start.fits):
        answers = replace(
            answers, start_ns=_instant(_prompt("When did the video begin, with its zone", None))
        )
    if "lens" in questions:
        note(f"Cameras that twin knows: {', '.join(nominal_lenses())}.")
        unknown = f"unknown, about {UNKNOWN_FOV_DEG:g}"
        question = "Camera model, or field of view across the longer side of the picture (°)"
        said = _prompt(question, given.lens or unknown)
        answers = replace(answers, lens="" if said == unknown else said)
    if "height" in questions:
        guess = f"{HEIGHT_M:g}, a guess"
        said = _prompt("Height of the camera over the road (m)", guess)
        answers = replace(answers, height_m=None if said == guess else _number(said, "a height in metres"))
    if "clock" in questions:
        said = _prompt("How well is the start of the video known (s)", f"{given.clock_s:g}")
        answers = replace(answers, clock_s=_number(said, "seconds"))
    if "annotations" in questions:
        usual = ", ".join(found.annotations) or "none yet"
        said = _prompt("File of annotations", usual)
        answers = replace(answers, annotations="" if said == usual else said)
    if "all" in questions:
        answers = replace(answers, complete=typer.confirm("Is every sign in view annotated?", err=True))
    return answers


def _prompt(text: str, default: str | None) -> str:
    return str(typer.prompt(text, default=default, err=True)).strip()


def _number(text: str, what: str) -> float:
    from twin.errors import ConfigError

    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise ConfigError(f"{text:.40} is not {what}.") from None
