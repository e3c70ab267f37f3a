"""The smoothed trajectory as files: what was written is what is read."""

from __future__ import annotations

import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from command_line import Twin

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.trajectory.poses import Poses, PoseTrack
from twin.drives.read import read_drive
from twin.drives.track.formats.poses_csv import read_poses
from twin.ingest.locate import trajectory_of
from twin.ingest.trajectory import smoothed_poses


@pytest.fixture(scope="module")
def poses(sample: Path) -> Poses:
    """The sample's trajectory."""
    found, warnings = smoothed_poses(sample / "trip_trondheim")
    assert warnings == ()
    return found


def test_csv_comes_back_as_it_was(twin: Twin, sample: Path, poses: Poses, tmp_path: Path) -> None:
    """Our own reader takes every pose, and finds positions, angles and sigmas as they were."""
    out = tmp_path / "poses.csv"
    assert twin("trajectory", sample / "trip_trondheim", "--out", out, "--json").json["poses"] == 250
    read = read_poses(out.read_bytes(), out.name)
    assert read.skipped == ()
    np.testing.assert_array_equal(read.track.epoch_ns, poses.epoch_ns)
    tolerance = {"latitude_deg": 1e-10, "longitude_deg": 1e-10, "height_m": 1e-4}
    for field in fields(PoseTrack):
        name = field.name
        if name == "sigma_roll_pitch_deg":
            expected = np.maximum(poses.sigma_roll_deg, poses.sigma_pitch_deg)
        else:
            expected = getattr(poses, name)
        np.testing.assert_allclose(
            getattr(read.track, name), expected, rtol=0, atol=tolerance.get(name, 1e-5), err_msg=name
        )


def test_a_drive_of_those_poses_drives_the_same_way(twin: Twin, trip: Path, tmp_path: Path) -> None:
    """In a folder of its own, the file gives the same trajectory, also between its poses."""
    recorded = trajectory_of(read_drive(trip))
    again = shutil.copytree(trip, tmp_path / "again")
    assert twin("trajectory", trip, "--out", tmp_path / "poses.csv").code == 0
    shutil.move(tmp_path / "poses.csv", again / "poses.csv")
    (told,) = [str(one) for one in read_drive(again).warnings if "poses.csv" in str(one)]
    assert '[poses] file = "poses.csv"' in told
    settings = again / "drive.toml"
    settings.write_text(settings.read_text() + '[poses]\nfile = "poses.csv"\n')
    drive = read_drive(again)
    assert not any("is not used" in str(one) for one in drive.warnings)
    read = trajectory_of(drive)
    between = recorded.epoch_ns[:-1] + np.diff(recorded.epoch_ns) // 2
    ours, theirs = recorded.poses_at(between), read.poses_at(between)
    apart = np.array(utm33_from_geographic(ours.latitude_deg, ours.longitude_deg))
    apart -= utm33_from_geographic(theirs.latitude_deg, theirs.longitude_deg)
    assert np.hypot(*apart).max() < 0.005
    assert np.abs(ours.heading_deg - theirs.heading_deg).max() < 0.02


def test_geopackage_has_points_and_the_way_between(
    twin: Twin, sample: Path, poses: Poses, tmp_path: Path
) -> None:
    """A point a pose with its sigmas; lines from pose to pose with the larger sigma of two."""
    out = tmp_path / "poses.gpkg"
    for _ in range(2):  # also over an older file
        assert twin("trajectory", sample / "trip_trondheim", "--out", out).code == 0
    points, path = (pyogrio.read_dataframe(out, layer=name) for name in ("poses", "path"))
    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    at = shapely.get_coordinates(points.geometry.to_numpy(), include_z=True)
    np.testing.assert_allclose(at, np.column_stack([east, north, poses.height_m]), atol=1e-6)
    np.testing.assert_array_equal(points["time_ns"], poses.epoch_ns)
    for name in ("heading_deg", "sigma_horizontal_m", "sigma_vertical_m", "sigma_heading_deg"):
        np.testing.assert_allclose(points[name], getattr(poses, name))
    sigma = poses.sigma_horizontal_m
    np.testing.assert_allclose(path["sigma_horizontal_m"], np.maximum(sigma[:-1], sigma[1:]))
    assert points.crs.to_epsg() == path.crs.to_epsg() == 25833
    assert [file.name for file in tmp_path.iterdir()] == ["poses.gpkg"]


def test_ending_that_names_no_format_is_refused(twin: Twin, trip: Path, tmp_path: Path) -> None:
    """Nothing is written under a name that says text and holds CSV."""
    answer = twin("trajectory", trip, "--out", tmp_path / "x.txt")
    assert answer.code == 2
    assert ".csv nor .gpkg" in " ".join(answer.err.split())
    assert not (tmp_path / "x.txt").exists()


def test_a_recording_is_not_written_over(twin: Twin, trip: Path) -> None:
    """A file in the drive's folder would be read as its recording: refused, and nothing changes."""
    before = {file.name for file in trip.iterdir()}
    answer = twin("trajectory", trip, "--out", trip / "poses.csv")
    assert answer.code == 5
    assert "name another" in answer.err
    assert {file.name for file in trip.iterdir()} == before
