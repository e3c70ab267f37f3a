"""The whole job on the shipped sample, as a newcomer's first run."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.errors import TwinError
from twin.evidence import EvidenceReport, make_evidence
from twin.export import export_findings, render_map
from twin.export.from_store import layers_from_store
from twin.ingest import IngestReport, ingest_drive
from twin.matching import MatchReport, match
from twin.mirror.sync import SyncResult, sync_nvdb
from twin.mirror.vegnett import sync_vegnett
from twin.reports.error_picture import plot
from twin.reports.evaluation import Evaluation, evaluate, read_truth
from twin.samples.pictures import PicturesReport, with_pictures
from twin.store.folders import make_folder
from twin.store.schema import METHODS
from twin.store.store import Store


@dataclass(frozen=True, slots=True)
class DemoReport:
    """What the demo did, for the closing table."""

    sync: SyncResult
    drives: tuple[IngestReport, ...]
    pictures: tuple[PicturesReport, ...]
    match: MatchReport
    evidence: EvidenceReport
    evaluation: Evaluation
    expected: dict[str, int]
    """Verdict → how many the sample was made to hold."""
    files: tuple[Path, ...]


def sample_folder() -> Path:
    """Return the folder of the shipped sample: package data of a wheel, or ``data/`` of a source tree.

    Raises
    ------
    TwinError
        The installation lacks the sample.
    """
    package = Path(__file__).parents[1]
    for folder in (package / "sample_data", package.parent / "data"):
        if (folder / "truth.csv").is_file():
            return folder
    raise TwinError("This installation lacks the sample data: install the wheel, or work in the source tree.")


def run_demo(out: Path | str, *, progress: Callable[[str], None] | None = None) -> DemoReport:
    """Sync, paint, ingest, match, export and evaluate the sample; a server on loopback plays NVDB.

    Parameters
    ----------
    out : Path or str
        Folder for the store ``demo.db``, the drives with their pictures, and the exported layers. That of an
        earlier demo is used again: running twice changes nothing.
    """
    from nvdb.area import Area
    from nvdb.client import NvdbClient
    from nvdb.replay import ReplayServer

    say = progress or (lambda _text: None)
    out, sample = make_folder(out), sample_folder()
    # A name of its own: the demo's invented signs must never get into a store that somebody works with.
    with Store.open(out / "demo.db") as store:
        with ReplayServer(sample / "nvdb") as server, NvdbClient(server.url) as client:
            say("syncing NVDB's signs and roads from the replay server")
            area = Area(kommuner=(5001,))
            synced = sync_nvdb(store, area, api_url=server.url)
            sync_vegnett(store, area, client=client)
        drives, pictures = [], []
        for trip in sorted(path for path in sample.iterdir() if path.name.startswith("trip_")):
            pictures.append(with_pictures(trip, out / trip.name, progress=progress))
            # The baseline too, so that the closing table can compare.
            for method in reversed(METHODS):
                say(f"ingesting {trip.name} by {method}")
                drives.append(ingest_drive(store, out / trip.name, method=method, progress=progress))
        say("matching")
        found = match(store, progress=progress)
        say("cutting out the pictures of the findings")
        evidence = make_evidence(store, progress=progress)
        say("exporting")
        files = export_findings(store, out, project=True, progress=progress).files
        render_map(layers_from_store(store, found.method), out / "changes.png")
        evaluation = evaluate(store, read_truth(sample / "truth.csv"))
        figures = plot(evaluation, out)
    return DemoReport(
        sync=synced,
        drives=tuple(drives),
        pictures=tuple(pictures),
        match=found,
        evidence=evidence,
        evaluation=evaluation,
        expected=_expected(sample / "expected_changes.csv"),
        files=(*files, out / "changes.png", *figures),
    )


def _expected(path: Path) -> dict[str, int]:
    counts: dict[str, int] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
    return counts


def summary(report: DemoReport) -> dict[str, Any]:
    """Return the closing table's numbers, as ``--json`` prints them."""
    best = [drive for drive in report.drives if drive.method == METHODS[0]]
    errors = {result.method: result.objects.median for result in report.evaluation.methods}
    return {
        "signs_synced": {"skiltpunkt": report.sync.skiltpunkt, "skiltplate": report.sync.skiltplate},
        "drives": len({drive.drive_id for drive in report.drives}),
        "pictures": sum(drive.n_pictures for drive in report.pictures),
        "crops": report.evidence.n_crops,
        "sightings": sum(drive.n_sightings for drive in best),
        "estimates": sum(drive.n_estimates for drive in best),
        "verdicts": {k: v for k, v in report.match.verdicts.items() if v},
        "verdicts_expected": report.expected,
        "median_error_m": errors,
        "coverage95": {result.method: result.coverage95 for result in report.evaluation.methods},
        "files": [str(path) for path in report.files],
    }
