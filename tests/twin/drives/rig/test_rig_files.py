"""Rigs without DriveWorks: cameras of any calibration file, placed by ``drive.toml``, with car masks."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from geoloc.calibration_files.kalibr import kalibr_text
from geoloc.calibration_files.opencv_file import opencv_text
from geoloc.cameras import FisheyeCamera, FovCamera, FThetaCamera, PinholeCamera
from geoloc.rig.rig import rig_from_document
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.ingest.ingest import ingest_drive
from twin.store.schema import METHODS
from twin.store.store import Store

WIDE, NARROW = "C3_wide", "C1_narrow"
FISHEYE = FisheyeCamera(1280, 800, 600.0, 601.0, 639.5, 399.5, (0.01, -0.002, 0.0, 0.0))
PINHOLE = PinholeCamera(1280, 800, 1000.0, 1001.0, 641.0, 398.0, (-0.1, 0.01, 1e-4, 2e-4))
PLACED = "position = [1.8, 0.1, 1.4]\nroll_pitch_yaw = [0.0, 2.5, 0.0]\n"
GNSS = '[gnss]\nfiles = { roof = "gnss52_vehicle.bin" }\nlever_arms = { roof = [1.0, -0.5, 1.6] }\n'
TOML = f'[cameras.{WIDE}]\nintrinsics = "camchain.yaml#cam1"\n{PLACED}{GNSS}'


def picture(mask: np.ndarray, kind: str = "PNG") -> bytes:
    """Draw a mask, true on the car, as people do: the car black."""
    file = io.BytesIO()
    Image.fromarray(np.where(mask, 0, 255).astype(np.uint8)).save(file, format=kind)
    return file.getvalue()


def bonnet(rows: int = 800, columns: int = 1280) -> np.ndarray:
    """A mask whose lower part, from row 510 of 800 on, is the car."""
    mask = np.zeros((rows, columns), dtype=bool)
    mask[rows * 51 // 80 :] = True
    return mask


def folder(maker: Any, tmp_path: Path, toml: str, **changes: str | None) -> Path:
    """Write the drive with these settings and a camera chain of two cameras, without a rig file."""
    files = {"car.json": None, "camchain.yaml": kalibr_text([PINHOLE, FISHEYE]), "drive.toml": toml}
    stamps = f'[timestamps]\n{WIDE} = "{WIDE}.h264.timestamps"\n'
    return maker.write(tmp_path, maker.files(**{**files, **changes, "drive.toml": toml + stamps}))  # type: ignore[no-any-return]


def assert_kept(drive: Drive) -> None:
    """The kept document makes the drive's cameras again, without any other file."""
    again = rig_from_document(json.loads(drive.rig_document), "kept")
    assert list(again.cameras) == list(drive.rig.cameras)
    for name, camera in drive.rig.cameras.items():
        assert again.cameras[name].model == camera.model
        np.testing.assert_array_equal(again.cameras[name].rig_R_camera, camera.rig_R_camera)
        np.testing.assert_array_equal(again.cameras[name].rig_t_camera_m, camera.rig_t_camera_m)
        np.testing.assert_array_equal(again.cameras[name].ego_mask, camera.ego_mask)


def test_rig_is_built_from_a_camera_chain_and_places(maker: Any, tmp_path: Path) -> None:
    """No rig file: intrinsics of the named camera, position and angles of ``drive.toml``."""
    drive = read_drive(folder(maker, tmp_path, TOML))
    camera = drive.rig.camera(WIDE)
    assert list(drive.rig.cameras) == [WIDE]
    assert camera.model == FISHEYE
    np.testing.assert_array_equal(camera.rig_t_camera_m, [1.8, 0.1, 1.4])
    axis = camera.rig_R_camera[:, 2]
    assert np.degrees(np.arcsin(axis[2])) == pytest.approx(-2.5)
    assert axis[1] == pytest.approx(0.0, abs=1e-15)
    assert len(drive.annotations.frame) == 3
    assert_kept(drive)


def test_calibrated_pose_counts_unless_the_drawing_is_chosen(maker: Any, tmp_path: Path) -> None:
    """Which camera is off, by how much, is said once; ``rig_pose`` chooses, ends the warning, and is kept."""
    wide = maker.camera(WIDE)
    drawn = wide["nominalSensor2Rig_FLU"]
    roll, pitch, yaw = drawn["roll-pitch-yaw"]
    x, y, z = drawn["t"]
    wide["sensor2Rig_FLU"] = {"roll-pitch-yaw": [roll, pitch, yaw + 1.0], "t": [x, y, z + 0.03]}
    car = json.dumps(maker.rig(wide, maker.camera(NARROW)))
    drives = {
        key: read_drive(folder(maker, tmp_path / key, f'{line}rig = "car.json"\n{GNSS}', **{"car.json": car}))
        for key, line in {
            "": "",
            "calibrated": 'rig_pose = "calibrated"\n',
            "nominal": 'rig_pose = "nominal"\n',
        }.items()
    }
    told = {key: [str(w) for w in drive.warnings if "two poses" in str(w)] for key, drive in drives.items()}
    (sentence,) = told.pop("")
    assert f"{WIDE} by 1.00° and 3.0 cm" in sentence
    assert told == {"calibrated": [], "nominal": []}
    heights = {key: drive.rig.camera(WIDE).rig_t_camera_m[2] for key, drive in drives.items()}
    assert heights == pytest.approx({"": z + 0.03, "calibrated": z + 0.03, "nominal": z})
    for drive in drives.values():
        assert_kept(drive)


def test_calibration_file_is_part_of_what_a_drive_was_read_from(maker: Any, tmp_path: Path) -> None:
    """Another calibration makes the same drive with other content."""
    path = folder(maker, tmp_path, TOML)
    before = read_drive(path)
    (path / "camchain.yaml").write_text(kalibr_text([PINHOLE, PINHOLE]))
    after = read_drive(path)
    assert after.drive_id == before.drive_id
    assert after.content_sha256 != before.content_sha256


def test_camera_of_its_own_name_needs_no_pick(maker: Any, tmp_path: Path) -> None:
    """A file of one camera, and a camera that is called as in the file, are clear without ``#``."""
    toml = TOML.replace("camchain.yaml#cam1", "front.yaml")
    drive = read_drive(folder(maker, tmp_path, toml, **{"front.yaml": opencv_text(PINHOLE, "else")}))
    assert drive.rig.camera(WIDE).model == PINHOLE
    named = maker.rig(maker.camera(WIDE), maker.camera(NARROW))
    toml = TOML.replace("camchain.yaml#cam1", "old.json")
    drive = read_drive(folder(maker, tmp_path, toml, **{"old.json": json.dumps(named)}))
    assert drive.rig.camera(WIDE).model == FThetaCamera(1280, 800, 639.5, 399.5, (0.0, 1e-3, 0.0, 0.0, 0.0))


def test_camera_of_a_colmap_file_is_picked_by_its_number(maker: Any, tmp_path: Path) -> None:
    """Also of a model that only this project's rig files hold, which is kept all the same."""
    toml = TOML.replace("camchain.yaml#cam1", "cameras.txt#2")
    lines = "# Camera list\n1 PINHOLE 1280 800 900 900 640 400\n2 FOV 1280 800 600 600 640 400 0.9\n"
    drive = read_drive(folder(maker, tmp_path, toml, **{"cameras.txt": lines}))
    assert drive.rig.camera(WIDE).model == FovCamera(1280, 800, 600.0, 600.0, 639.5, 399.5, 0.9)
    assert_kept(drive)


@pytest.mark.parametrize("model", ["ftheta", "mystery"])
def test_intrinsics_replace_those_of_the_rig_file(maker: Any, tmp_path: Path, model: str) -> None:
    """The rig file's pose stays, also of a camera whose model nobody knows; the other camera stays too."""
    car = maker.rig(maker.camera(WIDE, Model=model), maker.camera(NARROW))
    toml = f'rig = "car.json"\n[cameras.{WIDE}]\nintrinsics = "camchain.yaml#cam0"\n{GNSS}'
    drive = read_drive(folder(maker, tmp_path, toml, **{"car.json": json.dumps(car)}))
    assert drive.rig.camera(WIDE).model == PINHOLE
    np.testing.assert_array_equal(drive.rig.camera(WIDE).rig_t_camera_m, [1.8, 0.0, 1.4])
    assert isinstance(drive.rig.camera(NARROW).model, FThetaCamera)
    assert_kept(drive)


def test_place_replaces_that_of_the_rig_file(maker: Any, tmp_path: Path) -> None:
    """A camera moved or calibrated anew against the car: corrections of the file go with its old pose."""
    wide = {**maker.camera(WIDE), "correction_rig_T": [1.0, 1.0, 1.0]}
    toml = f'rig = "car.json"\n[cameras.{WIDE}]\n{PLACED}{GNSS}'
    drive = read_drive(folder(maker, tmp_path, toml, **{"car.json": json.dumps(maker.rig(wide))}))
    assert isinstance(drive.rig.camera(WIDE).model, FThetaCamera)
    np.testing.assert_array_equal(drive.rig.camera(WIDE).rig_t_camera_m, [1.8, 0.1, 1.4])


def test_rig_file_alone_is_kept_word_for_word(maker: Any, tmp_path: Path) -> None:
    """Where ``drive.toml`` adds nothing, the document is the file's own text."""
    path = maker.write(tmp_path, maker.files())
    assert read_drive(path).rig_document == (path / "car.json").read_text()


@pytest.mark.parametrize(("name", "kind"), [("mask.png", "PNG"), ("mask.pgm", "PPM")])
def test_mask_picture_is_black_on_the_car(maker: Any, tmp_path: Path, name: str, kind: str) -> None:
    """In its own, smaller size; and it is kept with the rig."""
    path = folder(maker, tmp_path, TOML.replace("position", f'mask = "{name}"\nposition'))
    (path / name).write_bytes(picture(bonnet(400, 640), kind))
    drive = read_drive(path)
    np.testing.assert_array_equal(drive.rig.camera(WIDE).ego_mask, bonnet(400, 640))
    assert_kept(drive)


def test_mask_that_the_rig_file_names_is_read(maker: Any, tmp_path: Path) -> None:
    """DriveWorks' property ``car-mask``; where the picture is absent, that is said."""
    car = maker.rig(maker.camera(WIDE, **{"car-mask": "/recorder/C3.pgm"}))
    path = folder(maker, tmp_path, f'rig = "car.json"\n{GNSS}', **{"car.json": json.dumps(car)})
    without = read_drive(path)
    assert without.rig.camera(WIDE).ego_mask is None
    assert any(
        "names the car mask /recorder/C3.pgm of C3_wide, which is not" in w.sentence for w in without.warnings
    )
    (path / "C3.pgm").write_bytes(picture(bonnet(), "PPM"))
    drive = read_drive(path)
    np.testing.assert_array_equal(drive.rig.camera(WIDE).ego_mask, bonnet())
    assert not any("car mask" in w.sentence for w in drive.warnings)
    assert_kept(drive)


@pytest.mark.parametrize("method", METHODS)
def test_annotation_on_the_car_itself_is_refused_and_counted(maker: Any, tmp_path: Path, method: str) -> None:
    """Of three feet one is below row 510, on the bonnet: every method leaves it out and says why."""
    toml = TOML.replace("position", 'mask = "mask.png"\nposition')
    poses = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n" + "".join(
        f"{maker.start_ns + i * 100_000_000},{63.42 + 1e-5 * i:.7f},10.4,80,0,0,0\n" for i in range(100)
    )
    toml = toml.replace(GNSS, '[poses]\nfile = "poses.csv"\n')
    path = folder(maker, tmp_path, toml, **{"poses.csv": poses})
    (path / "mask.png").write_bytes(picture(bonnet()))
    with Store.open(tmp_path / "twin.db") as store:
        report = ingest_drive(store, path, method=method)
    assert report.n_annotations == 3
    assert report.skipped["sightings: on the car itself"] == 1


def test_mask_the_wrong_way_round_is_doubted(maker: Any, tmp_path: Path) -> None:
    """A mask that hides most of the picture is used, with a question."""
    path = folder(maker, tmp_path, TOML.replace("position", 'mask = "mask.png"\nposition'))
    (path / "mask.png").write_bytes(picture(~bonnet()))
    assert any("hides 64% of the picture" in w.sentence for w in read_drive(path).warnings)


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        (TOML.replace("#cam1", ""), "holds the cameras cam0, cam1: say which of them is C3_wide"),
        (TOML.replace("#cam1", "#cam7"), r"has no camera cam7 \(its cameras: cam0, cam1; the nearest"),
        (TOML.replace("camchain", "other"), r"other\.yaml is not in the drive folder"),
        (TOML.replace("camchain.yaml#cam1", "../camchain.yaml"), "lies outside the drive folder"),
        (TOML.replace("camchain", "c" * 300), "is no file name"),
        (TOML.replace("camchain.yaml#cam1", f"{WIDE}.xml"), "is no calibration file that is known here"),
        (
            TOML.replace('intrinsics = "camchain.yaml#cam1"\n', ""),
            "names the camera C3_wide, which no rig file",
        ),
        (TOML.replace("roll_pitch_yaw", "roll_pitch_jaw"), "unknown key .*roll_pitch_jaw: the nearest"),
        (TOML.replace("roll_pitch_yaw = [0.0, 2.5, 0.0]\n", ""), "only one of position and roll_pitch_yaw"),
        (TOML.replace("[1.8, 0.1, 1.4]", "[1800, 100, 1400]"), "must be .x forward"),
        (TOML.replace("[0.0, 2.5, 0.0]", "[0.0, 2.5]"), "must be .roll, pitch, yaw. in degrees"),
        (TOML.replace("[0.0, 2.5, 0.0]", "[0.0, nan, 0.0]"), "must be a number"),
        (TOML.replace("position", 'mask = "none.png"\nposition'), r"none\.png is not in the drive folder"),
        (TOML.replace("position", 'mask = "camchain.yaml"\nposition'), "cannot be read as a picture"),
        (TOML.replace("position", 'mask = "small.png"\nposition'), "800 x 800 pixels, another shape"),
        (f"cameras = 3\n{GNSS}", "cameras = 3: it must be a table"),
        (f'[cameras]\n{WIDE} = "front.yaml"\n{GNSS}', "it must be a table"),
    ],
)
def test_fault_of_a_described_camera_is_named(maker: Any, tmp_path: Path, toml: str, message: str) -> None:
    """What is wrong, where, and what to write instead."""
    path = folder(maker, tmp_path, toml)
    (path / "small.png").write_bytes(picture(bonnet(800, 800)))
    with pytest.raises(DriveError, match=message):
        read_drive(path)
