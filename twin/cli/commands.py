"""The bodies of the commands: call one function of the library, print what it returned."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.cli.output import (
    bar,
    log_notes,
    note,
    print_json,
    print_pairs,
    print_paths,
    print_table,
    steps,
    warn,
)

if TYPE_CHECKING:
    from twin.evaluate import MethodResult
    from twin.ingest import IngestReport


def sync_nvdb(
    kommune: str | None,
    bbox: str | None,
    everything: bool,
    api_url: str,
    contact: str | None,
    replace: bool,
    store: Path,
    json_output: bool,
) -> None:
    """``twin sync-nvdb``."""
    from twin.store import Store
    from twin.sync import area_from_options
    from twin.sync import sync_nvdb as run

    area = area_from_options(kommune, bbox, everything)
    quiet = json_output
    with Store.open(store) as opened, log_notes("nvdb", quiet=quiet), bar(quiet=quiet) as progress:
        result = run(opened, area, api_url=api_url, contact=contact, replace=replace, progress=progress)
    if json_output:
        print_json(result)
        return
    print_pairs(
        f"NVDB: {result.area}",
        {
            "Skiltpunkt": result.skiltpunkt,
            "Skiltplate": result.skiltplate,
            "without own geometry": result.without_own_geometry,
            "problems": result.n_problems,
            "source": result.source,
        },
    )
    for problem in result.problems[:10]:
        warn(problem)
    if result.n_problems > 10:
        note(f"… and {result.n_problems - 10} more; --json lists the first 100 of each type.")


def ingest_drive(drive: Path, method: str, store: Path, json_output: bool) -> None:
    """``twin ingest-drive``."""
    from twin.ingest import ingest_drive as run
    from twin.store import Store

    with Store.open(store) as opened, steps(quiet=json_output) as progress:
        report = run(opened, drive, method=method, progress=progress)
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
        "annotations": report.n_annotations,
        "sightings located": f"{report.n_located:,} of {report.n_sightings:,}",
        "objects located": f"{report.n_estimates:,} of {report.n_objects:,}",
    }


def match(method: str | None, tolerance: float, store: Path, json_output: bool) -> None:
    """``twin match``."""
    from twin.match import match as run
    from twin.matching.config import MatchConfig
    from twin.store import Store

    config = MatchConfig(tolerance_m=tolerance)
    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        report = run(opened, method=method, config=config, progress=progress)
    if json_output:
        print_json(report)
        return
    rows = [(verdict, count) for verdict, count in report.verdicts.items()]
    print_table(
        f"{report.n_poles} observed poles ({report.method}) against {report.n_sites} sites of NVDB, "
        f"{report.n_in_view} of them in view of a completely annotated drive",
        ["verdict", "findings"],
        rows,
    )


def export(folder: Path, store: Path, json_output: bool) -> None:
    """``twin export``."""
    from twin.errors import StoreError
    from twin.export import export_all
    from twin.export.from_store import layers_from_store
    from twin.store import Store

    with Store.open(store, create=False) as opened, steps(quiet=json_output) as progress:
        last = opened.fact("last_match")
        if last is None:
            raise StoreError(f"The store {store} has no findings yet: run `twin match` first.")
        files = export_all(layers_from_store(opened, last["method"]), folder, progress=progress)
    if json_output:
        print_json({"files": [str(path) for path in files]})
        return
    print_paths("Written:", files)
    note("Open twin_utm33.gpkg in QGIS: the layer changes comes coloured by verdict.")


def evaluate(truth: Path, plots: Path | None, store: Path, json_output: bool) -> None:
    """``twin evaluate``."""
    from twin.evaluate import evaluate as run
    from twin.evaluate import plot, read_truth
    from twin.store import Store

    truths = read_truth(truth)
    with Store.open(store, create=False) as opened:
        evaluation = run(opened, truths)
    files = plot(evaluation, plots) if plots is not None else []
    if json_output:
        print_json({"methods": evaluation.as_json(), "plots": [str(path) for path in files]})
        return
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
    by_range = [
        (m.method, _bin(b), int(b["n"]), *(b[name] for name in names)) for m in methods for b in m.by_range
    ]
    header = ["method", "range [m]", "n", *(f"{name} [m]" for name in names)]
    print_table("Horizontal error of single sightings, by range to the object", header, by_range)
    for m in methods:
        if m.not_estimated:
            warn(f"{m.method}: no estimate of {', '.join(m.not_estimated)}.")


def _bin(entry: dict[str, Any]) -> str:
    return (
        f"{entry['from_m']:.0f}–{entry['to_m']:.0f}"
        if entry["to_m"] is not None
        else f"≥ {entry['from_m']:.0f}"
    )


def status(store: Path, json_output: bool) -> None:
    """``twin status``."""
    from twin.status import status as run
    from twin.store import Store

    with Store.open(store, create=False) as opened:
        found = run(opened)
    if json_output:
        print_json(found)
        return
    mirror = found["mirror"] or {}
    print_pairs(
        f"Store {found['store']}",
        {
            "NVDB area": mirror.get("area"),
            "synced": mirror.get("synced_at"),
            "Skiltpunkt": found["skiltpunkt"],
            "Skiltplate": found["skiltplate"],
            "drives": len(found["drives"]),
            "estimates": ", ".join(f"{n} {m}" for m, n in found["estimates"].items()) or None,
            "last match": (found["last_match"] or {}).get("at"),
            "findings": ", ".join(f"{n} {v}" for v, n in found["verdicts"].items()) or None,
        },
    )


def demo(out: Path, json_output: bool) -> None:
    """``twin demo``."""
    from twin.demo import run_demo, summary

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
