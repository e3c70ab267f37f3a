"""From boards to a drive: intrinsics, extrinsics and ingest as one recipe, for a rig of any make."""

from __future__ import annotations

import csv
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import sqlalchemy as sa
from command_line import Twin

from geoloc.calibration_files import kalibr_text, opencv_text, read_cameras
from geoloc.cameras import FisheyeCamera, PinholeCamera
from geoloc.earth.geodesy import rotation_from_rpy
from geoloc.rig.rig import FLU_R_RDF, RigCamera, read_rig
from geoloc.simulation.pictures.yard import draw_yard, yard_picture
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.calibrate.camera_files import new_rig_document, rig_text
from twin.calibrate.difference.fits import read_fits
from twin.calibrate.extrinsics.example import layout_text, write_yard
from twin.calibrate.intrinsics.example import example_camera
from twin.drives.read import read_drive
from twin.samples.write_drive import write_driveworks_trip
from twin.store import schema
from twin.store.store import Store

FRONT = RigCamera(
    name="front",
    model=PinholeCamera(960, 604, 800.0, 801.0, 479.5, 301.5, (-0.05, 0.01, 1e-4, 2e-4)),
    rig_R_camera=rotation_from_rpy(0.5, 2.4, 1.2) @ FLU_R_RDF,
    rig_t_camera_m=np.array([1.8, 0.2, 1.45]),
)
WIDE = RigCamera(
    name="wide",
    model=FisheyeCamera(960, 604, 480.0, 480.0, 478.0, 303.0, (0.01, -0.002, 0.0, 0.0)),
    rig_R_camera=rotation_from_rpy(-0.4, 3.0, -0.8) @ FLU_R_RDF,
    rig_t_camera_m=np.array([1.82, -0.1, 1.42]),
)
GNSS = (
    "[gnss]\n"
    'files = { left = "gnss50_vehicle.bin", right = "gnss52_vehicle.bin" }\n'
    "lever_arms = { left = [0.62, 0.55, 1.56], right = [0.60, -0.56, 1.55] }\n"
)


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive that stops before three poles, annotated on pictures of half the size, without a rig.

    The cameras of the example boards and of the example yard have half the simulated car's resolution.
    """
    whole, half = (tmp_path_factory.mktemp(name) for name in ("whole", "half"))
    write_driveworks_trip(simulate_drive(scenario("still"), seed=3), whole)
    notes = read_drive(whole).annotations
    for camera in ("C1_front60Single", "C3_tricam120"):
        with (half / f"{camera}.csv").open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["frame", "label", "object", "x_px", "y_px"])
            for i in np.flatnonzero(notes.camera == camera):
                # Tools count from the corner of the first pixel.
                x, y = (notes.pixel_px[i] + 0.5) / 2.0
                rows.writerow([notes.frame[i], "skilt", notes.object[i], f"{x:.3f}", f"{y:.3f}"])
    for file in whole.glob("*"):
        if file.suffix in {".timestamps", ".bin"}:
            shutil.copy(file, half)
    (half / "drive.toml").write_text(GNSS)
    return half


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example yard, without the pictures of one camera that nobody calibrates here."""
    folder = tmp_path_factory.mktemp("yard") / "yard"
    write_yard(folder, seed=5)
    (folder / "pictures" / "C2_tricam60.png").unlink()
    return folder


@pytest.fixture(scope="module")
def other_car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car of another make in a yard: pictures, a layout, and intrinsics by Kalibr and OpenCV."""
    folder, rng = tmp_path_factory.mktemp("other") / "car", np.random.default_rng(3)
    tags = draw_yard(rng)
    (folder / "pictures").mkdir(parents=True)
    for camera in (FRONT, WIDE):
        cv2.imwrite(str(folder / "pictures" / f"{camera.name}.png"), yard_picture(tags, camera, rng))
    (folder / "layout.toml").write_text(layout_text(tags))
    (folder / "camchain.yaml").write_text(kalibr_text([FRONT.model, WIDE.model]))
    (folder / "front.yaml").write_text(opencv_text(FRONT.model, "front"))
    return folder


def places(twin: Twin, drive: Path, rig: Path, store: Path) -> dict[str, np.ndarray]:
    """Ingest a drive with a rig: where each object stands by single frames."""
    shutil.copy(rig, drive / "rig.json")
    answer = twin("ingest-drive", drive, "--method", "single-frame", "--store", store)
    assert answer.code == 0, answer.err
    with Store.open(store) as opened:
        rows = opened.rows(sa.select(schema.estimate))
    return {row["object"]: np.array([row["east_m"], row["north_m"]]) for row in rows}


def next_command(answer: Any) -> list[str]:
    """The command that the last ``Next:`` names, as a shell splits it."""
    line = [line for line in answer.err.splitlines() if line.startswith("Next: twin ")][-1]
    return shlex.split(line.removeprefix("Next: twin "))


@pytest.mark.slow
def test_boards_yard_and_drive_are_one_recipe(
    trip: Path, yard: Path, tmp_path: Path, twin: Twin, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each command's Next leads to the following one; signs stand where the true rig puts them."""
    monkeypatch.chdir(tmp_path)
    # The first camera's calibration is taken as done.
    Path("calibrated").mkdir()
    other = replace(example_camera("C2_tricam60"), cx_px=480.0)
    first = new_rig_document({"C1_front60Single": example_camera("C1_front60Single"), "C2_tricam60": other})
    Path("calibrated/rig.json").write_text(rig_text(first))
    made = twin("calibrate", "example", "board", "--camera", "C3_tricam120", "--pictures", "6")
    command = [*next_command(made), "--model", "ftheta"]
    assert command[command.index("--out") + 1] == "calibrated"
    refused = twin(*command)
    assert (refused.code, "C1_front60Single, C2_tricam60, which would be lost" in refused.err) == (5, True)
    # The car's first rig file given again would lose what was calibrated since.
    refused = twin(*command, "--rig", yard / "drawn_rig.json")
    assert (refused.code, "C2_tricam60, which would be lost" in refused.err) == (5, True)
    command += ["--rig", "calibrated/rig.json"]
    refused = twin(*command)
    assert (refused.code, "put it in with --add" in refused.err) == (4, True)
    made = twin(*command, "--add")
    assert made.code == 0, made.err
    assert Path("calibrated/C3_tricam120/report.md").exists()
    assert list(read_rig(Path("calibrated/rig.json")).cameras) == list(
        read_rig(yard / "true_rig.json").cameras
    )
    command = next_command(made)
    command[command.index("PICTURES")] = str(yard / "pictures")
    command[command.index("layout.toml")] = str(yard / "layout.toml")
    assert command[command.index("--out") + 1] == "mounted"
    made = twin(*command)
    assert made.code == 0, made.err
    assert "Next: put mounted/rig.json into the drive's folder" in made.err
    # The lens's covariance has gone on with the rig: a mounting can be compared, lens and all.
    fits = read_fits(Path("mounted"))
    assert [name for name, fit in fits.items() if fit.lens is not None] == ["C3_tricam120"]
    assert fits["C3_tricam120"].mounting_covariance is not None
    assert Path("mounted/metres.png").read_bytes().startswith(b"\x89PNG")
    drive = Path(shutil.copytree(trip, tmp_path / "drive"))
    shutil.copy("calibrated/rig.json", drive)
    told = [doubt.sentence for doubt in read_drive(drive).warnings]
    (warning,) = (sentence for sentence in told if "at the rig's origin" in sentence)
    assert warning.startswith("C1_front60Single, C3_tricam120: ")
    found, true, drawn = (
        places(twin, drive, rig, tmp_path / f"{number}.db")
        for number, rig in enumerate(
            [Path("mounted/rig.json"), yard / "true_rig.json", yard / "drawn_rig.json"]
        )
    )
    assert sorted(found) == ["P01", "P02", "P03"]
    assert max(np.linalg.norm(found[name] - true[name]) for name in true) < 0.05
    assert max(np.linalg.norm(drawn[name] - true[name]) for name in true) > 0.2


@pytest.mark.slow
@pytest.mark.usefixtures("unarranged")
def test_drive_with_cameras_is_a_rig_and_gets_its_tables(
    other_car: Path, trip: Path, tmp_path: Path, twin: Twin
) -> None:
    """A drive.toml with intrinsics alone is calibrated, and read with the tables pasted into it."""
    drive = tmp_path / "drive"
    drive.mkdir()
    for file in trip.glob("*.bin"):
        shutil.copy(file, drive)
    shutil.copy(trip / "C1_front60Single.h264.timestamps", drive / "front.timestamps")
    shutil.copy(other_car / "camchain.yaml", drive)
    (drive / "front.csv").write_text("frame,label,object,x_px,y_px\n1,skilt,P01,500,400\n")
    tables = '[cameras.front]\nintrinsics = "camchain.yaml#cam0"\n'
    tables += '[cameras.wide]\nintrinsics = "camchain.yaml#cam1"\n'
    (drive / "drive.toml").write_text(GNSS + tables)
    assert twin("ingest-drive", drive, "--store", tmp_path / "twin.db").code == 4
    out = tmp_path / "mounted"
    answer = twin(
        *("calibrate", "extrinsics", other_car / "pictures", "--tags", other_car / "layout.toml"),
        *("--rig", drive, "--out", out),
    )
    assert answer.code == 0, answer.err
    pasted = (out / "cameras.toml").read_text()
    assert pasted in answer.out
    assert f"Next: paste {out / 'cameras.toml'} over those tables of {drive / 'drive.toml'}" in answer.err
    (drive / "drive.toml").write_text(GNSS + pasted)
    rig = read_drive(drive).rig
    for true in (FRONT, WIDE):
        mine = rig.cameras[true.name]
        assert mine.model == true.model
        assert mine.rig_t_camera_m == pytest.approx(true.rig_t_camera_m, abs=0.005)
        assert mine.rig_R_camera == pytest.approx(true.rig_R_camera, abs=5e-4)
    assert twin("ingest-drive", drive, "--store", tmp_path / "twin.db").code == 0


@pytest.mark.usefixtures("unarranged")
def test_files_of_other_programs_carry_the_mounting(other_car: Path, tmp_path: Path, twin: Twin) -> None:
    """Kalibr's T_cam_imu and T_cn_cnm1 and OpenCV's matrices say the same as the rig file."""
    answer = twin(
        *("calibrate", "extrinsics", other_car / "pictures", "--tags", other_car / "layout.toml"),
        *("--rig", other_car / "rig.json", "--out", tmp_path / "mounted"),
    )
    assert answer.code == 4
    assert "give a rig file, a calibration file or a drive folder" in answer.err
    renamed = tmp_path / "pictures"
    renamed.mkdir()
    for name, camera in (("cam0", "front"), ("cam1", "wide")):
        shutil.copy(other_car / "pictures" / f"{camera}.png", renamed / f"{name}.png")
    answer = twin(
        *("calibrate", "extrinsics", renamed, "--tags", other_car / "layout.toml", "--json"),
        *("--rig", other_car / "camchain.yaml", "--out", tmp_path / "mounted"),
    )
    assert answer.code == 0, answer.err
    assert [camera["turned_deg"] for camera in answer.json["cameras"]] == [None, None]
    out = tmp_path / "mounted"
    rig = read_rig(out / "rig.json")
    chain = (out / "kalibr.yaml").read_text()
    by_imu = read_cameras(chain.encode(), "kalibr.yaml")
    pairs = read_cameras(chain.replace("T_cam_imu", "left_out").encode(), "kalibr.yaml")
    first, second = (by_imu[name].camera_T_body for name in ("cam0", "cam1"))
    assert first is not None
    assert second is not None
    assert pairs["cam1"].camera_T_body == pytest.approx(second @ np.linalg.inv(first), abs=1e-9)
    for name, camera in rig.cameras.items():
        camera_T_rig = by_imu[name].camera_T_body
        assert camera_T_rig is not None
        assert camera_T_rig[:3, :3] == pytest.approx(camera.rig_R_camera.T, abs=1e-9)
        eye = -camera_T_rig[:3, :3].T @ camera_T_rig[:3, 3]
        assert eye == pytest.approx(camera.rig_t_camera_m, abs=1e-9)
        file = cv2.FileStorage(str(out / f"{name}.opencv.yaml"), cv2.FILE_STORAGE_READ)
        assert file.getNode("camera_R_rig").mat() == pytest.approx(camera_T_rig[:3, :3], abs=1e-12)
        assert file.getNode("camera_t_rig").mat()[:, 0] == pytest.approx(camera_T_rig[:3, 3], abs=1e-12)
        file.release()


@pytest.mark.usefixtures("unarranged")
def test_only_camera_of_a_file_takes_all_pictures(other_car: Path, tmp_path: Path, twin: Twin) -> None:
    """A file of one camera needs no camera's name in the pictures."""
    (tmp_path / "pictures").mkdir()
    shutil.copy(other_car / "pictures" / "front.png", tmp_path / "pictures" / "0001.png")
    answer = twin(
        *("calibrate", "extrinsics", tmp_path / "pictures", "--tags", other_car / "layout.toml"),
        *("--rig", other_car / "front.yaml", "--out", tmp_path / "mounted"),
    )
    assert answer.code == 0, answer.err
    found = read_rig(tmp_path / "mounted" / "rig.json").camera("front")
    assert found.rig_t_camera_m == pytest.approx(FRONT.rig_t_camera_m, abs=0.005)
