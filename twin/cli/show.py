"""The body of ``twin show``: one estimate in tables."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.cli.output import note, print_json, print_pairs, print_table

if TYPE_CHECKING:
    from twin.reports.estimate import EstimateExplained

_MAX_REJECTED = 12
"""Rejected frames that the table names; --json has them all."""


def show(which: str, out: Path | None, store: Path, json_output: bool) -> None:
    """``twin show``."""
    from twin.reports.estimate import explain_estimate
    from twin.reports.estimate_picture import draw_estimate
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        explained = explain_estimate(opened, which)
    if out is not None:
        draw_estimate(explained, out)
    if json_output:
        print_json({**explained.as_json(), "picture": None if out is None else str(out)})
        return
    _print_position(explained)
    _print_budget(explained)
    _print_cameras(explained)
    _print_rejected(explained)
    _print_corrections(explained.corrections)
    _print_neighbours(explained)
    if out is not None:
        note(f"wrote {out}")


def _print_position(e: EstimateExplained) -> None:
    height = f"{e.height_m:.2f}{_sigma(e.sigma_height_m)} m ellipsoidal"
    if math.isfinite(e.height_nn2000_m):
        height += f", {e.height_nn2000_m:.2f} m NN2000"
    first = dt.datetime.fromtimestamp(e.frames.epoch_ns.min() / 1e9, tz=dt.UTC)
    print_pairs(
        f"Object {e.object}",
        {
            "estimate": e.estimate_id,
            "label": e.label or None,
            "sign code": e.skiltnummer.replace(";", " + ") or None,
            "drive": f"{e.drive_name} ({e.drive_id}), first seen {first:%Y-%m-%d %H:%M:%S} UTC",
            "method": e.method,
            "position, EPSG:25833": f"{e.east_m:.2f} E  {e.north_m:.2f} N",
            "position, WGS84": f"{e.latitude_deg:.7f}° N  {e.longitude_deg:.7f}° E",
            "height": height,
            "95 % ellipse": f"half axes {e.major95_m:.2f} and {e.minor95_m:.2f} m, "
            f"the long one at {e.azimuth_deg:.0f}° from true north",
            "rests on": f"{e.n_sightings:,} sightings in {e.n_frames:,} frames",
            "remarks": "; ".join(e.flags) or None,
            "other estimates of it": ", ".join(e.also) or None,
        },
    )


def _print_budget(e: EstimateExplained) -> None:
    if not e.budget:
        note(f"No error budget by source: the method {e.method} keeps none (adjusted does).")
        return
    rows = [(s.source, f"{s.along_m:.3f}", f"{s.across_m:.3f}", f"{s.share:.0%}") for s in e.budget]
    total = [math.hypot(*(getattr(s, name) for s in e.budget)) for name in ("along_m", "across_m")]
    print_table(
        "Error budget: one sigma by source",
        ["source", "along the long axis [m]", "across it [m]", "share of the variance"],
        [*rows, ("all together", *(f"{value:.3f}" for value in total), "100%")],
    )


def _print_cameras(e: EstimateExplained) -> None:
    known = any(math.isfinite(c.rms_px) for c in e.cameras)
    rows = [
        (
            c.camera,
            c.n_used,
            c.n_rejected,
            f"{c.range_min_m:.1f}–{c.range_max_m:.1f}" if math.isfinite(c.range_min_m) else None,
            *([f"{c.rms_px:.2f}" if math.isfinite(c.rms_px) else None] if known else []),
        )
        for c in e.cameras
    ]
    header = ["camera", "used" if known else "located", "rejected", "distance [m]"]
    print_table("Seen by", [*header, *(["RMS residual [px]"] if known else [])], rows)
    if not known and e.n_rejected:
        note(
            f"The {e.n_rejected:,} outliers are among those located: {e.method} does not keep which they are."
        )


def _print_rejected(e: EstimateExplained) -> None:
    import numpy as np

    frames = e.frames
    rejected = np.flatnonzero(~frames.used)
    if rejected.size == 0:
        return

    def number(value: float, form: str) -> str | None:
        return format(value, form) if math.isfinite(value) else None

    rows = [
        (
            frames.camera[k],
            f"{frames.frame[k]}",
            frames.rejected[k],
            number(frames.range_m[k], ".1f"),
            *(number(value, "+.1f") for value in frames.residual_px[k].tolist()),
        )
        for k in rejected[:_MAX_REJECTED].tolist()
    ]
    header = ["camera", "frame", "reason", "distance [m]", "seen too far right [px]", "too low [px]"]
    if not np.isfinite(frames.residual_px).any():
        header, rows = header[:-2], [row[:-2] for row in rows]
    print_table("Rejected sightings", header, rows, right_from=3)
    if rejected.size > _MAX_REJECTED:
        note(f"… and {rejected.size - _MAX_REJECTED:,} more; --json lists them all.")


def _print_corrections(found: Mapping[str, Any]) -> None:
    if "boresight_deg" not in found:
        return

    def told(correction: Mapping[str, float | None], form: str) -> str:
        sigma = correction["sigma"]
        return f"{correction['value']:+{form}}" + ("" if sigma is None else f" ± {sigma:{form}}")

    print_pairs(
        "What the adjustment found in this drive",
        {
            "added to the camera clock [ms]": told(found["camera_offset_ms"], ".1f"),
            "rolling shutter, first to last row [ms]": told(found["rolling_shutter_ms"], ".1f"),
            "noise of a pixel against the stated one": f"× {found['pixel_noise_factor']:.2f}",
        },
    )
    rows = [
        (camera, *(told(angles[name], ".2f") for name in ("pitch", "yaw", "roll")))
        for camera, angles in found["boresight_deg"].items()
    ]
    print_table("Boresight corrections [°]", ["camera", "pitch", "yaw", "roll"], rows)


def _print_neighbours(e: EstimateExplained) -> None:
    from twin.reports.estimate import NEIGHBOURS_M

    rows = [
        (
            f"{site.nvdb_type}/{site.nvdb_id}",
            " + ".join(code for code in site.codes if code) or None,
            math.hypot(site.east_m - e.east_m, site.north_m - e.north_m),
            site.sigma_m,
        )
        for site in e.neighbours
    ]
    if rows:
        header = ["NVDB object", "sign codes", "distance [m]", "its own sigma [m]"]
        print_table(f"NVDB's signs within {NEIGHBOURS_M:g} m", header, rows, right_from=2)


def _sigma(value: float) -> str:
    return f" ± {value:.2f}" if math.isfinite(value) else ""
