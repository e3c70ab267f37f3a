"""The documentation's own example is a drive that works."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from checkout import ROOT

from geoloc.rig.rig import rig_from_document
from twin.drives.folder.drive_toml import read_settings
from twin.drives.track.formats.poses_csv import read_poses
from twin.errors import DriveError

PAGE = ROOT / "docs" / "drive-folder.md"


def block(kind: str) -> str:
    """The first code block of a kind on the page."""
    if not PAGE.exists():
        pytest.skip("docs are not beside the tests")
    found = re.search(rf"```{kind}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert found
    return found[1]


def test_documented_settings_read() -> None:
    """The page's drive.toml has every key, spelt right (either recordings or poses, so one table goes)."""
    text = re.sub(r"\[poses\].*?\n(?=\[timestamps\])", "", block("toml"), flags=re.DOTALL)
    settings = read_settings(text.encode())
    assert settings.annotations_complete
    assert settings.lever_arms_m["right"] == (0.9, -0.55, 1.6)


def test_documented_rig_reads_and_looks_ahead_and_down() -> None:
    """The page's rig is a pinhole that looks ahead and 2.5 degrees down, as the page says of its pitch."""
    rig = rig_from_document(json.loads(block("json")), "rig.json")
    camera = rig.camera("front")
    axis = camera.rig_R_camera @ np.array([0.0, 0.0, 1.0])
    assert axis[0] > 0.99
    assert np.degrees(np.arcsin(axis[2])) == pytest.approx(-2.5)
    assert camera.model.model == "pinhole"


def test_poses_in_descending_time_are_named_as_that() -> None:
    """A file sorted the wrong way round is told to be sorted."""
    header = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n"
    rows = [f"{1_780_000_000_000_000_000 - i * 10**8},63.4,10.4,50,0,0,90\n" for i in range(20)]
    with pytest.raises(DriveError, match="not in order of time"):
        read_poses((header + "".join(rows)).encode(), "poses.csv")


def test_poses_separated_by_semicolons_are_named_as_that() -> None:
    """A Norwegian spreadsheet writes semicolons: the message says so."""
    with pytest.raises(DriveError, match="semicolons"):
        read_poses(b"time_ns;latitude_deg;longitude_deg\n1;2;3\n", "poses.csv")
