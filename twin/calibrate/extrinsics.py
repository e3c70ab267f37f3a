"""Pictures of tags around the car → a rig file with the cameras where they are."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration.extrinsics.calibrate import Extrinsics, calibrate_extrinsics
from geoloc.calibration.extrinsics.doubts import doubts
from geoloc.calibration.extrinsics.observed import Pose, TagPicture
from geoloc.calibration_files.read import read_cameras
from geoloc.cameras.base import CameraModel
from geoloc.errors import CalibrationError
from geoloc.geodesy import rpy_from_rotation
from geoloc.rig import FLU_R_RDF, Rig, rig_from_document
from geoloc.rig_edit import with_extrinsics
from twin.calibrate.boards import Board
from twin.calibrate.detect import detect
from twin.calibrate.extrinsics_picture import draw_extrinsics
from twin.calibrate.layout import Layout, read_layout
from twin.calibrate.pictures import IMAGE_SUFFIXES, pictures
from twin.calibrate.tag_corners import find_tags
from twin.drives.camera_names import named_in
from twin.errors import ConfigError
from twin.export.atomic import replace_file
from twin.folders import make_folder

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int | None], None]

HAND = "hand"
"""Name of the camera that is carried around the car."""
RIG_NAME, REPORT_NAME, PICTURE_NAME = "rig.json", "extrinsics.json", "extrinsics.png"


@dataclass(frozen=True, slots=True)
class CameraFound:
    """Extrinsics of one camera, as a person reads them.

    Attributes
    ----------
    camera : str
    roll_pitch_yaw_deg, position_m : tuple of float
        As a rig file writes them: of the camera's FLU axes in the rig frame.
    sigma_deg, sigma_m : tuple of float
        One sigma, about and along the rig's x, y, z.
    turned_deg, moved_m : float
        Against the rig that was given.
    n_tags, n_left_out : int
        Tags in its pictures, and those of them that did not fit.
    rms_px : float
    """

    camera: str
    roll_pitch_yaw_deg: tuple[float, float, float]
    position_m: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    sigma_m: tuple[float, float, float]
    turned_deg: float
    moved_m: float
    n_tags: int
    n_left_out: int
    rms_px: float


@dataclass(frozen=True, slots=True)
class ExtrinsicsReport:
    """What ``twin calibrate extrinsics`` found and wrote.

    Attributes
    ----------
    cameras : tuple of CameraFound
    doubts : tuple of str
        What to look at before the result is trusted.
    notes : tuple of str
        What was left out on the way.
    n_pictures : int
    files : tuple of Path
    """

    cameras: tuple[CameraFound, ...]
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    n_pictures: int
    files: tuple[Path, ...]


def calibrate_rig(
    images: Path | str,
    tags: Path | str,
    rig: Path | str,
    out: Path | str,
    *,
    hand: Path | str | None = None,
    progress: Progress | None = None,
) -> ExtrinsicsReport:
    """Find where the cameras of a rig sit, from pictures of AprilTags around the standing car.

    Parameters
    ----------
    images : Path or str
        A folder of pictures. A picture belongs to the camera whose name is in its own or its sub-folder's.
    tags : Path or str
        The layout (`twin.calibrate.layout`).
    rig : Path or str
        DriveWorks rig file: the intrinsics, and rough poses to start from.
    out : Path or str
        Folder for ``rig.json`` (the rig with the new poses, all else kept), the report and its picture.
    hand : Path or str, optional
        Calibration file of a camera that was carried around: pictures that name no camera are its own.
    progress : callable, optional
        Called with what is done, how many, of how many.

    Raises
    ------
    ConfigError, CalibrationError, RefusedError
        If an input cannot be used; nothing is written then.
    """
    layout = read_layout(_content(tags, "layout"), Path(tags).name)
    document, known = _rig(Path(rig))
    models: dict[str, CameraModel] = {name: camera.model for name, camera in known.cameras.items()}
    if hand is not None:
        models[HAND] = _hand_model(Path(hand))
    shown, notes = _tag_pictures(_by_camera(Path(images), known, hand is not None), models, layout, progress)
    nominal = {n: Pose(c.rig_R_camera, c.rig_t_camera_m) for n, c in known.cameras.items()}
    found = calibrate_extrinsics(models, shown, layout.tags, nominal=nominal, sigmas=layout.sigmas)
    for name, camera in found.cameras.items():
        pose = camera.rig_T_camera
        document = with_extrinsics(document, name, pose.R, pose.t_m, Path(rig).name)
    report = ExtrinsicsReport(
        cameras=tuple(_found(found, name, known) for name in found.cameras),
        doubts=doubts(found),
        notes=tuple(notes),
        n_pictures=len(shown),
        files=tuple(Path(out) / name for name in (RIG_NAME, REPORT_NAME, PICTURE_NAME)),
    )
    folder = make_folder(out)
    replace_file(folder / RIG_NAME, (json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())
    replace_file(folder / REPORT_NAME, (json.dumps(_document(report, found), indent=2) + "\n").encode())
    draw_extrinsics(found, layout, folder / PICTURE_NAME)
    return report


def _content(path: Path | str, what: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"The {what} {path} cannot be read ({error.strerror}): check its name.") from error


def _rig(path: Path) -> tuple[Mapping[str, Any], Rig]:
    try:
        document = json.loads(_content(path, "rig file").decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"The rig file {path} is not JSON ({error}): export it again.") from error
    return document, rig_from_document(document, path.name)


def _hand_model(path: Path) -> CameraModel:
    cameras = read_cameras(_content(path, "calibration of the carried camera"), path.name)
    if len(cameras) != 1:
        raise ConfigError(f"{path} holds {len(cameras)} cameras: give the file of the one that was carried.")
    return next(iter(cameras.values())).model


class _PictureFile(NamedTuple):
    """One picture: its camera, its file, and its name inside the folder."""

    camera: str
    file: Path
    name: str


def _by_camera(folder: Path, rig: Rig, hand: bool) -> list[_PictureFile]:
    """Every picture of the folder and its sub-folders with the camera that its name names."""
    if not folder.is_dir():
        raise ConfigError(f"{folder} is no folder: give the one that holds the pictures.")
    files = [*folder.iterdir(), *(f for sub in folder.iterdir() if sub.is_dir() for f in sub.iterdir())]
    found = []
    for file in sorted(f for f in files if f.suffix.lower() in IMAGE_SUFFIXES):
        inside = file.relative_to(folder).with_suffix("")
        names = named_in(str(inside), rig.cameras)
        if len(names) > 1 or not (names or hand):
            raise ConfigError(
                f"{inside} names {' and '.join(names) or 'no camera'} of the rig ({', '.join(rig.cameras)}):"
                " put the camera's name into the name of the picture or its folder, or give the file of"
                " the carried camera's calibration with --hand."
            )
        found.append(_PictureFile(names[0] if names else HAND, file, inside.as_posix() + file.suffix))
    if not found:
        raise ConfigError(f"There are no pictures in {folder}: name the folder they are in.")
    return found


def _tag_pictures(
    files: Sequence[_PictureFile],
    models: Mapping[str, CameraModel],
    layout: Layout,
    progress: Progress | None,
) -> tuple[list[TagPicture], list[str]]:
    found, notes = [], []
    for done, (camera, file, name) in enumerate(files):
        if progress is not None:
            progress("pictures", done, len(files))
        grey = next(iter(pictures([file]))).grey
        model = models[camera]
        if grey.shape != (model.height_px, model.width_px):
            raise CalibrationError(
                f"{name} has {grey.shape[1]} x {grey.shape[0]} pixels, but {camera} has"
                f" {model.width_px} x {model.height_px}: give pictures in the camera's own size."
            )
        tags = find_tags(grey, model)
        if tags.mirrored:
            raise CalibrationError(
                f"{name} shows its tags mirrored: print them the right way round, or do not flip it."
            )
        if tags.n_small:
            notes.append(f"{name}: {tags.n_small} tags are too small or too blurred and were left out.")
        strange = sorted(set(tags.ids.tolist()) - set(layout.tags))
        if strange:
            listed = ", ".join(map(str, strange))
            notes.append(f"{name}: tag {listed} is not in the layout and was left out.")
        shown = [
            TagPicture(name, camera, camera != HAND, tags.ids, tags.corners_px),
            *_board_pictures(grey, name, camera, layout.boards),
        ]
        if not any(len(picture.tag_ids) for picture in shown):
            notes.append(f"{name} shows no tag.")
        found += [picture for picture in shown if len(picture.tag_ids)]
    if progress is not None:
        progress("pictures", len(files), len(files))
    return found, notes


def _board_pictures(
    grey: NDArray[np.uint8], name: str, camera: str, boards: Mapping[int, Board]
) -> list[TagPicture]:
    """Inner corners of boards, four at a time: far apart, so that each four have a pose of their own."""
    found = []
    for number, board in boards.items():
        seen = detect(grey, board, name)
        if seen is None:
            continue
        half = 0.5 * board.square_m * np.array([board.columns + 1, board.rows + 1])
        points = np.column_stack([seen.view.board_m - half, np.zeros(len(seen.ids))])
        groups = len(points) // 4
        order = np.arange(4 * groups).reshape(4, groups).T
        found.append(
            TagPicture(
                name=name,
                camera=camera,
                on_car=camera != HAND,
                tag_ids=np.full(groups, number),
                corners_px=seen.view.pixel_px[order],
                points_m=points[order],
            )
        )
    return found


def _found(result: Extrinsics, name: str, rig: Rig) -> CameraFound:
    camera, before = result.cameras[name], rig.cameras[name]
    pose = camera.rig_T_camera
    turn = pose.R @ before.rig_R_camera.T
    roll, pitch, yaw = rpy_from_rotation(pose.R @ FLU_R_RDF.T)
    return CameraFound(
        camera=name,
        roll_pitch_yaw_deg=(roll, pitch, yaw),
        position_m=_three(pose.t_m),
        sigma_deg=_three(camera.sigma_deg),
        sigma_m=_three(camera.sigma_m),
        turned_deg=float(np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))),
        moved_m=float(np.linalg.norm(pose.t_m - before.rig_t_camera_m)),
        n_tags=camera.n_sightings,
        n_left_out=camera.n_outliers,
        rms_px=camera.rms_px,
    )


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _document(report: ExtrinsicsReport, found: Extrinsics) -> dict[str, Any]:
    """The report as JSON: poses with their full covariances, tags, doubts."""
    from dataclasses import asdict

    cameras = [
        {**asdict(camera), "covariance_rad_m": found.cameras[camera.camera].covariance.tolist()}
        for camera in report.cameras
    ]
    tags = [
        {"id": tag, "centre_m": pose.t_m.tolist(), "sigma_m": found.tag_sigma_m[tag].tolist()}
        for tag, pose in sorted(found.state.tags.items())
    ]
    return {
        "cameras": cameras,
        "tags": tags,
        "corner_sigma_px": dict(found.sigma_px),
        "tag_scale": found.scale,
        "tag_scale_sigma": found.scale_sigma,
        "doubts": list(report.doubts),
        "notes": list(report.notes),
    }
