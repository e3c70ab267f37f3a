"""Real recordings as drive folders: an Argoverse 2 log here, KITTI sequences in `real_kitti`.

Nothing of them is copied into the project: a folder is made where the caller says, each time anew.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from geoloc.earth.geodesy import geographic_from_enu, utm33_from_geographic

if TYPE_CHECKING:
    import pandas as pd

REAL = Path(__file__).resolve().parents[2] / "shared" / "real"
"""Where the recordings lie, if they do: beside the checkout."""
TRONDHEIM = (63.4085, 10.4520)
"""Latitude and longitude where a recording from another country is set down, unless the caller says."""

EGO_HEIGHT_M = 0.324
"""The log's ego frame lies this far over the ground; the rig frame lies on it."""
EPOCH_SHIFT_NS = 1_465_000_000 * 1_000_000_000
"""The log counts from 1980: brought into 2026."""
POSE_COLUMNS = (
    "time_ns",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "roll_deg",
    "pitch_deg",
    "heading_deg",
)
SIGMA_COLUMNS = ("sigma_horizontal_m", "sigma_vertical_m", "sigma_roll_pitch_deg", "sigma_heading_deg")


@dataclass(frozen=True, slots=True)
class RealDrive:
    """A drive folder and the surveyed truth of its objects."""

    folder: Path
    truth: Path


def argoverse_drive(
    folder: Path,
    anchor: tuple[float, float] = TRONDHEIM,
    source: Path = REAL / "av2",
    *,
    noise_px: float = 0.0,
) -> RealDrive:
    """Write the Argoverse log: poses.csv, a pinhole rig of nine cameras, and the feet as CVAT points.

    Parameters
    ----------
    folder : Path
        Made; the truth is written beside it.
    anchor : (float, float)
        Latitude and longitude where the log's first pose is set down.
    source : Path
    noise_px : float
        One sigma of what is added to the published pixels, which are exact: what an annotator would.

    Returns
    -------
    RealDrive
    """
    import pandas as pd

    folder.mkdir(parents=True)
    poses = pd.read_feather(source / "city_SE3_egovehicle.feather")
    seen = argoverse_feet(source)
    _argoverse_poses(poses, anchor, folder / "poses.csv")
    _argoverse_rig(source / "calibration", folder / "rig.json")
    error_px = np.random.default_rng(0).normal(0.0, noise_px, (len(seen), 2))
    seen = seen.assign(u_px=seen.u_px + error_px[:, 0], v_px=seen.v_px + error_px[:, 1])
    cameras = sorted(seen.camera.unique())
    for camera in cameras:
        _argoverse_camera(seen[seen.camera == camera], camera, folder)
    write_settings(folder, "Argoverse 7fab2350", cameras)
    truth = folder.parent / f"{folder.name}-truth.csv"
    write_truth(truth, _argoverse_truth(seen, anchor))
    return RealDrive(folder, truth)


def argoverse_feet(source: Path) -> pd.DataFrame:
    """Return the exact pixels; ``east_m``, ``north_m``: the feet from the log's first pose, ``object``: id.

    The city frame is taken as local east, north, up.
    """
    import pandas as pd

    seen = pd.read_csv(source / "pixel_observations.csv")
    first = pd.read_feather(source / "city_SE3_egovehicle.feather").iloc[0]
    return seen.assign(
        object=seen.track_uuid.str[:8],
        east_m=seen.base_city_x - float(first.tx_m),
        north_m=seen.base_city_y - float(first.ty_m),
    )


def write_poses(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Write ``poses.csv``."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(header)
        out.writerows(rows)


def write_frames(path: Path, epochs_ns: Iterable[int]) -> None:
    """Write the frame times of one camera, frames counted from 0."""
    rows = [f"{i},{epoch}\n" for i, epoch in enumerate(epochs_ns)]
    path.write_text("frame,time_ns\n" + "".join(rows), encoding="utf-8")


def add_shape(image: ET.Element, kind: str, label: str, object_id: str, **place: str) -> None:
    """Add one CVAT shape, tied to its object by the attribute that twin reads."""
    shape = ET.SubElement(image, kind, {"label": label, "occluded": "0", **place})
    ET.SubElement(shape, "attribute", name="object").text = object_id


def new_image(root: ET.Element, frame: int, width: int, height: int) -> ET.Element:
    """Add one CVAT image; its name says which frame it is."""
    name = f"frame_{frame:06d}.jpg"
    return ET.SubElement(root, "image", id=str(frame), name=name, width=str(width), height=str(height))


def new_annotations() -> ET.Element:
    """Return an empty CVAT document."""
    root = ET.Element("annotations")
    ET.SubElement(root, "version").text = "1.1"
    return root


def write_settings(folder: Path, name: str, cameras: Sequence[str]) -> None:
    """Write ``drive.toml`` for poses.csv, ``<camera>.timestamps.csv`` and ``<camera>.xml``.

    All rows at once: KITTI's sensors have a global shutter, and the Argoverse pixels were projected.
    """
    lines = [f'name = "{name}"', 'rig = "rig.json"', "rolling_shutter_ms = 0.0"]
    lines += ["[poses]", 'file = "poses.csv"', "[timestamps]"]
    lines += [f'{camera} = "{camera}.timestamps.csv"' for camera in cameras]
    lines += ["[annotations]", *(f'{camera} = "{camera}.xml"' for camera in cameras)]
    (folder / "drive.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_truth(path: Path, rows: Iterable[tuple[str, str, float, float]]) -> None:
    """Write object, label and EPSG:25833 as ``twin evaluate`` reads them."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["object", "label", "easting", "northing"])
        out.writerows([name, label, f"{east:.4f}", f"{north:.4f}"] for name, label, east, north in rows)


def _argoverse_poses(poses: pd.DataFrame, anchor: tuple[float, float], path: Path) -> None:
    """Write the rig's origin (on the ground) and ISO 8855 attitude."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat(poses[["qx", "qy", "qz", "qw"]].to_numpy())
    city = poses[["tx_m", "ty_m", "tz_m"]].to_numpy()
    position = city - rotation.apply([0.0, 0.0, EGO_HEIGHT_M])
    lat, lon = geographic_from_enu(*anchor, *(position[:, :2] - city[0, :2]).T)
    yaw, pitch, roll = rotation.as_euler("ZYX", degrees=True).T
    heading = (90.0 - yaw) % 360.0
    stamps = poses.timestamp_ns.to_numpy() + EPOCH_SHIFT_NS
    rows = (
        (str(t), f"{a:.10f}", f"{b:.10f}", f"{h:.4f}", f"{r:.6f}", f"{p:.6f}", f"{y:.6f}")
        for t, a, b, h, r, p, y in zip(stamps, lat, lon, position[:, 2], roll, pitch, heading, strict=True)
    )
    write_poses(path, POSE_COLUMNS, rows)


def _argoverse_rig(calibration: Path, path: Path) -> None:
    """Write the nine cameras as DriveWorks pinholes.

    The observations in the CSV were projected without distortion, so the rig has none either.
    """
    import pandas as pd

    intrinsics = pd.read_feather(calibration / "intrinsics.feather").set_index("sensor_name")
    extrinsics = pd.read_feather(calibration / "egovehicle_SE3_sensor.feather").set_index("sensor_name")
    sensors: list[dict[str, Any]] = []
    for name, k in intrinsics.iterrows():
        e = extrinsics.loc[str(name)]
        properties = {"Model": "pinhole", "width": str(int(k.width_px)), "height": str(int(k.height_px))}
        properties |= {key: repr(float(k[f"{key}_px"])) for key in ("fx", "fy", "cx", "cy")}
        place = {"quaternion": [e.qx, e.qy, e.qz, e.qw], "t": [e.tx_m, e.ty_m, e.tz_m + EGO_HEIGHT_M]}
        sensors.append(
            {"name": name, "protocol": "camera.virtual", "properties": properties, "sensor2Rig": place}
        )
    path.write_text(json.dumps({"rig": {"sensors": sensors, "vehicle": {}}, "version": 7}), encoding="utf-8")


def _argoverse_camera(seen: pd.DataFrame, camera: str, folder: Path) -> None:
    """Write one camera's timestamps (a frame for each epoch) and its CVAT points."""
    epochs = np.sort(seen.timestamp_ns.unique())
    write_frames(folder / f"{camera}.timestamps.csv", epochs + EPOCH_SHIFT_NS)
    root = new_annotations()
    width, height = (1550, 2048) if camera == "ring_front_center" else (2048, 1550)
    for i, epoch in enumerate(epochs):
        image = new_image(root, i, width, height)
        for row in seen[seen.timestamp_ns == epoch].itertuples():
            # CVAT counts from the corner of the first pixel.
            points = f"{row.u_px + 0.5:.2f},{row.v_px + 0.5:.2f}"
            add_shape(image, "points", str(row.category), str(row.object), points=points)
    ET.ElementTree(root).write(folder / f"{camera}.xml", encoding="utf-8")


def _argoverse_truth(
    seen: pd.DataFrame, anchor: tuple[float, float]
) -> Iterable[tuple[str, str, float, float]]:
    for name, rows in seen.groupby("object"):
        place = geographic_from_enu(*anchor, float(rows.east_m.median()), float(rows.north_m.median()))
        east, north = utm33_from_geographic(*place)
        yield str(name), str(rows.category.iloc[0]), float(east), float(north)
