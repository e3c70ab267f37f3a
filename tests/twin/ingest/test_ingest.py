"""Drive → estimates: what a user's folder can hold beside the sample's perfect case."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from annotation_edits import as_boxes
from posed_trip import write_posed_trip

from geoloc.earth.datum import euref89_from_itrf
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.errors import ConfigError, DriveError
from twin.ingest import ingest_drive, locate_drive, save_drive
from twin.samples.write_drive import write_driveworks_trip
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.store import Store


def positions(store: Store) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Object → easting and northing."""
    rows = store.rows(sa.select(schema.estimate))
    return {row["object"]: np.array([row["east_m"], row["north_m"]]) for row in rows}


def variances_m2(store: Store) -> dict[str, float]:
    """Object → sum of its variances east and north."""
    return {r["object"]: r["cov_ee_m2"] + r["cov_nn_m2"] for r in store.rows(sa.select(schema.estimate))}


def test_ingest_brings_itrf2020_to_euref89_and_adds_its_uncertainty(empty: Store, trip: Path) -> None:
    """The same fixes declared ITRF2020 lie 0.84 m to the south-west in EUREF89, in 2026.

    Not to the last centimetre: the datum's own uncertainty (4.5 cm without grids) is added to every sign of
    the drive alike, and changes how sightings weigh against each other.
    """
    assert not any("EUREF89" in warning for warning in ingest_drive(empty, trip).warnings)
    before, as_euref = positions(empty), variances_m2(empty)
    settings = trip / "drive.toml"
    settings.write_text(settings.read_text().replace("EUREF89", "ITRF2020"))
    with Store.open(empty.path.with_name("itrf.db")) as other:
        warnings = ingest_drive(other, trip).warnings
        assert any("brought from ITRF2020 to EUREF89" in warning for warning in warnings)
        after, as_itrf = positions(other), variances_m2(other)
    shift = np.array([after[name] - before[name] for name in before])
    assert np.median(np.hypot(*shift.T)) == pytest.approx(0.84, abs=0.03)
    assert np.all(shift < -0.4)
    sigma_m = euref89_from_itrf("ITRF2020", 63.41, 10.45, 96.0, 2026.4).extra_sigma_m
    assert min(as_itrf[name] - as_euref[name] for name in as_euref) > 0.8 * 2 * sigma_m**2


def test_clock_a_second_off_casts_no_doubt_on_ids(empty: Store, trip: Path) -> None:
    """Ids are held against the clock that the adjustment found, not against the one that was stated."""
    settings = trip / "drive.toml"
    settings.write_text("camera_offset_ms = 1000\n" + settings.read_text())
    warnings = ingest_drive(empty, trip).warnings
    assert any("The camera clock does not fit the track" in warning for warning in warnings)
    assert not any("marks two signs" in warning for warning in warnings)


def test_ingest_takes_full_poses_instead_of_gnss(empty: Store, tmp_path: Path) -> None:
    """With the simulator's true poses the errors are those of the ground and the pixels alone."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_posed_trip(drive, tmp_path / "folder")
    report = ingest_drive(empty, tmp_path / "folder")
    assert report.delay_ms is None
    truth = {
        str(name): np.array([east, north])
        for name, east, north in zip(
            drive.objects.object, drive.objects.east_utm33_m, drive.objects.north_utm33_m, strict=True
        )
    }
    errors = [np.hypot(*(place - truth[name])) for name, place in positions(empty).items()]
    assert len(errors) == report.n_estimates > 0
    assert np.median(errors) < 0.5


def test_ingest_works_standing_still(empty: Store, tmp_path: Path) -> None:
    """Two antennas give the heading of a car that never moves; its line is a point."""
    world = scenario("still", None, 5)
    parked = replace(world.motion, speed=((0.0, 0.0),), start_station_m=56.67)
    drive = simulate_drive(replace(world, motion=parked), 5)
    write_driveworks_trip(drive, tmp_path / "trip")
    report = ingest_drive(empty, tmp_path / "trip", method="single-frame")
    assert report.n_estimates == report.n_objects > 0
    assert report.length_m < 1.0


@pytest.fixture
def n_boxes(trip: Path) -> int:
    """The trip with one camera's points drawn as boxes: how many of them are in a picture."""
    as_boxes(trip, "C2_tricam60.xml")
    return (trip / "C2_tricam60.xml").read_text().count('outside="0"')


def test_ingest_by_one_frame_counts_boxes_that_it_cannot_locate(
    empty: Store, trip: Path, n_boxes: int
) -> None:
    """A box shows the face: it is counted with the cure, and the points still give their estimates."""
    report = ingest_drive(empty, trip, method="single-frame")
    boxes = {key: count for key, count in report.skipped.items() if key.startswith("boxes")}
    assert list(boxes.values()) == [n_boxes]
    assert "--method adjusted" in next(iter(boxes))
    assert n_boxes > 100
    assert report.n_estimates == 15


def test_ingest_adjusted_takes_boxes_beside_points(empty: Store, trip: Path, n_boxes: int) -> None:
    """Boxes of one camera and points of the other place each object together; no box is left out as such."""
    report = ingest_drive(empty, trip)
    assert not any(key.startswith("boxes") for key in report.skipped)
    rows = empty.rows(sa.select(schema.sighting.c.rejected).where(schema.sighting.c.kind == "box"))
    assert len(rows) == n_boxes
    assert sum(row["rejected"] == "" for row in rows) > 0.9 * n_boxes
    assert report.n_estimates == 15


def test_ingest_refuses_terrain_settings_that_would_do_nothing(empty: Store, trip: Path) -> None:
    """Heights without a terrain, and a terrain for the paper's method, are mistakes and not wishes."""
    with pytest.raises(ConfigError, match="give --terrain too"):
        ingest_drive(empty, trip, terrain_heights="NN2000")
    with pytest.raises(ConfigError, match="knows no terrain"):
        ingest_drive(empty, trip, method="paper", terrain=trip / "dtm.tif")
    assert empty.count(schema.drive) == 0


def test_ingest_uses_a_stated_rolling_shutter_and_pole_radius(empty: Store, trip: Path) -> None:
    """What drive.toml states is used: the shutter hardly moves from it, and feet move by the radius."""
    (trip / "drive.toml").write_text("rolling_shutter_ms = 31.0\npole_radius_m = 0.0\n")
    ingest_drive(empty, trip)
    (told,) = empty.rows(sa.select(schema.drive_method.c.corrections))
    shutter = told["corrections"]["rolling_shutter_ms"]
    assert shutter["value"] == pytest.approx(31.0, abs=2.0)
    assert shutter["sigma"] < 1.5
    (trip / "drive.toml").write_text("rolling_shutter_ms = 310.0\n")
    with pytest.raises(DriveError, match="rolling_shutter_ms"):
        ingest_drive(empty, trip)


def test_ingest_tells_of_a_sound_drive(empty: Store, sample: Path) -> None:
    """What the store and the report say of the sample."""
    report = ingest_drive(empty, sample / "trip_trondheim")
    (drive,) = empty.rows(sa.select(schema.drive))
    poses = poses_from_blob(drive["poses"])
    # The stored poses are valid, in time order, and not closer than frames 0.2 m apart on average.
    assert poses.valid.all()
    assert np.all(np.diff(poses.epoch_ns) > 0)
    assert report.length_m / len(poses.epoch_ns) > 0.2
    # The host stamps are 78 ms late, as the real car's.
    assert report.delay_ms == pytest.approx(78.0, abs=1.5)
    # It is RTK fixed throughout.
    assert report.fix_quality == {"RTK fixed": 500}
    # Two cameras' frames are counted apart, and only those whose sighting took part.
    for row in empty.rows(sa.select(schema.estimate)):
        assert row["n_frames"] <= row["n_sightings"]
        assert row["n_cameras"] == len(row["cameras"]) == 2


def test_ingest_without_annotations_keeps_the_drive(empty: Store, trip: Path) -> None:
    """A drive that nobody annotated has a line and no sightings, and says so."""
    for path in trip.glob("*.xml"):
        path.unlink()
    report = ingest_drive(empty, trip)
    assert (report.n_sightings, report.n_estimates) == (0, 0)
    assert any("no annotations" in warning for warning in report.warnings)
    assert empty.count(schema.drive) == 1


def test_ingest_by_an_unknown_method_is_refused(empty: Store, trip: Path) -> None:
    """The message lists the methods."""
    with pytest.raises(DriveError, match="single-frame, paper"):
        ingest_drive(empty, trip, method="magic")


def test_ingest_counts_sightings_outside_the_track_together(empty: Store, trip: Path) -> None:
    """Frames before the first fix and inside a gap are two reasons with a count each, not one a frame."""
    for path in trip.glob("gnss*"):
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(lines[40:100] + lines[130:]))
    report = ingest_drive(empty, trip)
    reasons = [key for key in report.skipped if "fix" in key]
    assert len(reasons) == 2
    assert any("before the first fix" in key for key in reasons)
    assert any("inside a gap" in key for key in reasons)


def test_ingest_of_a_corrected_drive_replaces_it(empty: Store, trip: Path) -> None:
    """Annotations that were corrected and ingested again leave one drive, with the new sign codes."""
    first = ingest_drive(empty, trip)
    for path in trip.glob("*.xml"):
        path.write_text(path.read_text().replace("362.50", "362.70"))
    second = ingest_drive(empty, trip)
    assert second.drive_id == first.drive_id
    assert empty.count(schema.drive) == 1
    codes = {row["skiltnummer"] for row in empty.rows(sa.select(schema.estimate.c.skiltnummer))}
    assert any("362.70" in code for code in codes)
    assert not any("362.50" in code for code in codes)


def test_ingest_refuses_a_drive_outside_norway(empty: Store, tmp_path: Path) -> None:
    """Latitude and longitude swapped in poses.csv are named as that."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_posed_trip(drive, tmp_path / "folder")
    path = tmp_path / "folder" / "poses.csv"
    path.write_text(
        path.read_text()
        .replace("latitude_deg", "x")
        .replace("longitude_deg", "latitude_deg")
        .replace("x,", "longitude_deg,", 1)
    )
    with pytest.raises(DriveError, match="latitude and longitude are swapped"):
        ingest_drive(empty, tmp_path / "folder")
    assert empty.count(schema.drive) == 0


@pytest.mark.parametrize(("change", "refused"), [(np.radians, True), (lambda heading: heading + 25.0, False)])
def test_ingest_compares_headings_with_the_track(
    empty: Store, tmp_path: Path, change: Any, refused: bool
) -> None:
    """Headings in radians are refused, headings 25 degrees off are warned of."""
    drive = simulate_drive(scenario("approach", 15.0, 3), 3)
    write_posed_trip(drive, tmp_path / "folder")
    path = tmp_path / "folder" / "poses.csv"
    header, *rows = path.read_text().splitlines()
    column = header.split(",").index("heading_deg")
    changed = [row.split(",") for row in rows]
    for fields in changed:
        fields[column] = f"{change(float(fields[column])):.6f}"
    path.write_text("\n".join([header, *(",".join(fields) for fields in changed)]) + "\n")
    if refused:
        with pytest.raises(DriveError, match="direction of travel"):
            ingest_drive(empty, tmp_path / "folder")
    else:
        report = ingest_drive(empty, tmp_path / "folder")
        assert any("25°" in warning for warning in report.warnings)


def test_ingest_warns_of_missing_sign_codes(empty: Store, trip: Path) -> None:
    """A misspelt attribute costs every sign its code: said at once, not discovered in the map."""
    for path in trip.glob("*.xml"):
        path.write_text(path.read_text().replace('name="skiltnummer"', 'name="skiltnr"'))
    report = ingest_drive(empty, trip)
    assert any("15 of 15 annotated objects have no sign code" in warning for warning in report.warnings)


def test_ingest_is_locate_and_save_in_a_row_on_any_machine(empty: Store, trip: Path) -> None:
    """What `locate_drive` gives goes through a pickle into a store, once, as `ingest_drive` keeps it."""
    located = pickle.loads(pickle.dumps(locate_drive(trip)))
    save_drive(empty, located)
    tables = (schema.drive, schema.drive_method, schema.sighting, schema.estimate)
    kept = {table.name: empty.rows(sa.select(table)) for table in tables}
    revision = empty.revision()
    with Store.open(empty.path.with_name("other.db")) as other:
        ingest_drive(other, trip)
        assert {table.name: other.rows(sa.select(table)) for table in tables} == kept
    save_drive(empty, located)
    assert empty.revision() == revision


def test_saving_is_whole_or_not_at_all(empty: Store, trip: Path) -> None:
    """Where what is to be kept along with a drive fails, nothing of the drive is there."""
    located = locate_drive(trip, method="single-frame")

    def fail(_connection: sa.Connection) -> None:
        raise RuntimeError

    with pytest.raises(RuntimeError):
        save_drive(empty, located, also=fail)
    assert [empty.count(t) for t in (schema.drive, schema.sighting, schema.annotation_set)] == [0, 0, 0]
    assert empty.revision() == 0
