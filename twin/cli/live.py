"""``twin live``: positions while a drive goes on."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from twin.cli.output import note, steps, warn

app = typer.Typer()

_FASTEST = "max"


@app.command("live", epilog="Example: twin live --replay path/to/trip --speed max > live.geojsonl")
def live(
    replay: Annotated[
        Path,
        typer.Option(
            help="Play a recorded drive, as if it went on now.", metavar="DRIVE", show_default=False
        ),
    ],
    speed: Annotated[
        str,
        typer.Option(
            help="Times as fast as it was driven; max: as fast as it goes. The estimates are the same.",
            metavar="FACTOR",
        ),
    ] = "1",
    every: Annotated[
        bool,
        typer.Option("--every/--final", help="Every estimate as it changes, or only those that are final."),
    ] = True,
) -> None:
    """Locate signs as they are seen: one GeoJSON feature a line on stdout, with its error ellipse.

    An object is located from the first frame that shows it, refined while it is in view, and final when it
    has been out of view for a few seconds: the property state says which. More: twin help live.
    """
    from twin.drives.read import read_drive
    from twin.live import Estimate, LiveEngine, State, arrivals_of, car_of, played

    factor = _factor(speed)
    with steps(quiet=False) as say:
        drive = read_drive(replay, progress=say)
    for warning in drive.warnings:
        warn(str(warning))
    engine = LiveEngine(car_of(drive))
    ended: Counter[State] = Counter()

    def say_all(estimates: Iterable[Estimate]) -> None:
        for estimate in estimates:
            ended[estimate.state] += 1
            if every or estimate.state is State.FINAL:
                sys.stdout.write(estimate.line() + "\n")
        sys.stdout.flush()

    for arrival in played(arrivals_of(drive), factor):
        say_all(engine.feed(arrival))
    say_all(engine.finish())
    lost = f"; {ended[State.LOST]} objects got no position" if ended[State.LOST] else ""
    note(f"{engine.frames} frames, {engine.sightings} sightings, {ended[State.FINAL]} objects located{lost}.")


def _factor(speed: str) -> float | None:
    if speed == _FASTEST:
        return None
    try:
        factor = float(speed)
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < 1e6:
        raise typer.BadParameter(f"--speed takes a number above 0, or {_FASTEST}, but not {speed:.40}.")
    return factor
