"""One estimate explained: what is told agrees with the store, and the picture shows it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from annotation_edits import as_boxes
from command_line import Twin

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.locate.accuracy import ellipse_coverage
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.errors import ConfigError, StoreError
from twin.ingest.ingest import ingest_drive
from twin.reports.estimate import EstimateExplained, explain_estimate
from twin.reports.estimate_picture import draw_estimate
from twin.samples.write_drive import write_driveworks_trip
from twin.store import schema
from twin.store.store import Store


@pytest.fixture(scope="module")
def moved_note(tmp_path_factory: pytest.TempPathFactory) -> tuple[EstimateExplained, int]:
    """An approach in which one foot was marked 40 px too far to the right; and its frame."""
    folder = tmp_path_factory.mktemp("moved")
    write_driveworks_trip(simulate_drive(scenario("approach", 15.0, 3), 3), folder / "trip")
    notes = folder / "trip" / "C2_tricam60.xml"
    text = notes.read_text(encoding="utf-8")
    point = list(re.finditer(r'<points frame="(\d+)"[^>]*?points="([\d.]+),', text))[8]
    shifted = f"{float(point[2]) + 40:.2f}"
    notes.write_text(text[: point.start(2)] + shifted + text[point.end(2) :], encoding="utf-8")
    with Store.open(folder / "twin.db") as store:
        ingest_drive(store, folder / "trip")
        return explain_estimate(store, "P01"), int(point[1])


def test_show_tells_the_position_that_the_store_keeps(opened: Store) -> None:
    """Easting, northing, longitude and latitude are one place; the object's name gives the best method."""
    told = explain_estimate(opened, "P01")
    (row,) = opened.rows(sa.select(schema.estimate).where(schema.estimate.c.estimate_id == told.estimate_id))
    assert (told.method, told.east_m, told.north_m) == ("adjusted", row["east_m"], row["north_m"])
    latitude, longitude = geographic_from_utm33(row["east_m"], row["north_m"])
    assert (told.latitude_deg, told.longitude_deg) == (float(latitude), float(longitude))
    assert [name.rsplit(":", 1)[1] for name in told.also] == ["single-frame", "paper"]


def test_show_ellipse_is_the_covariances_with_95_percent(opened: Store) -> None:
    """Just inside the end of the long axis is inside the covariance's 95 % ellipse, just outside is not."""
    told = explain_estimate(opened, "P01")
    # The azimuth is from true north, which lies 4.1° east of grid north here.
    grid = math.radians(told.azimuth_deg + 4.07)
    end = told.major95_m * np.array([[math.sin(grid), math.cos(grid)]])
    covariance = told.covariance_m2[None]
    assert ellipse_coverage(0.99 * end, covariance) == 1.0
    assert ellipse_coverage(1.01 * end, covariance) == 0.0


def test_show_budget_adds_up_to_the_ellipse(opened: Store) -> None:
    """Sources' variances along the long axis add up to that axis's variance, their shares to one."""
    told = explain_estimate(opened, "P01")
    assert sum(share.share for share in told.budget) == pytest.approx(1.0)
    along = math.hypot(*(share.along_m for share in told.budget))
    across = math.hypot(*(share.across_m for share in told.budget))
    assert along / across == pytest.approx(told.major95_m / told.minor95_m, rel=1e-3)
    assert {"pixels", "time", "heading", "gnss", "lever arm"} <= {share.source for share in told.budget}
    assert [s.share for s in told.budget] == sorted((s.share for s in told.budget), reverse=True)


def test_show_counts_agree_between_frames_cameras_and_estimate(opened: Store) -> None:
    """What the cameras used is what the estimate rests on; what they rejected has a reason each."""
    for row in opened.rows(sa.select(schema.estimate).where(schema.estimate.c.method == "adjusted")):
        told = explain_estimate(opened, row["estimate_id"])
        assert sum(camera.n_used for camera in told.cameras) == told.n_sightings == row["n_sightings"]
        assert sum(camera.n_rejected for camera in told.cameras) == np.sum(told.frames.rejected != "")
        assert min(camera.range_min_m for camera in told.cameras) == pytest.approx(row["range_min_m"])


def test_show_residual_of_a_foot_marked_too_far_right_points_right(
    moved_note: tuple[EstimateExplained, int],
) -> None:
    """40 px too far right: a residual of +40 px, and at 32 px a degree a line of sight 1.2° to the right."""
    told, frame = moved_note
    frames = told.frames
    (k,) = np.flatnonzero((frames.camera == "C2_tricam60") & (frames.frame == frame))
    assert frames.rejected[k] != ""
    assert frames.residual_px[k, 0] == pytest.approx(40.0, abs=5.0)
    assert frames.turn_deg[k] == pytest.approx(40.0 / 32.5, abs=0.3)
    assert np.all(np.abs(frames.residual_px[frames.used]) < 8.0)


def test_show_camera_places_lie_where_the_car_drove(opened: Store) -> None:
    """Every camera's place is within 3 m of the driven line, at the stated distance from the object."""
    told = explain_estimate(opened, "P03")
    eye = told.frames.eye_m
    to_line = np.min(np.linalg.norm(eye[:, None] - told.line_m[None], axis=2), axis=1)
    assert np.all(to_line < 3.0)
    distance = np.hypot(*(eye - (told.east_m, told.north_m)).T)
    # UTM33 so far from its meridian stretches by 2 parts in ten thousand.
    assert distance == pytest.approx(told.frames.range_m, rel=5e-4)


def test_show_names_the_signs_of_the_mirror_that_are_near(opened: Store) -> None:
    """The sample's P01 has its Skiltpunkt a few centimetres away, nearest first."""
    near = explain_estimate(opened, "P01").neighbours
    assert (near[0].nvdb_id, near[0].codes) == (1042500101, ("362.50",))


def test_show_method_of_one_frame_has_no_budget(opened: Store) -> None:
    """What the method does not keep is empty or NaN, not made up."""
    told = explain_estimate(opened, explain_estimate(opened, "P01").also[-1])
    assert told.method == "paper"
    assert told.budget == ()
    assert told.corrections is None
    assert np.isnan(told.frames.residual_px).all()
    assert np.isnan(told.frames.eye_m).all()
    assert math.isnan(told.sigma_height_m)


def test_show_object_of_two_drives_lists_the_candidates(opened: Store, tmp_path: Path) -> None:
    """An object that two drives have is refused with both ids; each of them, or drive:object, is answered."""
    write_driveworks_trip(simulate_drive(scenario("approach", 15.0, 3), 3), tmp_path / "other")
    ingest_drive(opened, tmp_path / "other", method="paper")
    with pytest.raises(ConfigError, match=r"2 drives have an object 'P01': name one of ") as refusal:
        explain_estimate(opened, "P01")
    candidates = re.findall(r"\w+:P01:[a-z-]+", str(refusal.value))
    assert sorted(name.rsplit(":", 1)[1] for name in candidates) == ["adjusted", "paper"]
    for name in candidates:
        assert explain_estimate(opened, name).estimate_id == name
        assert explain_estimate(opened, name.rsplit(":", 1)[0]).estimate_id == name


def test_show_unknown_object_lists_what_there_is(opened: Store, tmp_path: Path) -> None:
    """A wrong name, an object without a position and an empty store are told apart."""
    with pytest.raises(
        ConfigError, match=r"No estimate, object or finding is called 'P99' in .*: perhaps P0"
    ):
        explain_estimate(opened, "P99")
    with opened.transaction() as connection:
        connection.execute(sa.delete(schema.estimate).where(schema.estimate.c.object == "P01"))
    with pytest.raises(ConfigError, match=r"'P01' .* was annotated but has no position: "):
        explain_estimate(opened, "P01")
    with Store.open(tmp_path / "empty.db") as empty, pytest.raises(StoreError, match="twin ingest-drive"):
        explain_estimate(empty, "P01")


def test_show_prints_every_part(twin: Twin, store: Path) -> None:
    """Position, ellipse, budget, cameras, rejected frames, the drive's corrections and NVDB's signs."""
    answer = twin("show", "P01", "--store", store)
    assert answer.code == 0
    for words in (
        "position, EPSG:25833",
        "position, WGS84",
        "95 % ellipse",
        "share of the variance",
        "lever arm",
        "C3_tricam120",
        "does not fit the other sightings",
        "What the adjustment found in this drive",
        "added to the camera clock [ms]",
        "rolling shutter",
        "Boresight",
        "95/1042500101",
    ):
        assert words in answer.out, words


def test_show_speaks_norwegian_with_the_same_numbers(twin: Twin, store: Path) -> None:
    """Titles and columns of every table are Norwegian, the figures those of the English one, with a comma."""
    english, norwegian = (twin("show", "P01", "--store", store, "--lang", lang).out for lang in ("en", "nb"))
    numbers = re.findall(r"\d+\.\d+", english)
    assert numbers == re.findall(r"\d+\.\d+", norwegian.replace(",", "."))
    assert len(numbers) > 50
    for words in (
        *("Objekt P01", "Feilbudsjett", "Sett av", "Forkastede observasjoner", "Det utjevningen fant"),
        *(
            "Korreksjoner av kameraenes retning",
            "Skilt i NVDB innen 15 m",
            "andel av variansen",
            "95 %-ellipse",
        ),
    ):
        assert words in norwegian, words
    paper = f"{twin('show', 'P01', '--store', store, '--json').json['drive_id']}:P01:paper"
    assert "Ikke noe feilbudsjett etter kilde" in twin("show", paper, "--store", store, "--lang", "nb").err


def test_show_says_that_the_paper_keeps_no_budget(twin: Twin, store: Path) -> None:
    """Where a method does not tell, the command says so instead of printing an empty table."""
    with Store.open(store) as one:
        name = explain_estimate(one, "P01").also[-1]
    answer = twin("show", name, "--store", store)
    assert answer.code == 0
    assert "No error budget by source" in answer.err
    assert "share of the variance" not in answer.out


def test_show_json_is_complete_and_strict(twin: Twin, store: Path) -> None:
    """JSON has every frame, no NaN, and what the tables say."""
    answer = twin("show", "P01", "--store", store, "--json")

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    told = json.loads(answer.out, parse_constant=refuse)
    assert len(told["frames"]) == sum(c["n_used"] + c["n_rejected"] for c in told["cameras"])
    assert told["frames"][0].keys() >= {"camera", "frame", "range_m", "residual_px", "eye_m", "rejected"}
    assert told["picture"] is None


def test_show_unknown_name_is_a_usage_error(twin: Twin, store: Path) -> None:
    """One sentence on stderr, exit code 2, no picture."""
    answer = twin("show", "P99", "--store", store, "--out", store.with_name("p.png"))
    assert answer.code == 2
    assert answer.err.count("\n") == 1
    assert not store.with_name("p.png").exists()


@pytest.mark.parametrize("method", ["adjusted", "paper"])
def test_show_picture_has_the_estimate_and_is_the_same_every_time(
    opened: Store, tmp_path: Path, method: str
) -> None:
    """The same estimate gives the same bytes, in a folder that is made for it."""
    best = explain_estimate(opened, "P02")
    told = explain_estimate(opened, f"{best.drive_id}:P02:{method}")
    first = draw_estimate(told, tmp_path / "new" / "a.png", dpi=60)
    second = draw_estimate(told, tmp_path / "new" / "b.png", dpi=60)
    assert first.read_bytes().startswith(b"\x89PNG")
    assert first.read_bytes() == second.read_bytes()


def test_show_picture_shows_the_rejected_line_of_sight_in_red(
    moved_note: tuple[EstimateExplained, int], tmp_path: Path
) -> None:
    """Red is on the picture only where a sighting was rejected."""
    import matplotlib.image

    told, _ = moved_note
    picture = matplotlib.image.imread(draw_estimate(told, tmp_path / "a.png", dpi=100))[..., :3]
    red = np.all(np.abs(picture - np.array([0xCC, 0x33, 0x11]) / 255) < 0.15, axis=-1)
    assert red.sum() > 50


def test_show_picture_of_another_format_is_refused(opened: Store, tmp_path: Path) -> None:
    """Another format is refused by name before anything is written."""
    with pytest.raises(ConfigError, match="neither PNG, SVG nor PDF"):
        draw_estimate(explain_estimate(opened, "P01"), tmp_path / "a.jpg")
    assert list(tmp_path.glob("a.*")) == []


def test_show_works_on_boxes(empty: Store, trip: Path, tmp_path: Path) -> None:
    """An object of which only the face was marked is explained and drawn too."""
    as_boxes(trip)
    ingest_drive(empty, trip)
    told = explain_estimate(empty, "P02")
    assert set(told.frames.kind) == {"box"}
    assert "its face, not its foot" in told.flags
    assert draw_estimate(told, tmp_path / "box.png", dpi=60).exists()
