"""The documentation's own examples work."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from checkout import code_block

from geoloc.rig.rig import rig_from_document
from twin.drives.annotations.labels import Meaning, read_label_map
from twin.drives.folder.drive_toml import FrameSettings, read_settings

PAGE = "drive-folder.md"


def test_documented_settings_read() -> None:
    """The page's drive.toml has every key, spelt right (either recordings or poses, so one table goes)."""
    text = re.sub(r"\[poses\].*?\n(?=\[timestamps\])", "", code_block(PAGE, "toml"), flags=re.DOTALL)
    settings = read_settings(text.encode())
    assert settings.annotations_complete
    assert settings.lever_arms_m["right"] == (0.9, -0.55, 1.6)


def test_documented_rig_reads_and_looks_ahead_and_down() -> None:
    """The page's rig is a pinhole that looks ahead and 2.5 degrees down, as the page says of its pitch."""
    rig = rig_from_document(json.loads(code_block(PAGE, "json")), "rig.json")
    camera = rig.camera("front")
    axis = camera.rig_R_camera @ np.array([0.0, 0.0, 1.0])
    assert axis[0] > 0.99
    assert np.degrees(np.arcsin(axis[2])) == pytest.approx(-2.5)
    assert camera.model.model == "pinhole"


def test_documented_frames_read() -> None:
    """Every key of the page's [frames], spelt right: 07:59:59.123 UTC is 1781078399.123 s."""
    assert read_settings(code_block("frames.md", "toml").encode()).frames == {
        "rear": FrameSettings("rear/"),
        "front": FrameSettings("front.mp4", start_ns=1_781_078_399_123_000_000),
        "left": FrameSettings("left/", utc_offset_hours=2.0),
        "right": FrameSettings("right/", numbered=True),
    }


def test_documented_labels_are_read() -> None:
    """The page's labels.toml works as the page says."""
    labels = read_label_map(code_block("labels.md", "toml").encode())
    assert labels.of("speed_50") == Meaning("362.50")
    assert labels.of("guard rail end") == Meaning(nvdb_type=14)
