"""Tiny networks, made here node by node, and a drive past two bright boards."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Networks:
    """Makes ONNX files."""

    def save(
        self,
        path: Path,
        nodes: Sequence[tuple[str, Sequence[str], str, dict[str, Any]]],
        constants: dict[str, Array],
        shape: Sequence[int | str],
        names: str = "",
    ) -> Path:
        """Write a network of nodes (operation, inputs, output, attributes); the last one's output is its."""
        from onnx import TensorProto, helper, numpy_helper

        last = nodes[-1][2]
        graph = helper.make_graph(
            [helper.make_node(kind, list(inputs), [out], **more) for kind, inputs, out, more in nodes],
            "tiny",
            [helper.make_tensor_value_info("images", TensorProto.FLOAT, list(shape))],
            [helper.make_tensor_value_info(last, TensorProto.FLOAT, ["a", "b", "c"])],
            [numpy_helper.from_array(value, name) for name, value in constants.items()],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        if names:
            helper.set_model_props(model, {"stride": "8", "names": names})
        path.write_bytes(model.SerializeToString())
        return path

    def constant(
        self, path: Path, output: Array, names: str = "", shape: Sequence[int | str] = (1, 3, 64, 96)
    ) -> Path:
        """A network that always answers the same."""
        nodes: list[tuple[str, Sequence[str], str, dict[str, Any]]] = [
            ("ReduceMean", ["images"], "mean", {"axes": [1, 2, 3], "keepdims": 0}),
            ("Mul", ["mean", "zero"], "nothing", {}),
            ("Add", ["answer", "nothing"], "output0", {}),
        ]
        constants = {"answer": output.astype(np.float32), "zero": np.zeros(1, np.float32)}
        return self.save(path, nodes, constants, shape, names)

    def grid(self, path: Path, side: int = 64, stride: int = 8) -> Path:
        """A YOLOv8 head of one class: a box on each cell of a grid, its score how red the cell is."""
        cells = side // stride
        weight = np.zeros((5, 3, stride, stride), np.float32)
        weight[4, 0], weight[4, 1] = 1 / stride**2, -1 / stride**2
        middle = (np.arange(cells, dtype=np.float32) + 0.5) * stride
        place = np.zeros((1, 5, cells, cells), np.float32)
        place[0, 0], place[0, 1] = middle[None, :], middle[:, None]
        constants: dict[str, Array] = {
            "weight": weight,
            "bias": np.array([0, 0, stride, stride, 0], np.float32),
            "place": place,
            "form": np.array([1, 5, -1]),
        }
        nodes: list[tuple[str, Sequence[str], str, dict[str, Any]]] = [
            (
                "Conv",
                ["images", "weight", "bias"],
                "cells",
                {"kernel_shape": [stride] * 2, "strides": [stride] * 2},
            ),
            ("Add", ["cells", "place"], "placed", {}),
            ("Reshape", ["placed", "form"], "output0", {}),
        ]
        return self.save(path, nodes, constants, (1, 3, side, side), "{0: 'red board'}")

    def boards(self, path: Path, side: int = 640) -> Path:
        """Boxes around all that is red (class 0) and all that is blue (class 1): the form (1, 2, 6)."""
        ramp = np.arange(side, dtype=np.float32)
        constants: dict[str, Array] = {
            "colour": np.array([[1, -1, 0], [0, -1, 1]], np.float32).reshape(2, 3, 1, 1),
            "bias": np.full(2, -0.4, np.float32),
            "sharp": np.array([100.0], np.float32),
            "side": np.array([side], np.float32),
            "from_left": (side - ramp).reshape(1, 1, -1),
            "to_right": (ramp + 1.0).reshape(1, 1, -1),
            "classes": np.array([0.0, 1.0], np.float32).reshape(1, 2, 1),
        }
        nodes: list[tuple[str, Sequence[str], str, dict[str, Any]]] = [
            ("Conv", ["images", "colour", "bias"], "strength", {"kernel_shape": [1, 1]}),
            ("Mul", ["strength", "sharp"], "sharpened", {}),
            ("Sigmoid", ["sharpened"], "mask", {}),
            ("ReduceMax", ["mask"], "columns", {"axes": [2], "keepdims": 0}),
            ("ReduceMax", ["mask"], "rows", {"axes": [3], "keepdims": 0}),
            ("ReduceMax", ["columns"], "score", {"axes": [2], "keepdims": 1}),
        ]
        for axis in ("columns", "rows"):
            nodes += [
                ("Mul", [axis, "from_left"], f"{axis} first", {}),
                ("ReduceMax", [f"{axis} first"], f"{axis} reach", {"axes": [2], "keepdims": 1}),
                ("Sub", ["side", f"{axis} reach"], f"{axis} low", {}),
                ("Mul", [axis, "to_right"], f"{axis} last", {}),
                ("ReduceMax", [f"{axis} last"], f"{axis} high", {"axes": [2], "keepdims": 1}),
            ]
        parts = ["columns low", "rows low", "columns high", "rows high", "score", "classes"]
        nodes.append(("Concat", parts, "output0", {"axis": 2}))
        return self.save(path, nodes, constants, (1, 3, side, side), "{0: '362.50', 1: 'blue board'}")


START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * 1_000_000_000
ORIGIN = (63.42, 10.40, 80.0)
WIDTH, HEIGHT, FOCAL_PX = 640, 400, 500.0
FORWARD_M, UP_M = 1.8, 1.4
SPEED_MPS, RATE_HZ = 10.0, 15
BOARD_M = 0.6
RED, BLUE = (255, 0, 0), (0, 0, 255)


@dataclass(frozen=True)
class BoardDrive:
    """A car that drives due north past two boards beside a flat road, seen by one level pinhole camera."""

    boards: tuple[tuple[tuple[int, int, int], float, float, float], ...] = (
        (RED, 4.0, 42.0, 2.2),
        (BLUE, -5.0, 46.0, 2.6),
    )
    """Colour; metres east, north and up of the start."""
    n_frames: int = 56
    reflection_at: int = 3
    """Frame in which a red reflection shows up elsewhere, where no board is near yet."""
    hidden: tuple[int, int] = (0, 0)
    """First frame, and the one after the last, in which a lorry hides all boards."""

    def picture(self, frame: int) -> NDArray[np.uint8]:
        """What the camera sees: axis-parallel boards, since it looks straight at them."""
        image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        for colour, east, north, up in self.boards:
            ahead = north - SPEED_MPS * frame / RATE_HZ - FORWARD_M
            if not 4.0 < ahead < 30.0 or self.hidden[0] <= frame < self.hidden[1]:
                continue
            middle = np.array([east, UP_M - up]) / ahead * FOCAL_PX + [WIDTH / 2, HEIGHT / 2]
            half = BOARD_M / 2 / ahead * FOCAL_PX
            (left, top), (right, bottom) = (
                np.round(middle - half).astype(int),
                np.round(middle + half).astype(int),
            )
            image[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = colour
        return image

    def poses(self) -> str:
        """Full poses at 10 Hz from a second before the first frame on."""
        from pyproj import Geod

        rows = ["time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"]
        for i in range(-10, 60):
            north = SPEED_MPS * i / 10
            azimuth = 0.0 if north >= 0 else 180.0
            longitude, latitude, _ = Geod(ellps="GRS80").fwd(ORIGIN[1], ORIGIN[0], azimuth, abs(north))
            rows.append(
                f"{START_NS + i * 100_000_000},{latitude:.10f},{longitude:.10f},{ORIGIN[2]:.4f},0,0,0"
            )
        return "\n".join(rows) + "\n"

    def write(self, folder: Path) -> Path:
        """Write video, poses, rig and settings."""
        sensor = {
            "name": "front",
            "protocol": "camera.virtual",
            "properties": {
                "Model": "pinhole",
                "width": str(WIDTH),
                "height": str(HEIGHT),
                "fx": str(FOCAL_PX),
                "fy": str(FOCAL_PX),
                "cx": str((WIDTH - 1) / 2),
                "cy": str((HEIGHT - 1) / 2),
            },
            "nominalSensor2Rig_FLU": {"roll-pitch-yaw": [0.0, 0.0, 0.0], "t": [FORWARD_M, 0.0, UP_M]},
        }
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "rig.json").write_text(json.dumps({"version": 7, "rig": {"sensors": [sensor]}}))
        (folder / "poses.csv").write_text(self.poses())
        start = "2026-06-10T08:00:00Z"
        (folder / "drive.toml").write_text(
            'rig = "rig.json"\nrolling_shutter_ms = 0.0\n[poses]\nfile = "poses.csv"\n'
            f'[frames.front]\nfile = "front.mp4"\nstart = "{start}"\n'
        )
        (folder / "front.mp4").write_bytes(b"")
        self.encode(folder / "front.mp4")
        return folder

    def encode(self, path: Path) -> None:
        """Write the video, and the reflection in one of its frames."""
        import av

        with av.open(str(path), "w") as container:
            stream: Any = container.add_stream(
                "libx264", rate=RATE_HZ, options={"crf": "12", "preset": "veryfast"}
            )
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            stream.codec_context.time_base = Fraction(1, RATE_HZ)
            for i in range(self.n_frames):
                image = self.picture(i)
                if i == self.reflection_at:
                    image[300:330, 100:130] = RED
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
                frame.pts, frame.time_base = i, Fraction(1, RATE_HZ)
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
