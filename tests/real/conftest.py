"""Real recordings as drives. Nothing of them is copied into the project: folders are made while tests run."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from geoloc.geodesy import geographic_from_enu, geographic_from_utm33, utm33_from_geographic
from nvdb.skilt import skilt_from_les_v4

if TYPE_CHECKING:
    import pandas as pd

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "real"

BOLLARD = "c46bad07"
"""The object, seen 180 times, that is set down beside a recorded plate of Oslo."""
BESIDE_M = 0.5
"""How far east of the plate."""
EGO_HEIGHT_M = 0.324
"""The log's ego frame lies this far over the ground; the rig frame lies on it."""
EPOCH_SHIFT_NS = 1_465_000_000 * 1_000_000_000
"""The log counts from 1980: brought into 2026."""


@dataclass(frozen=True)
class RealDrive:
    """A drive folder and the surveyed truth of its objects."""

    folder: Path
    truth: Path
    plate_id: int
    """The Oslo plate beside which the log is set down."""


def _real(name: str) -> Path:
    folder = REAL / name
    if not folder.exists():
        pytest.skip(f"the real data {name} are not beside the checkout")
    return folder


@pytest.fixture(scope="session")
def oslo_pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded Oslo pages alone, as the replay server takes them: a folder of links."""
    source = _real("nvdb/les_v4_live_2026-09/signs-0301-page1.json")
    folder = tmp_path_factory.mktemp("oslo")
    (folder / source.name).symlink_to(source)
    return folder


@pytest.fixture(scope="session")
def av2_drive(tmp_path_factory: pytest.TempPathFactory) -> RealDrive:
    """The Argoverse log as a generic drive folder: poses.csv, a pinhole rig, CVAT points."""
    pd = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow", reason="reading the log's feather files needs pyarrow")
    source = _real("av2")
    folder = tmp_path_factory.mktemp("argoverse") / "7fab2350"
    folder.mkdir()
    poses = pd.read_feather(source / "city_SE3_egovehicle.feather")
    seen = pd.read_csv(source / "pixel_observations.csv")
    origin = (float(poses.tx_m.iloc[0]), float(poses.ty_m.iloc[0]))
    plate_id, anchor = _anchor(seen, origin)
    _write_poses(poses, origin, anchor, folder / "poses.csv")
    _write_rig(source / "calibration", folder / "rig.json")
    cameras = sorted(seen.camera.unique())
    for camera in cameras:
        _write_camera(seen[seen.camera == camera], camera, folder)
    _write_settings(cameras, folder / "drive.toml")
    truth = folder.parent / "truth.csv"
    _write_truth(seen, origin, anchor, truth)
    return RealDrive(folder, truth, plate_id)


def _anchor(seen: pd.DataFrame, origin: tuple[float, float]) -> tuple[int, tuple[float, float]]:
    """Where the log's origin must lie in Oslo so that one bollard stands beside a recorded plate."""
    page = json.loads((_real("nvdb/les_v4_live_2026-09/signs-0301-page1.json")).read_text(encoding="utf-8"))
    plate = skilt_from_les_v4(page["objekter"][0], 96)
    assert plate.own_geometry
    assert plate.position is not None
    lat, lon = geographic_from_utm33(plate.position.east_m, plate.position.north_m)
    rows = seen[seen.track_uuid.str.startswith(BOLLARD)]
    east = float(rows.base_city_x.median()) - origin[0] - BESIDE_M
    north = float(rows.base_city_y.median()) - origin[1]
    place = geographic_from_enu(lat, lon, -east, -north)
    return plate.nvdb_id, (float(place[0]), float(place[1]))


def _rotations(frame: pd.DataFrame) -> Any:
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(frame[["qx", "qy", "qz", "qw"]].to_numpy())


def _write_poses(
    poses: pd.DataFrame, origin: tuple[float, float], anchor: tuple[float, float], path: Path
) -> None:
    """Write the rig's origin (on the ground) and ISO 8855 attitude; the city frame is taken as local ENU."""
    rotation = _rotations(poses)
    position = poses[["tx_m", "ty_m", "tz_m"]].to_numpy() - rotation.apply([0.0, 0.0, EGO_HEIGHT_M])
    lat, lon = geographic_from_enu(*anchor, position[:, 0] - origin[0], position[:, 1] - origin[1])
    yaw, pitch, roll = rotation.as_euler("ZYX", degrees=True).T
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(
            ["time_ns", "latitude_deg", "longitude_deg", "height_m", "roll_deg", "pitch_deg", "heading_deg"]
        )
        for i, stamp in enumerate(poses.timestamp_ns):
            place = (f"{lat[i]:.10f}", f"{lon[i]:.10f}", f"{position[i, 2]:.4f}")
            attitude = (f"{roll[i]:.6f}", f"{pitch[i]:.6f}", f"{(90.0 - yaw[i]) % 360.0:.6f}")
            out.writerow([stamp + EPOCH_SHIFT_NS, *place, *attitude])


def _write_rig(calibration: Path, path: Path) -> None:
    """Write the nine cameras as DriveWorks pinholes.

    The observations in the CSV were projected without distortion, so the rig has none either.
    """
    import pandas as pd

    intrinsics = pd.read_feather(calibration / "intrinsics.feather").set_index("sensor_name")
    extrinsics = pd.read_feather(calibration / "egovehicle_SE3_sensor.feather").set_index("sensor_name")
    sensors = []
    for name, k in intrinsics.iterrows():
        e = extrinsics.loc[name]
        properties = {"Model": "pinhole", "width": str(int(k.width_px)), "height": str(int(k.height_px))}
        properties |= {key: repr(float(k[f"{key}_px"])) for key in ("fx", "fy", "cx", "cy")}
        sensors.append(
            {
                "name": name,
                "protocol": "camera.virtual",
                "properties": properties,
                "sensor2Rig": {
                    "quaternion": [e.qx, e.qy, e.qz, e.qw],
                    "t": [e.tx_m, e.ty_m, e.tz_m + EGO_HEIGHT_M],
                },
            }
        )
    path.write_text(json.dumps({"rig": {"sensors": sensors, "vehicle": {}}, "version": 7}), encoding="utf-8")


def _write_camera(seen: pd.DataFrame, camera: str, folder: Path) -> None:
    """Write one camera's timestamps (a frame for each epoch) and its CVAT points."""
    epochs = np.sort(seen.timestamp_ns.unique())
    rows = [f"{i},{epoch + EPOCH_SHIFT_NS}" for i, epoch in enumerate(epochs)]
    (folder / f"{camera}.timestamps.csv").write_text("frame,time_ns\n" + "\n".join(rows) + "\n")
    root = ET.Element("annotations")
    ET.SubElement(root, "version").text = "1.1"
    width, height = (1550, 2048) if camera == "ring_front_center" else (2048, 1550)
    for i, epoch in enumerate(epochs):
        image = ET.SubElement(
            root, "image", id=str(i), name=f"frame_{i:06d}.jpg", width=str(width), height=str(height)
        )
        for row in seen[seen.timestamp_ns == epoch].itertuples():
            # CVAT counts from the corner of the first pixel.
            xy = f"{row.u_px + 0.5:.2f},{row.v_px + 0.5:.2f}"
            points = ET.SubElement(image, "points", label=str(row.category), points=xy, occluded="0")
            ET.SubElement(points, "attribute", name="object").text = str(row.track_uuid)[:8]
    ET.ElementTree(root).write(folder / f"{camera}.xml", encoding="utf-8")


def _write_settings(cameras: list[str], path: Path) -> None:
    lines = [
        'name = "Argoverse 7fab2350"',
        'rig = "rig.json"',
        "[poses]",
        'file = "poses.csv"',
        "[timestamps]",
    ]
    lines += [f'{camera} = "{camera}.timestamps.csv"' for camera in cameras]
    lines += ["[annotations]", *(f'{camera} = "{camera}.xml"' for camera in cameras)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_truth(
    seen: pd.DataFrame, origin: tuple[float, float], anchor: tuple[float, float], path: Path
) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["object", "label", "easting", "northing"])
        for track, rows in seen.groupby("track_uuid"):
            x, y = float(rows.base_city_x.median()) - origin[0], float(rows.base_city_y.median()) - origin[1]
            east, north = utm33_from_geographic(*geographic_from_enu(*anchor, x, y))
            out.writerow([str(track)[:8], rows.category.iloc[0], f"{float(east):.4f}", f"{float(north):.4f}"])
