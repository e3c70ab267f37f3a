"""``twin calibrate verify`` and ``from-drives``: cameras checked against places, and followed over drives."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Twin
from pyproj import Transformer

from geoloc.calibration.verify_mounting import turned
from geoloc.rig.rig import read_rig
from twin.calibrate.drives.history import DriveTurn
from twin.calibrate.drives.plots import tick_labels
from twin.calibrate.mounting_files import drive_tables
from twin.drives.folder.drive_toml import CameraSettings
from twin.ingest import locate_drive, save_drive
from twin.samples.simulation import simulate
from twin.store.records import Boresight, Correction, Corrections
from twin.store.store import Store


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated car that stops before three surveyed poles."""
    folder = tmp_path_factory.mktemp("still") / "still"
    simulate(folder, name="still", seed=3)
    return folder


@pytest.fixture(scope="module")
def urban(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive past thirteen signs."""
    folder = tmp_path_factory.mktemp("urban") / "urban"
    simulate(folder, name="urban", seed=4)
    return folder


def test_applied_rig_beats_the_paper_at_each_distance(still: Path, tmp_path: Path, twin: Twin) -> None:
    """With the corrected rig single frames are nearer than the paper's table 1 at all three distances."""
    rig = tmp_path / "mended.json"
    found = twin("calibrate", "verify", still, "--known", still / "truth.csv", "--apply", rig, "--json")
    assert found.code == 0, found.err
    copy = tmp_path / "mended"
    shutil.copytree(still, copy)
    shutil.copy(rig, copy / "rig.json")
    again = twin("calibrate", "verify", copy, "--known", copy / "truth.csv", "--json").json
    paper_m = {"C1_front60Single": (0.77, 1.53, 5.05), "C2_tricam60": (0.82, 1.42, 4.53)}
    paper_m["C3_tricam120"] = (0.34, 0.22, 1.01)
    for camera, bars in paper_m.items():
        errors = sorted((e for e in again["errors"] if e["camera"] == camera), key=lambda e: e["distance_m"])
        assert len(errors) == 3
        assert all(e["before_m"] < bar for e, bar in zip(errors, bars, strict=True))
    assert again["advised"] == []


def known(drive: Path, path: Path, moved: Callable[[str, float, float], tuple[float, float]]) -> Path:
    """Copy a drive's truth with its positions moved."""
    lines = [line.split(",") for line in (drive / "truth.csv").read_text().splitlines()]
    place = {name: lines[0].index(name) for name in ("object", "easting", "northing")}
    rows = ["object,easting,northing"]
    for line in lines[1:]:
        name, east, north = (line[place[n]] for n in ("object", "easting", "northing"))
        east_m, north_m = moved(name, float(east), float(north))
        rows.append(f"{name},{east_m:.3f},{north_m:.3f}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_survey_in_the_next_zone_is_refused(still: Path, tmp_path: Path, twin: Twin) -> None:
    """Positions in EPSG:25832 end with how far they are and the system that they fit."""
    zone_32 = Transformer.from_crs("EPSG:25833", "EPSG:25832", always_xy=True)
    survey = known(still, tmp_path / "32.csv", lambda _, east, north: zone_32.transform(east, north))
    answer = twin("calibrate", "verify", still, "--known", survey, "--apply", tmp_path / "rig.json")
    assert answer.code == 4
    assert (
        "its numbers fit as EPSG:25832 (UTM zone 32), not as EPSG:25833: say so by --epsg 25832" in answer.err
    )
    assert not (tmp_path / "rig.json").exists()


@pytest.mark.slow
def test_shifted_survey_writes_no_rig(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """All objects 3 m off ask for turns that no mounting has: told, and refused to be written."""
    survey = known(urban, tmp_path / "shifted.csv", lambda _, east, north: (east + 3.0, north - 3.0))
    command = ("calibrate", "verify", urban, "--known", survey)
    told = twin(*command, "--json").json
    assert "that is no mounting" in told["doubt"]
    assert told["advised"] == []
    refused = twin(*command, "--apply", tmp_path / "rig.json")
    assert refused.code != 0
    assert "is not written" in refused.err
    assert not (tmp_path / "rig.json").exists()


def test_object_a_metre_off_is_named_and_left_out(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """One of thirteen objects, surveyed 1.5 m beside its place, is named and does not count."""
    right = twin("calibrate", "verify", urban, "--known", urban / "truth.csv", "--json").json
    assert right["misplaced"] == {}

    def moved(name: str, east: float, north: float) -> tuple[float, float]:
        return (east + 1.5, north) if name == "P05" else (east, north)

    survey = known(urban, tmp_path / "one.csv", moved)
    found = twin("calibrate", "verify", urban, "--known", survey, "--json").json
    assert list(found["misplaced"]) == ["P05"]
    assert found["misplaced"]["P05"] == pytest.approx(1.5, abs=0.7)
    assert found["turns"]["C3_tricam120"]["n_objects"] == right["turns"]["C3_tricam120"]["n_objects"] - 1


@pytest.mark.parametrize(("n_fixes", "gone"), [(185, "P13"), (135, "P11, P12, P13")])
def test_frames_after_the_last_fix_are_left_out_and_named(
    urban: Path, tmp_path: Path, twin: Twin, n_fixes: int, gone: str
) -> None:
    """Where the fixes end early every number is finite, and objects seen only later are named as such."""
    drive = Path(shutil.copytree(urban, tmp_path / "drive"))
    for file in drive.glob("gnss*.bin"):
        file.write_text("".join(file.read_text().splitlines(keepends=True)[:n_fixes]))
    answer = twin("calibrate", "verify", drive, "--known", drive / "truth.csv", "--json")
    assert answer.code == 0, answer.err
    assert "NaN" not in answer.out
    assert all(turn["sigma_pitch_deg"] > 0.0 for turn in answer.json["turns"].values())
    (told,) = (w for w in answer.json["warnings"] if "have no pose and are left out: after the last fix" in w)
    assert gone in told


def test_roll_that_the_drive_does_not_know_is_not_written(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """Signs along a road that falls make all cameras roll: the rig that is written has little of it."""
    found = twin(
        *("calibrate", "verify", urban, "--known", urban / "truth.csv"),
        *("--apply", tmp_path / "rig.json", "--json"),
    ).json
    assert max(turn["roll_deg"] for turn in found["turns"].values()) > 0.7
    assert all(turn["sigma_roll_deg"] > 1.0 for turn in found["turns"].values())
    assert all(abs(turn["roll_deg"]) < 0.5 for turn in found["mounting"].values())
    assert any("of roll together" in warning for warning in found["warnings"])
    level = twin("calibrate", "verify", urban, "--known", urban / "truth.csv", "--level", 0.1, "--json").json
    assert all(turn["sigma_roll_deg"] < 0.6 for turn in level["turns"].values())


def test_errors_that_the_drive_states_count(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """A clock that is known to half a second may have pitched all cameras: told, and not applied."""
    drive = Path(shutil.copytree(urban, tmp_path / "drive"))
    command = ("calibrate", "verify", drive, "--known", drive / "truth.csv", "--level", 0.1, "--json")
    usual = twin(*command).json["turns"]
    settings = (drive / "drive.toml").read_text()
    (drive / "drive.toml").write_text(settings + "\n[errors]\ntime_ms = 500\n")
    late = twin(*command).json
    for camera, turn in late["turns"].items():
        assert turn["pitch_deg"] == usual[camera]["pitch_deg"]
        assert usual[camera]["sigma_pitch_deg"] < 0.4
        assert turn["sigma_pitch_deg"] > 0.8


def test_drive_with_cameras_gets_its_corrected_tables(still: Path, tmp_path: Path, twin: Twin) -> None:
    """Where drive.toml says where cameras sit, --apply writes its tables; pasted, nothing is left to turn."""
    drive = Path(shutil.copytree(still, tmp_path / "drive"))
    settings = (drive / "drive.toml").read_text()
    rig = read_rig(drive / "rig.json")
    own = drive_tables(rig, rig.cameras, {"C2_tricam60": CameraSettings("rig.json#C2_tricam60")})
    (drive / "drive.toml").write_text(settings + own)
    command = ("calibrate", "verify", drive, "--known", drive / "truth.csv")
    answer = twin(*command, "--apply", tmp_path / "mended.json")
    assert answer.code == 0, answer.err
    pasted = (tmp_path / "mended.cameras.toml").read_text()
    assert 'intrinsics = "rig.json#C2_tricam60"' in pasted
    assert pasted in answer.out
    assert f"Next: paste {tmp_path / 'mended.cameras.toml'} over those tables" in answer.err
    (drive / "drive.toml").write_text(settings + pasted)
    again = twin(*command)
    assert "No camera needs a correction" in again.err
    assert f"Next: twin ingest-drive {drive}" in again.err


def test_table_and_picture_show_what_the_turn_changes(still: Path, tmp_path: Path, twin: Twin) -> None:
    """Without --apply nothing is written but the picture, and the advice names the option."""
    answer = twin(
        "calibrate", "verify", still, "--known", still / "truth.csv", "--plot", tmp_path / "errors.png"
    )
    assert answer.code == 0
    assert "turned [m]" in answer.out
    assert "--apply FILE writes the corrected rig" in answer.err
    assert f"Next: twin calibrate verify {still} --known {still / 'truth.csv'} --apply rig_" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["errors.png"]


def test_unknown_objects_are_refused(still: Path, tmp_path: Path, twin: Twin) -> None:
    """A file of other objects ends with the cure."""
    (tmp_path / "known.csv").write_text("object,label,easting,northing\nX1,skilt,273000,7039000\n")
    answer = twin("calibrate", "verify", still, "--known", tmp_path / "known.csv")
    assert answer.code == 4
    assert "attribute object with the same names" in answer.err


def history(store: Path, drive: Path, pitches_deg: Sequence[float], roll_deg: float = 0.0) -> None:
    """Repeat a drive, a week apart, with a wide camera that is seen at these angles."""
    located = replace(locate_drive(drive), estimates=())
    with Store.open(store) as opened:
        for week, pitch in enumerate(pitches_deg):
            boresight = Boresight(*(Correction(angle, 0.03) for angle in (pitch, 0.0, roll_deg)))
            still = Correction(0.0, 0.1)
            later = replace(
                located.drive,
                drive_id=f"week{week}",
                name=f"week {week}",
                started_ns=located.drive.started_ns + week * 7 * 86_400 * 10**9,
            )
            found = Corrections(1.0, still, still, {"C3_tricam120": boresight})
            result = replace(located.result, corrections=found)
            save_drive(opened, replace(located, drive=later, result=result))


@pytest.mark.slow
def test_moved_camera_is_told_and_the_mean_starts_anew(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """A camera that looks 0.3° elsewhere from the third week on is told, between the right drives."""
    store = tmp_path / "twin.db"
    history(store, urban, (0.01, -0.02, 0.29, 0.31, 0.30))
    found = twin(
        *("calibrate", "from-drives", "--store", store, "--apply", tmp_path / "rig.json", "--json")
    ).json
    (camera,) = (c for c in found["cameras"] if c["camera"] == "C3_tricam120")
    assert camera["since"] == 2
    assert camera["turn_deg"][0] == pytest.approx(0.30, abs=0.03)
    (warning,) = found["warnings"]
    assert "C3_tricam120 has turned between week 1 and week 2 (pitch +0.3" in warning
    assert found["advised"] == ["C3_tricam120"]
    before, after = read_rig(urban / "rig.json"), read_rig(tmp_path / "rig.json")
    # Rig files are off by 0.2°: next to that the mean's sigma takes a few hundredths off.
    assert camera["mounting_deg"] == pytest.approx(camera["turn_deg"], abs=0.01)
    right = turned(before.cameras["C3_tricam120"], *camera["mounting_deg"]).rig_R_camera
    assert after.cameras["C3_tricam120"].rig_R_camera == pytest.approx(right, abs=1e-9)


def test_steady_camera_gives_no_warning(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """Angles that scatter by their sigmas are one mean; a roll that roads may have made is not applied."""
    store = tmp_path / "twin.db"
    history(store, urban, (0.02, -0.03, 0.01, 0.04), roll_deg=0.5)
    found = twin("calibrate", "from-drives", "--store", store, "--json").json
    (camera,) = (c for c in found["cameras"] if c["camera"] == "C3_tricam120")
    assert (camera["since"], found["advised"]) == (0, [])
    (warning,) = found["warnings"]
    assert "+0.5" in warning
    assert "the roads' crossfall may have made" in warning
    assert camera["sigma_deg"][0] < 0.03
    assert camera["sigma_deg"][2] > 0.5


def test_drives_of_one_day_are_told_by_name() -> None:
    """The picture's axis has days, and names where two drives share a day."""
    monday, zero = 1_781_000_000 * 10**9, (0.0, 0.0, 0.0)
    drives = [DriveTurn(name, name, monday, zero, zero) for name in ("there", "back")]
    assert tick_labels(drives) == ["there", "back"]
    assert tick_labels(drives[:1]) == ["2026-06-09"]


def test_store_without_adjusted_drives_is_refused(tmp_path: Path, sample: Path, twin: Twin) -> None:
    """Drives located by other methods say nothing of the cameras."""
    store = tmp_path / "twin.db"
    twin("ingest-drive", sample / "trip_trondheim", "--method", "paper", "--store", store)
    answer = twin("calibrate", "from-drives", "--store", store)
    assert answer.code == 2
    assert "ingested by the method adjusted" in answer.err


def test_angles_are_finite_in_json(urban: Path, tmp_path: Path, twin: Twin) -> None:
    """One drive is a history too: angles with sigmas, and no warning."""
    store = tmp_path / "twin.db"
    assert twin("ingest-drive", urban, "--store", store).code == 0
    found = twin(
        "calibrate", "from-drives", "--store", store, "--plot", tmp_path / "history.png", "--json"
    ).json
    assert {c["camera"] for c in found["cameras"]} == {"C1_front60Single", "C2_tricam60", "C3_tricam120"}
    for camera in found["cameras"]:
        assert np.isfinite(camera["turn_deg"]).all()
        assert 0.0 < max(camera["sigma_deg"]) < 1.0
    assert found["warnings"] == []
    assert (tmp_path / "history.png").exists()
