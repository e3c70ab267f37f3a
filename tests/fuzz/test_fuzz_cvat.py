"""CVAT XML, damaged."""

from __future__ import annotations

import math

from mutate import fuzzed, mutated, real_files

from twin.drives.annotations.formats.cvat import is_cvat, read_cvat
from twin.errors import DriveError

SOUND = b"""<?xml version="1.0" encoding="utf-8"?>
<annotations><version>1.1</version><meta><task><id>1</id><name>C3</name><source>C3.mp4</source>
<original_size><width>1280</width><height>800</height></original_size></task></meta>
<track id="3" label="362.50"><points frame="20" outside="0" points="700.5,500.5">
<attribute name="skiltnummer">362.50</attribute></points><points frame="21" outside="1" points="5,5"/></track>
<track id="4" label="s"><skeleton frame="1" points="1,1;2,2"/><track id="0" label="top"/>
<track id="1" label="foot"><points frame="1" outside="0" points="2,2"/></track></track>
<image id="0" name="C3_000040.png" width="1280" height="800">
<skeleton label="s"><points label="top" points="1,1"/>
<points label="foot" outside="0" points="2,2"/></skeleton>
<polygon label="p" points="1,1;9,4;5,5"/>
<box label="202" xtl="10" ytl="20" xbr="30" ybr="60" rotation="10.5"/><points label="x" points="3,4"/></image>
</annotations>"""


@fuzzed(mutated([SOUND, *real_files("annotations/cvat", ".xml")]))
def test_cvat_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """Whatever the bytes: a DriveError, or shapes with finite pixels."""
    is_cvat(content[:4096])
    try:
        file = read_cvat(content, "a.xml")
    except DriveError:
        return
    assert all(math.isfinite(value) for shape in file.shapes for value in shape.pixel_px)
