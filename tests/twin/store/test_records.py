"""Records and their rows: nothing is lost on the way to the store and back."""

from __future__ import annotations

from dataclasses import replace

import pytest
from findings import finding

from twin.store import schema
from twin.store.kinds import Method, Verdict
from twin.store.records import Estimate, Finding

ESTIMATE = Estimate(
    drive_id="d",
    object="P1",
    codes=("362.50", "808.1"),
    east_m=1.0,
    north_m=2.0,
    covariance_m2=(0.04, 0.01, 0.02),
    cameras=("C1", "C2"),
    n_sightings=5,
    first_ns=10,
    last_ns=20,
    text=";200 m",
    budget={"gnss": (0.04, 0.0, 0.04)},
    estimate_id="d:P1:adjusted",
    method=Method.SINGLE_FRAME,
    label="skilt",
    height_m=65.0,
    sigma_height_m=0.1,
    n_frames=4,
    n_cameras=2,
    range_min_m=6.5,
    n_rejected=1,
    flags=("one sighting", "1 outlier left out"),
    nvdb_type=25,
)
FINDING = finding(
    verdict=Verdict.WRONG_TYPE,
    nvdb_type=96,
    nvdb_id=7,
    nvdb_version=1,
    skiltnummer_nvdb=("", "808.1"),
    distance_m=0.3,
    distance_sigma_m=0.1,
    drive_ids=("d", "e"),
    terms={"match": 0.9},
    covariance_m2=(0.04, 0.01, 0.02),
    cameras=("C1",),
)
UNSEEN = replace(FINDING, skiltnummer_seen=(), covariance_m2=None, cameras=(), distance_m=None)


def test_estimate_comes_back_from_its_row() -> None:
    """With every column of the table, and no other."""
    row = ESTIMATE.to_row()
    assert set(row) == {column.name for column in schema.estimate.columns}
    assert Estimate.from_row(row) == ESTIMATE


@pytest.mark.parametrize("record", [finding(), FINDING, UNSEEN])
def test_finding_comes_back_from_its_row(record: Finding) -> None:
    """With every column of the table, and no other; what was not seen has no codes, cameras or covariance."""
    row = record.to_row()
    assert set(row) == {column.name for column in schema.change.columns}
    assert Finding.from_row(row) == record
