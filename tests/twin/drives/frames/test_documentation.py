"""The example of docs/frames.md."""

from __future__ import annotations

import re

import pytest
from checkout import ROOT

from twin.drives.folder.drive_toml import FrameSettings, read_settings

PAGE = ROOT / "docs" / "frames.md"


def test_documented_frames_read() -> None:
    """Every key of the page's [frames], spelt right: 07:59:59.123 UTC is 1781078399.123 s."""
    if not PAGE.exists():
        pytest.skip("docs are not beside the tests")
    found = re.search(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert found
    assert read_settings(found[1].encode()).frames == {
        "rear": FrameSettings("rear/"),
        "front": FrameSettings("front.mp4", start_ns=1_781_078_399_123_000_000),
        "left": FrameSettings("left/", utc_offset_hours=2.0),
    }
