"""Surveys that fit by their ids and not by their places or heights are doubted, others are not."""

from __future__ import annotations

import csv
from pathlib import Path

from command_line import Twin

from twin.ingest.ingest import ingest_drive
from twin.samples.simulation import simulate
from twin.store.store import Store


def _shifted(truth: Path, to: Path, **metres: float) -> Path:
    """The survey with some of its columns moved."""
    rows = list(csv.DictReader(truth.read_text().splitlines()))
    with to.open("w", newline="") as file:
        out = csv.DictWriter(file, rows[0].keys())
        out.writeheader()
        for row in rows:
            out.writerow(row | {name: f"{float(row[name]) + by:.4f}" for name, by in metres.items()})
    return to


def test_survey_of_another_drive_is_doubted(twin: Twin, store: Path, sample: Path, tmp_path: Path) -> None:
    """Under the same ids, 58 m away; the sample's own survey, and one whose numbers are told, are not."""
    own = twin("evaluate", sample / "truth.csv", "--store", store, "--json")
    assert own.json["warnings"] == []
    other = _shifted(sample / "truth.csv", tmp_path / "other.csv", easting=40.0, northing=42.0)
    (told,) = twin("evaluate", other, "--store", store, "--json").json["warnings"]
    assert "lie 58.0 m or more from the survey" in told
    answer = twin("evaluate", other, "--store", store, "--lang", "nb")
    assert answer.code == 0
    assert "er dette fasiten for denne turen?" in answer.err


def test_heights_in_another_system_are_doubted(twin: Twin, tmp_path: Path) -> None:
    """40 m alike are the geoid; the drive's own heights, and 5 m, are not."""
    trial, path = tmp_path / "trial", tmp_path / "twin.db"
    simulate(trial, name="approach")
    with Store.open(path) as store:
        ingest_drive(store, trial)
    for metres, doubted in ((0.0, False), (-5.0, False), (-40.0, True), (40.0, True)):
        truth = _shifted(trial / "truth.csv", tmp_path / "truth.csv", height=metres)
        warnings = twin("evaluate", truth, "--store", path, "--json").json["warnings"]
        assert ["NN2000" in one for one in warnings] == [True] * doubted, metres
