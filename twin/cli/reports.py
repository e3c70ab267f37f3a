"""``twin evaluate``, ``show``, ``status`` and ``confidence``: what the store holds, and how good it is."""

from __future__ import annotations

import datetime as dt
import math
import sys
from collections.abc import Mapping
from enum import StrEnum
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, JsonOption, LangOption, StoreOption
from twin.cli.output import note, print_json, print_pairs, print_table, warn
from twin.words import Lang, say, verdict_title

if TYPE_CHECKING:
    from twin.decisions.opinions import Agreement
    from twin.reports.confidences import ConfidenceReport
    from twin.reports.estimate import EstimateExplained
    from twin.reports.evaluation import MethodResult, RangeErrors
    from twin.reports.store_status import Status
    from twin.store.records import Correction, Corrections

app = typer.Typer()
_MAX_REJECTED = 12
"""Rejected frames that the table names; --json has them all."""


class PairBy(StrEnum):
    """How estimates find their truth, as in :data:`twin.reports.evaluation.BY`."""

    AUTO = "auto"
    ID = "id"
    POSITION = "position"


@app.command("evaluate", epilog="Example: twin evaluate data/truth.csv --plots plots")
def evaluate(
    truth: Annotated[
        Path,
        typer.Argument(
            help="CSV with object,label,easting,northing (EPSG:25833) and, if known, height (ellipsoidal).",
            metavar="TRUTH.csv",
        ),
    ],
    by: Annotated[
        PairBy,
        typer.Option(help="How estimates find their truth: auto takes the ids, or positions if no id fits."),
    ] = PairBy.AUTO,
    within: Annotated[
        float, typer.Option(min=0, help="By position: nothing farther apart is paired.", metavar="METRES")
    ] = 5.0,
    plots: Annotated[
        Path | None, typer.Option(help="Folder for the figures error–distance and error–speed.")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", help="Also write the error of each object.", metavar="FILE.csv")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates of every method with surveyed positions, and heights where TRUTH has some."""
    from twin.reports.evaluation import evaluate as run
    from twin.reports.evaluation import plot, read_truth
    from twin.reports.object_errors import csv_of
    from twin.store.atomic_files import replace_file
    from twin.store.store import Store

    truths = read_truth(truth)
    with Store.open(store, create=False) as opened:
        evaluation = run(opened, truths, by=by.value, within_m=within)
    files = plot(evaluation, plots) if plots is not None else []
    if csv is not None:
        each = [error for method in evaluation.methods for error in method.each]
        replace_file(csv, csv_of(each).encode())
    if json_output:
        written = {"plots": [str(path) for path in files], "csv": None if csv is None else str(csv)}
        print_json({"methods": evaluation.as_json(), **written})
        return
    if evaluation.methods[0].paired_by == "position":
        note(f"Estimates are paired with the surveyed objects by position, within {within:g} m.")
    print_errors(evaluation.methods)
    for path in (*files, *([] if csv is None else [csv])):
        note(f"wrote {path}")


def print_errors(methods: tuple[MethodResult, ...]) -> None:
    """Print the error tables: objects, then single sightings by range."""
    names = ("mean", "median", "p95", "max", "rmse")
    numbers = attrgetter(*names)
    rows = [(m.method, m.objects.n, *numbers(m.objects), f"{m.coverage95:.0%}", m.nees) for m in methods]
    header = ["method", "n", *(f"{name} [m]" for name in names), "in 95 % ellipse", "NEES/2"]
    print_table("Horizontal error of the estimates", header, rows)
    heights = [(m.method, m.heights.n, m.heights.mean, m.heights.rmse, m.heights.nees) for m in methods]
    if any(m.heights.n for m in methods):
        print_table("Error of their heights", ["method", "n", "mean [m]", "rmse [m]", "NEES"], heights)
    header = ["method", "range [m]", "n", *(f"{name} [m]" for name in names), "in 95 % ellipse"]
    for title, kind in (
        ("The same by range to the object (nearest sighting)", "objects_by_range"),
        ("Horizontal error of single sightings, by range to the object", "sightings_by_range"),
    ):
        by_range = [
            (m.method, _bin(b), b.n, *numbers(b), f"{b.coverage95:.0%}")
            for m in methods
            for b in getattr(m, kind)
        ]
        if by_range:
            print_table(title, header, by_range)
    for m in methods:
        if m.not_estimated:
            missed = f"surveyed objects without an estimate: {len(m.not_estimated)}"
            warn(f"{m.method}: {missed} ({', '.join(m.not_estimated)}).")
        if m.not_in_truth:
            warn(f"{m.method}: estimates of no surveyed object: {m.not_in_truth}.")


def _bin(errors: RangeErrors) -> str:
    return f"≥ {errors.from_m:.0f}" if errors.to_m is None else f"{errors.from_m:.0f}–{errors.to_m:.0f}"


@app.command("show", epilog="Example: twin show P01 --out P01.png")
def show(
    estimate: Annotated[
        str,
        typer.Argument(
            help="An estimate's id, or an object's where only one drive has it.", metavar="ESTIMATE"
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Also draw it: a PNG.", metavar="FILE.png")] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one estimate: its position, what its error comes from, the frames that it rests on."""
    from twin.reports.estimate import explain_estimate
    from twin.reports.estimate_picture import draw_estimate
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        explained = explain_estimate(opened, estimate)
    if out is not None:
        draw_estimate(explained, out)
    if json_output:
        print_json({**explained.as_json(), "picture": None if out is None else str(out)})
        return
    _print_position(explained)
    _print_budget(explained)
    _print_cameras(explained)
    _print_rejected(explained)
    if explained.corrections is not None:
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
    keeps_residuals = any(math.isfinite(c.rms_px) for c in e.cameras)
    rows = [
        (
            c.camera,
            c.n_used,
            c.n_rejected,
            f"{c.range_min_m:.1f}–{c.range_max_m:.1f}" if math.isfinite(c.range_min_m) else None,
            *([f"{c.rms_px:.2f}" if math.isfinite(c.rms_px) else None] if keeps_residuals else []),
        )
        for c in e.cameras
    ]
    header = ["camera", "used" if keeps_residuals else "located", "rejected", "distance [m]"]
    print_table("Seen by", [*header, *(["RMS residual [px]"] if keeps_residuals else [])], rows)
    if not keeps_residuals and e.n_rejected:
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


def _print_corrections(corrections: Corrections) -> None:
    def told(correction: Correction, form: str) -> str:
        sigma = correction.sigma
        return f"{correction.value:+{form}}" + ("" if sigma is None else f" ± {sigma:{form}}")

    print_pairs(
        "What the adjustment found in this drive",
        {
            "added to the camera clock [ms]": told(corrections.camera_offset_ms, ".1f"),
            "rolling shutter, first to last row [ms]": told(corrections.rolling_shutter_ms, ".1f"),
            "noise of a pixel against the stated one": f"× {corrections.pixel_noise_factor:.2f}",
        },
    )
    rows = [
        (camera, *(told(angle, ".2f") for angle in (turn.pitch, turn.yaw, turn.roll)))
        for camera, turn in corrections.boresight_deg.items()
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


@app.command("status", epilog="Example: twin status")
def status(
    lang: LangOption = Lang.EN, store: StoreOption = DEFAULT_STORE, json_output: JsonOption = False
) -> None:
    """Say what the store holds: the mirror and its age, drives, estimates, findings."""
    from twin.reports.store_status import status as status_of
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        held = status_of(opened)
    if json_output:
        print_json(held.as_json())
        return
    pairs = {
        **_mirror_pairs(held, lang),
        "drives": len(held.drives),
        "estimates": ", ".join(f"{n} {m}" for m, n in held.estimates.items()) or None,
        "last_match": held.last_match.at if held.last_match else None,
        "findings": ", ".join(f"{n} {verdict_title(v, lang)}" for v, n in held.verdicts.items()) or None,
        "agreement": _agreement(held.opinions, lang),
    }
    title = say(lang, "status.title", store=str(held.store))
    print_pairs(title, {say(lang, f"status.{name}"): value for name, value in pairs.items()})


def _agreement(opinions: Mapping[str, Agreement], lang: Lang) -> str | None:
    """``new: 40 of 42`` for each verdict that people have reviewed blindly."""
    told = (
        say(lang, "status.agreed", verdict=verdict_title(verdict, lang), agreed=one.n_agreed, of=one.n)
        for verdict, one in opinions.items()
    )
    return ", ".join(told) or None


def _mirror_pairs(held: Status, lang: Lang) -> dict[str, object]:
    mirror = held.mirror
    pairs: dict[str, object] = {
        "area": mirror.area if mirror else None,
        "skiltpunkt": held.skiltpunkt,
        "skiltplate": held.skiltplate,
        "synced": f"{mirror.synced_at}, {_ago(mirror.age_hours, lang)}" if mirror else None,
        "source": mirror.source if mirror else None,
        "position": mirror.position if mirror else None,
    }
    if held.unfinished:
        kept = [f"{n:,} {name}" for name, n in held.unfinished.kept.items()]
        both = say(lang, "status.both", first=kept[0], second=kept[-1])
        pairs["unfinished"] = say(lang, "status.so_far", area=held.unfinished.area, kept=both)
    if network := held.vegnett:
        pairs["network"] = say(
            lang, "status.links", links=network.count, area=network.area, at=network.fetched_at
        )
    return pairs


def _ago(hours: float, lang: Lang) -> str:
    if hours < 1:
        return say(lang, "status.minutes_ago", minutes=hours * 60)
    if hours < 48:
        return say(lang, "status.hours_ago", hours=hours)
    return say(lang, "status.days_ago", days=hours / 24)


@app.command("confidence", epilog="Example: twin confidence --out confidence.svg")
def confidence(
    out: Annotated[
        Path | None, typer.Option(help="Also draw the reliability diagram: PNG or SVG.", metavar="FILE")
    ] = None,
    lang: LangOption = Lang.EN,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Hold the confidences against people's decisions, and say what the priors would be; changes nothing."""
    from twin.reports.confidence_picture import draw_confidences
    from twin.reports.confidences import confidences_against_decisions
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        report = confidences_against_decisions(opened)
    if out is not None:
        draw_confidences(report, out, lang)
    if json_output:
        print_json({**report.as_json(), "picture": None if out is None else str(out)})
        return
    _print_confidences(report, lang)
    if out is not None:
        note(f"wrote {out}")


def _print_confidences(report: ConfidenceReport, lang: Lang) -> None:
    from twin.reports.confidences import ENOUGH, priors_toml

    rows = [
        (
            verdict_title(one.verdict, lang) if one.verdict else say(lang, "confidence.all"),
            one.n,
            one.n_right,
            say(lang, "term.chance", share=one.mean_confidence) if one.n else None,
            None
            if one.brier is None or one.low is None or one.high is None
            else say(lang, "confidence.interval", value=one.brier, low=one.low, high=one.high),
            say(lang, "confidence.score", value=one.brier_if_true) if one.n else None,
        )
        for one in report.scores
    ]
    names = ("verdict", "decided", "right", "mean", "brier", "if_true")
    columns = [say(lang, f"confidence.{name}") for name in names]
    print_table(say(lang, "confidence.title"), columns, rows)
    if few := [one for one in report.scores if one.n < ENOUGH]:
        which = [verdict_title(one.verdict, lang) for one in few if one.verdict]
        told = ", ".join(which) or say(lang, "confidence.all")
        note(say(lang, "confidence.too_few", which=told, enough=ENOUGH))
    for name, n in (
        ("deferred", report.n_deferred),
        ("temporary", report.n_temporary),
        ("unknown", report.n_unknown),
    ):
        if n:
            note(say(lang, f"confidence.{name}", n=n))
    for prior in report.priors:
        if prior.fitted is None:
            note(say(lang, "confidence.not_fitted", name=prior.name, decided=prior.n, enough=ENOUGH))
    if toml := priors_toml(report.priors):
        note(say(lang, "confidence.priors"))
        sys.stdout.write(toml)
