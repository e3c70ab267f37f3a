"""``drive.toml``."""

from __future__ import annotations

import itertools
from contextlib import suppress

import pytest

from twin.drives.folder.drive_toml import DriveSettings, read_settings
from twin.errors import DriveError

EVERYTHING = """
name = "E6 Okstad"
rig = "rig.json"
annotations_complete = true
datum = "ITRF2020"
camera_offset_ms = -16.5
pitch_positive = "nose_up"
[gnss]
files = {"gnss50:vehicle" = "gnss50.nmea"}
lever_arms = {"gnss50:vehicle" = [1, 0.5, 1.6]}
[timestamps]
C3 = "C3.timestamps"
[annotations]
C3 = "C3.xml"
C1 = ["a.xml", "b.xml"]
[errors]
boresight_deg = 0.1
time_ms = 20
"""


def test_settings_read_every_key() -> None:
    """Each key ends up in its field, milliseconds as nanoseconds."""
    assert read_settings(EVERYTHING.encode()) == DriveSettings(
        name="E6 Okstad",
        rig="rig.json",
        annotations_complete=True,
        datum="ITRF2020",
        camera_offset_ns=-16_500_000,
        pitch_nose_up=True,
        gnss={"gnss50:vehicle": "gnss50.nmea"},
        lever_arms_m={"gnss50:vehicle": (1.0, 0.5, 1.6)},
        poses=None,
        timestamps={"C3": "C3.timestamps"},
        annotations={"C3": ("C3.xml",), "C1": ("a.xml", "b.xml")},
        errors={"boresight_deg": 0.1, "time_ms": 20.0},
    )


def test_settings_default_to_an_incomplete_euref89_drive() -> None:
    """An empty file says nothing: no sign can be missing, and the folder is searched."""
    assert read_settings(b"") == DriveSettings()
    assert DriveSettings().annotations_complete is False
    assert DriveSettings().datum == "EUREF89"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("annotation_complete = true", "annotation_complete: the nearest known one is annotations_complete"),
        ("[gnss]\nfile = {}", r"\[gnss\] file: the nearest known one is \[gnss\] files"),
        ("[poses]\nfiles = 'p.csv'", r"\[poses\] files: the nearest known one is \[poses\] file"),
        ('datum = "WGS84"', 'datum = .WGS84.*"EUREF89".*"ITRF2014" or "ITRF2020".*WGS84 alone does not say'),
        ("datum = ['EUREF89']", "datum = .*it must be"),
        ("annotations_complete = 1", "true or false"),
        ('camera_offset_ms = "5"', "camera_offset_ms = '5': it must be a number"),
        ("camera_offset_ms = nan", "a number"),
        ("camera_offset_ms = true", "a number"),
        ('pitch_positive = "up"', '"nose_down" or "nose_up"'),
        ("rig = 5", "rig = 5: it must be a text"),
        ('name = " "', "a text"),
        ('gnss = "gnss.nmea"', "gnss = 'gnss.nmea': it must be a table"),
        ("[gnss]\nfiles = {a = 5}", r"gnss\.files\.a = 5"),
        ("[gnss]\nlever_arms = {a = [1, 2]}", r"gnss\.lever_arms\.a"),
        ("[gnss]\nlever_arms = {a = [1, 2, inf]}", r"gnss\.lever_arms\.a"),
        ("[gnss]\nlever_arms = {a = [1100, 500, 1600]}", "in metres"),
        ("[timestamps]\nC3 = ''", r"timestamps\.C3"),
        ("[annotations]\nC3 = []", r"annotations\.C3"),
        ("[gnss]\nfiles = {a = 'a.nmea'}\n[poses]\nfile = 'p.csv'", "both GNSS files and the pose file"),
        ("[errors]\nboresigth_deg = 0.1", r"\[errors\] boresigth_deg: the nearest .* boresight_deg"),
        ("[errors]\nboresight_deg = 0", r"errors\.boresight_deg = 0.0: it must be one sigma, .* to 30"),
        ("[errors]\ncamera_position_m = 500", r"errors\.camera_position_m = 500.0"),
        ("[errors]\ntime_ms = 'good'", r"errors\.time_ms = 'good': it must be a number"),
        (
            "[poses]\nsigma_heading_deg = -1",
            r"poses\.sigma_heading_deg = -1.0: it must be one sigma",
        ),
        ("name = 1 2", "not valid TOML .*line 1"),
    ],
)
def test_settings_that_are_wrong_are_refused_with_key_and_cure(text: str, message: str) -> None:
    """The error names drive.toml, the key, and what it must be."""
    with pytest.raises(DriveError, match=message) as caught:
        read_settings(text.encode())
    assert "drive.toml" in str(caught.value)


def test_settings_of_another_type_raise_nothing_but_drive_errors() -> None:
    """Whatever value a key has: settings or a DriveError."""
    keys = ["name", "rig", "gnss", "gnss.files", "poses.file", "timestamps.C", "annotations", "x.y"]
    values = ["1", "''", "'a'", "[]", "[1]", "{}", "{a=1}", "true", "nan", "1979-05-27", "[[]]", "{''='b'}"]
    for key, value in itertools.product(keys, values):
        with suppress(DriveError):
            assert isinstance(read_settings(f"{key} = {value}".encode()), DriveSettings)
