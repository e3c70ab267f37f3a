"""Small videos and images, encoded here."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from twin.drives.drive import Drive
from twin.drives.read import read_drive

SIZE = (64, 48)


class Movies:
    """Makes videos whose frame i is grey level 8 * i, so that a picture tells its number."""

    def video(
        self,
        times_ms: Sequence[int],
        form: str = "mp4",
        codec: str = "libx264",
        tags: dict[str, str] | None = None,
        **options: str,
    ) -> bytes:
        """Encode one frame at each time."""
        import av

        file = io.BytesIO()
        with av.open(file, "w", format=form) as container:
            container.metadata.update(tags or {})
            stream: Any = container.add_stream(codec, rate=30, options={"crf": "1", **options})
            stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
            stream.codec_context.time_base = Fraction(1, 1000)
            for i, time_ms in enumerate(times_ms):
                frame = av.VideoFrame.from_ndarray(self.image(i), format="rgb24")
                frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return file.getvalue()

    def image(self, number: int) -> NDArray[np.uint8]:
        """Picture of a frame."""
        return np.full((SIZE[1], SIZE[0], 3), 8 * number, dtype=np.uint8)

    def number(self, image: NDArray[np.uint8]) -> int:
        """Frame number that a picture shows."""
        return round(float(image.mean()) / 8)

    def jpeg(
        self,
        size: tuple[int, int] = SIZE,
        exif: dict[int, Any] | None = None,
        ifd: dict[int, Any] | None = None,
        form: str = "JPEG",
        mode: str = "RGB",
    ) -> bytes:
        """Encode one image, its left half white, with EXIF tags."""
        from PIL import Image

        image = Image.new("RGB", size)
        image.paste((255, 255, 255), (0, 0, size[0] // 2, size[1]))
        tags = Image.Exif()
        tags.update(exif or {})
        if ifd:
            tags.get_ifd(0x8769).update(ifd)
        file = io.BytesIO()
        image.convert(mode).save(file, form, exif=tags)
        return file.getvalue()


@pytest.fixture(scope="session")
def movies() -> Movies:
    """The maker of videos and images."""
    return Movies()


START_NS = 1_781_078_400_000_000_000
"""2026-06-10 08:00:00 UTC."""


class SmallDrive:
    """A folder with a rig of one camera, poses for ten seconds, and pictures that each test adds."""

    def __init__(self, root: Path, movies: Movies) -> None:
        self.root, self.movies, self.start_ns = root, movies, START_NS
        properties = {"Model": "pinhole", "width": "64", "height": "48", "fx": "60", "fy": "60"}
        properties |= {"cx": "31.5", "cy": "23.5"}
        mounted = {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [1.8, 0.0, 1.4]}
        sensor = {"name": "front", "protocol": "camera.virtual", "properties": properties}
        sensors = [sensor | {"nominalSensor2Rig_FLU": mounted}]
        self.add("rig.json", json.dumps({"version": 7, "rig": {"sensors": sensors}}))
        rows = [
            f"{START_NS + i * 100_000_000},{63.42 + i * 1e-5:.7f},10.4,80.0,0,0,0" for i in range(-10, 100)
        ]
        header = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"
        self.add("poses.csv", "\n".join([header, *rows]) + "\n")
        self.settings("")

    def add(self, name: str, content: str | bytes) -> None:
        """Write one file."""
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    def settings(self, text: str, top: str = "") -> None:
        """Write ``drive.toml``: what every drive has, and `text` at its end."""
        self.add("drive.toml", f'rig = "rig.json"\n{top}\n[poses]\nfile = "poses.csv"\n{text}\n')

    def annotate_video(self, *frames: int) -> None:
        """Mark a foot in these frames of a video task."""
        points = "".join(
            f'<points frame="{frame}" outside="0" occluded="0" keyframe="1" points="40.0,40.0"/>'
            for frame in frames
        )
        self._cvat(f'<track id="1" label="362.50">{points}</track>')

    def annotate_images(self, *names: str) -> None:
        """Mark a foot in these images of an image task."""
        self._cvat(
            "".join(
                f'<image id="{i}" name="{name}" width="64" height="48"><points label="362.50"'
                ' points="40.0,40.0"/></image>'
                for i, name in enumerate(names)
            )
        )

    def _cvat(self, inner: str) -> None:
        self.add("front.xml", f"<annotations><version>1.1</version><meta/>{inner}</annotations>")

    def stamps(self, count: int, first: int = 0) -> None:
        """Write the recorder's stamps, ten a second."""
        lines = (f"{first + i}\t{(START_NS + i * 100_000_000) // 1000}\n" for i in range(count))
        self.add("front.timestamps", "".join(lines))

    def read(self, **options: Any) -> Drive:
        """Read it."""
        return read_drive(self.root, **options)

    def seconds(self, drive: Drive) -> list[float]:
        """Stamps of the camera's frames, from the start; None where there is none."""
        return [round((int(t) - START_NS) / 1e9, 6) for t in drive.frame_epoch_ns["front"]]


@pytest.fixture
def small(tmp_path: Path, movies: Movies) -> SmallDrive:
    """A drive without pictures yet."""
    return SmallDrive(tmp_path / "drive", movies)
