"""`twin init` on the command line: what it takes without a terminal, and what stands already."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from command_line import Twin
from small_camera import gps9_packet, write_video

NS = 1_000_000_000
START_NS = 1_781_078_400 * NS


def test_without_a_terminal_it_asks_nothing_and_says_what_it_took(twin: Twin, tmp_path: Path) -> None:
    """The file is written once; options count, the rest is assumed and told; a second run leaves it alone."""
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = [(START_NS + k * NS // 10, (63.41 + k * 9e-6, 10.45, 60.0)) for k in range(30)]
    data = [(1000 * s, gps9_packet(rows[10 * s : 10 * s + 10])) for s in range(3)]
    stamps = START_NS + np.arange(90, dtype=np.int64) * NS // 30
    write_video(folder / "GX010001.MP4", stamps, START_NS, data=data)
    told = twin("init", folder, "--height", "1.2")
    assert told.code == 0, told.err
    assert "Taken without asking: lens gopro hero9-12 wide; clock known to 0.3 s" in " ".join(
        told.err.split()
    )
    assert "No annotations yet. Next: twin annotate" in told.err
    written = tomllib.loads((folder / "drive.toml").read_text())
    assert written["cameras"]["gx010001"]["position"] == [1.5, 0.0, 1.2]
    assert written["gnss"]["files"] == {"receiver": "GX010001.MP4"}
    before = (folder / "drive.toml").read_bytes()
    again = twin("init", folder)
    assert again.code == 5
    assert "stays as it is" in again.err
    assert (folder / "drive.toml").read_bytes() == before
