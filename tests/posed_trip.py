"""A simulated drive whose track is full poses, as a perfect INS would write them."""

from __future__ import annotations

from pathlib import Path

from geoloc.simulation.simulate import SimulatedDrive
from twin.samples.write_drive import write_driveworks_trip

HEADER = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"


def write_posed_trip(drive: SimulatedDrive, folder: Path) -> None:
    """Write the trip with ``poses.csv`` in place of its GNSS recordings."""
    write_driveworks_trip(drive, folder)
    for recording in folder.glob("gnss*"):
        recording.unlink()
    columns = (getattr(drive.poses, name).tolist() for name in ["epoch_ns", *HEADER.split(",")[1:]])
    rows = [
        f"{t},{lat:.10f},{lon:.10f},{h:.4f},{roll:.5f},{pitch:.5f},{heading:.5f}"
        for t, lat, lon, h, roll, pitch, heading in zip(*columns, strict=True)
    ]
    (folder / "poses.csv").write_text("\n".join([HEADER, *rows]) + "\n", encoding="utf-8")
    with (folder / "drive.toml").open("a", encoding="utf-8") as settings:
        settings.write('\n[poses]\nfile = "poses.csv"\n')
