"""What is drawn over pictures lies where it should, and nothing else of them is shown unasked."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from geoloc.earth.geodesy import rotation_enu_from_rig
from twin.cli import run
from twin.drives.read import read_drive
from twin.overlay.lines import FrameLines, lines_of
from twin.overlay.scene import DriveScene, scene_of
from twin.samples.demo import sample_folder
from twin.samples.pictures import Studio
from twin.samples.sample import TRIP, sample_drives
from twin.store.store import Store

CAMERA = "C3_tricam120"
Image = NDArray[np.uint8]


@pytest.fixture(scope="module")
def scene(matched_store: Path) -> DriveScene:
    """The sample's drive as the store keeps it."""
    with Store.open(matched_store, create=False) as store:
        found, name = scene_of(store, "P01")
    assert name == "P01"
    return found


@pytest.fixture(scope="module")
def frames(scene: DriveScene) -> list[int]:
    """The last three in which the first sign was annotated."""
    return scene.frames_of("P01")[CAMERA][-3:].tolist()


def _lines(scene: DriveScene, frame: int) -> FrameLines:
    drive = read_drive(sample_folder() / TRIP)
    epoch_ns = int(drive.frame_epoch_ns[CAMERA][frame]) + drive.camera_offset_ns
    found = lines_of(scene, CAMERA, frame, epoch_ns)
    assert found is not None
    return found


def test_an_estimate_lies_where_the_adjustment_expects_it(scene: DriveScene, frames: list[int]) -> None:
    """Clicked minus residual, in the picture."""
    for frame in frames:
        lines = _lines(scene, frame)
        (click,) = (one for one in lines.clicks if one.object == "P01")
        (shown,) = (one for one in lines.estimates if one.what.object == "P01")
        assert click.residual_px is not None
        expected = np.array(click.pixel_px) - np.array(click.residual_px)
        # Several signs share one shift, and what is left of it is the car's own small turns.
        assert np.abs(shown.pixel_px - expected).max() < 1.5
        assert np.abs(lines.shift_px).max() < 25.0, "the track alone puts it near"
        assert shown.ellipse_px is not None
        assert cv2.pointPolygonTest(shown.ellipse_px.astype(np.float32), shown.pixel_px.tolist(), False) > 0


def test_horizon_and_rings_agree_with_the_rays_of_their_pixels(scene: DriveScene, frames: list[int]) -> None:
    """By the camera's own rays, not by projecting once more."""
    lines = _lines(scene, frames[-1])
    camera, pose = scene.camera(CAMERA), lines.pose
    enu_R_rig = rotation_enu_from_rig(pose.heading_deg, pose.pitch_deg, pose.roll_deg)[0]

    def rays(line: NDArray[np.float64]) -> NDArray[np.float64]:
        seen = line[np.isfinite(line).all(axis=1)] - lines.shift_px
        assert len(seen) > 50
        return camera.model.camera_ray_from_pixel(seen)[0] @ camera.rig_R_camera.T

    assert np.abs((rays(lines.horizon_px) @ enu_R_rig.T)[:, 2]).max() < 1e-5
    for radius, line in lines.rings_px:
        ray = rays(line)
        ground = -camera.rig_t_camera_m[2] / ray[:, 2:] * ray
        assert np.hypot(*ground[:, :2].T) == pytest.approx(np.full(len(ray), radius), abs=1e-5)


@pytest.fixture(scope="module")
def filmed(
    matched_store: Path, sample: Path, frames: list[int], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A store whose drive has pictures of those frames."""
    import sqlalchemy as sa

    from twin.store import schema

    root = tmp_path_factory.mktemp("filmed")
    folder = Path(shutil.copytree(sample / TRIP, root / TRIP))
    (folder / CAMERA).mkdir()
    studio = Studio(sample_drives()[TRIP])
    for frame in frames:
        rgb = studio.picture(CAMERA, frame).rgb
        cv2.imwrite(str(folder / CAMERA / f"{frame:06d}.jpg"), rgb[..., ::-1])
    with (folder / "drive.toml").open("a") as settings:
        settings.write(f'[frames.{CAMERA}]\nfile = "{CAMERA}"\nnumbered = true\n')
    path = Path(shutil.copy(matched_store, root / "twin.db"))
    with Store.open(path) as store, store.transaction() as connection:
        here = schema.annotation_set.c.drive_id.in_(
            sa.select(schema.drive.c.drive_id).where(schema.drive.c.name == TRIP)
        )
        connection.execute(sa.update(schema.annotation_set).where(here).values(folder=str(folder)))
    return path


def _show(store: Path, *options: str) -> None:
    assert run(["show", "P01", "--store", str(store), *options]) == 0


def test_a_picture_is_masked_unless_asked_otherwise(filmed: Path, frames: list[int], tmp_path: Path) -> None:
    """Outside the signs no detail is left; unmasked it is the picture."""
    masked, plain = tmp_path / "masked.png", tmp_path / "plain.png"
    _show(filmed, "--frame", "nearest", "--out", str(masked))
    _show(filmed, "--frame", f"{CAMERA}:{frames[-1]}", "--unmasked", "--out", str(plain))
    folder = filmed.parent / TRIP / CAMERA
    original = cv2.imread(str(folder / f"{frames[-1]:06d}.jpg"))
    shown, hidden = (cv2.imread(str(path))[: len(original)] for path in (plain, masked))
    # Lines cover a small part; the rest is the picture itself, or has no detail left.
    assert np.mean(np.abs(shown.astype(int) - original).max(axis=2) > 8) < 0.08
    mask = Studio(sample_drives()[TRIP]).picture(CAMERA, frames[-1]).mask
    saturation = [np.ptp(one, axis=2)[mask == 2] for one in (original, hidden)]
    assert np.percentile(saturation[0], 90) > 100, "there are cars, and not grey ones"
    assert np.percentile(saturation[1], 90) < 40, "by their colour they would be known"
    face = cv2.erode((mask == 3).astype(np.uint8), np.ones((5, 5))).astype(bool)
    face[:, : face.shape[1] // 2] = False  # the near sign, whose foot was annotated
    assert face.sum() > 1000
    assert np.mean((hidden == original).all(axis=2)[face]) > 0.95


@pytest.mark.slow
def test_a_film_holds_every_picture_that_is_there(filmed: Path, frames: list[int], tmp_path: Path) -> None:
    """It can be decoded, at its size."""
    import av

    film = tmp_path / "approach.mp4"
    _show(filmed, "--video", str(film), "--camera", CAMERA)
    with av.open(str(film)) as container:
        pictures = [one.to_ndarray(format="rgb24") for one in container.decode(video=0)]
    assert len(pictures) == len(frames)
    assert pictures[0].shape[1] == 1920
    assert not list(tmp_path.glob(".*")), "nothing half written is left"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--frame", "nearest"], "--out"),
        (["--frame", "84", "--out", "x.png"], "CAMERA:NUMBER"),
        (["--frame", "C9:84", "--out", "x.png"], "C9"),
        (["--video", "x.avi"], ".mp4"),
        (["--camera", CAMERA], "--frame"),
    ],
)
def test_a_wish_that_makes_no_sense_is_told(
    filmed: Path, options: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is drawn or written."""
    assert run(["show", "P01", "--store", str(filmed), *options]) == 2
    assert told in capsys.readouterr().err
    assert not Path("x.png").exists()
