"""Fault after fault of a drive's recordings: what ``twin ingest-drive`` and ``twin inspect`` say of each.

The drive is a simulated approach to one sign: 15 s, two antennas at 5 Hz, three cameras. Names, files and
bombs are in ``test_fault_matrix_files``.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
from pathlib import Path
from typing import NamedTuple

import pytest
import sqlalchemy as sa
from command_line import Twin
from drive_damage import (
    CAMERA,
    GNSS,
    MARKS,
    SETTINGS,
    STAMPS,
    Damage,
    both,
    edited,
    encoded,
    field,
    filmed,
    fixes,
    fixes_later,
    frames_later,
    frozen,
    hosts_later,
    photographed,
    put,
    video,
    without,
)

from twin.cli import run
from twin.ingest.ingest import ingest_drive
from twin.store.store import Store

N_FRAMES = 384
SOUND_VIDEO = video([33 * i for i in range(N_FRAMES)])
DAY_S = 86_400
FROZEN = "position repeated while the car drove"
MARK = r'<points frame="3\d\d"[^>]*points="[^"]*"'


class Fault(NamedTuple):
    """One row: what is damaged and what is said; `code` 4 is a refusal, `count` how much is left out."""

    name: str
    damage: Damage
    code: int
    said: str
    count: int | None = None
    inspected: str = ""
    """What ``inspect`` says instead; "" where it says the same."""


def _marked(text: str) -> Damage:
    return edited(MARKS, MARK, text)


def _face(left: int, top: int, right: int, bottom: int) -> Damage:
    corners = f'xtl="{left}" ytl="{top}" xbr="{right}" ybr="{bottom}"'
    box = f'<track id="9" label="202"><box frame="330" outside="0" {corners}/></track></annotations>'
    return edited(MARKS, "</annotations>", box)


def _another_rig(drive: Path) -> None:
    put("other.json", (drive / "rig.json").read_text().replace("1.47", "1.57"))(drive)


FAULTS = (
    # Positions
    Fault("nan", field(2, "nan", last=5), 0, "position unreadable", 10),
    Fault("infinite", field(9, "inf", last=5), 0, "height absurd", 10),
    Fault("null_island", field(2, "0000.0", "N", "00000.0", "E", last=7), 0, "null island", 14),
    Fault("quality_0", field(6, "0", last=9), 0, "fix quality 0", 18),
    Fault("quality_0_always", field(6, "0"), 4, "75 × fix quality 0"),
    Fault("jump", field(2, "6330.0000000", first=40, last=42), 0, "reached only faster than 70 m/s", 4),
    Fault("swapped_axes", field(2, "1027.0", "N", "06324.5", "E"), 4, "latitude and longitude are swapped"),
    Fault("frozen_then_on", frozen(GNSS, 20, 40), 0, FROZEN, 38),
    Fault("frozen_one", frozen(GNSS[:1], 20, 40), 0, FROZEN, 19),
    Fault("frozen_one_to_the_end", frozen(GNSS[:1], 20, 100), 0, FROZEN, 54),
    Fault("frozen_to_the_end", frozen(GNSS, 20, 100), 4, "lies outside the GNSS fixes"),
    Fault("frozen_always", frozen(GNSS, 0, 100), 0, "the receiver was frozen"),
    Fault(
        "gap", fixes(lambda n, f, h: None if 55 <= n < 66 else (f, h)), 0, "inside a gap", 54, '"n_gaps": 1'
    ),
    Fault("datum_unclear", edited(SETTINGS, "EUREF89", "WGS84"), 4, "WGS84 alone does not say which"),
    # Clocks
    Fault("duplicate_epochs", fixes_later(-0.2, first=20, last=25), 0, "epoch not after the fix before", 2),
    Fault("backwards", fixes_later(-3, first=20, last=25), 0, "epoch not after the fix before", 10),
    Fault("gps_time_in_sentences", fixes_later(18), 4, "off by 18 s, as GPS time is from UTC"),
    Fault("gps_time_of_host", hosts_later(18), 0, "18 s would be GPS time"),
    Fault("gps_time_of_frames", frames_later(18), 4, "give camera_offset_ms = -18000"),
    Fault("local_time_in_sentences", fixes_later(7200), 4, "off by 2 h, as local time can be"),
    Fault(
        "local_time_of_host", both(hosts_later(7200), frames_later(7200)), 4, "camera_offset_ms = -7200000"
    ),
    Fault("local_time_of_frames", frames_later(-3600), 4, "give camera_offset_ms = 3600000"),
    Fault("frames_past_the_fixes", frames_later(3), 0, "54 of 66 annotations lie outside the GNSS fixes"),
    Fault("another_day", hosts_later(DAY_S), 4, "Bring files of one drive together"),
    Fault("one_antenna_of_another_day", hosts_later(DAY_S, GNSS[1:]), 4, "begins 24.0 h after that of"),
    Fault("stamps_empty", put(STAMPS, ""), 4, f"{STAMPS} holds no usable time stamp"),
    Fault("one_recording_empty", put(GNSS[0], ""), 0, "read without one antenna"),
    Fault("recordings_empty", both(put(GNSS[0], ""), put(GNSS[1], "")), 4, "holds no usable GNSS fix"),
    # Videos and images
    Fault("video_empty", filmed(b"", stamps=False), 4, "C3.mp4 is empty"),
    Fault("video_cut", filmed(SOUND_VIDEO[: len(SOUND_VIDEO) // 2], stamps=False), 4, "no index (moov)"),
    Fault("video_noise", filmed(bytes(range(256)) * 40, stamps=False), 4, "is not a video that can be read"),
    Fault("video_noise_with_stamps", filmed(b"noise" * 99, stamps=True), 0, "frames are not counted against"),
    Fault("video_without_frames", filmed(video([]), stamps=False), 4, "C3.mp4"),
    Fault("frames_lost", filmed(video(range(0, 9900, 33)), stamps=True), 4, "C3.mp4 holds 300 frames"),
    Fault("frames_too_many", filmed(video(range(385)), stamps=True), 0, "no stamp for the last frames", 1),
    Fault(
        "frame_rate_halved",
        filmed(video([66 * i for i in range(N_FRAMES)]), stamps=False),
        0,
        "All 22 annotations of C3_tricam120 lie outside the GNSS fixes",
    ),
    Fault("images_lost", photographed(range(340, 384)), 0, "frame of C3_tricam120 without a time stamp", 13),
    Fault("image_renamed", photographed(thumbnail=b""), 0, "no time in name or EXIF", 1),
    Fault(
        "image_twice",
        photographed(b_1781078406000000=b"", c_1781078406000000=b""),
        0,
        "stamp not later than that of the frame before",
        2,
    ),
    # Annotations
    Fault("frame_absent", edited(MARKS, 'frame="315"', 'frame="9999"'), 0, "without a time stamp", 1),
    Fault("frame_negative", edited(MARKS, 'frame="315"', 'frame="-5"'), 0, "frame number unreadable", 1),
    Fault("point_outside", _marked('<points frame="315" points="-500,300"'), 0, "outside the image", 1),
    Fault("point_nan", _marked('<points frame="315" points="nan,4"'), 0, "coordinates not finite", 1),
    Fault("box_negative", _face(300, 300, 200, 200), 0, "box without area", 1),
    Fault("box_oversized", _face(-300, 100, 9000, 2000), 0, "outside the image", 1),
    Fault("class_unknown", edited(MARKS, "362.50", "", 0), 0, "No sign code for the labels skilt (22)"),
    Fault("utf_16_that_says_utf_8", encoded(MARKS, "utf-16"), 4, f"{MARKS} is not well-formed XML"),
    Fault("latin_1_that_says_utf_8", put(SETTINGS, 'name = "Skrå"'.encode("latin-1")), 4, "save it as UTF-8"),
    Fault("annotations_empty", put(MARKS, b""), 0, f"{MARKS} is empty or no XML"),
    # The folder as a whole
    Fault("two_rigs", _another_rig, 4, "other.json and rig.json are two different rigs"),
    Fault(
        "no_gnss",
        both(*(without(name) for name in GNSS)),
        4,
        "no GNSS recording (rig.json names gnss50",
    ),
    Fault("no_timestamps", without(STAMPS), 4, f"annotated frames of {CAMERA} have no time"),
    Fault("model_unknown", edited("rig.json", '"ftheta"', '"hyperbolic"', 0), 4, "hyperbolic"),
    Fault("camera_not_in_rig", edited("rig.json", CAMERA, "C9", 0), 4, CAMERA),
    Fault(
        "other_resolution",
        both(edited("rig.json", r'"1920"', '"960"', 0), edited("rig.json", r'"1208"', '"604"', 0)),
        4,
        "1920 x 1208 pixels, but C1_front60Single has 960 x 604",
    ),
    Fault("setting_misspelt", put(SETTINGS, "anotations_complete = true\n"), 4, "anotations_complete"),
)


@pytest.fixture(scope="session")
def kept(approach: Path) -> Path:
    """A store with the sound drive."""
    path = approach.parent / "twin.db"
    arguments = ["ingest-drive", str(approach), "--method", "single-frame", "--store", str(path), "--json"]
    assert run(arguments) == 0
    return path


@pytest.fixture
def store(kept: Path, tmp_path: Path) -> Path:
    """A copy of that store."""
    return Path(shutil.copy(kept, tmp_path / "twin.db"))


def contents(store: Path) -> list[str]:
    """Everything in a store, as SQL."""
    connection = sqlite3.connect(store)
    try:
        return list(connection.iterdump())
    finally:
        connection.close()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_fault_of_a_recording_is_said_by_both_commands(
    fault: Fault, drive: Path, store: Path, twin: Twin
) -> None:
    """What, where and how much, in the same words; a refused drive leaves the store as it was."""
    before = contents(store)
    fault.damage(drive)
    answer = twin("ingest-drive", drive, "--method", "single-frame", "--store", store, "--json")
    assert answer.code == fault.code, answer.err
    looked = twin("inspect", drive, "--json")
    assert looked.code == fault.code
    assert looked.json["ready"] is (fault.code == 0)
    if fault.code:
        assert fault.said in answer.err
        assert len(answer.err.strip().splitlines()) == 1
        assert any(fault.said in refusal for refusal in looked.json["refusals"])
        assert contents(store) == before
        return
    told = "\n".join([*answer.json["warnings"], *answer.json["skipped"]])
    assert fault.said in told
    assert (fault.inspected or fault.said) in json.dumps(looked.json, ensure_ascii=False)
    if fault.count is not None:
        assert sum(n for why, n in answer.json["skipped"].items() if fault.said in why) == fault.count
        if not fault.inspected:
            skipped = looked.json["skipped"]
            assert sum(one["count"] for one in skipped if fault.said in one["reason"]) == fault.count


def test_sound_drive_is_told_without_a_word(drive: Path, store: Path, twin: Twin) -> None:
    """What the faults are measured against: no warning, nothing left out but one outlier."""
    answer = twin("ingest-drive", drive, "--method", "single-frame", "--store", store, "--json")
    assert (answer.json["warnings"], answer.json["n_located"]) == ([], 66)
    assert not [why for why in answer.json["skipped"] if "outliers" not in why]
    looked = twin("inspect", drive, "--json").json
    assert (looked["warnings"], looked["skipped"], looked["refusals"]) == ([], [], [])


def test_frames_of_a_variable_rate_are_timed_one_by_one(drive: Path, store: Path) -> None:
    """Frames up to 6 ms early or late by the container's own times: every annotation is located."""
    filmed(video([33 * i + i % 7 for i in range(N_FRAMES)]), stamps=False)(drive)
    with Store.open(store) as opened:
        report = ingest_drive(opened, drive, method="single-frame")
    assert (report.n_located, report.warnings) == (66, ())


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.parametrize("statement", [1, 3, 6])
def test_ingest_that_is_killed_leaves_the_store_and_can_be_run_again(
    statement: int, drive: Path, store: Path
) -> None:
    """SIGKILL at any SQL statement: the old drive stays whole, and the next run replaces it."""
    field(6, "0", last=9)(drive)
    before = contents(store)
    child = os.fork()
    if child == 0:
        _ingest_and_die(drive, store, statement)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    assert contents(store) == before
    reports = []
    for path in (store, store.with_name("clean.db")):
        with Store.open(path) as opened:
            reports.append(ingest_drive(opened, drive, method="single-frame"))
    assert reports[0] == reports[1]
    assert contents(store) != before


def _ingest_and_die(drive: Path, store: Path, statement: int) -> None:
    """End this process at one of the statements that write."""
    left = [statement]

    def count(_connection: object, _cursor: object, text: str, *_more: object) -> None:
        left[0] -= text.startswith(("INSERT", "DELETE", "UPDATE"))
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)

    try:
        sa.event.listen(sa.Engine, "before_cursor_execute", count)
        with Store.open(store) as opened:
            ingest_drive(opened, drive, method="single-frame")
    finally:
        os._exit(0)
