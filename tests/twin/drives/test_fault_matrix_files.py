"""Fault after fault of names, links, encodings and bombs in a drive folder, as ``test_fault_matrix``."""

from __future__ import annotations

import os
import struct
import unicodedata
import zlib
from pathlib import Path
from typing import NamedTuple

import pytest
from command_line import Twin
from drive_damage import (
    CAMERA,
    GNSS,
    MARKS,
    SETTINGS,
    STAMPS,
    Damage,
    added,
    both,
    edited,
    encoded,
    linked,
    moved,
    put,
    stamped_by,
    without,
)

NFC, NFD = (unicodedata.normalize(form, "Ålesund.timestamps") for form in ("NFC", "NFD"))
LAUGHS = (
    '<!DOCTYPE a [<!ENTITY a0 "ha">'
    + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    + "]><annotations><version>1.1</version><meta>&a11;</meta></annotations>"
)
OUTSIDE = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]><annotations>&x;</annotations>'
REFERENCES = "a0: &a0 [1, 1, 1, 1]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)
CAMERA_CHAIN = f"{REFERENCES}cam0:\n  camera_model: pinhole\n  resolution: [1920, 1208]\n"
CAMERA_CHAIN += "  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n  intrinsics: *a11\n"
CHAINED = added(f'[cameras.{CAMERA}]\nintrinsics = "cam.yaml"')
MANY_DIGITS = '{"rig": {"sensors": [], "x": ' + "9" * 100_000 + "}}"
ONE_LABEL = put("labels/330.txt", "0 0.5 0.5 0.1 0.1\n")
_HEADER = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
GIANT = b"\x89PNG\r\n\x1a\n\0\0\0\r" + _HEADER + struct.pack(">I", zlib.crc32(_HEADER))
"""The first bytes of a picture of 3.6 thousand million pixels."""
OUT = "lies outside the drive folder"


class Refused(NamedTuple):
    """One row: what is damaged, and the words of the refusal."""

    name: str
    damage: Damage
    said: str


class Read(NamedTuple):
    """One row: what is unusual, how many annotations are located, how many are left out and why."""

    name: str
    damage: Damage
    n_located: int = 66
    said: str = ""
    count: int = 0


REFUSED = (
    # Names and links
    Refused("up_and_out", stamped_by("../../etc/hosts"), OUT),
    Refused("absolute", stamped_by("/etc/hosts"), OUT),
    Refused("gnss_out", added('[gnss]\nfiles = {"gnss50:vehicle" = "../../etc/hosts"}'), OUT),
    Refused("absolute_on_windows", stamped_by("C:\\\\x\\\\y"), OUT),
    Refused("link_out", linked(STAMPS, "/etc/hosts"), OUT),
    Refused("link_to_itself", linked(STAMPS, STAMPS), "cannot be followed to a file"),
    Refused("name_too_long", stamped_by("a" * 256), "is no file name that twin can keep"),
    Refused("name_with_nul", stamped_by("a\\u0000b"), "is no file name that twin can keep"),
    Refused("name_not_utf_8", put(os.fsdecode(b"\xff\xfe.xml"), "x"), "rename the file"),
    Refused("pipe", both(lambda drive: os.mkfifo(drive / "pipe"), stamped_by("pipe")), "pipe is not in the"),
    # Encodings
    Refused(
        "latin_1", both(edited(MARKS, "skilt", "på", 0), encoded(MARKS, "latin-1")), "not well-formed XML"
    ),
    Refused("blank_line_before_xml", edited(MARKS, r"\A", "\n"), "not well-formed XML"),
    Refused("gnss_utf_16", both(*(encoded(name, "utf-16") for name in GNSS)), "76 × not an NMEA sentence"),
    Refused("rig_utf_16", encoded("rig.json", "utf-16"), "rig.json is not JSON"),
    # Files that grow when they are read
    Refused("billion_laughs", put(MARKS, LAUGHS), f"{MARKS} declares a document type or entities"),
    Refused("entity_of_another_file", put(MARKS, OUTSIDE), f"{MARKS} declares a document type or entities"),
    Refused("entity_in_a_found_file", put("signs.xml", OUTSIDE), "signs.xml declares a document type"),
    Refused("elements_in_elements", put(MARKS, "<annotations>" + "<a>" * 50_000), "not well-formed XML"),
    Refused("lists_in_lists", put("rig.json", "[" * 200_000), "rig.json is not JSON"),
    Refused("lists_in_annotations", put("signs.json", '{"images":' + "[" * 200_000), "nested too deeply"),
    Refused("lists_in_settings", put(SETTINGS, "a = " + "[" * 100_000), f"{SETTINGS} is not valid TOML"),
    Refused("digits_without_end", put("rig.json", MANY_DIGITS), "rig.json is not JSON"),
    Refused("references_in_calibration", both(put("cam.yaml", CAMERA_CHAIN), CHAINED), "gives intrinsics as"),
    Refused(
        "references_in_classes",
        both(ONE_LABEL, put("labels/data.yaml", REFERENCES + "names: *a9\n")),
        "it has references",
    ),
    Refused(
        "giant_mask",
        both(put("mask.png", GIANT), added(f'[cameras.{CAMERA}]\nmask = "mask.png"')),
        "mask.png",
    ),
    # Calibration
    Refused(
        "giant_camera", edited("rig.json", r'"width": "\d+"', '"width": "1000000000"', 0), "at most 100000"
    ),
    Refused("rig_absent", without("rig.json"), "Add the rig file of the car"),
    Refused("calibration_absent", CHAINED, "cam.yaml is not in the drive folder"),
    Refused(
        "antennas_exchanged",
        both(moved(GNSS[0], "x"), moved(GNSS[1], GNSS[0]), moved("x", GNSS[1])),
        "driving backwards",
    ),
)

READ = (
    Read("utf_16", both(edited(MARKS, 'encoding="utf-8"', 'encoding="utf-16"'), encoded(MARKS, "utf-16"))),
    Read("byte_order_mark", both(*(encoded(name, "utf-8-sig") for name in (MARKS, "rig.json", SETTINGS)))),
    Read("accents_written_in_another_way", both(moved(STAMPS, NFD), stamped_by(NFC))),
    Read("link_to_the_folder_itself", linked("front", ".")),
    Read("pipe_beside", lambda drive: os.mkfifo(drive / "pipe.xml")),
    Read(
        "names_differ_in_case_only",
        lambda drive: put(MARKS.upper(), (drive / MARKS).read_bytes())(drive),
        66,
        "again",
        22,
    ),
)


@pytest.mark.parametrize("row", REFUSED, ids=lambda row: row.name)
def test_fault_of_a_file_is_refused_by_both_commands(row: Refused, drive: Path, twin: Twin) -> None:
    """Exit code 4, one line that says what and where, and no store is made."""
    row.damage(drive)
    store = drive.parent / "twin.db"
    answer = twin("ingest-drive", drive, "--store", store, "--json")
    assert answer.code == 4, answer.err
    assert row.said in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not store.exists()
    looked = twin("inspect", drive, "--json")
    assert looked.code == 4
    assert any(row.said in refusal for refusal in looked.json["refusals"])


@pytest.mark.parametrize("row", READ, ids=lambda row: row.name)
def test_unusual_file_is_read_or_counted(row: Read, drive: Path, twin: Twin) -> None:
    """What only looks wrong costs nothing, and what is there twice counts once."""
    row.damage(drive)
    arguments = ["--method", "single-frame", "--store", drive.parent / "twin.db", "--json"]
    report = twin("ingest-drive", drive, *arguments).json
    assert report["n_located"] == row.n_located
    counts = {why: n for why, n in report["skipped"].items() if "outliers" not in why}
    assert sum(counts.values()) == row.count
    assert all(row.said in why for why in counts)
    looked = twin("inspect", drive, "--json").json
    assert looked["ready"]
    assert sum(one["count"] for one in looked["skipped"]) == row.count
