"""KITTI sequences as drive folders: real drives past signs whose faces were boxed by hand.

The signs' centres were measured by the car's laser scanner (Chawla et al. 2020, on GitHub as
hemangchawla/3d-groundtruth-traffic-sign-positions). Nothing is copied into the project.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from real_drives import (
    POSE_COLUMNS,
    REAL,
    SIGMA_COLUMNS,
    TRONDHEIM,
    RealDrive,
    add_shape,
    new_annotations,
    new_image,
    write_frames,
    write_poses,
    write_settings,
    write_truth,
)

from geoloc.arrays import FloatArray, IntArray
from geoloc.cameras import PinholeCamera
from geoloc.earth.geodesy import rotation_from_rpy, utm33_from_geographic
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera, rig_document
from geoloc.simulation.flat_frame import LocalFrame

CAMERA = "cam2"
SEQUENCES = ("00", "02", "04", "07", "10")
START_NS = 1_781_078_400 * 1_000_000_000
"""The recordings have no clock that is worth keeping: frame 0 is 2026-06-10 08:00 UTC."""
FRAME_NS = 100_000_000
CAMERA_HEIGHT_M = 1.65
CAMERA_AHEAD_M = 1.03
"""Camera 0 before the rear axle: 0.27 m before the laser scanner, that 0.81 m before the INS, and that 0.05 m
behind the axle (Geiger et al. 2013). The side steps of the four longer tracks in bends say 0.6 to 1.0 m."""
CAMERA_DOWN_DEG = 1.0
"""The camera looks below the direction of travel: 0.98 to 1.21 degrees, median of each of the same tracks."""
SIGMAS = (0.10, 0.10, 0.10, 0.20)
"""One sigma of horizontal and vertical position (m), of roll and pitch, and of heading (degrees).

From the tracks themselves, not from the signs: over two seconds of straight driving they move sideways
against their own heading by 0.08 to 0.18 m (rms of each sequence, `side_drift_m`), where a car moves along
it. 0.1 m and 0.2 degrees, each lasting some seconds, make 0.13 m at 10 m/s. Laser scans of one sign that
these poses bring together agree: they scatter by 0.03 to 0.16 m (one sigma) within a single passage."""
DRIFT_FRAMES = 20
SAME_PASSAGE_FRAMES = 50
"""A sign boxed again five seconds later is another passage."""
MIN_FRAMES = 3
"""As in the published evaluations: a sign needs boxes in three frames."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Rectified left colour camera; `p4` is the fourth column of its projection matrix."""

    width_px: int
    height_px: int
    f_px: float
    cx_px: float
    cy_px: float
    p4: tuple[float, float, float]

    def position_m(self) -> FloatArray:
        """Where it sits in camera 0: ``P = K [I | t]``, and the centre is ``-t``."""
        x, y, z = self.p4
        return -np.array([(x - self.cx_px * z) / self.f_px, (y - self.cy_px * z) / self.f_px, z])


_OCTOBER = Intrinsics(1241, 376, 718.856, 607.1928, 185.2157, (45.38225, -0.1130887, 0.003779761))
_SEPTEMBER = Intrinsics(1226, 370, 707.0912, 601.8873, 183.1104, (46.88783, 0.1178601, 0.006203223))


@dataclass(frozen=True, slots=True)
class Boxes:
    """Boxes of one sign, in order of frames: ``left, top, right, bottom``, whole pixels inside the box."""

    frame: IntArray
    box_px: FloatArray


def kitti_drives(folder: Path, source: Path = REAL / "kitti_signs") -> list[RealDrive]:
    """Write every sequence as a drive folder ``folder/kitti-NN`` with its truth beside it.

    Returns
    -------
    list of RealDrive
        Objects are named ``NN-sign``: unique over all sequences.
    """
    return [_drive(folder / f"kitti-{sequence}", sequence, source) for sequence in SEQUENCES]


def sign_centres(sequence: str, source: Path) -> tuple[dict[int, FloatArray], dict[int, IntArray]]:
    """Centre of each sign in the frame of the first camera 0, and the frames whose scans it comes from.

    Scans of the same sign are averaged.
    """
    poses = camera_poses(sequence, source)
    path = source / sequence / f"kitti{sequence}_sign_position_coordinates_rel.txt"
    places: dict[int, list[FloatArray]] = {}
    frames: dict[int, list[int]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file, delimiter=";"):
            frame, sign = int(row["imageidx"]), int(row["gt_id"])
            place = np.array([float(row[axis]) for axis in "xyz"])
            places.setdefault(sign, []).append(poses[frame, :, :3] @ place + poses[frame, :, 3])
            frames.setdefault(sign, []).append(frame)
    return (
        {sign: np.mean(many, axis=0) for sign, many in places.items()},
        {sign: np.array(many) for sign, many in frames.items()},
    )


def sign_places(sequence: str, source: Path) -> dict[int, FloatArray]:
    """Latitude, longitude and ellipsoidal height ``(3,)`` of each sign's centre, as set down in Norway."""
    centres, _ = sign_centres(sequence, source)
    return {
        sign: np.array(_frame().geographic_from_enu(centre @ _enu_R_world().T))
        for sign, centre in centres.items()
    }


def camera_poses(sequence: str, source: Path) -> FloatArray:
    """Camera 0 to the first camera 0, float64 (frames, 3, 4), right-down-forward."""
    return np.loadtxt(source / sequence / "poses.txt").reshape(-1, 3, 4)


def sign_boxes(sequence: str, source: Path) -> dict[int, Boxes]:
    """Boxes of the passage in which a sign was scanned; signs with fewer than three are left out.

    Only that passage has a truth: the poses of another, minutes later, are off by up to 0.5 m against it.
    """
    _, scanned = sign_centres(sequence, source)
    found: dict[int, list[tuple[int, list[float]]]] = {}
    with (source / "associated_boxes.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["seq"] == sequence:
                corners = [float(row[name]) for name in ("x1", "y1", "x3", "y3")]
                found.setdefault(int(row["gt_id"]), []).append((int(row["frame"]), corners))
    kept = {}
    for sign, rows in sorted(found.items()):
        frame, box = np.array([f for f, _ in rows]), np.array([b for _, b in rows])
        passages = np.split(np.arange(frame.size), np.flatnonzero(np.diff(frame) > SAME_PASSAGE_FRAMES) + 1)
        own = min(passages, key=lambda p: int(np.abs(frame[p][:, None] - scanned[sign]).min()))
        if own.size >= MIN_FRAMES:
            kept[sign] = Boxes(frame[own], box[own])
    return kept


def side_drift_m(poses: FloatArray) -> FloatArray:
    """How far poses move sideways against their own heading in the two seconds about each frame.

    A car moves along its heading, so this is an error of position or heading. The median slant is taken off:
    the camera need not look straight ahead.

    Parameters
    ----------
    poses : float64 (frames, 3, 4)
        Of the camera, as `camera_poses` gives them.

    Returns
    -------
    float64 (frames,)
        Metres, to the right; NaN within a second of either end, and where the car moves slower than 3 m/s or
        turns by more than 3 degrees a second: there slip and the stated place of the axle matter.
    """
    from scipy.spatial.transform import Rotation

    before, after = poses[:-1, :, :3], poses[1:, :, :3]
    step = np.einsum("nji,nj->ni", before, np.diff(poses[:, :, 3], axis=0))
    turn = Rotation.from_matrix(np.swapaxes(before, 1, 2) @ after).as_rotvec()[:, 1]
    # What the camera moves sideways because it sits before the axle, which cannot.
    sideways = step[:, 0] - turn * (CAMERA_AHEAD_M + step[:, 2] / 2.0)
    side, ahead, turned = (
        np.convolve(values, np.ones(DRIFT_FRAMES), "valid") for values in (sideways, step[:, 2], np.abs(turn))
    )
    seconds = DRIFT_FRAMES * FRAME_NS / 1e9
    clear = (ahead > 3.0 * seconds) & (turned < np.radians(3.0) * seconds)
    drift = np.full(len(poses), np.nan)
    half = DRIFT_FRAMES // 2
    drift[half : half + len(side)] = np.where(
        clear, side - np.median(side[clear] / ahead[clear]) * ahead, np.nan
    )
    return drift


def horizontal_sigma_m(poses: FloatArray) -> FloatArray:
    """One sigma of each pose's place: that of `SIGMAS`, wider where the track steps aside.

    An INS states such steps itself, when GNSS comes back after a bridge; here the track shows them. Only what
    is beyond three sigmas of the usual drift counts.
    """
    drift = np.nan_to_num(np.abs(side_drift_m(poses)))
    return np.hypot(SIGMAS[0], np.where(drift > 3.0 * stated_drift_m(), drift, 0.0))


def stated_drift_m() -> float:
    """One sigma of `side_drift_m` that `SIGMAS` promise at 10 m/s.

    A process of one sigma s that lasts two seconds changes by 1.12 s in two seconds; 20 m are driven then.
    """
    return float(np.hypot(1.12 * SIGMAS[0], 20.0 * np.radians(SIGMAS[3])))


def intrinsics_of(sequence: str) -> Intrinsics:
    """Intrinsics of the day on which the sequence was driven."""
    return _OCTOBER if sequence in {"00", "01", "02"} else _SEPTEMBER


def _drive(folder: Path, sequence: str, source: Path) -> RealDrive:
    folder.mkdir(parents=True)
    intrinsics, poses = intrinsics_of(sequence), camera_poses(sequence, source)
    (folder / "rig.json").write_text(json.dumps(rig_document(_rig(intrinsics))), encoding="utf-8")
    write_poses(folder / "poses.csv", (*POSE_COLUMNS, *SIGMA_COLUMNS), _pose_rows(poses))
    write_frames(folder / f"{CAMERA}.timestamps.csv", (START_NS + i * FRAME_NS for i in range(len(poses))))
    boxes = sign_boxes(sequence, source)
    _write_boxes(folder / f"{CAMERA}.xml", sequence, intrinsics, boxes)
    write_settings(folder, f"KITTI {sequence}", [CAMERA])
    places = sign_places(sequence, source)
    truth = folder.parent / f"{folder.name}-truth.csv"
    write_truth(truth, ((object_name(sequence, sign), "sign", *_utm33(places[sign])) for sign in boxes))
    return RealDrive(folder, truth)


def object_name(sequence: str, sign: int) -> str:
    """Return the object's id in annotations and truth."""
    return f"{sequence}-{sign:02d}"


def _rig(intrinsics: Intrinsics) -> Rig:
    f, cx, cy = intrinsics.f_px, intrinsics.cx_px, intrinsics.cy_px
    model = PinholeCamera(intrinsics.width_px, intrinsics.height_px, f, f, cx, cy)
    rotation = _rig_R_camera()
    position = _camera0_in_rig_m() + rotation @ intrinsics.position_m()
    return Rig({CAMERA: RigCamera(CAMERA, model, rotation, position)}, {}, "KITTI")


def _rig_R_camera() -> FloatArray:
    return np.asarray(rotation_from_rpy(0.0, CAMERA_DOWN_DEG, 0.0) @ FLU_R_RDF)


def _camera0_in_rig_m() -> FloatArray:
    return np.array([CAMERA_AHEAD_M, 0.0, CAMERA_HEIGHT_M])


def _enu_R_world() -> FloatArray:
    """First camera 0 to east, north, up, where the car stands level and heads north."""
    enu_R_rig = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return enu_R_rig @ _rig_R_camera()


def rig_in_enu(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the rig is by camera poses ``(n, 3, 4)``, and its axes as columns: ``(n, 3)``, ``(n, 3, 3)``.

    On the ground below the rear axle; east, north and up about the first camera.
    """
    enu_R_rig = _enu_R_world() @ poses[:, :, :3] @ _rig_R_camera().T
    return poses[:, :, 3] @ _enu_R_world().T - enu_R_rig @ _camera0_in_rig_m(), enu_R_rig


def _pose_rows(poses: FloatArray) -> Iterable[tuple[str, ...]]:
    """Poses of the rig, ISO 8855, each about its own vertical."""
    from scipy.spatial.transform import Rotation

    enu, enu_R_rig = rig_in_enu(poses)
    lat, lon, height = _frame().geographic_from_enu(enu)
    local = _frame().rotation_local_from_frame(lat, lon) @ enu_R_rig
    yaw, pitch, roll = Rotation.from_matrix(local).as_euler("ZYX", degrees=True).T
    sigma_m = horizontal_sigma_m(poses)
    others = tuple(str(sigma) for sigma in SIGMAS[1:])
    for i in range(len(poses)):
        place = (f"{lat[i]:.10f}", f"{lon[i]:.10f}", f"{height[i]:.4f}")
        attitude = (f"{roll[i]:.6f}", f"{pitch[i]:.6f}", f"{(90.0 - yaw[i]) % 360.0:.6f}")
        yield (str(START_NS + i * FRAME_NS), *place, *attitude, f"{sigma_m[i]:.3f}", *others)


def _utm33(place: FloatArray) -> tuple[float, float]:
    east, north = utm33_from_geographic(place[0], place[1])
    return float(east), float(north)


def _frame() -> LocalFrame:
    return LocalFrame(*TRONDHEIM, 100.0)


def _write_boxes(path: Path, sequence: str, intrinsics: Intrinsics, boxes: dict[int, Boxes]) -> None:
    by_frame: dict[int, list[tuple[int, FloatArray]]] = {}
    for sign, own in boxes.items():
        for frame, box in zip(own.frame, own.box_px, strict=True):
            by_frame.setdefault(int(frame), []).append((sign, box))
    root = new_annotations()
    for frame, rows in sorted(by_frame.items()):
        image = new_image(root, frame, intrinsics.width_px, intrinsics.height_px)
        for sign, box in rows:
            # CVAT counts from the corner of the first pixel; what sticks out of the picture is cut there.
            limit = np.array([intrinsics.width_px, intrinsics.height_px] * 2)
            left, top, right, bottom = (f"{x:.2f}" for x in np.clip(box + 0.5, 0.0, limit))
            add_shape(
                image, "box", "sign", object_name(sequence, sign), xtl=left, ytl=top, xbr=right, ybr=bottom
            )
    ET.ElementTree(root).write(path, encoding="utf-8")
