"""Drive → estimates: what a user's folder can hold beside the sample's perfect case."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa

from geoloc.earth.datum import euref89_from_itrf
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.errors import ConfigError, DriveError
from twin.ingest.ingest import ingest_drive
from twin.samples.write_drive import write_driveworks_trip, write_generic_folder
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Store


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """A new store."""
    with Store.open(tmp_path / "twin.db") as opened:
        yield opened


@pytest.fixture
def trip(sample: Path, tmp_path: Path) -> Path:
    """A copy of the sample's drive."""
    return Path(shutil.copytree(sample / "trip_trondheim", tmp_path / "trip"))


def positions(store: Store) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Object → easting and northing."""
    rows = store.rows(sa.select(schema.estimate))
    return {row["object"]: np.array([row["east_m"], row["north_m"]]) for row in rows}


def test_ingest_brings_itrf2020_to_euref89(store: Store, trip: Path) -> None:
    """The same fixes declared ITRF2020 lie 0.84 m to the south-west in EUREF89, in 2026.

    Not to the last centimetre: the datum's own uncertainty changes how sightings weigh against each other.
    """
    assert not any("EUREF89" in warning for warning in ingest_drive(store, trip).warnings)
    before = positions(store)
    settings = trip / "drive.toml"
    settings.write_text(settings.read_text().replace("EUREF89", "ITRF2020"))
    with Store.open(store.path.with_name("itrf.db")) as other:
        warnings = ingest_drive(other, trip).warnings
        assert any("brought from ITRF2020 to EUREF89" in warning for warning in warnings)
        after = positions(other)
    shift = np.array([after[name] - before[name] for name in before])
    assert np.median(np.hypot(*shift.T)) == pytest.approx(0.84, abs=0.03)
    assert np.all(shift < -0.4)


def test_ingest_adds_the_datums_uncertainty(store: Store, trip: Path) -> None:
    """What the change of datum costs (4.5 cm without grids) is added to every sign of the drive alike."""
    ingest_drive(store, trip)
    before = {r["object"]: r["cov_ee_m2"] + r["cov_nn_m2"] for r in store.rows(sa.select(schema.estimate))}
    settings = trip / "drive.toml"
    settings.write_text(settings.read_text().replace("EUREF89", "ITRF2020"))
    ingest_drive(store, trip)
    after = {r["object"]: r["cov_ee_m2"] + r["cov_nn_m2"] for r in store.rows(sa.select(schema.estimate))}
    added = [after[name] - before[name] for name in before]
    sigma_m = euref89_from_itrf("ITRF2020", 63.41, 10.45, 96.0, 2026.4).extra_sigma_m
    assert min(added) > 0.8 * 2 * sigma_m**2


def test_ingest_gives_the_same_from_both_layouts(store: Store, tmp_path: Path) -> None:
    """One drive as a DriveWorks trip and as a generic folder: the same positions to the last bit."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_driveworks_trip(drive, tmp_path / "trip")
    write_generic_folder(drive, tmp_path / "folder")
    ingest_drive(store, tmp_path / "trip")
    with Store.open(tmp_path / "other.db") as other:
        ingest_drive(other, tmp_path / "folder")
        ours, theirs = positions(store), positions(other)
    assert ours.keys() == theirs.keys()
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_ingest_takes_full_poses_instead_of_gnss(store: Store, tmp_path: Path) -> None:
    """With the simulator's true poses the errors are those of the ground and the pixels alone."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_generic_folder(drive, tmp_path / "folder", true_poses=True)
    report = ingest_drive(store, tmp_path / "folder")
    assert report.delay_ms is None
    truth = {
        str(name): np.array([east, north])
        for name, east, north in zip(
            drive.objects.object, drive.objects.east_utm33_m, drive.objects.north_utm33_m, strict=True
        )
    }
    errors = [np.hypot(*(place - truth[name])) for name, place in positions(store).items()]
    assert len(errors) == report.n_estimates > 0
    assert np.median(errors) < 0.5


def test_ingest_works_standing_still(store: Store, tmp_path: Path) -> None:
    """Two antennas give the heading of a car that never moves; its line is a point."""
    world = scenario("still", None, 5)
    parked = replace(world.motion, speed=((0.0, 0.0),), start_station_m=56.67)
    drive = simulate_drive(replace(world, motion=parked), 5)
    write_driveworks_trip(drive, tmp_path / "trip")
    report = ingest_drive(store, tmp_path / "trip", method="single-frame")
    assert report.n_estimates == report.n_objects > 0
    assert report.length_m < 1.0


def boxed(trip: Path) -> int:
    """Turn the points of one camera into boxes; return how many of them are in a picture."""
    path = trip / "C2_tricam60.xml"
    text = re.sub(
        r'<points (frame="\d+"[^>]*?) points="([\d.]+),([\d.]+)"',
        lambda m: f'<box {m[1]} xtl="{m[2]}" ytl="{m[3]}" xbr="{float(m[2]) + 9}" ybr="{float(m[3]) + 9}"',
        path.read_text(),
    ).replace("</points>", "</box>")
    path.write_text(text)
    return len(re.findall(r'<box [^>]*outside="0"', text))


def test_ingest_by_one_frame_counts_boxes_that_it_cannot_locate(store: Store, trip: Path) -> None:
    """A box shows the face: it is counted with the cure, and the points still give their estimates."""
    n = boxed(trip)
    report = ingest_drive(store, trip, method="single-frame")
    boxes = {key: count for key, count in report.skipped.items() if key.startswith("boxes")}
    assert list(boxes.values()) == [n]
    assert "--method adjusted" in next(iter(boxes))
    assert n > 100
    assert report.n_estimates == 15


def test_ingest_adjusted_takes_boxes_beside_points(store: Store, trip: Path) -> None:
    """Boxes of one camera and points of the other place each object together; no box is left out as such."""
    n = boxed(trip)
    report = ingest_drive(store, trip)
    assert not any(key.startswith("boxes") for key in report.skipped)
    rows = store.rows(sa.select(schema.sighting.c.rejected).where(schema.sighting.c.kind == "box"))
    assert len(rows) == n
    assert sum(row["rejected"] == "" for row in rows) > 0.9 * n
    assert report.n_estimates == 15


def test_ingest_refuses_terrain_settings_that_would_do_nothing(store: Store, trip: Path) -> None:
    """Heights without a terrain, and a terrain for the paper's method, are mistakes and not wishes."""
    with pytest.raises(ConfigError, match="give --terrain too"):
        ingest_drive(store, trip, terrain_heights="NN2000")
    with pytest.raises(ConfigError, match="knows no terrain"):
        ingest_drive(store, trip, method="paper", terrain=trip / "dtm.tif")
    assert store.count(schema.drive) == 0


def test_ingest_uses_a_stated_rolling_shutter_and_pole_radius(store: Store, trip: Path) -> None:
    """What drive.toml states is used: the shutter hardly moves from it, and feet move by the radius."""
    (trip / "drive.toml").write_text("rolling_shutter_ms = 31.0\npole_radius_m = 0.0\n")
    ingest_drive(store, trip)
    (told,) = store.rows(sa.select(schema.drive_method.c.corrections))
    shutter = told["corrections"]["rolling_shutter_ms"]
    assert shutter["value"] == pytest.approx(31.0, abs=2.0)
    assert shutter["sigma"] < 1.5
    (trip / "drive.toml").write_text("rolling_shutter_ms = 310.0\n")
    with pytest.raises(DriveError, match="rolling_shutter_ms"):
        ingest_drive(store, trip)


def test_ingest_without_annotations_keeps_the_drive(store: Store, trip: Path) -> None:
    """A drive that nobody annotated has a line and no sightings, and says so."""
    for path in trip.glob("*.xml"):
        path.unlink()
    report = ingest_drive(store, trip)
    assert (report.n_sightings, report.n_estimates) == (0, 0)
    assert any("no annotations" in warning for warning in report.warnings)
    assert store.count(schema.drive) == 1


def test_ingest_keeps_where_the_car_was(store: Store, trip: Path) -> None:
    """The stored poses are valid, in time order, and not closer than frames 0.2 m apart on average."""
    report = ingest_drive(store, trip)
    (drive,) = store.rows(sa.select(schema.drive))
    poses = poses_from_blob(drive["poses"])
    assert poses.valid.all()
    assert np.all(np.diff(poses.epoch_ns) > 0)
    assert report.length_m / len(poses.epoch_ns) > 0.2


def test_ingest_reports_the_link_delay(store: Store, trip: Path) -> None:
    """The sample's host stamps are 78 ms late, as the real car's."""
    report = ingest_drive(store, trip)
    assert report.delay_ms == pytest.approx(78.0, abs=1.5)


def test_ingest_by_an_unknown_method_is_refused(store: Store, trip: Path) -> None:
    """The message lists the methods."""
    with pytest.raises(DriveError, match="single-frame, paper"):
        ingest_drive(store, trip, method="magic")


def test_ingest_counts_sightings_outside_the_track_together(store: Store, trip: Path) -> None:
    """Frames before the first fix and inside a gap are two reasons with a count each, not one a frame."""
    for path in trip.glob("gnss*"):
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(lines[40:100] + lines[130:]))
    report = ingest_drive(store, trip)
    reasons = [key for key in report.skipped if "fix" in key]
    assert len(reasons) == 2
    assert any("before the first fix" in key for key in reasons)
    assert any("inside a gap" in key for key in reasons)


def test_ingest_of_a_corrected_drive_replaces_it(store: Store, trip: Path) -> None:
    """Annotations that were corrected and ingested again leave one drive, with the new sign codes."""
    first = ingest_drive(store, trip)
    for path in trip.glob("*.xml"):
        path.write_text(path.read_text().replace("362.50", "362.70"))
    second = ingest_drive(store, trip)
    assert second.drive_id == first.drive_id
    assert store.count(schema.drive) == 1
    codes = {row["skiltnummer"] for row in store.rows(sa.select(schema.estimate.c.skiltnummer))}
    assert any("362.70" in code for code in codes)
    assert not any("362.50" in code for code in codes)


def test_ingest_counts_frames_of_each_camera(store: Store, trip: Path) -> None:
    """Two cameras' frames are counted apart, and only those whose sighting took part."""
    ingest_drive(store, trip)
    for row in store.rows(sa.select(schema.estimate)):
        assert row["n_frames"] <= row["n_sightings"]
        assert row["n_cameras"] == len(row["cameras"]) == 2


def test_ingest_says_how_good_the_fixes_are(store: Store, trip: Path) -> None:
    """The sample is RTK fixed throughout."""
    assert ingest_drive(store, trip).fix_quality == {"RTK fixed": 500}


def test_ingest_refuses_a_drive_outside_norway(store: Store, tmp_path: Path) -> None:
    """Latitude and longitude swapped in poses.csv are named as that."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_generic_folder(drive, tmp_path / "folder", true_poses=True)
    path = tmp_path / "folder" / "poses.csv"
    path.write_text(
        path.read_text()
        .replace("latitude_deg", "x")
        .replace("longitude_deg", "latitude_deg")
        .replace("x,", "longitude_deg,", 1)
    )
    with pytest.raises(DriveError, match="latitude and longitude are swapped"):
        ingest_drive(store, tmp_path / "folder")
    assert store.count(schema.drive) == 0


@pytest.mark.parametrize(("change", "refused"), [(np.radians, True), (lambda heading: heading + 25.0, False)])
def test_ingest_compares_headings_with_the_track(
    store: Store, tmp_path: Path, change: Any, refused: bool
) -> None:
    """Headings in radians are refused, headings 25 degrees off are warned of."""
    drive = simulate_drive(scenario("urban", 25.0, 3), 3)
    write_generic_folder(drive, tmp_path / "folder", true_poses=True)
    path = tmp_path / "folder" / "poses.csv"
    header, *rows = path.read_text().splitlines()
    column = header.split(",").index("heading_deg")
    changed = [row.split(",") for row in rows]
    for fields in changed:
        fields[column] = f"{change(float(fields[column])):.6f}"
    path.write_text("\n".join([header, *(",".join(fields) for fields in changed)]) + "\n")
    if refused:
        with pytest.raises(DriveError, match="direction of travel"):
            ingest_drive(store, tmp_path / "folder")
    else:
        report = ingest_drive(store, tmp_path / "folder")
        assert any("25°" in warning for warning in report.warnings)


def test_ingest_warns_of_missing_sign_codes(store: Store, trip: Path) -> None:
    """A misspelt attribute costs every sign its code: said at once, not discovered in the map."""
    for path in trip.glob("*.xml"):
        path.write_text(path.read_text().replace('name="skiltnummer"', 'name="skiltnr"'))
    report = ingest_drive(store, trip)
    assert any("15 of 15 annotated objects have no sign code" in warning for warning in report.warnings)
