"""Estimates against surveyed truth: what each method is judged by, and the figures."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import shapely
import sqlalchemy as sa
from command_line import Twin

from geoloc.earth.geodesy import grid_convergence_deg
from twin.errors import ConfigError, TruthError
from twin.ingest.ingest import ingest_drive
from twin.reports.error_picture import plot, quantile_bands
from twin.reports.evaluation import Evaluation, evaluate, read_truth
from twin.samples.simulation import simulate
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Store


@pytest.fixture
def evaluation(opened: Store, sample: Path) -> Evaluation:
    """The sample against its truth."""
    return evaluate(opened, read_truth(sample / "truth.csv"))


def test_evaluate_judges_adjusted_by_its_objects_alone(evaluation: Evaluation) -> None:
    """A sighting of `adjusted` is no position of its own; those of the methods of one frame are."""
    by_method = {result.method: result for result in evaluation.methods}
    assert by_method["adjusted"].sightings_by_range == ()
    assert by_method["adjusted"].objects.n == 15
    assert set(evaluation.sightings) == {"paper", "single-frame"}
    for method in evaluation.sightings:
        n = sum(one.n for one in by_method[method].sightings_by_range)
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


@pytest.mark.slow
def test_figures_are_drawn_as_pdf_and_svg(evaluation: Evaluation, tmp_path: Path) -> None:
    """Vectors for print; another ending is refused before anything is drawn."""
    for ending, begins in ((".pdf", b"%PDF"), (".svg", b"<?xml")):
        for path in plot(evaluation, tmp_path, ending=ending):
            assert path.read_bytes().startswith(begins)
            assert path.suffix == ending
    with pytest.raises(ConfigError, match="neither PNG, SVG nor PDF"):
        plot(evaluation, tmp_path / "none", ending=".jpg")
    assert not (tmp_path / "none").exists()


def test_bands_hold_the_share_that_they_say() -> None:
    """Of errors that grow with distance, 95 and 50 % lie inside the bands at every distance."""
    rng = np.random.default_rng(0)
    x = rng.uniform(5.0, 40.0, 40_000)
    y = x * rng.uniform(0.0, 0.1, x.size)
    at, percentiles = quantile_bands(x, y, 2.5)
    assert (at[0], at[-1]) == (x.min(), x.max())
    assert np.all(np.diff(at) > 0)
    low, quarter, median, three_quarters, high = (np.interp(x, at, row) for row in percentiles)
    inner = (at[1] < x) & (x < at[-2])
    assert np.mean((low < y) & (y < high), where=inner) == pytest.approx(0.95, abs=0.01)
    assert np.mean((quarter < y) & (y < three_quarters), where=inner) == pytest.approx(0.5, abs=0.01)
    assert np.mean(y < median, where=inner) == pytest.approx(0.5, abs=0.01)


def test_bands_join_steps_with_few_values() -> None:
    """Twelve values far apart are one step; nothing finite gives nothing."""
    at, percentiles = quantile_bands(np.arange(12.0) * 10, np.arange(12.0), 2.5)
    assert at.tolist() == [0.0, 55.0, 110.0]
    assert percentiles[2].tolist() == [5.5, 5.5, 5.5]
    assert quantile_bands(np.array([np.nan]), np.array([1.0]), 2.5)[0].size == 0


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


def renamed_truth(sample: Path, path: Path, *, label: str = "skilt", without: str = "") -> Path:
    """The sample's truth under names that no estimate has."""
    lines = (sample / "truth.csv").read_text().splitlines()
    rows = [line.replace("P", "survey-").replace("skilt", label) for line in lines[1:]]
    path.write_text("\n".join([lines[0], *(row for row in rows if not (without and without in row))]))
    return path


def test_evaluate_pairs_by_position_where_no_id_fits(
    opened: Store, evaluation: Evaluation, sample: Path, tmp_path: Path
) -> None:
    """Surveyed under other names, the sample has the same errors: every estimate finds its neighbour."""
    found = evaluate(opened, read_truth(renamed_truth(sample, tmp_path / "truth.csv")))
    assert [result.paired_by for result in evaluation.methods] == ["id"] * 3
    for by_id, by_position in zip(evaluation.methods, found.methods, strict=True):
        assert by_position.paired_by == "position"
        assert by_position.objects == by_id.objects
        assert by_position.sightings_by_range == by_id.sightings_by_range
        assert by_position.not_estimated == ()
        assert by_position.not_in_truth == 0


def test_evaluate_by_position_counts_what_is_left_on_both_sides(
    opened: Store, sample: Path, tmp_path: Path
) -> None:
    """A survey of 14 poles and one far away: one estimate is of none, and one pole has no estimate."""
    path = renamed_truth(sample, tmp_path / "truth.csv", without="survey-06")
    path.write_text(path.read_text() + "\nelsewhere,skilt,273036.5,7039378.8\n")
    (adjusted, *_) = evaluate(opened, read_truth(path), pair_by="position").methods
    assert adjusted.objects.n == 14
    assert adjusted.not_estimated == ("elsewhere",)
    assert adjusted.not_in_truth == 1


def test_evaluate_by_position_is_one_to_one_and_within_its_limit(
    opened: Store, sample: Path, tmp_path: Path
) -> None:
    """Two surveyed poles at one estimate: the nearer gets it; and none beyond the limit."""
    path = tmp_path / "truth.csv"
    path.write_text(
        "object,label,easting,northing\nnear,,273036.505,7039178.817\nbeside,,273037.505,7039178.817\n"
    )
    (adjusted, *_) = evaluate(opened, read_truth(path)).methods
    assert adjusted.objects.n == 1
    assert adjusted.not_estimated == ("beside",)
    path.write_text("object,label,easting,northing\nfar,,273039.505,7039178.817\n")
    assert evaluate(opened, read_truth(path)).methods[0].objects.n == 1
    with pytest.raises(TruthError, match=r"within 2 m of one; the nearest is 3\.\d m away"):
        evaluate(opened, read_truth(path), within_m=2.0)


def test_evaluate_by_position_heeds_the_codes_of_labels(opened: Store, sample: Path, tmp_path: Path) -> None:
    """A surveyed 372 where a 362.50 was seen is another sign."""
    path = renamed_truth(sample, tmp_path / "truth.csv", label="372")
    (adjusted, *_) = evaluate(opened, read_truth(path)).methods
    codes = {row["skiltnummer"] for row in opened.rows(sa.select(schema.estimate))}
    assert adjusted.objects.n == sum("372" in code.split(";") for code in sorted(codes)) == 2


def test_evaluate_by_id_does_not_guess(opened: Store, sample: Path, tmp_path: Path) -> None:
    """Asked for ids, it refuses other names, and says how positions would do."""
    truths = read_truth(renamed_truth(sample, tmp_path / "truth.csv"))
    with pytest.raises(TruthError, match="--pair-by position"):
        evaluate(opened, truths, pair_by="id")


def test_evaluate_says_how_it_paired(twin: Twin, store: Path, sample: Path, tmp_path: Path) -> None:
    """The command tells that positions were taken, and counts what found no partner."""
    path = renamed_truth(sample, tmp_path / "truth.csv", without="survey-06")
    path.write_text(path.read_text() + "\nelsewhere,skilt,273036.5,7039378.8\n")
    answer = twin("evaluate", path, "--store", store, "--within", "3")
    assert answer.code == 0
    assert "by position, within 3 m" in answer.err
    assert "surveyed objects without an estimate: 1 (elsewhere)" in answer.err
    assert "adjusted: estimates of no surveyed object: 1" in answer.err
    norwegian = twin("evaluate", path, "--store", store, "--within", "3", "--lang", "nb")
    assert "etter posisjon, innen 3 m" in norwegian.err
    assert "innmålte objekter uten måling: 1 (elsewhere)" in norwegian.err
    for title in ("Målingenes avvik i grunnriss", "Enkeltobservasjoners avvik", "i 95 %-ellipsen"):
        assert title in norwegian.out
    numbers = re.findall(r"\d+\.\d+", answer.out)
    assert numbers == re.findall(r"\d+\.\d+", norwegian.out.replace(",", "."))
    assert len(numbers) > 20


def test_evaluate_tells_the_error_of_each_object(twin: Twin, tmp_path: Path) -> None:
    """Errors, NEES and heights of a simulated drive, as recomputed from the file's rows and the store's."""
    trial, path, table = tmp_path / "trial", tmp_path / "twin.db", tmp_path / "errors.csv"
    simulate(trial, name="approach")
    with Store.open(path) as store:
        ingest_drive(store, trial)
        rows = {row["object"]: row for row in store.rows(sa.select(schema.estimate))}
    truth = {row["object"]: row for row in csv.DictReader((trial / "truth.csv").read_text().splitlines())}
    (adjusted,) = twin("evaluate", trial / "truth.csv", "--store", path, "--csv", table, "--json").json[
        "methods"
    ]
    written = list(csv.DictReader(table.read_text().splitlines()))
    assert len(written) == len(adjusted["each"]) == len(rows) >= 1
    squares, heights = [], []
    for one, line in zip(adjusted["each"], written, strict=True):
        row, surveyed = rows[one["object"]], truth[one["object"]]
        d = np.array(
            [row["east_m"] - float(surveyed["easting"]), row["north_m"] - float(surveyed["northing"])]
        )
        c = np.array([[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]])
        up = row["height_m"] - float(surveyed["height"])
        squares.append(d @ np.linalg.solve(c, d) / 2)
        heights.append(up)
        assert (one["error_east_m"], one["error_north_m"], one["error_height_m"]) == pytest.approx((*d, up))
        assert one["nees_per_dof"] == pytest.approx(squares[-1])
        assert one["height_nees_per_dof"] == pytest.approx((up / row["sigma_height_m"]) ** 2)
        assert one["inside95"] == (squares[-1] * 2 <= 5.991)
        assert one["sigma_major_m"] == pytest.approx(np.sqrt(np.linalg.eigvalsh(c)[1]), rel=1e-6)
        assert np.hypot(one["error_forward_m"], one["error_left_m"]) == pytest.approx(one["error_m"])
        assert float(line["error_east_m"]) == pytest.approx(d[0], abs=1e-4)
        assert float(line["error_m"]) == pytest.approx(one["error_m"], abs=1e-4)
    assert adjusted["nees_per_dof"] == pytest.approx(np.mean(squares))
    assert adjusted["heights"]["rmse"] == pytest.approx(np.sqrt(np.mean(np.square(heights))))
    assert adjusted["heights"]["n"] == len(rows)


def test_along_and_across_are_those_of_the_car(opened: Store, sample: Path) -> None:
    """A survey that is moved a metre on, in the way of the car, leaves every estimate a metre behind."""
    truths = read_truth(sample / "truth.csv")
    before = evaluate(opened, truths, pair_by="id").methods[0].each
    line = opened.rows(sa.select(schema.drive.c.line))[0]["line"]
    xy = shapely.get_coordinates(shapely.from_wkb(line))
    moved = []
    for truth in truths:
        k = int(np.argmin(np.hypot(*(xy - (truth.east_m, truth.north_m)).T)))
        way = xy[min(k + 2, len(xy) - 1)] - xy[max(k - 2, 0)]
        east, north = way / np.hypot(*way)
        moved.append(replace(truth, east_m=truth.east_m + east, north_m=truth.north_m + north))
    for one, other in zip(before, evaluate(opened, moved, pair_by="id").methods[0].each, strict=True):
        assert other.error_forward_m == pytest.approx(one.error_forward_m - 1.0, abs=0.01)
        assert other.error_left_m == pytest.approx(one.error_left_m, abs=0.12)


def test_a_standing_car_tells_along_and_across_too(tmp_path: Path) -> None:
    """Of a car that stopped before the poles, along is the way that it points."""
    trial, path = tmp_path / "trial", tmp_path / "twin.db"
    simulate(trial, name="still", cameras=("C3_tricam120",))
    truths = read_truth(trial / "truth.csv")
    with Store.open(path) as store:
        ingest_drive(store, trial)
        before = evaluate(store, truths).methods[0].each
        poses = poses_from_blob(store.rows(sa.select(schema.drive.c.poses))[0]["poses"])
        grid = np.radians(
            poses.heading_deg[-1] - grid_convergence_deg(poses.latitude_deg[-1], poses.longitude_deg[-1])
        )
        ahead = [replace(t, east_m=t.east_m + np.sin(grid), north_m=t.north_m + np.cos(grid)) for t in truths]
        after = evaluate(store, ahead).methods[0].each
    for one, other in zip(before, after, strict=True):
        assert other.error_forward_m == pytest.approx(one.error_forward_m - 1.0, abs=0.01)
        assert other.error_left_m == pytest.approx(one.error_left_m, abs=0.03)


def test_evaluate_prints_each_object(twin: Twin, store: Path, sample: Path, tmp_path: Path) -> None:
    """A table a method, the largest error first, in both languages; the figures in the format asked for."""
    options = ("--store", store, "--objects", "--plots", tmp_path / "plots", "--plots-as", "pdf")
    answer = twin("evaluate", sample / "truth.csv", *options)
    assert answer.code == 0
    table = answer.out[answer.out.index("Error of each object by adjusted") :]
    errors = [float(line.split("│")[3]) for line in table.splitlines() if line.startswith("│")][:15]
    assert errors == sorted(errors, reverse=True)
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == [
        "error_distance.pdf",
        "error_speed.pdf",
    ]
    norwegian = twin("evaluate", sample / "truth.csv", "--store", store, "--objects", "--lang", "nb")
    assert "Avvik for hvert objekt med adjusted" in norwegian.out


def test_heights_that_are_not_known_are_not_told(opened: Store, sample: Path, tmp_path: Path) -> None:
    """Without heights in the survey none is judged; a height that is no number is refused with its line."""
    (adjusted, *_) = evaluate(opened, read_truth(sample / "truth.csv")).methods
    assert (adjusted.heights.n, adjusted.heights.rmse, adjusted.heights.nees_per_dof) == (0, None, None)
    path = tmp_path / "truth.csv"
    path.write_text("object,easting,northing,height\nP01,273036.5,7039178.8,\nP02,273074.4,7039197.2,high\n")
    with pytest.raises(TruthError, match="line 3: height must be a number or empty"):
        read_truth(path)


def test_groups_hold_every_error_once_and_say_what_the_store_says(
    opened: Store, sample: Path, evaluation: Evaluation
) -> None:
    """By camera, speed and range together as many errors as there are; the mean of one group by pandas."""
    groups = evaluation.grouped(("camera", "speed", "range"))
    for kind, n in (("objects", 3 * 15), ("sightings", len(evaluation.each_sighting))):
        assert sum(group.n for group in groups if group.kind == kind) == n
    frame = opened.sightings().query("method == 'paper' and rejected.isna()").dropna(subset=["geometry"])
    frame = frame[(frame["camera"] == "C3_tricam120") & frame["range_m"].between(8.0, 12.0, inclusive="left")]
    places = {one.object: (one.east_m, one.north_m) for one in read_truth(sample / "truth.csv")}
    off = [
        np.hypot(point.x - places[name][0], point.y - places[name][1])
        for name, point in zip(frame["object"], frame.geometry, strict=True)
    ]
    (mine,) = [
        group
        for group in evaluation.grouped(("range", "camera"))
        if (group.kind, group.method, group.camera) == ("sightings", "paper", "C3_tricam120")
        and group.range_from_m == 8.0
    ]
    assert (mine.n, mine.mean) == (len(off), pytest.approx(np.mean(off)))
    assert mine.speed_from_kmh is mine.speed_to_kmh is None


def test_grouped_errors_are_printed_and_written(
    twin: Twin, store: Path, sample: Path, tmp_path: Path
) -> None:
    """A table of objects and one of sightings, as JSON and CSV too; what is no group is told how to pair."""
    asked = ("evaluate", sample / "truth.csv", "--store", store, "--by", "speed,camera")
    answer = twin(*asked)
    assert answer.code == 0
    assert "Horizontal error of single sightings, grouped" in answer.out
    groups = twin(*asked, "--json", "--csv", tmp_path / "errors.csv").json["groups"]
    with (tmp_path / "errors_by.csv").open(encoding="utf-8", newline="") as file:
        assert [float(row["mean"]) for row in csv.DictReader(file)] == pytest.approx(
            [group["mean"] for group in groups], abs=1e-4
        )
    assert {group["kind"] for group in groups} == {"objects", "sightings"}
    assert all(group["range_from_m"] is None and group["speed_to_kmh"] for group in groups)
    wrong = twin("evaluate", sample / "truth.csv", "--store", store, "--by", "position")
    assert wrong.code == 2
    assert "--pair-by" in wrong.err
