"""``twin locate``: where on the ground a pixel of a recorded drive points."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from twin.cli.options import JsonOption
from twin.cli.output import print_json, print_pairs, steps, warn

app = typer.Typer()


class OneFrame(StrEnum):
    """Methods that take one picture."""

    SINGLE_FRAME = "single-frame"
    PAPER = "paper"


@app.command("locate", epilog="Example: twin locate path/to/trip C3_tricam120 84 1516 800")
def locate(
    drive: Annotated[Path, typer.Argument(help="A folder with a recorded drive.", metavar="DRIVE")],
    camera: Annotated[str, typer.Argument(help="A camera of its rig.", metavar="CAMERA")],
    frame: Annotated[int, typer.Argument(help="Number of the picture in its recording, from 0.", min=0)],
    u: Annotated[float, typer.Argument(help="Column, counted from the left edge as annotation tools do.")],
    v: Annotated[float, typer.Argument(help="Row, counted from the upper edge.")],
    method: Annotated[OneFrame, typer.Option(help="How.")] = OneFrame.SINGLE_FRAME,
    json_output: JsonOption = False,
) -> None:
    """Tell where on the road's plane a pixel points, with its error: no store, no annotations needed.

    One picture knows the distance poorly: the ellipse says how poorly. What stands higher than the road is
    told too far away.
    """
    from twin.drives.epochs import utc_text
    from twin.ingest.pixel import locate_pixel

    with steps(quiet=json_output) as say:
        found = locate_pixel(drive, camera, frame, (u, v), method=method.value, progress=say)
    for warning in found.warnings:
        warn(warning)
    if json_output:
        print_json(found.as_json())
        return
    height = f"{found.height_m:.2f} m above the ellipsoid" if math.isfinite(found.height_m) else None
    if math.isfinite(found.height_nn2000_m):
        height = f"{height}, {found.height_nn2000_m:.2f} m NN2000"
    pairs = {
        "time": f"{utc_text(found.epoch_ns)}, at {3.6 * found.speed_mps:.0f} km/h",
        "distance": f"{found.range_m:.2f} m from the camera, horizontally",
        "EPSG:25833": f"east {found.east_m:.2f} m, north {found.north_m:.2f} m",
        "WGS84": f"{found.latitude_deg:.8f}, {found.longitude_deg:.8f} (latitude, longitude)",
        "height": height,
        "95 % ellipse": f"{found.major95_m:.2f} × {found.minor95_m:.2f} m (half axes), long axis"
        f" {found.azimuth_deg:.0f}° from true north",
    }
    print_pairs(f"{camera}, frame {frame}, pixel {u:g} {v:g}", pairs)
