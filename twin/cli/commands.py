"""The bodies of the commands: call one function of the library, print what it returned."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.cli.findings import person
from twin.cli.output import (
    note,
    print_json,
    print_pairs,
    print_paths,
    print_table,
    steps,
    warn,
)

if TYPE_CHECKING:
    from twin.changesets import ChangeSets
    from twin.ingest.ingest import IngestReport
    from twin.reports.evaluate import MethodResult
    from twin.store.store import Store


@contextmanager
def made_store(path: Path) -> Iterator[Store]:
    """Open a store, making it; one that was only made for a command that failed is taken away again."""
    from twin.store.store import Store

    existed = path.exists()
    try:
        with Store.open(path) as opened:
            yield opened
    except BaseException:
        if not existed:
            for name in (path.name, f"{path.name}-wal", f"{path.name}-shm"):
                path.with_name(name).unlink(missing_ok=True)
        raise


def ingest_drive(
    drive: Path,
    method: str,
    terrain: Path | None,
    terrain_heights: str | None,
    store: Path,
    json_output: bool,
    *,
    labels: Path | None = None,
    detector: tuple[Path, int, float] | None = None,
) -> None:
    """``twin ingest-drive``; `detector` is model, frames in between, and lowest score."""
    from twin.drives.detection.run import DetectorOptions
    from twin.ingest.ingest import ingest_drive as run

    with made_store(store) as opened, steps(quiet=json_output) as progress:
        report = run(
            opened,
            drive,
            method=method,
            terrain=terrain,
            terrain_heights=terrain_heights,
            labels=labels,
            detector=None if detector is None else DetectorOptions(*detector),
            progress=progress,
        )
    for warning in report.warnings:
        warn(warning)
    if json_output:
        print_json(report)
        return
    print_pairs(f"Drive {report.name}", _ingest_pairs(report))
    if report.skipped:
        print_table("Left out", ["what", "count"], list(report.skipped.items()))


def _ingest_pairs(report: IngestReport) -> dict[str, object]:
    delay = None if report.delay_ms is None else f"{report.delay_ms:.1f} ms"
    return {
        "drive id": report.drive_id,
        "method": report.method,
        "length": f"{report.length_m:.0f} m",
        "GNSS host stamps late by (median)": delay,
        "GNSS fixes": ", ".join(f"{n:,} {quality}" for quality, n in report.fix_quality.items()) or None,
        "annotations": report.n_annotations,
        "sightings located": f"{report.n_located:,} of {report.n_sightings:,}",
        "objects located": f"{report.n_estimates:,} of {report.n_objects:,}",
    }


def export(
    folder: Path,
    by: str | None,
    store: Path,
    json_output: bool,
    *,
    decision: str = "accept",
    project: bool = False,
) -> None:
    """``twin export``."""
    from twin.cli.submit import change_sets_as_json, end_if_unsendable, print_change_sets
    from twin.export import export_findings
    from twin.store.store import Store

    made: list[ChangeSets] = []
    who = person() if by is None else by
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        files = export_findings(
            opened,
            folder,
            by=who,
            decision=decision,
            project=project,
            change_sets=made.append,
            progress=progress,
        )
    if json_output:
        print_json({"files": [str(path) for path in files], **change_sets_as_json(made[0])})
    else:
        _print_export(files, folder)
        print_change_sets(made[0], folder)
    end_if_unsendable(made[0])


def _print_export(files: Sequence[Path], folder: Path) -> None:
    from geoloc.earth.heights import nn2000_from_ellipsoidal

    print_paths("Written:", files)
    note(f"How to open them in QGIS, and decide there: twin qgis {folder}")
    geoid = nn2000_from_ellipsoidal([], [], [])
    if math.isnan(geoid.sigma_m):
        note(geoid.how)


def evaluate(
    truth: Path, by: str, within_m: float, plots: Path | None, store: Path, json_output: bool
) -> None:
    """``twin evaluate``."""
    from twin.reports.evaluate import evaluate as run
    from twin.reports.evaluate import plot, read_truth
    from twin.store.store import Store

    truths = read_truth(truth)
    with Store.open(store, create=False) as opened:
        evaluation = run(opened, truths, by=by, within_m=within_m)
    files = plot(evaluation, plots) if plots is not None else []
    if json_output:
        print_json({"methods": evaluation.as_json(), "plots": [str(path) for path in files]})
        return
    if evaluation.methods[0].paired_by == "position":
        note(f"Estimates are paired with the surveyed objects by position, within {within_m:g} m.")
    print_errors(evaluation.methods)
    for path in files:
        note(f"wrote {path}")


def print_errors(methods: tuple[MethodResult, ...]) -> None:
    """Print the error tables: objects, then single sightings by range."""
    names = ("mean", "median", "p95", "max", "rmse")
    rows = [
        (m.method, int(m.objects["n"]), *(m.objects[name] for name in names), f"{m.coverage95:.0%}")
        for m in methods
    ]
    header = ["method", "n", *(f"{name} [m]" for name in names), "in 95 % ellipse"]
    print_table("Horizontal error of the estimates", header, rows)
    header = ["method", "range [m]", "n", *(f"{name} [m]" for name in names), "in 95 % ellipse"]
    for title, kind in (
        ("The same by range to the object (nearest sighting)", "objects_by_range"),
        ("Horizontal error of single sightings, by range to the object", "sightings_by_range"),
    ):
        by_range = [
            (m.method, _bin(b), b["n"], *(b[name] for name in names), f"{b['coverage95']:.0%}")
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


def _bin(entry: dict[str, Any]) -> str:
    return (
        f"{entry['from_m']:.0f}–{entry['to_m']:.0f}"
        if entry["to_m"] is not None
        else f"≥ {entry['from_m']:.0f}"
    )


def status(store: Path, json_output: bool) -> None:
    """``twin status``."""
    from twin.reports.status import status as run
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        found = run(opened)
    if json_output:
        print_json(found)
        return
    print_pairs(
        f"Store {found['store']}",
        {
            **_mirror_pairs(found),
            "drives": len(found["drives"]),
            "estimates": ", ".join(f"{n} {m}" for m, n in found["estimates"].items()) or None,
            "last match": (found["last_match"] or {}).get("at"),
            "findings": ", ".join(f"{n} {v}" for v, n in found["verdicts"].items()) or None,
        },
    )


def _mirror_pairs(found: Mapping[str, Any]) -> dict[str, object]:
    mirror, unfinished, vegnett = found["mirror"] or {}, found["unfinished"], found["vegnett"]
    pairs: dict[str, object] = {
        "NVDB area": mirror.get("area"),
        "Skiltpunkt": found["skiltpunkt"],
        "Skiltplate": found["skiltplate"],
        "last synced": f"{mirror['synced_at']}, {_ago(mirror['age_hours'])}" if mirror else None,
        "follows": mirror.get("source"),
        "position in its change feed": mirror.get("position"),
    }
    if unfinished:
        kept = " and ".join(f"{n:,} {name}" for name, n in unfinished["kept"].items())
        pairs["unfinished backfill"] = f"{unfinished['area']}: {kept} so far"
    if vegnett:
        pairs["road network"] = f"{vegnett['count']:,} links of {vegnett['area']}, {vegnett['fetched_at']}"
    return pairs


def _ago(hours: float) -> str:
    if hours < 1:
        return f"{hours * 60:.0f} min ago"
    return f"{hours:.1f} h ago" if hours < 48 else f"{hours / 24:.0f} days ago"


def simulate(
    out: Path,
    scenario: str,
    speed_kmh: float | None,
    seed: int,
    antennas: int,
    cameras: str | None,
    json_output: bool,
) -> None:
    """``twin simulate``."""
    from twin.samples.simulate import simulate as run

    names = tuple(name.strip() for name in (cameras or "").split(",") if name.strip())
    with steps(quiet=json_output) as progress:
        report = run(
            out,
            name=scenario,
            speed_kmh=speed_kmh,
            seed=seed,
            antennas=antennas,
            cameras=names,
            progress=progress,
        )
    if json_output:
        print_json(report)
        return
    print_pairs(
        f"Simulated drive {report.folder}",
        {
            "scenario": f"{report.scenario}, seed {report.seed}",
            "speed": None if report.scenario == "still" else f"{report.speed_kmh:g} km/h",
            "recorded": f"{report.duration_s:.1f} s, {report.n_frames:,} frames of each camera",
            "antennas": len(report.antennas),
            "annotated": ", ".join(report.cameras),
            "poles": report.n_objects,
            "sightings": report.n_sightings,
        },
    )
    print_paths("Written:", report.files)
    note(f"Next: twin ingest-drive {out}, then twin evaluate {report.files[-2]}")


def demo(out: Path, json_output: bool) -> None:
    """``twin demo``."""
    from twin.samples.demo import run_demo, summary

    with steps(quiet=json_output) as progress:
        report = run_demo(out, progress=progress)
    numbers = summary(report)
    if json_output:
        print_json(numbers)
        return
    expected = report.expected
    print_pairs(
        "The sample, end to end",
        {
            "signs synced": f"{numbers['signs_synced']['skiltpunkt']} Skiltpunkt, "
            f"{numbers['signs_synced']['skiltplate']} Skiltplate",
            "drives": numbers["drives"],
            "sightings": numbers["sightings"],
            "estimates": numbers["estimates"],
        },
    )
    print_table(
        "Verdicts",
        ["verdict", "found", "made to be"],
        [(v, n, expected.get(v, 0)) for v, n in report.match.verdicts.items()],
    )
    print_errors(report.evaluation.methods)
    print_paths("Open these:", report.files)
    note(f"In QGIS: twin qgis {out} --open")
    note(f"Why a sign stands where it does: twin show P01 --store {out / 'demo.db'} --out P01.png")
