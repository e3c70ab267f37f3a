"""The pages' own files: whole, and referring to nobody else."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

import twin.annotate
import twin.live
import twin.review
import twin.web
from twin.export.appearance import DRIVE_COLOUR, ESTIMATE_COLOUR, MARKS, NVDB_COLOUR
from twin.words.table import table

PAGE = Path(twin.review.__file__).parent / "static"
ANNOTATE = Path(twin.annotate.__file__).parent / "static"
LIVE = Path(twin.live.__file__).parent / "page"
SHARED = Path(twin.web.__file__).parent / "static"
VENDOR = SHARED / "vendor"
OWN_FILES = sorted(
    path
    for folder in (PAGE, ANNOTATE, LIVE, SHARED)
    for path in folder.iterdir()
    if path.is_file() and path.suffix != ".png"
)
NAMESPACE = "http://www.w3.org/2000/svg"


def test_vendored_files_are_those_that_were_looked_at() -> None:
    """Each file beside a list of SHA-256 has the one written there, and none is unlisted."""
    lists = list(VENDOR.glob("*/VENDORED.txt"))
    assert lists
    for listing in lists:
        told = dict(re.findall(r"^([0-9a-f]{64})  (\S+)$", listing.read_text("utf-8"), re.MULTILINE))
        found = {path.name for path in listing.parent.iterdir()} - {listing.name}
        assert set(told.values()) == found
        for sha256, name in told.items():
            assert hashlib.sha256((listing.parent / name).read_bytes()).hexdigest() == sha256, name


@pytest.mark.parametrize("path", OWN_FILES, ids=lambda path: path.name)
def test_no_file_of_the_page_refers_to_an_outside_host(path: Path) -> None:
    """Nor does any hold script or style that the page's policy would forbid."""
    text = path.read_text("utf-8").replace(NAMESPACE, "")
    assert not re.findall(r"(?:https?:)?//[a-z0-9-]+\.[a-z]", text)
    if path.suffix == ".html":
        assert not re.search(r"\son\w+=|\sstyle=|<style|<script(?![^>]*src=)", text)


def test_verdicts_look_as_in_every_other_output() -> None:
    """Colours and shapes are those of twin/export/appearance.py."""
    text = (SHARED / "marks.js").read_text("utf-8")
    marks = re.findall(r'(\w+): \{ colour: "(#\w{6})", shape: "(.)" \}', text)
    assert marks == [(mark.verdict, mark.colour, mark.mpl_marker) for mark in MARKS]
    for name, colour in (("SEEN", ESTIMATE_COLOUR), ("NVDB", NVDB_COLOUR), ("DRIVE", DRIVE_COLOUR)):
        assert f'{name}_COLOUR = "{colour}"' in text


@pytest.mark.parametrize("page", ["page", "annotate", "live"])
def test_every_text_that_a_page_asks_for_is_in_the_table(page: str) -> None:
    """And the table holds none that it does not; keys that are put together are known by their beginning."""
    source = "\n".join(path.read_text("utf-8") for path in OWN_FILES)
    asked = set(re.findall(rf'"({page}\.[a-z.-]+)"', source))
    families = set(re.findall(rf"`({page}\.[^`$]+)\$", source))
    families |= {f"page.{one}." for one in re.findall(r'sayOf\(["`]([a-z-]+)', source)}
    known = {key for key in table() if key.startswith(f"{page}.")}
    assert asked <= known
    unasked = {key for key in known - asked if not key.startswith(tuple(families))}
    assert not unasked
