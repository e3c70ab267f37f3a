"""The paper's tables and figures: of trips with a survey, and of the simulated experiments."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Twin

from twin.errors import ConfigError, TruthError
from twin.reports.truth import read_truth
from twin.reproduce import Reproduction, reproduce
from twin.samples.simulation import simulate

FILES = [
    *("signs.csv", "by_distance.csv", "trends.csv", "sightings.csv", "objects.csv"),
    *("experiment1_slow_and_fast.png", "experiment1_slow_and_fast.pdf"),
]


@pytest.fixture(scope="module")
def trips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two drives towards one pole, and one that stops before three."""
    folder = tmp_path_factory.mktemp("trips")
    for name, speed in (("slow", 8.0), ("fast", 25.0)):
        simulate(folder / name, name="approach", speed_kmh=speed, seed=31)
    simulate(folder / "standing", name="still", seed=31, cameras=("C2_tricam60",))
    return folder


@pytest.fixture(scope="module")
def standing(trips: Path) -> Reproduction:
    """The trip that stops."""
    return reproduce([trips / "standing"], read_truth(trips / "standing" / "truth.csv"))


def rows(path: Path) -> list[dict[str, str]]:
    """A table that was written."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_trips_past_the_same_pole_are_slow_and_fast(twin: Twin, trips: Path, tmp_path: Path) -> None:
    """Every table and figure is written; a trend line is the least-squares line of the errors written."""
    out, asked = tmp_path / "out", ("reproduce", trips / "slow", trips / "fast", "--truth")
    asked = (*asked, trips / "slow" / "truth.csv", "--out", out, "--json")
    answer = twin(*asked)
    assert answer.code == 0
    assert [Path(path).name for path in answer.json["files"]] == FILES
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    assert (out / FILES[-1]).read_bytes().startswith(b"%PDF")
    for series, kmh in (("slow", 8.0), ("fast", 25.0)):
        seen = [
            (float(row["distance_m"]), float(row["error_m"]))
            for row in rows(out / "sightings.csv")
            if row["method"] == "paper" and abs(3.6 * float(row["speed_mps"]) - kmh) < 3.0
        ]
        slope, at_0_m = np.polyfit(*np.transpose(seen), 1)
        (trend,) = [
            row
            for row in answer.json["trends"]
            if (row["method"], row["kind"], row["series"]) == ("paper", "sightings", series)
        ]
        assert (trend["n"], trend["speed_kmh"]) == (len(seen), pytest.approx(kmh, abs=0.3))
        assert (trend["slope"], trend["at_0_m"]) == pytest.approx((slope, at_0_m), abs=1e-3)
    kept = (out / "trends.csv").read_bytes()
    again = twin(*asked)
    assert (again.code, again.error["kind"]) == (5, "refused")
    assert (out / "trends.csv").read_bytes() == kept


def test_table_1_has_the_distances_at_which_the_car_stands(standing: Reproduction) -> None:
    """9.0, 11.8 and 19.3 m from the rig's origin, the published error of that camera beside each."""
    assert [row.distance_m for row in standing.standing] == pytest.approx([9.0, 11.8, 19.3], abs=0.04)
    assert [row.published_m for row in standing.standing] == [0.82, 1.42, 4.53]
    assert standing.signs == standing.bands == ()
    for row in standing.standing:
        errors = [
            one.error_m
            for one in standing.experiments[0].sightings
            if (one.method, one.truth) == ("paper", row.object)
        ]
        assert row.frames == len(errors) > 30
        assert row.paper_m == pytest.approx(np.mean(errors))
        assert row.adjusted_m is not None


@pytest.mark.slow
def test_a_trip_that_stood_is_an_experiment_of_its_own(trips: Path) -> None:
    """A drive past the objects that another trip stood before does not take table 1 away."""
    both = reproduce([trips / "slow", trips / "standing"], read_truth(trips / "standing" / "truth.csv"))
    assert [one.name for one in both.experiments] == ["slow", "standing"]
    assert len(both.standing) == 3


@pytest.mark.slow
def test_a_trip_without_a_surveyed_object_is_named(trips: Path) -> None:
    """One sentence says which trip the survey does not fit, although it fits another; no trip is refused."""
    (truth,) = read_truth(trips / "slow" / "truth.csv")
    drive = reproduce([trips / "slow"], [truth]).experiments[0].objects[0].drive_id
    with pytest.raises(TruthError, match="Trip standing shows no surveyed object"):
        reproduce([trips / "slow", trips / "standing"], [replace(truth, drive_id=drive)])
    with pytest.raises(ConfigError, match="No trips"):
        reproduce([], [truth])


@pytest.mark.parametrize(
    ("asked", "code", "words"),
    [
        (["slow"], 2, "--truth TRUTH.csv"),
        (["--truth", "slow/truth.csv"], 2, "belong together"),
        (["slow", "--truth", "none.csv"], 4, "none.csv"),
        (["nothing", "--truth", "slow/truth.csv"], 4, "nothing"),
        (["slow", "--truth", "slow/truth.csv", "--paper", "ray"], 2, "KEY=VALUE"),
        (["slow", "--truth", "slow/truth.csv", "--out", "slow"], 5, "not an empty folder"),
    ],
)
def test_wrong_requests_are_one_sentence_and_leave_nothing(
    twin: Twin, trips: Path, monkeypatch: pytest.MonkeyPatch, asked: list[str], code: int, words: str
) -> None:
    """The right exit code, what is wrong, and no folder."""
    monkeypatch.chdir(trips)
    answer = twin("reproduce", *asked)
    assert answer.code == code
    assert words in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not (trips / "reproduced").exists()
