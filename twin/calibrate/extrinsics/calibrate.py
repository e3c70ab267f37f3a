"""Pictures of tags around the car → a rig file with the cameras where they are."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics import Extrinsics, TagPicture, calibrate_extrinsics
from geoloc.calibration.extrinsics.doubts import doubts, is_determined
from geoloc.calibration_files import read_cameras
from geoloc.cameras import CameraModel
from geoloc.earth.geodesy import rpy_from_rotation
from geoloc.errors import CalibrationError
from geoloc.rig.edit import with_extrinsics
from geoloc.rig.rig import FLU_R_RDF, Rig, rig_from_document
from twin.calibrate.boards.boards import Board
from twin.calibrate.boards.detect import BLURRED_PX, detect
from twin.calibrate.boards.pictures import IMAGE_SUFFIXES, Progress, pictures
from twin.calibrate.camera_files import RIG_NAME, file_name
from twin.calibrate.difference.fits import read_fits
from twin.calibrate.extrinsics.given_rig import GivenRig, read_given_rig
from twin.calibrate.extrinsics.layout import YardLayout, read_layout
from twin.calibrate.extrinsics.picture import draw_extrinsics
from twin.calibrate.extrinsics.tag_corners import TagsFound, find_tags
from twin.calibrate.mounting_files import drive_tables, kalibr_rig, mrcal_mounted, opencv_mounted
from twin.calibrate.result_files import lens_reports
from twin.calibrate.sign_metres import draw_mounted_metres
from twin.drives.folder.sensor_names import named_in
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder

HAND = "hand"
"""Name of the camera that is carried around the car."""
REPORT_NAME, PICTURE_NAME, METRES_NAME = "extrinsics.json", "extrinsics.png", "metres.png"
TABLES_NAME, KALIBR_NAME = "cameras.toml", "kalibr.yaml"


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
    turned_deg, moved_m : float or None
        Against the rig that was given; None where it does not say where the camera sits.
    determined : bool
        Whether the tags settle all of it; else the rig file keeps what it had.
    n_tags, n_left_out : int
        Tags in its pictures, and those of them that did not fit.
    rms_px : float
    """

    camera: str
    roll_pitch_yaw_deg: tuple[float, float, float]
    position_m: tuple[float, float, float]
    sigma_deg: tuple[float, float, float]
    sigma_m: tuple[float, float, float]
    turned_deg: float | None
    moved_m: float | None
    determined: bool
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
    drive : Path or None
        The drive folder that the rig was given as.
    rig_file : str
        The rig's name there.
    drive_tables : str
        What ``[cameras]`` of the drive's ``drive.toml`` has to say now; empty where the rig is another's.
    """

    cameras: tuple[CameraFound, ...]
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    n_pictures: int
    files: tuple[Path, ...]
    drive: Path | None
    rig_file: str
    drive_tables: str


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
        The layout (`twin.calibrate.extrinsics.layout`).
    rig : Path or str
        The intrinsics, and rough poses to start from where they are known: a DriveWorks rig file, a drive
        folder or its ``drive.toml``, or a calibration file (`twin.calibrate.extrinsics.given_rig`).
    out : Path or str
        Folder for ``rig.json`` (the rig with the new poses, all else kept), ``cameras.toml`` (the same for a
        ``drive.toml`` that has ``[cameras]``), Kalibr's and OpenCV's files where they know the cameras'
        models, the report and its picture.
    hand : Path or str, optional
        Calibration file of a camera that was carried around: pictures that name no camera are its own.
    progress : callable, optional
        Called with what is done, how many, of how many.

    Raises
    ------
    CalibrationError, RefusedError
        If an input cannot be used, or no camera's pose is settled; nothing is written then.
    """
    layout = read_layout(_content(tags, "layout"), Path(tags).name)
    rig = Path(rig)
    given = read_given_rig(rig)
    models: dict[str, CameraModel] = {name: camera.model for name, camera in given.rig.cameras.items()}
    if hand is not None:
        models[HAND] = _hand_model(Path(hand))
    files, strangers = _by_camera(Path(images), given.rig, hand is not None)
    shown, notes, blurred = _tag_pictures(files, models, layout, progress)
    found = calibrate_extrinsics(models, shown, layout.tags, nominal=given.nominal, sigmas=layout.sigmas)
    document = given.document
    sentences = (*blurred, *doubts(found))
    settled = [name for name, camera in found.cameras.items() if is_determined(camera)]
    if not settled:
        raise CalibrationError(f"No camera was calibrated, and nothing is written. {' '.join(sentences)}")
    for name in settled:
        pose = found.cameras[name].rig_T_camera
        document = with_extrinsics(document, name, pose.R, pose.t_m, given.rig.source)
    texts = _mounting_texts(rig_from_document(document, given.rig.source), settled, given)
    # The lenses' own uncertainty goes on with the rig, for `calibrate diff` and for the metres.
    texts |= lens_reports(rig if rig.is_dir() else rig.parent, settled)
    names = (RIG_NAME, *texts, REPORT_NAME, PICTURE_NAME, METRES_NAME)
    report = ExtrinsicsReport(
        cameras=tuple(_found(found, name, given) for name in found.cameras),
        doubts=sentences,
        notes=(*given.warnings, *strangers, *notes, *_turned(found.turned), *_left_alone(given, settled)),
        n_pictures=len(shown),
        files=tuple(Path(out) / name for name in names),
        drive=given.drive,
        rig_file=given.rig.source,
        drive_tables=texts.get(TABLES_NAME, ""),
    )
    texts[RIG_NAME] = json.dumps(document, indent=2, ensure_ascii=False) + "\n"
    texts[REPORT_NAME] = json.dumps(_document(report, found), indent=2) + "\n"
    folder = make_folder(out)
    for name, text in texts.items():
        make_folder((folder / name).parent)
        replace_file(folder / name, text.encode())
    draw_extrinsics(found, layout, folder / PICTURE_NAME)
    draw_mounted_metres(read_fits(folder / RIG_NAME), settled, folder / METRES_NAME)
    return report


def _turned(tags: Sequence[int]) -> list[str]:
    if not tags:
        return []
    sentence = (
        f"Tags {', '.join(map(str, tags))} are printed upside down against the corners in the layout"
        " (OpenCV's generator prints AprilTags so): taken as printed."
    )
    return [sentence]


def _left_alone(given: GivenRig, settled: Sequence[str]) -> list[str]:
    names = ", ".join(name for name in given.rig.cameras if name not in settled)
    return [f"{names}: not calibrated, and in {RIG_NAME} as before."] if names else []


def _mounting_texts(rig: Rig, cameras: Sequence[str], given: GivenRig) -> dict[str, str]:
    """Where the cameras sit in the files of others, by file name."""
    texts = {}
    if given.tables and cameras:
        texts[TABLES_NAME] = drive_tables(rig, cameras, given.tables)
    kalibr = kalibr_rig(rig, cameras)
    if kalibr is not None:
        texts[KALIBR_NAME] = kalibr
    for name in cameras:
        camera = rig.camera(name)
        mounted = {"opencv.yaml": opencv_mounted(camera), "cameramodel": mrcal_mounted(camera)}
        texts |= {f"{file_name(name)}.{end}": text for end, text in mounted.items() if text is not None}
    return texts


def _content(path: Path | str, what: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise CalibrationError(
            f"The {what} {path} cannot be read ({error.strerror}): check its name."
        ) from error


def _hand_model(path: Path) -> CameraModel:
    cameras = read_cameras(_content(path, "calibration of the carried camera"), path.name)
    if len(cameras) != 1:
        raise CalibrationError(
            f"{path} holds {len(cameras)} cameras: give the file of the one that was carried."
        )
    return next(iter(cameras.values())).model


class _PictureFile(NamedTuple):
    """One picture: its camera, its file, and its name inside the folder."""

    camera: str
    file: Path
    name: str


def _by_camera(folder: Path, rig: Rig, hand: bool) -> tuple[list[_PictureFile], list[str]]:
    """Every picture of the folder and its sub-folders with the camera that its name names; notes.

    Of a rig with one camera all pictures are that one's where none names it.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder} is no folder: give the one that holds the pictures.")
    files = [*folder.iterdir(), *(f for sub in folder.iterdir() if sub.is_dir() for f in sub.iterdir())]
    inside = {f: f.relative_to(folder) for f in sorted(files) if f.suffix.lower() in IMAGE_SUFFIXES}
    if not inside:
        raise CalibrationError(f"There are no pictures in {folder}: name the folder they are in.")
    named = {f: list(named_in(str(name.with_suffix("")), rig.cameras)) for f, name in inside.items()}
    notes = []
    if len(rig.cameras) == 1 and not hand:
        (only,) = rig.cameras
        others = [f for f, names in named.items() if not names]
        if len(others) == len(named):
            named = {f: [only] for f in named}
        elif others:
            listed = ", ".join(inside[f].as_posix() for f in others)
            notes.append(f"{listed}: left out, since other pictures name {only}, the only camera of the rig.")
            named = {f: names for f, names in named.items() if names}
    for file, names in named.items():
        if len(names) > 1 or not (names or hand):
            raise CalibrationError(
                f"{inside[file].with_suffix('')} names {' and '.join(names) or 'no camera'} of the rig"
                f" ({', '.join(rig.cameras)}): put the camera's name into the name of the picture or its"
                " folder, or give the file of the carried camera's calibration with --hand."
            )
    shown = [_PictureFile(n[0] if n else HAND, f, inside[f].as_posix()) for f, n in named.items()]
    return shown, notes


def _tag_pictures(
    files: Sequence[_PictureFile],
    models: Mapping[str, CameraModel],
    layout: YardLayout,
    progress: Progress | None,
) -> tuple[list[TagPicture], list[str], list[str]]:
    """What pictures show, notes, and which of them are blurred."""
    found, notes, blurred = [], [], []
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
        boards = _board_pictures(grey, name, camera, layout.boards)
        flipped = np.ascontiguousarray(grey[:, ::-1])
        nothing = not len(tags.ids) and not boards
        if tags.mirrored or (nothing and _board_pictures(flipped, name, camera, layout.boards)):
            raise CalibrationError(
                f"{name} shows its tags mirrored: print them the right way round, or do not flip it."
            )
        notes += _tag_notes(name, tags, layout)
        if tags.edge_px > BLURRED_PX:
            blurred.append(
                f"{name} is blurred: the tags' edges are {tags.edge_px:.1f} px wide, where a sharp lens gives"
                " 2 to 3. Its corners are uncertain by more than their residuals say: focus the camera, hold"
                " it still, and take the picture again."
            )
        if nothing:
            notes.append(f"{name} shows no tag or board.")
        if len(tags.ids):
            found.append(TagPicture(name, camera, camera != HAND, tags.ids, tags.corners_px))
        found += boards
    if progress is not None:
        progress("pictures", len(files), len(files))
    return found, notes, blurred


def _tag_notes(name: str, tags: TagsFound, layout: YardLayout) -> list[str]:
    notes = []
    if tags.n_small:
        notes.append(f"{name}: {tags.n_small} tags are too small or too blurred and were left out.")
    strange = sorted(set(tags.ids.tolist()) - set(layout.tags))
    if strange:
        listed = ", ".join(map(str, strange))
        notes.append(f"{name}: tag {listed} is not in the layout and was left out.")
    return notes


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


def _found(result: Extrinsics, name: str, given: GivenRig) -> CameraFound:
    camera, before = result.cameras[name], given.nominal.get(name)
    pose = camera.rig_T_camera
    roll, pitch, yaw = rpy_from_rotation(pose.R @ FLU_R_RDF.T)
    return CameraFound(
        camera=name,
        roll_pitch_yaw_deg=(roll, pitch, yaw),
        position_m=_three(pose.t_m),
        sigma_deg=_three(camera.sigma_deg),
        sigma_m=_three(camera.sigma_m),
        turned_deg=None if before is None else _angle_deg(pose.R @ before.R.T),
        moved_m=None if before is None else float(np.linalg.norm(pose.t_m - before.t_m)),
        determined=is_determined(camera),
        n_tags=camera.n_sightings,
        n_left_out=camera.n_outliers,
        rms_px=camera.rms_px,
    )


def _angle_deg(rotation: FloatArray) -> float:
    return float(np.rad2deg(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0))))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _document(report: ExtrinsicsReport, found: Extrinsics) -> dict[str, Any]:
    """The report as JSON: poses with their full covariances, tags, doubts."""
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
