"""A simulated drive through bends, and what its own sensors would say of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import metres_per_degree
from geoloc.simulation.simulate import SimulatedDrive
from twin.drives.folder.drive_toml import DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.motion.read import MotionOfDrive, read_motion

WHEELBASE_M = 2.7


@dataclass(frozen=True)
class MovingCar:
    """The truth at every frame, and the folder of the drive."""

    drive: SimulatedDrive
    trip: Path

    @property
    def epoch_ns(self) -> IntArray:
        """Of the frames."""
        return self.drive.frame_epoch_ns

    @property
    def speed_mps(self) -> FloatArray:
        """Speed of the rig's origin."""
        poses = self.drive.poses
        east_m, north_m = metres_per_degree(poses.latitude_deg)
        place = np.column_stack([poses.longitude_deg * east_m.mean(), poses.latitude_deg * north_m.mean()])
        return np.hypot(*np.gradient(place, self.seconds, axis=0).T)

    @property
    def turn_rad_s(self) -> FloatArray:
        """Rate of turn, to the left."""
        return -np.gradient(np.unwrap(np.radians(self.drive.poses.heading_deg)), self.seconds)

    @property
    def wheel_rad(self) -> FloatArray:
        """Angle of the front wheels, to the left."""
        return np.arctan(WHEELBASE_M * self.turn_rad_s / np.maximum(self.speed_mps, 1.0))

    @property
    def seconds(self) -> FloatArray:
        """Since the first frame."""
        return (self.epoch_ns - self.epoch_ns[0]) / 1e9

    def table(self, path: Path, *, zero_ns: int = 0, late_s: float = 0.0) -> Path:
        """Write a CSV as a logger might: seconds, km/h, degrees a second and a steering wheel's degrees."""
        lines = ["t_s,v_kmh,yaw_dps,steer_deg"]
        columns = (
            3.6 * self.speed_mps,
            np.degrees(self.turn_rad_s),
            15.0 * np.degrees(self.wheel_rad),
        )
        for epoch_ns, *row in zip(self.epoch_ns.tolist(), *columns, strict=True):
            t_ns = epoch_ns - zero_ns + round(late_s * 1e9)
            lines.append(",".join([f"{t_ns // 10**9}.{t_ns % 10**9:09d}", *(f"{v:.6f}" for v in row)]))
        path.write_text("\n".join(lines) + "\n")
        return path


TABLE = {
    "file": '"can.csv"',
    "time": '"t_s"',
    "time_unit": '"s"',
    "speed": '"v_kmh"',
    "speed_unit": '"km/h"',
    "turn_rate": '"yaw_dps"',
    "turn_rate_unit": '"deg/s"',
    "wheel_angle": '"steer_deg"',
    "wheel_angle_unit": '"deg"',
    "steering_ratio": "15.0",
    "wheelbase_m": str(WHEELBASE_M),
}
"""What drive.toml says of the table that `MovingCar.table` writes."""


def settings_of(**keys: str) -> DriveSettings:
    """Settings with one source of motion."""
    lines = "\n".join(f"{key} = {value}" for key, value in keys.items())
    return read_settings(f"[motion]\n{lines}\n".encode())


def motion_of(car: MovingCar, settings: DriveSettings, notes: ReadingNotes | None = None) -> MotionOfDrive:
    """Read the motion in the folder of a drive, beside its fixes."""
    rig = (car.trip / "rig.json").read_text()
    return read_motion(DriveFolder(car.trip), settings.motion, rig, car.drive.gnss, notes or ReadingNotes())


def nearly(values: FloatArray, truth: FloatArray, within: float) -> bool:
    """Whether values are as they were written: to the last digit of the file."""
    return len(values) == len(truth) and float(np.abs(values - truth).max()) < within
