"""Estimates against surveyed truth: what each method is judged by, and the figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
import sqlalchemy as sa

from twin import schema
from twin.evaluate import Evaluation, evaluate, plot, read_truth
from twin.ingest import ingest_drive
from twin.store import Store

Twin = Callable[..., Any]


@pytest.fixture
def opened(store: Path) -> Iterator[Store]:
    """The matched sample: every object by every method."""
    with Store.open(store) as one:
        yield one


@pytest.fixture
def evaluation(opened: Store, sample: Path) -> Evaluation:
    """The sample against its truth."""
    return evaluate(opened, read_truth(sample / "truth.csv"))


def test_evaluate_judges_adjusted_by_its_objects_alone(evaluation: Evaluation) -> None:
    """A sighting of `adjusted` is no position of its own; those of the methods of one frame are."""
    by_method = {result.method: result for result in evaluation.methods}
    assert by_method["adjusted"].sightings_by_range == []
    assert by_method["adjusted"].objects["n"] == 15
    assert set(evaluation.sightings) == {"paper", "single-frame"}
    for method in evaluation.sightings:
        n = sum(one["n"] for one in by_method[method].sightings_by_range)
        assert n == evaluation.sightings[method]["error_m"].size > 1000


def test_evaluate_gives_objects_the_speed_at_which_they_were_seen(
    opened: Store, evaluation: Evaluation
) -> None:
    """An object's speed is the car's mean over the sightings that took part, whatever the method."""
    first = opened.rows(sa.select(schema.estimate).order_by(schema.estimate.c.estimate_id))[0]
    seen = schema.sighting.c
    rows = opened.rows(
        sa.select(seen.speed_mps).where(
            seen.object == first["object"], seen.method == first["method"], seen.rejected == ""
        )
    )
    speed = evaluation.estimates[first["method"]]["speed_mps"]
    assert speed[0] == pytest.approx(np.mean([row["speed_mps"] for row in rows]))
    # The sample's car goes at 20 to 40 km/h.
    for arrays in evaluation.estimates.values():
        assert np.all((arrays["speed_mps"] > 19.5 / 3.6) & (arrays["speed_mps"] < 40.5 / 3.6))


def test_evaluate_draws_every_method_in_both_figures(evaluation: Evaluation, tmp_path: Path) -> None:
    """Each figure shows marks in the colour of each of the three methods."""
    files = plot(evaluation, tmp_path / "plots")
    assert [path.name for path in files] == ["error_distance.png", "error_speed.png"]
    for path in files:
        picture = matplotlib.image.imread(path)[..., :3]
        for colour in ((0x00, 0x9E, 0x73), (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)):
            near = np.all(np.abs(picture - np.array(colour) / 255) < 0.12, axis=-1)
            assert near.sum() > 100, (path.name, colour)


def test_evaluate_of_adjusted_alone_has_no_table_of_single_sightings(
    twin: Twin, sample: Path, tmp_path: Path
) -> None:
    """Where only `adjusted` was run, nothing is said of single sightings, and the figures still come."""
    path = tmp_path / "twin.db"
    with Store.open(path) as store:
        ingest_drive(store, sample / "trip_trondheim")
    answer = twin("evaluate", sample / "truth.csv", "--store", path, "--plots", tmp_path / "plots")
    assert answer.code == 0
    assert "single sightings" not in answer.out
    assert "adjusted" in answer.out
    assert len(list((tmp_path / "plots").glob("error_*.png"))) == 2
