"""``twin show``: one estimate, or that behind a finding, and what it rests on."""

from __future__ import annotations

import datetime as dt
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, JsonOption, LangOption, StoreOption
from twin.cli.output import note, print_json, print_pairs, print_table
from twin.cli.overlay import Wish, show_pictures
from twin.cli.told import Told, told_in
from twin.errors import ConfigError
from twin.store.address import StoreAddress
from twin.words import (
    Lang,
    chance_text,
    decision_title,
    number_text,
    reason_of,
    say,
    verdict_title,
)

if TYPE_CHECKING:
    from twin.reports.estimate import EstimateExplained
    from twin.reports.finding_shown import FindingShown
    from twin.store.records import Correction, Corrections

app = typer.Typer()
_MAX_REJECTED = 12
"""Rejected frames that the table names; --json has them all."""


@app.command(
    "show", epilog="Example: twin show P01 --out P01.png.  What stands behind a finding: twin show 45ca74"
)
def show(
    which: Annotated[
        str,
        typer.Argument(
            help="A finding's change id or its first six digits, an estimate's id, or an object's where only "
            "one drive has it.",
            metavar="ID",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Also draw it: PNG, SVG or PDF; where --frame writes: PNG or JPEG.", metavar="FILE"
        ),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(
            help="Draw into the drive's own picture: CAMERA:NUMBER, or `nearest`. ID may be a drive's.",
            metavar="PICTURE",
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            help="Draw into every picture around an object's annotations, or of a drive: MP4.", metavar="FILE"
        ),
    ] = None,
    camera: Annotated[
        str | None, typer.Option(help="Of --video and --frame nearest.  [default: that saw it most often]")
    ] = None,
    masker: Annotated[
        Path | None,
        typer.Option(help="Network that finds people and vehicles: of --frame and --video.", metavar="ONNX"),
    ] = None,
    unmasked: Annotated[
        bool, typer.Option("--unmasked", help="Mask nothing; such pictures are to stay on this machine.")
    ] = False,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one estimate: its position, what its error comes from, the frames that it rests on.

    Of a finding: its verdict and decision, and the estimate that it rests on. With --frame or --video it is
    drawn into the drive's pictures, masked, with what was annotated, NVDB's signs, distances and horizon.
    """
    if frame is not None or video is not None:
        written = show_pictures(
            which,
            Wish(frame, out, video, camera, masker, is_masked=not unmasked, lang=lang),
            store,
            quiet=json_output,
        )
        if json_output:
            print_json({"pictures": [str(path) for path in written]})
        return
    if camera is not None or masker is not None or unmasked:
        raise ConfigError(
            "--camera, --masker and --unmasked belong to --frame or --video: give one of these."
        )
    _show_estimate(which, out, store, lang, json_output=json_output)


def _show_estimate(
    which: str, out: Path | None, store: StoreAddress, lang: Lang, *, json_output: bool
) -> None:
    from twin.reports.estimate import explain_estimate
    from twin.reports.estimate_picture import draw_estimate
    from twin.reports.finding_shown import finding_shown
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        finding = finding_shown(opened, which)
        told = None if finding is None else told_in(opened, [finding.change], lang)
        estimate = which if finding is None else next(iter(finding.estimates), None)
        explained = None if estimate is None else explain_estimate(opened, estimate)
    if out is not None:
        if explained is None:
            raise ConfigError(
                f"The finding {which} is of a sign that was not seen: there is nothing to draw."
            )
        draw_estimate(explained, out)
    if json_output:
        document = {} if explained is None else explained.as_json()
        of_finding = None if finding is None else finding.change.as_json()
        print_json({**document, "finding": of_finding, "picture": None if out is None else str(out)})
        return
    if finding is not None and told is not None:
        _print_finding(finding, told)
    if explained is None:
        return
    _print_position(explained, lang)
    _print_budget(explained, lang)
    _print_cameras(explained, lang)
    _print_rejected(explained, lang)
    if explained.corrections is not None:
        _print_corrections(explained.corrections, lang)
    _print_neighbours(explained, lang)
    if out is not None:
        note(say(lang, "output.wrote", path=str(out)))


def _print_finding(shown: FindingShown, told: Told) -> None:
    lang, finding = told.lang, shown.change.finding
    road = str(told.roads.get(finding.change_id) or "")
    pairs = {
        "finding": finding.change_id,
        "verdict": f"{verdict_title(finding.verdict, lang)}, {chance_text(finding.confidence, lang)}",
        "decision": decision_title(shown.change.decision, lang),
        "road": road or None,
        "estimates": ", ".join(shown.estimates) or say(lang, "show.no_estimate"),
    }
    sys.stdout.write(f"{told.seen(finding)} {reason_of(finding, lang, told.names)}\n")
    title = say(lang, "show.finding_title", finding=finding.change_id)
    print_pairs(title, {say(lang, f"show.{name}"): value for name, value in pairs.items()})
    note(say(lang, "show.explain", finding=finding.change_id))


def _print_position(e: EstimateExplained, lang: Lang) -> None:
    height = None
    if math.isfinite(e.height_m):
        height = say(lang, "show.ellipsoidal", height=e.height_m, sigma=_sigma(e, lang))
    if math.isfinite(e.height_nn2000_m):
        height = f"{height}, {_number(e.height_nn2000_m, '.2f', lang)} m NN2000"
    first = dt.datetime.fromtimestamp(e.frames.epoch_ns.min() / 1e9, tz=dt.UTC)
    seen = f"{first:%Y-%m-%d %H:%M:%S} UTC"
    pairs = {
        "estimate": e.estimate_id,
        "label": e.label or None,
        "sign_code": e.skiltnummer.replace(";", " + ") or None,
        "drive": say(lang, "show.drive_seen", name=e.drive_name, drive=e.drive_id, first=seen),
        "method": e.method,
        "utm33": say(lang, "show.east_north", east=e.east_m, north=e.north_m),
        "wgs84": say(lang, "show.degrees", latitude=e.latitude_deg, longitude=e.longitude_deg),
        "height": height,
        "ellipse": say(lang, "show.half_axes", major=e.major95_m, minor=e.minor95_m, azimuth=e.azimuth_deg),
        "rests_on": say(lang, "show.sightings", sightings=e.n_sightings, frames=e.n_frames),
        "remarks": "; ".join(e.flags) or None,
        "others": ", ".join(e.also) or None,
    }
    print_pairs(
        say(lang, "show.object", object=e.object),
        {say(lang, f"show.{name}"): value for name, value in pairs.items()},
    )


def _print_budget(e: EstimateExplained, lang: Lang) -> None:
    if not e.budget:
        note(say(lang, "show.no_budget", method=e.method))
        return
    rows = [
        (s.source, *(_number(m, ".3f", lang) for m in (s.along_m, s.across_m)), _number(s.share, ".0%", lang))
        for s in e.budget
    ]
    total = [math.hypot(*(getattr(s, name) for s in e.budget)) for name in ("along_m", "across_m")]
    whole = (*(_number(value, ".3f", lang) for value in total), _number(1.0, ".0%", lang))
    columns = _columns(lang, "source", "along", "across", "share")
    print_table(say(lang, "show.budget"), columns, [*rows, (say(lang, "show.all_together"), *whole)])


def _print_cameras(e: EstimateExplained, lang: Lang) -> None:
    keeps_residuals = any(math.isfinite(c.rms_px) for c in e.cameras)
    rows = [
        (
            c.camera,
            c.n_used,
            c.n_rejected,
            number_text(lang, f"{c.range_min_m:.1f}–{c.range_max_m:.1f}")
            if math.isfinite(c.range_min_m)
            else None,
            *([_number(c.rms_px, ".2f", lang)] if keeps_residuals else []),
        )
        for c in e.cameras
    ]
    columns = _columns(lang, "camera", "used" if keeps_residuals else "located", "rejected", "distance")
    rms = _columns(lang, "rms") if keeps_residuals else []
    print_table(say(lang, "show.seen_by"), [*columns, *rms], rows)
    if not keeps_residuals and e.n_rejected:
        note(say(lang, "show.outliers_unknown", n=e.n_rejected, method=e.method))


def _print_rejected(e: EstimateExplained, lang: Lang) -> None:
    import numpy as np

    frames = e.frames
    rejected = np.flatnonzero(~frames.used)
    if rejected.size == 0:
        return
    rows = [
        (
            frames.camera[k],
            f"{frames.frame[k]}",
            frames.rejected[k],
            _number(frames.range_m[k], ".1f", lang),
            *(_number(value, "+.1f", lang) for value in frames.residual_px[k].tolist()),
        )
        for k in rejected[:_MAX_REJECTED].tolist()
    ]
    columns = _columns(lang, "camera", "frame", "reason", "distance", "too_right", "too_low")
    if not np.isfinite(frames.residual_px).any():
        columns, rows = columns[:-2], [row[:-2] for row in rows]
    print_table(say(lang, "show.rejected_sightings"), columns, rows, right_from=3)
    if rejected.size > _MAX_REJECTED:
        note(say(lang, "show.more", n=int(rejected.size) - _MAX_REJECTED))


def _print_corrections(corrections: Corrections, lang: Lang) -> None:
    def told(correction: Correction, form: str) -> str:
        sigma = correction.sigma
        text = f"{correction.value:+{form}}" + ("" if sigma is None else f" ± {sigma:{form}}")
        return number_text(lang, text)

    pairs = {
        "clock": told(corrections.camera_offset_ms, ".1f"),
        "shutter": told(corrections.rolling_shutter_ms, ".1f"),
        "noise": f"× {_number(corrections.pixel_noise_factor, '.2f', lang)}",
    }
    found = {say(lang, f"show.{name}"): value for name, value in pairs.items()}
    print_pairs(say(lang, "show.corrections"), found)
    rows = [
        (camera, *(told(angle, ".2f") for angle in (turn.pitch, turn.yaw, turn.roll)))
        for camera, turn in corrections.boresight_deg.items()
    ]
    print_table(say(lang, "show.boresight"), _columns(lang, "camera", "pitch", "yaw", "roll"), rows)


def _print_neighbours(e: EstimateExplained, lang: Lang) -> None:
    from twin.reports.estimate import NEIGHBOURS_M

    rows = [
        (
            f"{site.nvdb_type}/{site.nvdb_id}",
            " + ".join(code for code in site.codes if code) or None,
            _number(math.hypot(site.east_m - e.east_m, site.north_m - e.north_m), ".2f", lang),
            _number(site.sigma_m, ".2f", lang),
        )
        for site in e.neighbours
    ]
    if rows:
        columns = _columns(lang, "nvdb_object", "sign_codes", "distance", "own_sigma")
        print_table(say(lang, "show.neighbours", within=NEIGHBOURS_M), columns, rows, right_from=2)


def _columns(lang: Lang, *names: str) -> list[str]:
    return [say(lang, f"show.{name}") for name in names]


def _number(value: float, form: str, lang: Lang) -> str | None:
    """A number as the language writes it; none where it is not known."""
    return number_text(lang, format(value, form)) if math.isfinite(value) else None


def _sigma(e: EstimateExplained, lang: Lang) -> str:
    known = _number(e.sigma_height_m, ".2f", lang)
    return "" if known is None else f" ± {known}"
