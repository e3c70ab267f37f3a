"""Small drives, written file by file with numbers of their own."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce
from pathlib import Path
from typing import Any

import pytest
from board_drive import BoardDrive, Networks

from twin.samples.simulation import simulate

WIDE, NARROW = "C3_wide", "C1_narrow"
WIDTH, HEIGHT = 1280, 800
START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * 1_000_000_000
LINK_DELAY_NS = 78_000_000
FRAME_NS = 100_000_000


def sensor(name: str, protocol: str, parameter: str, t: list[float], **properties: str) -> dict[str, Any]:
    """One sensor of a rig file."""
    return {
        "name": name,
        "protocol": protocol,
        "parameter": parameter,
        "properties": properties or None,
        "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 2.0 if properties else 0.0, 0.0], "t": t},
    }


def camera(name: str, **changes: str) -> dict[str, Any]:
    """An f-theta camera of 0.001 rad a pixel."""
    properties = {
        "Model": "ftheta",
        "cx": "639.5",
        "cy": "399.5",
        "width": str(WIDTH),
        "height": str(HEIGHT),
        "bw-poly": "0 0.001 0 0 0 ",
    } | changes
    files = f"video={name}.h264,timestamp={name}.h264.timestamps"
    return sensor(name, "camera.virtual", files, [1.8, 0.0, 1.4], **properties)


def antenna(name: str, t: list[float]) -> dict[str, Any]:
    """A GNSS antenna whose recording is named as on the real car."""
    return sensor(name, "gps.virtual", f"file={name.replace(':', '_')}.bin", t)


@dataclass(frozen=True)
class Maker:
    """Makes the files of a drive: ten seconds northwards, fixes at 5 Hz, frames at 10 Hz."""

    wide: str = WIDE
    narrow: str = NARROW
    size: tuple[int, int] = (WIDTH, HEIGHT)
    start_ns: int = START_NS

    def rig(self, *sensors: dict[str, Any]) -> dict[str, Any]:
        """Build a rig document; by default two cameras and two antennas."""
        default = (
            camera(WIDE),
            camera(NARROW),
            antenna("gnss50:vehicle", [1.0, 0.5, 1.6]),
            antenna("gnss52:vehicle", [1.0, -0.5, 1.6]),
        )
        return {"rig": {"sensors": list(sensors or default), "vehicle": {}}, "version": 7}

    def camera(self, name: str, **changes: str) -> dict[str, Any]:
        """Build one camera of a rig document."""
        return camera(name, **changes)

    def antenna(self, name: str, t: list[float]) -> dict[str, Any]:
        """Build one antenna of a rig document."""
        return antenna(name, t)

    def sentence(self, body: str, host_us: int | None = None) -> str:
        """Put dollar, checksum and host stamp around a sentence, as the real car writes it."""
        checksum = reduce(lambda total, char: total ^ ord(char), body, 0)
        return f"${body}*{checksum:02X}" + ("" if host_us is None else f" {host_us}") + "\r\n"

    def gga(self, epoch_ns: int, *, host: bool = True, delay_ns: int = LINK_DELAY_NS, **changes: str) -> str:
        """One GGA line, 63.42° N 10.4° E, ellipsoidal height 80 m."""
        moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=UTC)
        field = {
            "time": f"{moment:%H%M%S}.{epoch_ns // 10_000_000 % 100:02d}",
            "lat": "6325.2000000",
            "ns": "N",
            "lon": "01024.0000000",
            "ew": "E",
            "quality": "4",
            "altitude": "80.00",
            "separation": "0.0",
        } | changes
        body = (
            f"GPGGA,{field['time']},{field['lat']},{field['ns']},{field['lon']},{field['ew']},{field['quality']}"
            f",14,1.1,{field['altitude']},M,{field['separation']},M,0.9,0246"
        )
        return self.sentence(body, (epoch_ns + delay_ns) // 1000 if host else None)

    def nmea(self, *, host: bool = True, start_ns: int = START_NS, lon: str = "01024.0000000") -> str:
        """50 fixes at 5 Hz that move north by 1e-4 minutes each, with an RMC sentence for the date."""
        lines = []
        for i in range(50):
            epoch_ns = start_ns + i * 200_000_000
            moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=UTC)
            rmc = f"GPRMC,{moment:%H%M%S}.00,A,6325.2,N,01024.0,E,1.0,0.0,{moment:%d%m%y},,,D"
            lines.append(self.sentence(rmc, (epoch_ns + LINK_DELAY_NS) // 1000 if host else None))
            lines.append(self.gga(epoch_ns, host=host, lat=f"{6325.2 + i * 1e-4:.7f}", lon=lon))
        return "".join(lines)

    def stamps(self, *, start_ns: int = START_NS, frames: int = 100) -> str:
        """Frame stamps as DriveWorks writes them."""
        return "".join(f"{i}\t{(start_ns + i * FRAME_NS) // 1000}\n" for i in range(frames))

    def cvat(self, *elements: str, meta: str = "") -> str:
        """Wrap a CVAT XML 1.1 document around the given elements."""
        head = '<?xml version="1.0" encoding="utf-8"?>\n<annotations><version>1.1</version>'
        return f"{head}<meta>{meta}</meta>{''.join(elements)}</annotations>\n"

    def track(
        self, identifier: int, rows: dict[int, tuple[float, float]], label: str = "362.50", **attributes: str
    ) -> str:
        """Build a track of single points; attributes stand on every row."""
        inner = "".join(f'<attribute name="{k}">{v}</attribute>' for k, v in attributes.items())
        points = "".join(
            f'<points frame="{frame}" outside="0" occluded="0" keyframe="1" points="{x},{y}">{inner}</points>'
            for frame, (x, y) in rows.items()
        )
        return f'<track id="{identifier}" label="{label}">{points}</track>'

    def annotations(self) -> str:
        """Two tracks, one of which ends."""
        ended = '<track id="7" label="202"><points frame="33" outside="1" points="5.0,5.0"/></track>'
        return self.cvat(
            self.track(3, {20: (700.5, 500.5), 23: (720.25, 520.5)}),
            self.track(5, {30: (400.0, 450.0)}, label="206"),
            ended,
        )

    def files(self, **changes: str | None) -> dict[str, str]:
        """Build a DriveWorks trip with one annotated camera; None leaves a file out."""
        files: dict[str, str | None] = {
            "car.json": json.dumps(self.rig()),
            "gnss50_vehicle.bin": self.nmea(lon="01024.0005000"),
            "gnss52_vehicle.bin": self.nmea(),
            f"{WIDE}.h264.timestamps": self.stamps(),
            f"{WIDE}.xml": self.annotations(),
        }
        return {name: text for name, text in (files | changes).items() if text is not None}

    def write(self, folder: Path, files: dict[str, str]) -> Path:
        """Write the files, byte for byte."""
        for name, text in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text.encode())
        return folder


@pytest.fixture(scope="session")
def maker() -> Maker:
    """Return the maker of drive files."""
    return Maker()


@pytest.fixture(scope="session")
def networks() -> Networks:
    """The maker of networks."""
    return Networks()


@pytest.fixture(scope="session")
def board_drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[BoardDrive, Path]:
    """The drive past two boards and its folder; do not write into it."""
    drive = BoardDrive()
    return drive, drive.write(tmp_path_factory.mktemp("boards") / "drive")


@pytest.fixture(scope="session")
def approach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound drive; copy it before damaging it."""
    drive = tmp_path_factory.mktemp("approach") / "drive"
    simulate(drive, name="approach", seed=1)
    return drive


@pytest.fixture
def drive(approach: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    return Path(shutil.copytree(approach, tmp_path / "drive"))
