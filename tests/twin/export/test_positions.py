"""What a researcher takes from a drive without NVDB: positions with sigmas, in every form."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from command_line import Twin

from twin.store import schema
from twin.store.store import Store


def test_positions_of_a_drive_alone_are_exported_with_sigmas(
    twin: Twin, sample: Path, tmp_path: Path
) -> None:
    """CSV and GeoJSON hold each estimate of the store once, and evaluate reads the CSV as a survey."""
    path, out = tmp_path / "twin.db", tmp_path / "out"
    assert twin("ingest-drive", sample / "trip_trondheim", "--store", path, "--json").code == 0
    answer = twin("export", out, "--store", path)
    assert answer.code == 0
    assert "by the method adjusted" in answer.err
    with Store.open(path) as opened:
        estimates = {row["estimate_id"]: row for row in opened.rows(sa.select(schema.estimate))}
    with (out / "positions.csv").open(encoding="utf-8") as file:
        rows = {row["estimate_id"]: row for row in csv.DictReader(file)}
    features = {one["id"]: one for one in json.loads((out / "positions.geojson").read_text())["features"]}
    assert rows.keys() == features.keys() == estimates.keys()
    for key, estimate in estimates.items():
        row = rows[key]
        assert float(row["easting"]) == pytest.approx(estimate["east_m"], abs=1e-4)
        assert float(row["northing"]) == pytest.approx(estimate["north_m"], abs=1e-4)
        sigmas = float(row["sigma_major_m"]), float(row["sigma_minor_m"])
        assert float(row["sigma_height_m"]) == pytest.approx(estimate["sigma_height_m"], abs=1e-4)
        east, north = (float(row[f"sigma_{axis}_m"]) for axis in ("east", "north"))
        assert (east**2, north**2) == pytest.approx((estimate["cov_ee_m2"], estimate["cov_nn_m2"]), abs=1e-4)
        both = float(row["correlation"]) * np.sqrt(estimate["cov_ee_m2"] * estimate["cov_nn_m2"])
        assert both == pytest.approx(estimate["cov_en_m2"], abs=1e-6)
        trace = estimate["cov_ee_m2"] + estimate["cov_nn_m2"]
        assert sigmas[0] ** 2 + sigmas[1] ** 2 == pytest.approx(trace, abs=1e-4)
        place = float(row["longitude"]), float(row["latitude"])
        assert features[key]["geometry"]["coordinates"] == pytest.approx(place, abs=1e-7)
    (method,) = twin("evaluate", out / "positions.csv", "--store", path, "--json").json["methods"]
    assert method["objects"]["n"] == len(estimates)
    assert method["objects"]["max"] < 1e-3
