"""From a folder with a video and a GPX to positions, with no file written by hand but annotations."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from simulated_receiver import as_single_fixes, metre_fixes
from small_camera import gps9_packet, write_gpx, write_video

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.drives.inspection.inspect import inspect_drive
from twin.drives.starting.found import look
from twin.drives.starting.settings_text import Answers, settings_text, usual_answers
from twin.drives.starting.write import write_settings
from twin.errors import ConfigError, DriveError, RefusedError
from twin.ingest.ingest import ingest_drive
from twin.samples.write_cvat import cvat_document
from twin.store import schema
from twin.store.store import Store

NS = 1_000_000_000
CAMERA = "C3_tricam120"
START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * NS
CHI2_95 = 5.991


def small_folder(folder: Path, created_ns: int | None, name: str = "clip.mp4", **tags: str) -> Path:
    """Ten seconds of a car northwards: a video and a GPX that begins a minute before it and ends after it."""
    drive = simulate_drive(metre_fixes(scenario("approach"), 2.0), seed=3)
    fixes = as_single_fixes(drive.gnss[0], 2.0)
    first = int(fixes.epoch_ns[0])
    folder.mkdir()
    write_gpx(folder / "ride.gpx", replace(fixes, epoch_ns=fixes.epoch_ns - first + START_NS))
    stamps = START_NS + NS + np.arange(90, dtype=np.int64) * NS // 30
    write_video(folder / name, stamps, created_ns, tags=tags)
    return folder


@pytest.mark.parametrize(
    ("created_s", "name", "shift_s", "why"),
    [
        (1, "clip.mp4", 0, "creation_time"),
        (1 + 7200, "clip.mp4", 0, "local time"),
        (1 - 5 * 3600, "clip.mp4", 0, "local time"),
        (1 + 7200, "20260610_100001.mp4", 0, "local time"),
        (None, "20260610_100001.mp4", 0, "in its name"),
    ],
)
def test_a_start_in_another_zone_is_found_by_the_track(
    tmp_path: Path, created_s: int | None, name: str, shift_s: int, why: str
) -> None:
    """Whole hours between tag or name and the track are a zone; the reason stands beside the start."""
    created_ns = None if created_s is None else START_NS + created_s * NS
    found = look(small_folder(tmp_path / "drive", created_ns, name))
    assert found.start is not None
    assert found.start.fits
    assert found.start.epoch_ns == START_NS + (1 + shift_s) * NS
    assert why in found.start.why
    written = tomllib.loads(settings_text(found, usual_answers(found)))
    assert written["frames"][found.camera]["start"] == "2026-06-10T08:00:01.000Z"
    assert written["errors"]["time_ms"] == 1000


def test_what_is_not_known_is_said_or_refused(tmp_path: Path) -> None:
    """A start outside the track, two videos, no track and no start are refused with the cure."""
    folder = small_folder(tmp_path / "drive", START_NS + 1234 * NS)
    found = look(folder)
    assert found.start is not None
    assert not found.start.fits
    with pytest.raises(ConfigError, match=r"outside the track ride\.gpx.*Give --start"):
        settings_text(found, usual_answers(found))
    assert "as you said" in settings_text(found, replace(usual_answers(found), start_ns=START_NS))
    with pytest.raises(ConfigError, match="does not say when it began"):
        settings_text(replace(found, start=None), Answers())
    with pytest.raises(DriveError, match="Export the track as GPX"):
        settings_text(replace(found, track=None), Answers())
    with pytest.raises(ConfigError, match="There is no lens 'gopro hero'"):
        settings_text(found, Answers(lens="gopro hero", start_ns=START_NS))
    (folder / "other.mp4").write_bytes((folder / "clip.mp4").read_bytes())
    with pytest.raises(DriveError, match=r"--video clip\.mp4"):
        look(folder)


def test_inspect_points_to_what_writes_or_mends_the_settings(tmp_path: Path) -> None:
    """A video without drive.toml is for twin init; of one that cannot be read, that is the only refusal."""
    folder = small_folder(tmp_path / "drive", START_NS + NS)
    (refusal,) = [one for one in inspect_drive(folder).refusals if "rig" in one]
    assert f"twin init {folder} writes drive.toml" in refusal
    (folder / "drive.toml").write_text("[cameras.clip]\nfov_dge = 110\n")
    (refusal,) = inspect_drive(folder).refusals
    assert "fov_dge" in refusal


def test_a_settings_file_that_stands_is_kept(tmp_path: Path) -> None:
    """It is refused; asked to replace it, a copy of the old one stays."""
    folder = small_folder(tmp_path / "drive", START_NS + NS)
    (folder / "drive.toml").write_text("# mine\n")
    with pytest.raises(RefusedError, match="is there already, and stays as it is"):
        write_settings(folder, "name = 'a'\n", replace=False)
    copy, target = write_settings(folder, "name = 'a'\n", replace=True)
    assert copy.read_text() == "# mine\n"
    assert target.read_text() == "name = 'a'\n"


def test_the_maker_in_the_tags_names_the_lens(tmp_path: Path) -> None:
    """A telephone that says what it is gets its nominal lens; GoPro's own track gives the start to 0.3 s."""
    phone = look(small_folder(tmp_path / "phone", START_NS + NS, comment="Apple iPhone 13"))
    assert usual_answers(phone).lens == "iphone main"
    gopro = tmp_path / "gopro"
    gopro.mkdir()
    rows = [(START_NS + k * NS // 10, (63.41 + k * 9e-6, 10.45, 60.0)) for k in range(30)]
    stamps = START_NS + np.arange(90, dtype=np.int64) * NS // 30
    data = [(1000 * s, gps9_packet(rows[10 * s : 10 * s + 10])) for s in range(3)]
    write_video(gopro / "GX010001.MP4", stamps, START_NS + 7200 * NS, data=data)
    found = look(gopro)
    assert found.track == "GX010001.MP4"
    assert found.start is not None
    assert found.start.epoch_ns == pytest.approx(START_NS, abs=2_000_000)
    write_settings(gopro, settings_text(found, usual_answers(found)), replace=False)
    assert inspect_drive(gopro).ready


@pytest.mark.parametrize("off", [0.95, 1.05])
def test_a_dashcam_folder_becomes_positions_inside_their_ellipses(tmp_path: Path, off: float) -> None:
    """With a field of view that is 5 % off and a start two hours off, each sign is found all the same."""
    drive = simulate_drive(metre_fixes(scenario("approach"), 2.0), seed=3)
    model, stamps = drive.rig.camera(CAMERA).model, drive.frame_host_ns[CAMERA]
    folder = tmp_path / "drive"
    folder.mkdir()
    write_gpx(folder / "ride.gpx", as_single_fixes(drive.gnss[0], 2.0))
    write_video(folder / "cam.mp4", stamps, int(stamps[0]) + 7200 * NS, (model.width_px, model.height_px))
    found = look(folder)
    fov_deg = off * float(np.degrees(model.horizontal_fov_rad))
    write_settings(folder, settings_text(found, Answers(lens=f"{fov_deg:.1f}", height_m=1.44)), replace=False)
    (folder / "cam.annotate.xml").write_text(cvat_document(drive, CAMERA).replace(CAMERA, "cam"))
    assert inspect_drive(folder).ready
    with Store.open(tmp_path / "twin.db") as store:
        report = ingest_drive(store, folder)
        rows = {row["object"]: row for row in store.rows(sa.select(schema.estimate))}
    assert any("nominal" in warning for warning in report.warnings)
    assert any("The focal length of cam" in warning for warning in report.warnings)
    assert rows
    truth = drive.objects
    east, north = utm33_from_geographic(truth.latitude_deg, truth.longitude_deg)
    for name, e, n in zip(truth.object, east, north, strict=True):
        row = rows[str(name)]
        error = np.array([row["east_m"] - e, row["north_m"] - n])
        covariance = np.array(
            [[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]], dtype=np.float64
        )
        assert error @ np.linalg.solve(covariance, error) < CHI2_95
        assert np.hypot(*error) < 15.0
